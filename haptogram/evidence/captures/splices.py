"""Samples that an analyser lost: the clock of the carrier goes on, and jumps in the file."""

from __future__ import annotations

import dataclasses
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from .capture import Capture

_Floats: TypeAlias = NDArray[np.float64]
_AROUND: Final = 8  # pulses on both sides that must agree on the jump: one alone is a disturbance
_FEWEST: Final = 3  # least pulses on both sides of a jump
_SAMPLES: Final = 2.5  # tolerance of two edges and the fit of a period
_LEAST: Final = 0.01  # tolerated jitter of the clock, in periods
_LONGEST: Final = 2.5  # periods without a pulse: a longer pause is that of a clock that stops


def capture_to_first_splice(capture: Capture, rises: _Floats, sample: float) -> Capture:
    """Return *capture* up to where samples are missing; as it is if the clock never jumps.

    The times after a jump are off by an unknown amount.

    Parameters
    ----------
    capture : Capture
        The capture.
    rises : (P,) numpy.ndarray
        Ticks at which the clock of the carrier rises.
    sample : float
        Ticks of a sample.
    """
    at = _first_jump_in_capture(rises, sample)
    if at is None:
        return capture
    why = (
        f"samples are missing at {at * capture.tick_s * 1e3:.3f} ms, where the clock of the "
        "carrier jumps: capture at a lower rate, fewer channels, or with another cable"
    )
    return dataclasses.replace(capture.until(int(at)), cut=why)


def _first_jump_in_capture(rises: _Floats, sample: float) -> float | None:
    """Return the tick of the pulse after which the phase jumps for good; None if never."""
    steps = np.diff(rises)
    if len(steps) < 2 * _AROUND:
        return None
    period = float(np.median(steps))
    limit = max(_SAMPLES * sample, _LEAST * period)
    off = np.abs(steps - np.rint(steps / period) * period) > limit
    for place in np.flatnonzero(off & (steps < _LONGEST * period)).tolist():
        before = rises[max(0, place - _AROUND + 1) : place + 1]
        after = rises[place + 1 : place + 1 + _AROUND]
        if min(len(before), len(after)) < _FEWEST:
            continue
        phases = [np.exp(2j * np.pi * (times - rises[place]) / period) for times in (before, after)]
        jump = np.angle(np.median(phases[1].real) + 1j * np.median(phases[1].imag)) - np.angle(
            np.median(phases[0].real) + 1j * np.median(phases[0].imag)
        )
        if abs((jump + np.pi) % (2.0 * np.pi) - np.pi) > 2.0 * np.pi * limit / period:
            return float(rises[place])
    return None
