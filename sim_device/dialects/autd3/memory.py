"""A memory of two segments: what a client writes into it, and what of it is out.

A device has one for sequences and one for modulation. The processor checks operations against what
was written last; the FPGA shows what was there when an operation last asked it to.
"""

from __future__ import annotations

from collections import Counter
from typing import Final, Generic, TypeVar

from haptogram_protocol.dialects.autd3 import operations

from .refusals import SEGMENTS, autd3_segment_refusal, autd3_time_refusal, autd3_transition_refusal
from .segments import PERIOD_NS, Autd3Sampling, Autd3SwapChain

MAX_ITEMS: Final = 65_536

Content = TypeVar("Content")


Start = TypeVar("Start", operations.FociStart, operations.ModulationStart)


class Autd3Memory(Generic[Content, Start]):
    """Two segments that hold *content*, the first of them out.

    Parameters
    ----------
    content : object
        Content of both segments at power-up.
    item_bytes : int
        Bytes of one of the 65 536 items that a segment has room for.
    counters : Counter
        Counts ``items_beyond_memory`` and ``parts_without_start``.

    Attributes
    ----------
    start : Start or None
        Head of what is being written, None between sequences.
    part : bytearray
        The received part of an operation.
    """

    def __init__(self, content: Content, item_bytes: int, counters: Counter[str]) -> None:
        self.start: Start | None = None
        self.part = bytearray()
        self._counters = counters
        self._room = MAX_ITEMS * item_bytes
        self._segment = 0
        self._samplings = [Autd3Sampling()] * SEGMENTS
        self._written, self._shown = [content] * SEGMENTS, [content] * SEGMENTS
        self._chain = Autd3SwapChain()

    @property
    def divider(self) -> int:
        """Divider of the segment that the processor takes to be out."""
        return self._samplings[self._segment].divider

    def divider_of(self, segment: int) -> int:
        """Return the divider of *segment*, or 65 535 if there is none."""
        return (self._samplings[segment] if segment < SEGMENTS else Autd3Sampling()).divider

    def written(self, segment: int) -> Content:
        """Return the content of *segment*."""
        return self._written[segment]

    def begin(self, segment: int, start: Start) -> None:
        """Begin to write *segment*."""
        if start.transition_mode != operations.TransitionMode.LATER:
            self._segment = segment
        self._samplings[segment] = Autd3Sampling(start.divider, 1, start.repeat)
        self.start = start
        self.part.clear()

    def abandon(self) -> None:
        """Forget what is being written."""
        self.start = None
        self.part.clear()

    def extend(self, data: bytes) -> bool:
        """Append *data* to what is being written; return False if nothing is."""
        if self.start is None:
            self._counters["parts_without_start"] += 1
            return False
        room = self._room - len(self.part)
        if len(data) > room:
            self._counters["items_beyond_memory"] += 1
        self.part += data[:room]
        return True

    def write(self, segment: int, content: Content, sampling: Autd3Sampling) -> None:
        """Fill *segment*."""
        self._written[segment], self._samplings[segment] = content, sampling

    def select(self, segment: int) -> None:
        """Take *segment* to be out, as the processor does before the FPGA shows it."""
        self._segment = segment

    def refusal(self, segment: int, mode: int, repeat: int | None = None) -> operations.ErrorCode:
        """Return why *segment* cannot be shown by *mode*, with what it holds or *repeat*."""
        if error := autd3_segment_refusal(segment):
            return error
        if repeat is None:
            repeat = self._samplings[segment].repeat
        return autd3_transition_refusal(self._segment, segment, repeat, mode)

    def show(self, segment: int, mode: int, value: int, now_ns: int) -> operations.ErrorCode:
        """Show *segment* as *mode* says; refuse a time that is too near."""
        if error := autd3_time_refusal(mode, value, now_ns):
            return error
        self._segment = segment
        self._shown = list(self._written)
        period = now_ns // PERIOD_NS
        self._chain.advance(period)
        self._chain.swap(segment, self._samplings, mode, value, period)
        return operations.ErrorCode.NONE

    def output(self, period: int) -> tuple[Content, int]:
        """Return the content that is out in *period*, and the index in it."""
        self._chain.advance(period)
        return self._shown[self._chain.segment], self._chain.index(period)

    def next_change(self, period: int) -> int | None:
        """Return the next period after *period* that may have another output, or None."""
        return self._chain.next_change(period)
