"""Lead of a frame before its time: the default, and the trim from arrival margins.

Pure functions and one small state machine; nothing here knows a port or a clock.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction
from typing import Final

_LONGEST_DEFAULT_US: Final = 100_000
_SHARE: Final = Fraction(3, 4)  # share of the queue (the rest takes up a burst) and of the horizon
_GUARD_US: Final = 200  # margin above the worst delay seen: two clocks and a carrier period
_GUARD_SHARE: Final = 4  # part of the worst delay, 1 / n, that is added as well
_LATENESS_DECAY: Final = 0.9  # factor on the lateness for each report without a late frame
_MOST_LATENESS_US: Final = 10_000.0
_FIRST_EPOCH: Final = 8  # reports; each epoch is twice as long as the one before


def default_lead_us(horizon_us: Fraction | int) -> int:
    """Return the lead that a stream or a playback gets unless it asks for another.

    As long as the board allows with a quarter to spare, 100 ms at most: a stall of the host below
    the lead costs nothing, and a line that is 92 % full needs twelve times the stall to catch up.

    Parameters
    ----------
    horizon_us : Fraction or int
        How far the board looks ahead, or for how long its queue has room, if that is less.
    """
    return max(1, min(_LONGEST_DEFAULT_US, int(_SHARE * horizon_us)))


def sufficient_lead_us(delays_us: list[int], *, frames: int, miss_share: float) -> int:
    """Return the smallest lead with which no more than *miss_share* of the frames were too late.

    Parameters
    ----------
    delays_us : list of int
        Worst delay from sending to complete arrival, of each report; one or more.
    frames : int
        Frames that the reports speak of.
    miss_share : float
        Share of frames that may be late, 0 to 1.

    Notes
    -----
    A report tells the worst of its frames only.  So the worst report may be exceeded if one frame
    may be late, the second worst if two may, and so on: if a report held several late frames the
    guard on top (a quarter, and 200 µs) is all there is.
    """
    ranked = sorted(delays_us, reverse=True)
    worst_us = max(0, ranked[min(int(miss_share * frames), len(ranked) - 1)])
    return worst_us + worst_us // _GUARD_SHARE + _GUARD_US


@dataclass(slots=True)
class LeadTrim:
    """Moves a lead to the smallest one that still meets the miss target.

    It comes down only at the end of an epoch, to what the whole epoch needed, and every epoch is
    twice as long as the one before; within an epoch it only goes up.  So over n reports it turns
    round no more than 2 log2(n) times: it cannot oscillate, and in steady conditions it stands
    still from the first epoch on.

    Parameters
    ----------
    longest_us : int
        Lead to begin with, and never to exceed.
    shortest_us : int
        Lead never to go below: the frame's own time on the line.
    miss_share : float
        Share of frames that may be late.

    Attributes
    ----------
    lead_us : int
        The lead now.
    moves : int
        How often it has changed.
    """

    longest_us: int
    shortest_us: int
    miss_share: float = 1e-3
    lead_us: int = field(init=False)
    moves: int = field(default=0, init=False)
    _delays_us: list[int] = field(default_factory=list, init=False)
    _frames: int = field(default=0, init=False)
    _epoch: int = field(default=_FIRST_EPOCH, init=False)

    def __post_init__(self) -> None:
        self.lead_us = self.longest_us

    def add(self, delay_us: int, frames: int) -> int:
        """Take the worst delay of *frames* frames, and return the lead from now on."""
        self._delays_us.append(delay_us)
        self._frames += frames
        needed_us = sufficient_lead_us(
            self._delays_us, frames=self._frames, miss_share=self.miss_share
        )
        if len(self._delays_us) >= self._epoch:
            self._move(needed_us)
            self._begin_epoch()
        else:
            self._move(max(self.lead_us, needed_us))
        return self.lead_us

    def _move(self, lead_us: int) -> None:
        """Set the lead, within its limits, and count a change."""
        lead_us = min(self.longest_us, max(self.shortest_us, lead_us))
        self.moves += lead_us != self.lead_us
        self.lead_us = lead_us

    def _begin_epoch(self) -> None:
        """Forget the delays measured until now; the next span of STATUS reports is twice as long.

        At the end of such a span, an epoch, the lead may come down.
        """
        self._delays_us.clear()
        self._frames = 0
        self._epoch *= 2


class LeadMargin:
    """Time before t_apply at which a frame must be complete, to be worth sending.

    The margin is the error of the clock, and the lateness that the board reported of frames that
    should have been in time.  Without the margin a host that is late by its whole lead would go on
    sending frames that the board drops, and never catch up.

    Parameters
    ----------
    uncertainty_us : float
        Stated error of the device clock.
    """

    def __init__(self, uncertainty_us: float) -> None:
        self._uncertainty_us = uncertainty_us
        self._lateness_us = 0.0

    def take(self, margin_min_us: int, uncertainty_us: float) -> None:
        """Take a report: the least arrival margin, negative if a frame was late."""
        self._uncertainty_us = uncertainty_us
        if margin_min_us < 0:
            self._lateness_us = min(_MOST_LATENESS_US, self._lateness_us - margin_min_us)
        else:
            self._lateness_us *= _LATENESS_DECAY

    @property
    def ns(self) -> int:
        """The margin, in nanoseconds."""
        return int((self._uncertainty_us + self._lateness_us) * 1000)
