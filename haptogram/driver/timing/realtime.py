"""Deadlines on a grid, the rules for missed ones, the loop that keeps them, and its log."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from haptogram.errors import ConfigurationError

_SPIN_SHARE: Final = 4  # part of a period, 1 / n, that may be spent spinning


def next_deadline_ns(*, deadline_ns: int, now_ns: int, period_ns: int) -> int:
    """Return the first deadline after *now_ns* on the original grid.

    Missed ticks are skipped, never bunched, and the phase of the grid is kept::

        0         1         2         3         4
        *---------o-*-------o---------O---------*----> time
        T0          T1 late           T2,T3 missed   T4
    """
    late_ns = max(0, now_ns - deadline_ns)
    return deadline_ns + period_ns * (late_ns // period_ns + 1)


def can_arrive_by_deadline(
    *, now_ns: int, line_free_ns: int, transmission_ns: int, due_ns: int
) -> bool:
    """Return True if a frame that would be sent now is complete at the board before it is due.

    The rule of the stream for missed ticks: a frame that can still make it is sent at once, after
    what the line is busy with; one that cannot is skipped, so that it delays no other::

        deadline  now      line free       arrival   due
        *---------|--------|===============*---------|----> time     sent
        *---------|--------|===============|=====*--------> time     skipped
                                           due
    """
    return max(now_ns, line_free_ns) + transmission_ns <= due_ns


@dataclass(frozen=True, slots=True)
class Tick:
    """One tick of a periodic loop.

    Attributes
    ----------
    number : int
        Place on the grid, from 0; the numbers of missed ticks are left out.
    deadline_ns, wake_ns : int
        When it was due, and when the loop was there.
    """

    number: int
    deadline_ns: int
    wake_ns: int


def check_spin_before_tick(spin_ns: int, period_ns: int) -> None:
    """Raise unless a loop of this period can spin for *spin_ns*.

    Raises
    ------
    ConfigurationError
        Names the spin and the longest one, in microseconds.
    """
    longest_ns = period_ns // _SPIN_SHARE
    if not 0 <= spin_ns <= longest_ns:
        raise ConfigurationError(
            f"spin_us is {spin_ns / 1e3:g} µs; at {1e9 / period_ns:g} Hz it can be 0 to "
            f"{longest_ns / 1e3:g} µs, a quarter of the period"
        )


class PeriodicLoop:
    """Keeps absolute deadlines; between them it serves whatever else there is to do.

    It spins for a quarter of the period at most: a loop that spins does not serve, and a
    port that is not served fills up, until neither end can write.

    Parameters
    ----------
    now_ns : callable
        The clock.
    serve : callable
        Serves the port until the time that it is given, at least once, and returns.
    period_ns : int
        From one deadline to the next.
    spin_ns : int
        How long before a deadline to stop sleeping and watch the clock instead.

    Raises
    ------
    ConfigurationError
        If *spin_ns* is more than a quarter of the period.
    """

    def __init__(
        self,
        now_ns: Callable[[], int],
        serve: Callable[[int], None],
        *,
        period_ns: int,
        spin_ns: int = 0,
    ) -> None:
        check_spin_before_tick(spin_ns, period_ns)
        self.spin_ns = spin_ns
        self._now_ns, self._serve = now_ns, serve
        self._period_ns = period_ns

    def wait(self, deadline_ns: int) -> int:
        """Serve until *deadline_ns* and return when the loop was there."""
        self._serve(deadline_ns - self.spin_ns)
        now_ns = self._now_ns()
        while now_ns < deadline_ns:
            before_ns, now_ns = now_ns, self._now_ns()
            if now_ns == before_ns:  # virtual time: it passes only while the port is served
                self._serve(deadline_ns)
                now_ns = self._now_ns()
        return now_ns

    def ticks(self, start_ns: int, end_ns: int) -> Iterator[Tick]:
        """Yield a tick at *start_ns* and every period after it, until *end_ns*.

        What the caller does in a tick may take longer than the period: the ticks it covers are
        missed (:func:`next_deadline_ns`), and the next one is on the grid again.
        """
        deadline_ns = start_ns
        while deadline_ns < end_ns:
            wake_ns = self.wait(deadline_ns)
            yield Tick((deadline_ns - start_ns) // self._period_ns, deadline_ns, wake_ns)
            deadline_ns = next_deadline_ns(
                deadline_ns=deadline_ns, now_ns=self._now_ns(), period_ns=self._period_ns
            )


class TickStamps(NamedTuple):
    """Host times of the events of one tick, in nanoseconds."""

    deadline: int
    idle: int
    wake: int
    ready: int
    room: int
    done: int
    line_free: int


#: Fields of a tick in :class:`TickLog`.
STAMPS: Final = TickStamps._fields


class TickLog:
    """Times of the events of every tick, in memory that is allocated before the first.

    Parameters
    ----------
    ticks : int
        How many ticks there will be, at most.

    Notes
    -----
    The stamps of a tick, in order:

    deadline
        When it was due.
    idle
        When the loop had done everything before and began to wait, as far as it came to that.
    wake
        When it was there.
    ready
        When the frame was; the same as ``done`` for one that was skipped.
    room
        When the line had room for it.
    done
        When the port had taken it.
    line_free
        When its last byte leaves the line, computed from the baud rate.
    """

    def __init__(self, ticks: int) -> None:
        self._rows = np.zeros((ticks, len(STAMPS)), dtype=np.int64)
        self.count = 0

    def record(self, stamps: TickStamps) -> None:
        """Take the stamps of the next tick."""
        self._rows[self.count] = stamps
        self.count += 1

    def stamp_ns(self, name: str) -> NDArray[np.int64]:
        """Return the (n,) host times of one stamp of :data:`STAMPS`, nanoseconds."""
        return self._rows[: self.count, STAMPS.index(name)]

    def lateness_us(self) -> NDArray[np.float64]:
        """Return the lateness of the loop at each of the (n,) ticks, in microseconds."""
        return (self.stamp_ns("wake") - self.stamp_ns("deadline")) / 1e3
