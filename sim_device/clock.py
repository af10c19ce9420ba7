"""The board's clock: device microseconds for nanoseconds since power-up, and back.

All in whole numbers, so that both ways agree to the microsecond.
"""

from __future__ import annotations

import bisect
from dataclasses import dataclass
from typing import Final

_MILLION: Final = 1_000_000
NS_PER_US: Final = 1_000


def earliest(*times: int | None) -> int | None:
    """Return the first of *times*; None stands for never."""
    first = None
    for t in times:
        if t is not None and (first is None or t < first):
            first = t
    return first


def whole_us(t_ns: int) -> int:
    """Return *t_ns* rounded up to the microseconds that the board counts in."""
    return -(-t_ns // NS_PER_US) * NS_PER_US


@dataclass(frozen=True, slots=True)
class DeviceClock:
    """A clock that is fast by ``ppm``, and jumps ahead.

    Attributes
    ----------
    boot_us : int
        Unwrapped device time at power-up.
    ppm : int
        Error of its rate, above -1 000 000.
    step_us : int
        By how much it jumps ahead, 0 or more: the board's time never runs backwards.
    step_at_us : int
        Time of its own, since power-up, at which it jumps.
    step_every : bool
        Whether it jumps again whenever that time has passed.
    """

    boot_us: int
    ppm: int = 0
    step_us: int = 0
    step_at_us: int = 1
    step_every: bool = False

    def device_us(self, t_ns: int) -> int:
        """Return the unwrapped device time at *t_ns*: whole microseconds that have passed."""
        run_us = t_ns * (_MILLION + self.ppm) // (_MILLION * NS_PER_US)
        return self.boot_us + self._shown_us(run_us)

    def reached_ns(self, device_us: int) -> int:
        """Return the first time at which the clock shows *device_us* or more."""
        run_us = device_us - self.boot_us
        if self.step_us and run_us > 0:  # it never falls: the first moment is found by halving
            run_us = bisect.bisect_left(range(run_us), run_us, key=self._shown_us)
        return -(-run_us * _MILLION * NS_PER_US // (_MILLION + self.ppm))

    def _shown_us(self, run_us: int) -> int:
        return run_us + self._jumps(run_us) * self.step_us

    def _jumps(self, run_us: int) -> int:
        jumps = max(0, run_us) // self.step_at_us
        return jumps if self.step_every else min(jumps, 1)
