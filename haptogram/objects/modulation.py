"""Modulation of a focus: at a fixed place and constant pressure the skin soon feels nothing.

Amplitude modulation varies the strength, lateral modulation shakes the focus, spatio-temporal
modulation runs it along a closed path, dwell holds one point after the other.  Each is sampled to
frames at the rate of the loop; what they make at a point is their radiation pressure in time.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from haptogram.acoustics import AcousticModel, FieldEngine, focus_phases, radiation_pressure_pa
from haptogram.acoustics.arrays import ComplexArray, FloatArray, as_coordinates, as_point_array
from haptogram.acoustics.levels.dynamics import Resonator
from haptogram.errors import ConfigurationError
from haptogram.settings.arguments import check_number, check_positive, check_whole
from haptogram.settings.frozen import dataclass

KINDS: Final = ("am", "lm", "stm")
_DEFAULT_MODULATION_HZ: Final = 200.0  # skin feels vibration best around 200 Hz
_DEFAULT_SHIFT_M: Final = (3e-3, 0.0, 0.0)
_MAX_SHIFT_M: Final = 0.1
MAX_FRAMES: Final = 200_000

# How far off, in periods, a pass may end, and how many frames it may have: exactly, if that is not
# long, else as well as anybody can feel.
_SEAMS: Final = ((1e-9, 2_000), (1e-3, MAX_FRAMES))


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

    @property
    def count(self) -> int:
        """Number of frames."""
        return len(self.amplitudes)

    @property
    def duration_s(self) -> float:
        """Duration of one pass."""
        return self.count / self.rate_hz

    @property
    def steps_m(self) -> FloatArray:
        """Distance of the focus from each frame to the next, from the last to the first."""
        steps: FloatArray = np.linalg.norm(
            np.roll(self.points_m, -1, axis=0) - self.points_m, axis=1
        )
        return steps

    def repeated(self, times: int) -> FocusFrames:
        """Return the frames of several passes."""
        points = np.tile(self.points_m, (times, 1))
        return FocusFrames(points, np.tile(self.amplitudes, times), self.rate_hz)

    def weights(self, model: AcousticModel) -> ComplexArray:
        """Return the (F, N) weights that the frames ask for."""
        phases = focus_phases(model, self.points_m)
        weights: ComplexArray = self.amplitudes[:, None] * np.exp(1j * phases)
        return weights


@dataclass(frozen=True, slots=True)
class Modulation:
    """Modulation of the points of an object.

    Attributes
    ----------
    kind : str or None
        One of :data:`KINDS`: "am" and "lm" modulate the points one after the other, "stm" runs
        along them; None shows them as they are.
    frequency_hz : float
        Of "am" and "lm"; of "stm" rounds per second.
    depth : float
        Of "am", see :func:`modulate_amplitude`.
    shift_m : (float, float, float)
        Of "lm", see :func:`modulate_place`.
    dwell_s : float or None
        How long each point is held; None: one frame.  Not for "stm", which does not stop.
    """

    kind: str | None = "am"
    frequency_hz: float = _DEFAULT_MODULATION_HZ
    depth: float = 1.0
    shift_m: tuple[float, float, float] = _DEFAULT_SHIFT_M
    dwell_s: float | None = None

    def frames(self, points_m: ArrayLike, rate_hz: float) -> FocusFrames:
        """Return the frames of a pass that can be repeated without a seam.

        It holds whole passes of the points and whole periods; where none of 2000 frames or fewer
        does exactly, the frequency is rounded, by less than a thousandth of a period in the pass.

        Raises
        ------
        ConfigurationError
            As :func:`modulate_amplitude` and its likes; an unknown kind; a pass of more than
            200 000 frames.
        """
        if self.kind not in (None, *KINDS):
            raise ConfigurationError(
                f"modulation is {self.kind!r}, must be one of {', '.join(KINDS)}"
            )
        rate_hz = check_positive("rate_hz", rate_hz)
        if self.kind == "stm":
            return self._along(points_m, rate_hz)
        held_s = 1.0 / rate_hz if self.dwell_s is None else self.dwell_s
        held = dwell_modulation(points_m, dwell_s=held_s, rate_hz=rate_hz)
        if self.kind is None:
            return held
        passes, frequency_hz = self._seamless(held.count, rate_hz)
        frames = held.repeated(passes)
        if self.kind == "am":
            return modulate_amplitude(frames, frequency_hz=frequency_hz, depth=self.depth)
        return modulate_place(frames, frequency_hz=frequency_hz, shift_m=self.shift_m)

    def _along(self, path_m: ArrayLike, rate_hz: float) -> FocusFrames:
        """Return frames that move the focus along a path (spatio-temporal modulation).

        Raises ConfigurationError if a dwell is given: every frame moves on.
        """
        if self.dwell_s is not None:
            raise ConfigurationError(
                f"a dwell of {self.dwell_s * 1e3:g} ms: stm moves on with every frame"
            )
        count, frequency_hz = self._seamless(1, rate_hz)
        return spatio_temporal_modulation(
            path_m, frequency_hz=frequency_hz, duration_s=count / rate_hz, rate_hz=rate_hz
        )

    def _seamless(self, count: int, rate_hz: float) -> tuple[int, float]:
        """Return how often *count* frames repeat until whole periods have passed; the frequency.

        The frequency (Hz) is the one asked for, rounded so that whole periods fit. Raises
        ConfigurationError if that takes more than MAX_FRAMES frames.
        """
        frequency_hz = _check_modulation_frequency(self.frequency_hz, rate_hz)
        most = MAX_FRAMES // count
        passes = np.arange(1, most + 1)
        periods = passes * (count * frequency_hz / rate_hz)
        off = np.where(periods > 0.5, np.abs(periods - np.round(periods)), 1.0)
        for seam, frames in _SEAMS:
            if (found := np.flatnonzero((off < seam) & (passes * count <= frames))).size:
                chosen = int(found[0])
                rounded = round(periods[chosen]) * rate_hz / (count * (chosen + 1))
                return chosen + 1, min(rounded, rate_hz / 2.0)  # the last bit may round up
        raise ConfigurationError(
            f"{count} frames at {rate_hz:g} Hz and a modulation of {frequency_hz:.9g} Hz come "
            f"into step again only after more than {MAX_FRAMES} frames; take a frequency of which "
            "the rate is a multiple, or fewer points"
        )


def modulate_amplitude(
    frames: FocusFrames, *, frequency_hz: float = _DEFAULT_MODULATION_HZ, depth: float = 1.0
) -> FocusFrames:
    """Return the frames with a radiation pressure that varies as a sine.

    The force goes with the square of the amplitude, A = sqrt((1 + m cos) / (1 + m)): a sine in the
    force has no overtones, a sine in the amplitude would have one at twice the frequency.

    Parameters
    ----------
    depth : float
        m, 0 to 1: 1 swings between nothing and full force.

    Raises
    ------
    ConfigurationError
        A depth outside 0 to 1, or a frequency above half the rate.
    """
    depth = check_number("depth", depth, 0.0, 1.0)
    force = (1.0 + depth * np.cos(_modulation_phase_rad(frames, frequency_hz))) / (1.0 + depth)
    amplitudes = frames.amplitudes * np.sqrt(np.maximum(force, 0.0))
    return FocusFrames(frames.points_m, amplitudes, frames.rate_hz)


def modulate_place(
    frames: FocusFrames,
    *,
    frequency_hz: float = _DEFAULT_MODULATION_HZ,
    shift_m: ArrayLike = _DEFAULT_SHIFT_M,
) -> FocusFrames:
    """Return the frames with a focus that swings by *shift_m* (3,) to both sides of its point.

    The force at the point itself varies at twice the frequency; skin beside it feels the frequency.

    Raises
    ------
    ConfigurationError
        A shift of no length or of more than 100 mm, or a frequency above half the rate.
    """
    shift = as_coordinates("shift_m", shift_m)
    length_m = float(np.linalg.norm(shift))
    if not 0.0 < length_m <= _MAX_SHIFT_M:
        raise ConfigurationError(
            f"the shift is {length_m * 1e3:g} mm long, must be above 0, at most "
            f"{_MAX_SHIFT_M * 1e3:g} mm"
        )
    swing = np.cos(_modulation_phase_rad(frames, frequency_hz))[:, None] * shift
    return FocusFrames(frames.points_m + swing, frames.amplitudes, frames.rate_hz)


def spatio_temporal_modulation(
    path_m: ArrayLike,
    *,
    frequency_hz: float,
    duration_s: float,
    rate_hz: float,
) -> FocusFrames:
    """Return a focus that runs along a closed path at constant speed and full amplitude.

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
    corners = as_point_array("path_m", path_m)
    if len(corners) < 2:
        raise ConfigurationError(
            f"number of points on the path is {len(corners)}, must be 2 at least"
        )
    closed = np.vstack([corners, corners[:1]])
    lengths = np.linalg.norm(np.diff(closed, axis=0), axis=1)
    travelled = np.concatenate([[0.0], np.cumsum(lengths)])
    check_positive("length of the path", travelled[-1])
    rate_hz = check_positive("rate_hz", rate_hz)
    frequency_hz = _check_modulation_frequency(frequency_hz, rate_hz)
    count = _whole_modulated_frames(check_positive("duration_s", duration_s) * rate_hz)
    place = np.mod(frequency_hz * (np.arange(count) / rate_hz), 1.0) * travelled[-1]
    points = np.stack([np.interp(place, travelled, closed[:, axis]) for axis in range(3)], axis=1)
    return FocusFrames(points, np.ones(count), rate_hz)


def dwell_modulation(points_m: ArrayLike, *, dwell_s: float, rate_hz: float) -> FocusFrames:
    """Return each point held for *dwell_s*, rounded to whole frames, at full amplitude.

    Raises
    ------
    ConfigurationError
        Points that are not (K, 3), a dwell of half a frame or less, or frames out of range.
    """
    points = as_point_array("points_m", points_m)
    check_whole("number of points", len(points), 1, MAX_FRAMES)
    rate_hz = check_positive("rate_hz", rate_hz)
    frames = check_positive("dwell_s", dwell_s) * rate_hz
    if frames <= 0.5:
        raise ConfigurationError(
            f"a dwell of {dwell_s * 1e3:g} ms is {frames:.3g} frames at {rate_hz:g} Hz, "
            "must be more than half a frame"
        )
    per_point = _whole_modulated_frames(frames)
    _whole_modulated_frames(per_point * len(points))
    held = np.repeat(points, per_point, axis=0)
    return FocusFrames(held, np.ones(len(held)), rate_hz)


def _check_modulation_frequency(frequency_hz: float, rate_hz: float) -> float:
    """Return a modulation's frequency as a float if it is above 0, at most half the rate.

    Raises
    ------
    ConfigurationError
        Names the value and the limit.
    """
    frequency_hz = check_positive("modulation_hz", frequency_hz)
    if frequency_hz > rate_hz / 2.0:
        raise ConfigurationError(
            f"modulation_hz is {frequency_hz:g}, must be at most half of {rate_hz:g} frames a "
            f"second, {rate_hz / 2.0:g}"
        )
    return frequency_hz


def _whole_modulated_frames(frames: float) -> int:
    """Return *frames* rounded; raise ConfigurationError unless that is 1 to MAX_FRAMES."""
    count = round(min(frames, MAX_FRAMES + 1))
    if not 1 <= count <= MAX_FRAMES:
        raise ConfigurationError(f"{frames:.6g} frames, must be 1 to {MAX_FRAMES}")
    return count


def _modulation_phase_rad(frames: FocusFrames, frequency_hz: float) -> FloatArray:
    """Return (F,) the modulation's phase at each frame, from 0 to 2 pi."""
    periods = _check_modulation_frequency(frequency_hz, frames.rate_hz) / frames.rate_hz
    turns = np.arange(frames.count) * periods
    phase: FloatArray = 2.0 * np.pi * np.mod(turns, 1.0)
    return phase


# --- What frames make at a point -----------------------------------------------------------------


_ROUNDING: Final = 1e-12  # rounding noise, relative to the mean
_FOCI_AT_A_TIME: Final = 2048  # foci whose weights are computed at a time: 8 MB over 256 elements


@dataclass(frozen=True, eq=False, slots=True)
class FeltSignal:
    """Radiation pressure on a reflecting wall at a point, and its spectrum.

    Attributes
    ----------
    time_s, pressure_pa : (T,) numpy.ndarray
        One pass, sampled evenly.
    frequency_hz, amplitude_pa : (K,) numpy.ndarray
        One-sided amplitude spectrum; the value at 0 Hz is the mean.
    """

    time_s: FloatArray
    pressure_pa: FloatArray
    frequency_hz: FloatArray
    amplitude_pa: FloatArray

    @property
    def mean_pa(self) -> float:
        """Mean radiation pressure."""
        return float(self.amplitude_pa[0])

    @property
    def swing(self) -> float:
        """(max - min) / (max + min): the depth of the modulation that arrives."""
        low, high = float(self.pressure_pa.min()), float(self.pressure_pa.max())
        return (high - low) / (high + low) if high > 0.0 else 0.0

    @property
    def vibration_rms_pa(self) -> float:
        """RMS of the varying part."""
        return float(self.pressure_pa.std())

    def lines(self, least_share: float, highest_hz: float = math.inf) -> list[tuple[float, float]]:
        """Return (frequency in Hz, amplitude in Pa) of the varying part, in order of frequency.

        Parameters
        ----------
        least_share : float
            Lines below that share of the strongest are left out.
        """
        varying = self._varying_pa
        shown = (varying > least_share * varying.max()) & (self.frequency_hz <= highest_hz)
        return list(
            zip(self.frequency_hz[shown].tolist(), self.amplitude_pa[shown].tolist(), strict=True)
        )

    def share_above(self, frequency_hz: float) -> float:
        """Return which share of the power of the vibration is above a frequency."""
        power = self._varying_pa**2
        whole = float(power.sum())
        return float(power[self.frequency_hz > frequency_hz].sum()) / whole if whole else 0.0

    @property
    def _varying_pa(self) -> FloatArray:
        """Return the amplitudes (Pa) of spectral lines, with 0 for the mean and rounding errors.

        Those are lines up to 1e-12 of the mean.
        """
        heard = self.amplitude_pa > _ROUNDING * self.amplitude_pa[0]
        heard[0] = False
        return np.where(heard, self.amplitude_pa, 0.0)


def felt_signal_at(
    engine: FieldEngine,
    frames: FocusFrames,
    point_m: ArrayLike,
    resonator: Resonator | None = None,
    samples_per_frame: int = 16,
) -> FeltSignal:
    """Return the radiation pressure of repeated frames at a point, in time and in frequency.

    Parameters
    ----------
    engine : FieldEngine
        Engine that computes the field.
    point_m : (3,) array_like
        Where: on the skin, say.
    resonator : Resonator, optional
        Envelope of the transducers, in the steady state of the repetition; without it frames switch
        at once.  Travel times are left out.
    samples_per_frame : int
        Samples per frame; they resolve the build-up within one.
    """
    settled = _settled_felt_signal(engine, frames, as_coordinates("point_m", point_m))
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
    return FeltSignal(time_s, pressure, frequency_hz, spectrum)


def _settled_felt_signal(
    engine: FieldEngine, frames: FocusFrames, point_m: FloatArray
) -> ComplexArray:
    """Return the complex pressure (F,), in Pa, at a point in each frame's steady state."""
    foci, which = np.unique(frames.points_m, axis=0, return_inverse=True)
    parts = [
        engine.pressure(
            np.exp(1j * focus_phases(engine.model, foci[start : start + _FOCI_AT_A_TIME])),
            [point_m],
        )[:, 0]
        for start in range(0, len(foci), _FOCI_AT_A_TIME)
    ]
    return frames.amplitudes * np.concatenate(parts)[which.reshape(-1)]
