"""Deadlines, the rules for missed ones, and what a real-time loop asks of its process."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import sys
from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

_PR_SET_TIMERSLACK: Final = 29  # linux/prctl.h
_PR_GET_TIMERSLACK: Final = 30


def next_deadline_ns(*, deadline_ns: int, now_ns: int, period_ns: int) -> int:
    """Return the first deadline after *now_ns* on the original grid.

    Missed ticks are skipped, never bunched, and the phase of the grid is kept::

        0         1         2         3         4
        *---------o-*-------o---------O---------*----> time
        T0          T1 late           T2,T3 missed   T4
    """
    late_ns = max(0, now_ns - deadline_ns)
    return deadline_ns + period_ns * (late_ns // period_ns + 1)


def can_arrive(*, now_ns: int, line_free_ns: int, transmission_ns: int, due_ns: int) -> bool:
    """Tell whether a frame that would be sent now is complete at the board before it is due.

    The rule of the stream for missed ticks: a frame that can still make it is sent at once, behind
    what the line is busy with; one that cannot is skipped, so that it delays no other::

        deadline  now      line free       arrival   due
        *---------|--------|===============*---------|----> time     sent
        *---------|--------|===============|=====*--------> time     skipped
                                           due
    """
    return max(now_ns, line_free_ns) + transmission_ns <= due_ns


class LoopStats:
    """How late a loop was at every tick, in memory that was there before the first.

    Parameters
    ----------
    ticks : int
        How many ticks there will be, at most.
    """

    def __init__(self, ticks: int) -> None:
        self._lateness_ns = np.zeros(ticks, dtype=np.int64)
        self.count = 0

    def record(self, lateness_ns: int) -> None:
        """Take the lateness of the next tick, negative if it came early."""
        self._lateness_ns[self.count] = lateness_ns
        self.count += 1

    def lateness_us(self) -> NDArray[np.float64]:
        """Return the (n,) lateness of the ticks so far, in microseconds."""
        lateness: NDArray[np.float64] = self._lateness_ns[: self.count] / 1e3
        return lateness


@contextlib.contextmanager
def real_time() -> Iterator[None]:
    """Keep the garbage collector out, and let timers end when they should, while inside.

    A collection of a large program takes 10 to 100 ms; the kernel groups wake-ups within 50 us
    (the slack of a timer) unless it is told not to.
    """
    collected = gc.isenabled()
    slack_ns = _timer_slack_ns()
    gc.disable()
    _set_timer_slack(1)
    try:
        yield
    finally:
        _set_timer_slack(slack_ns)
        if collected:
            gc.enable()


def _timer_slack_ns() -> int:
    return _prctl(_PR_GET_TIMERSLACK, 0)


def _set_timer_slack(slack_ns: int) -> None:
    if slack_ns > 0:
        _prctl(_PR_SET_TIMERSLACK, slack_ns)


def _prctl(option: int, value: int) -> int:
    """Call prctl(2), of this thread; elsewhere than on Linux do nothing and return 0."""
    if not sys.platform.startswith("linux"):
        return 0
    return int(ctypes.CDLL(None).prctl(option, ctypes.c_ulong(value), 0, 0, 0))
