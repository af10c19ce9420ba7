"""What makes a focus felt: a focus that stands still at constant pressure soon is not.

Amplitude modulation varies the strength, lateral modulation shakes the focus, spatio-temporal
modulation runs it along a closed path, dwell holds one point after the other.  Each is sampled to
frames at the rate of the loop, and the radiation pressure that they make at a point has a spectrum.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from haptogram.acoustics import AcousticModel, FieldEngine, focus_phases, radiation_pressure_pa
from haptogram.acoustics.dynamics import Resonator
from haptogram.errors import ConfigurationError

FloatArray: TypeAlias = NDArray[np.float64]
ComplexArray: TypeAlias = NDArray[np.complex128]

DEFAULT_MODULATION_HZ: Final = 200.0  # skin feels vibration best around 200 Hz
DEFAULT_LATERAL_M: Final = 3e-3
MAX_FRAMES: Final = 1_000_000


@dataclass(frozen=True, eq=False, slots=True)
class FocusFrames:
    """A focus sampled in time: one frame after the other, each held for 1 / rate.

    Attributes
    ----------
    points_m : (F, 3) numpy.ndarray
        Focus of each frame.
    amplitudes : (F,) numpy.ndarray
        Amplitude of each frame, 0 to 1, linear in pressure.
    rate_hz : float
        Frames per second.
    """

    points_m: FloatArray
    amplitudes: FloatArray
    rate_hz: float

    def weights(self, model: AcousticModel) -> ComplexArray:
        """Return the (F, N) weights that the frames ask for."""
        phases = focus_phases(model, self.points_m)
        weights: ComplexArray = self.amplitudes[:, None] * np.exp(1j * phases)
        return weights


def amplitude_modulation(
    point_m: ArrayLike,
    *,
    frequency_hz: float = DEFAULT_MODULATION_HZ,
    depth: float = 1.0,
    duration_s: float,
    rate_hz: float,
) -> FocusFrames:
    """Return a standing focus whose radiation pressure varies as a sine.

    The force goes with the square of the amplitude, A = sqrt((1 + m cos) / (1 + m)): a sine in the
    force has no overtones, a sine in the amplitude would have one at twice the frequency.

    Parameters
    ----------
    depth : float
        m, 0 to 1: 1 swings between nothing and full force.

    Raises
    ------
    ConfigurationError
        A depth outside 0 to 1, a frequency above half the rate, or frames out of range.
    """
    if not 0.0 <= depth <= 1.0:
        raise ConfigurationError(f"depth is {depth:g}, must be 0 to 1")
    time_s = _frame_times(frequency_hz, duration_s, rate_hz)
    force = (1.0 + depth * np.cos(2.0 * np.pi * frequency_hz * time_s)) / (1.0 + depth)
    points = np.tile(_as_point(point_m), (len(time_s), 1))
    return FocusFrames(points, np.sqrt(np.maximum(force, 0.0)), rate_hz)


def lateral_modulation(
    point_m: ArrayLike,
    *,
    frequency_hz: float = DEFAULT_MODULATION_HZ,
    shift_m: float = DEFAULT_LATERAL_M,
    direction: ArrayLike = (1.0, 0.0, 0.0),
    duration_s: float,
    rate_hz: float,
) -> FocusFrames:
    """Return a focus that swings by *shift_m* to both sides of a point, at full amplitude.

    The force at the point itself varies at twice the frequency; skin beside it feels the frequency.

    Raises
    ------
    ConfigurationError
        A direction of no length, a shift outside 0 to 100 mm, a frequency above half the rate, or
        frames out of range.
    """
    along = _as_point(direction)
    length = float(np.linalg.norm(along))
    if not length > 0.0 or not 0.0 <= shift_m <= 0.1:
        raise ConfigurationError(
            f"direction has length {length:g} and shift_m is {shift_m:g}, "
            "must be above 0 and 0 to 0.1"
        )
    time_s = _frame_times(frequency_hz, duration_s, rate_hz)
    swing = shift_m * np.cos(2.0 * np.pi * frequency_hz * time_s)
    points = _as_point(point_m) + swing[:, None] * (along / length)
    return FocusFrames(points, np.ones(len(time_s)), rate_hz)


def spatio_temporal_modulation(
    path_m: ArrayLike,
    *,
    frequency_hz: float,
    duration_s: float,
    rate_hz: float,
) -> FocusFrames:
    """Return a focus that runs along a closed path at constant speed.

    Parameters
    ----------
    path_m : (K, 3) array_like
        Corners of the path; the last is joined to the first.
    frequency_hz : float
        Rounds per second.

    Raises
    ------
    ConfigurationError
        Fewer than two points, a path of no length, a frequency above half the rate, or frames out
        of range.
    """
    corners = np.asarray(path_m, dtype=np.float64)
    if corners.ndim != 2 or corners.shape[1:] != (3,) or len(corners) < 2:
        raise ConfigurationError(f"path_m has shape {corners.shape}, must be (K, 3), K at least 2")
    closed = np.vstack([corners, corners[:1]])
    lengths = np.linalg.norm(np.diff(closed, axis=0), axis=1)
    travelled = np.concatenate([[0.0], np.cumsum(lengths)])
    if not (math.isfinite(travelled[-1]) and travelled[-1] > 0.0):
        raise ConfigurationError(f"the path is {travelled[-1]:g} m long, must be above 0")
    time_s = _frame_times(frequency_hz, duration_s, rate_hz)
    place = np.mod(frequency_hz * time_s, 1.0) * travelled[-1]
    points = np.stack([np.interp(place, travelled, closed[:, axis]) for axis in range(3)], axis=1)
    return FocusFrames(points, np.ones(len(time_s)), rate_hz)


def dwell(points_m: ArrayLike, *, dwell_s: float, rate_hz: float) -> FocusFrames:
    """Return each point held for *dwell_s*, rounded to whole frames, at full amplitude.

    Raises
    ------
    ConfigurationError
        Points that are not (K, 3), a dwell shorter than half a frame, or frames out of range.
    """
    points = np.asarray(points_m, dtype=np.float64)
    if points.ndim != 2 or points.shape[1:] != (3,) or not len(points):
        raise ConfigurationError(f"points_m has shape {points.shape}, must be (K, 3)")
    _check_above("rate_hz", rate_hz)
    frames = round(_check_above("dwell_s", dwell_s) * rate_hz)
    if not 1 <= frames * len(points) <= MAX_FRAMES:
        raise ConfigurationError(
            f"{len(points)} points of {dwell_s * rate_hz:g} frames, "
            f"must be 1 to {MAX_FRAMES} frames in all"
        )
    held = np.repeat(points, frames, axis=0)
    return FocusFrames(held, np.ones(len(held)), rate_hz)


@dataclass(frozen=True, eq=False, slots=True)
class FocusSignal:
    """Radiation pressure on a reflecting wall at a point, and its spectrum.

    Attributes
    ----------
    time_s, pressure_pa : (T,) numpy.ndarray
        The last pass, sampled evenly.
    frequency_hz, amplitude_pa : (K,) numpy.ndarray
        One-sided amplitude spectrum; the value at 0 Hz is the mean.
    """

    time_s: FloatArray
    pressure_pa: FloatArray
    frequency_hz: FloatArray
    amplitude_pa: FloatArray


def signal_at(
    engine: FieldEngine,
    frames: FocusFrames,
    point_m: ArrayLike,
    resonator: Resonator | None = None,
    samples_per_frame: int = 16,
) -> FocusSignal:
    """Return what repeated frames make at a point, in time and in frequency.

    Parameters
    ----------
    engine : FieldEngine
        What computes the field.
    point_m : (3,) array_like
        Where: on the skin, say.
    resonator : Resonator, optional
        Envelope of the transducers, in the steady state of the repetition; without it frames switch
        at once.  Travel times are left out.
    samples_per_frame : int
        Samples per frame; they resolve the build-up within one.
    """
    settled = engine.pressure(frames.weights(engine.model), [_as_point(point_m)])[:, 0]
    follow = resonator or Resonator(0.0)
    frame_s = 1.0 / frames.rate_hz
    # The field is linear in the drives, so its envelope is theirs; from rest, the state after one
    # pass falls short of the periodic one by the factor 1 - e^{-T/tau}.
    first = follow.envelope(settled, frame_s, 1)[-1]
    start = first / (1.0 - follow.decay(frame_s * len(settled)))
    field = follow.envelope(settled, frame_s, samples_per_frame, start)
    pressure = radiation_pressure_pa(field, engine.model.medium)
    step_s = frame_s / samples_per_frame
    time_s = np.arange(1, len(pressure) + 1, dtype=np.float64) * step_s
    frequency_hz = np.asarray(np.fft.rfftfreq(len(pressure), step_s), dtype=np.float64)
    spectrum: FloatArray = np.abs(np.fft.rfft(pressure)) / len(pressure)
    spectrum[1 : (len(pressure) + 1) // 2] *= 2.0
    return FocusSignal(time_s, pressure, frequency_hz, spectrum)


def _frame_times(frequency_hz: float, duration_s: float, rate_hz: float) -> FloatArray:
    """Return the starts of the frames of a duration, or raise."""
    _check_above("frequency_hz", frequency_hz)
    _check_above("rate_hz", rate_hz)
    if frequency_hz > rate_hz / 2.0:
        raise ConfigurationError(
            f"frequency_hz is {frequency_hz:g}, must be at most half of {rate_hz:g} frames a second"
        )
    count = round(_check_above("duration_s", duration_s) * rate_hz)
    if not 1 <= count <= MAX_FRAMES:
        raise ConfigurationError(f"{count} frames, must be 1 to {MAX_FRAMES}")
    return np.arange(count) / rate_hz


def _check_above(name: str, value: float) -> float:
    if not (math.isfinite(value) and value > 0.0):
        raise ConfigurationError(f"{name} is {value:g}, must be finite and above 0")
    return value


def _as_point(values: ArrayLike) -> FloatArray:
    point = np.asarray(values, dtype=np.float64)
    if point.shape != (3,) or not np.isfinite(point).all():
        raise ConfigurationError(f"{values!r} is not a point of three finite numbers")
    return point
