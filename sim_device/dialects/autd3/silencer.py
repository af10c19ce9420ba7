"""The silencer of a device: phases and intensities move to their targets, period by period.

A value goes the shorter way round its circle (a phase) or straight (an intensity), by a rate for
each channel and period, in 1/256. With *completion steps* a change of d/256 arrives after s
periods: d // s in each of them, and one more in d mod s of them, from the second on; a channel
whose target stays keeps the rate of its last change. A *fixed update rate* is the same for all.

Source: shinolab/autd3-firmware 063eea2, ``silent/step_calculator`` and ``silent/interpolator``;
held beside what ``pyautd3_emulator`` 38.0.1 radiates, period by period. The two differ in one
thing: a phase that has gone round the circle is below 256 again in the HDL, and here; the emulator
counts on, and may go the longer way next.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

_ONE: Final = 256  # of a value that moves by less than one in a period
_CIRCLE: Final = 256 * _ONE
_HALF: Final = _CIRCLE // 2

_Numbers = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Pace:
    """Speed of a silencer; the default is that of power-up.

    Attributes
    ----------
    is_rate : bool
        Whether the numbers are rates in 1/256 per period; otherwise they are completion steps.
    intensity, phase : int
        Of intensities and of phases.
    """

    is_rate: bool = False
    intensity: int = 10
    phase: int = 40


class _SilencerValues:
    """Phases or intensities of all channels, on their way."""

    def __init__(self, count: int, *, round_circle: bool) -> None:
        self._round_circle = round_circle
        self._current: _Numbers = np.zeros(count, np.int64)
        self._target: _Numbers = np.zeros(count, np.int64)
        self._change: _Numbers = np.zeros(count, np.int64)
        self._more: _Numbers = np.zeros(count, np.int64)  # longer steps to come

    @property
    def values(self) -> NDArray[np.uint8]:
        """The values that are out."""
        return (self._current // _ONE).astype(np.uint8)

    def move(self, target: NDArray[np.uint8], periods: int, number: int, *, is_rate: bool) -> None:
        """Move towards *target* for so many periods; *number* is the rate, or the steps."""
        aim: _Numbers = target.astype(np.int64)
        if is_rate:
            travel: _Numbers = np.full(len(aim), periods * number)
            self._target = aim
        else:
            travel = self._travel(aim, periods, max(1, number))
        gap = self._gap()
        self._current += np.sign(gap) * np.minimum(np.abs(gap), travel)
        if self._round_circle:
            self._current %= _CIRCLE

    def periods_left(self, number: int, *, is_rate: bool) -> int | None:
        """Return after how many periods all have arrived; None: some never do."""
        left = np.abs(self._gap())
        if not left.any():
            return 0
        if is_rate:
            return None if number == 0 else int(-(-left.max() // number))
        slow = self._change // max(1, number)
        quick = slow + 1
        in_quick = np.minimum(self._more, -(-left // quick))
        left = np.maximum(0, left - in_quick * quick)
        if (left[slow == 0] > 0).any():
            return None
        return int((in_quick + -(-left // np.maximum(slow, 1))).max())

    def _travel(self, target: _Numbers, periods: int, steps: int) -> _Numbers:
        """Return the remaining distance of each channel, and set its step size."""
        change = np.abs(target - self._target) * _ONE
        if self._round_circle:
            change = np.where(change >= _HALF, _CIRCLE - change, change)
        self._target = target
        is_new = change > 0
        self._change = np.where(is_new, change, self._change)
        slow, more = self._change // steps, np.where(is_new, self._change % steps, self._more)
        longer = np.minimum(more, periods - is_new)
        self._more = more - longer
        travel: _Numbers = slow * periods + longer
        return travel

    def _gap(self) -> _Numbers:
        """Return target minus current value; phases by the shorter way round."""
        gap = self._target * _ONE - self._current
        if self._round_circle:
            gap = np.where(gap < -_HALF, gap + _CIRCLE, np.where(gap > _HALF, gap - _CIRCLE, gap))
        return gap


class Silencer:
    """The silencer of a device with *count* channels, at rest at 0."""

    def __init__(self, count: int) -> None:
        self._phases = _SilencerValues(count, round_circle=True)
        self._intensities = _SilencerValues(count, round_circle=False)

    @property
    def phases(self) -> NDArray[np.uint8]:
        """The phases that are out."""
        return self._phases.values

    @property
    def intensities(self) -> NDArray[np.uint8]:
        """The intensities that are out."""
        return self._intensities.values

    def move(
        self,
        phases: NDArray[np.uint8],
        intensities: NDArray[np.uint8],
        periods: int,
        pace: Pace,
    ) -> None:
        """Let so many periods pass with these targets."""
        self._phases.move(phases, periods, pace.phase, is_rate=pace.is_rate)
        self._intensities.move(intensities, periods, pace.intensity, is_rate=pace.is_rate)

    def periods_left(self, pace: Pace) -> int | None:
        """Return after how many periods everything has arrived; None: some of it never does."""
        left = (
            self._phases.periods_left(pace.phase, is_rate=pace.is_rate),
            self._intensities.periods_left(pace.intensity, is_rate=pace.is_rate),
        )
        return None if None in left else max(n for n in left if n is not None)
