"""The radiation pressure of frames at a point in time, and its spectrum."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from haptogram.acoustics import FieldEngine, focus_phases, radiation_pressure_pa
from haptogram.acoustics.arrays import ComplexArray, FloatArray, as_coordinates
from haptogram.acoustics.levels.dynamics import Resonator
from haptogram.objects.modulation import FocusFrames

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
        """Return the amplitudes (Pa) of the spectral lines, 0 for the mean and rounding noise."""
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
    """Return the pressure (F,) at a point in each frame's steady state."""
    foci, which = np.unique(frames.points_m, axis=0, return_inverse=True)
    parts = [
        engine.pressure(
            np.exp(1j * focus_phases(engine.model, foci[start : start + _FOCI_AT_A_TIME])),
            [point_m],
        )[:, 0]
        for start in range(0, len(foci), _FOCI_AT_A_TIME)
    ]
    settled: ComplexArray = frames.amplitudes * np.concatenate(parts)[which.reshape(-1)]
    return settled
