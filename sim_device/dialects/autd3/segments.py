"""Which segment of a memory is out, and which of its samples, in each period of 25 µs.

Sequences and modulation have a memory of two segments each. A segment is sampled by the system time
and not from its start: in period p sample (p // divider) mod length is out, so devices that share a
clock agree. A segment that repeats a number of times starts at a moment that the client names, and
stays at its last sample; one without end starts at once. In the mode EXT the segments take turns:
each goes when its index comes back to 0.

Time line of a segment with 3 samples, divider 2, that plays once on a sync of its index::

    period    0  1  2  3  4  5  6  7  8  9 10 11 12 13
    sample    . (swap)  .  .  .  0  0  1  1  2  2  2  2

Checked period by period against ``pyautd3_emulator`` 38.0.1, but for EXT, where it goes by the laps
of another segment. Source: shinolab/autd3-firmware 098266f, ``stm_swapchain.sv``. No GPIO input
comes: a segment that waits for one waits on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from haptogram_protocol.dialects.autd3.operations import TransitionMode

from .refusals import ENDLESS, SEGMENTS

PERIOD_NS: Final = 25_000


@dataclass(frozen=True, slots=True)
class Autd3Sampling:
    """Sampling of a segment.

    Attributes
    ----------
    divider : int
        Periods for which a sample is out; 0 counts as 1.
    length : int
        Samples, at least 1.
    repeat : int
        Repetitions after the first; 65 535 is endless.
    """

    divider: int = ENDLESS
    length: int = 1
    repeat: int = ENDLESS

    def next_lap(self, period: int) -> int | None:
        """Return when the index next comes back to 0 after *period*; None: it never leaves 0."""
        lap = max(1, self.divider) * self.length
        return (period // lap + 1) * lap if self.length > 1 else None

    def index(self, period: int) -> int:
        """Return the sample that is out in *period*."""
        return period // max(1, self.divider) % self.length


@dataclass(frozen=True, slots=True)
class _Waiting:
    """A segment that starts in carrier period *period*; None: never."""

    segment: int
    period: int | None


class Autd3SwapChain:
    """The two segments of a memory, the first of them out."""

    def __init__(self) -> None:
        self._samplings = [Autd3Sampling()] * SEGMENTS
        self._segment = 0
        self._offset = 0  # sample with which the segment that is out began
        self._waiting: _Waiting | None = None
        self._ends: int | None = None  # period of the last sample's end
        self._has_ended = False
        self._alternates = False
        self._turns: int | None = None  # period in which the other segment has its turn

    @property
    def segment(self) -> int:
        """The segment that is out."""
        return self._segment

    def index(self, period: int) -> int:
        """Return the sample of the segment that is out in *period*."""
        sampling = self._samplings[self._segment]
        if self._has_ended:
            return sampling.length - 1
        return (sampling.index(period) - self._offset) % sampling.length

    def swap(
        self,
        segment: int,
        samplings: Sequence[Autd3Sampling],
        mode: int,
        value_ns: int,
        period: int,
    ) -> None:
        """Show *segment* at once or as *mode* says; asked for in *period*.

        *samplings* are those of both segments, as a device takes all its settings over together.
        """
        self._samplings = list(samplings)
        sampling = samplings[segment]
        self._alternates, self._turns, self._ends = False, None, None
        if sampling.repeat != ENDLESS:
            self._waiting = _Waiting(segment, _start_of_segment(sampling, mode, value_ns, period))
            return
        self._waiting = None
        self._segment, self._offset, self._has_ended = segment, 0, False
        self._alternates = mode == TransitionMode.EXT
        self._turns = self._next_turn(period)

    def advance(self, period: int) -> None:
        """Start, end or alternate the segments as is due up to *period*."""
        while (due := self._next_step()) is not None and due <= period:
            if self._waiting is not None:
                self._start(self._waiting.segment, due)
            elif self._ends is not None:
                self._ends, self._has_ended = None, True
            else:
                self._segment, self._offset = SEGMENTS - 1 - self._segment, 0
                self._turns = self._next_turn(due)

    def next_change(self, period: int) -> int | None:
        """Return the next period after *period* with another sample or segment, or None."""
        times = [self._next_step()]
        sampling = self._samplings[self._segment]
        if sampling.length > 1 and not self._has_ended:
            divider = max(1, sampling.divider)
            times.append((period // divider + 1) * divider)
        return min((time for time in times if time is not None), default=None)

    def _next_step(self) -> int | None:
        """Return the carrier period of the next change of segment; None if none is due.

        It was asked for, or is due as repetitions end or segments alternate.
        """
        if self._waiting is not None:
            return self._waiting.period
        return self._ends if self._ends is not None else self._turns

    def _next_turn(self, period: int) -> int | None:
        """Return the carrier period, after *period*, in which alternating segments change.

        None if segments do not alternate.
        """
        sampling = self._samplings[self._segment]
        return sampling.next_lap(period) if self._alternates else None

    def _start(self, segment: int, period: int) -> None:
        """Switch to *segment* in carrier period *period*; compute the period when repeats end."""
        sampling = self._samplings[segment]
        self._waiting, self._has_ended = None, False
        self._segment, self._offset = segment, sampling.index(period)
        ticks = period // max(1, sampling.divider) + (sampling.repeat + 1) * sampling.length
        self._ends = ticks * max(1, sampling.divider)


def _start_of_segment(sampling: Autd3Sampling, mode: int, value_ns: int, period: int) -> int | None:
    """Return the carrier period after *period* in which a queued segment starts, by *mode*.

    With SYNC_INDEX when the index of *sampling*, that of the segment, is 0 again; with SYSTEM_TIME
    at *value_ns*. None for other modes, or if the index never leaves 0.
    """
    if mode == TransitionMode.SYNC_INDEX:
        return sampling.next_lap(period)
    if mode == TransitionMode.SYSTEM_TIME:
        return max(period + 1, -(-value_ns // PERIOD_NS))
    return None
