"""From a phasor to the sound at a microphone: its oscillation, and its RMS value."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from haptogram.acoustics.arrays import FloatArray, as_float_array, as_phasor_array
from haptogram.acoustics.memory import check_array_memory
from haptogram.settings.arguments import check_positive


def rms_pressure(pressure_peak: ArrayLike) -> FloatArray:
    """Return |p| / sqrt(2), in the shape and unit of complex peak pressures *pressure_peak*.

    Examples
    --------
    >>> rms_pressure([100.0 + 100.0j]).round(1).tolist()
    [100.0]
    """
    result: FloatArray = np.abs(as_phasor_array("pressure_peak", pressure_peak)) / math.sqrt(2.0)
    return result


def instantaneous_pressure(
    pressure_peak: ArrayLike, frequency_hz: float, times_s: ArrayLike
) -> FloatArray:
    """Return Re p e^{-j 2 pi f t}, the pressure at given times.

    Parameters
    ----------
    pressure_peak : (...) array_like of complex
        Peak phasors, as engines return them.
    frequency_hz : float
        Carrier frequency f.
    times_s : (T,) array_like
        Times t, in seconds.

    Returns
    -------
    (..., T) numpy.ndarray
        In the unit of *pressure_peak*.

    Raises
    ------
    ConfigurationError
        A value that is no number or not finite, a frequency that is not above 0, or a result of
        more than half of the memory.

    Examples
    --------
    >>> instantaneous_pressure([100.0], 40e3, [0.0, 12.5e-6]).round(1).tolist()
    [[100.0, -100.0]]
    """
    phasors = as_phasor_array("pressure_peak", pressure_peak)
    times = np.atleast_1d(as_float_array("times_s", times_s))
    check_array_memory("a waveform", (*phasors.shape, *times.shape), 32)
    turns = check_positive("frequency_hz", frequency_hz) * times
    result: FloatArray = (phasors[..., None] * np.exp(-2j * np.pi * (turns - np.rint(turns)))).real
    return result
