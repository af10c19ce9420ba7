"""The seam between a wire and what its boards do: operations in, pulses out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any, Protocol, runtime_checkable

from haptogram_protocol.dialects.codec import Operation, Reply

from ..board.events import PulseLatch


class Unit(Protocol):
    """All boards on one line: they take operations and change their pulses.

    A unit reads no clock: it is told the time in microseconds of device time, never backwards, and
    everything that was due by itself has happened (:meth:`advance_to`) when an operation comes. The
    first latch is that of the power-up, at the time that the unit was made with. Any partition of
    time into steps gives the same latches.
    """

    @property
    def counters(self) -> Counter[str]:
        """Counts of the operations that the boards cannot do, by kind."""

    def take(self, operation: Operation, t_us: int) -> Sequence[Reply | bytes]:
        """Do *operation*, whose last byte is complete at *t_us*; return what the boards answer."""

    def next_event_us(self) -> int | None:
        """Return when the boards next do something by themselves, or None."""

    def advance_to(self, t_us: int) -> Sequence[Reply | bytes]:
        """Let everything happen that is due up to *t_us*; return what the boards say by it."""

    def take_latches(self) -> list[PulseLatch]:
        """Return the latches since the last call, in order.

        A unit sets time, pulses, cause, and index and modulation where it has them; the dialect
        adds the rest.
        """


@runtime_checkable
class HoldsBackUnit(Protocol):
    """A unit with flow control: its client waits while it has no room."""

    @property
    def room_bytes(self) -> int:
        """Bytes that the boards take now."""


@runtime_checkable
class HearsBytesUnit(Protocol):
    """A unit whose output changes while bytes arrive."""

    def hear(self, begin_us: float, end_us: float) -> None:
        """Learn that bytes arrive from one device time to another."""
        ...


@runtime_checkable
class RunsAheadUnit(Protocol):
    """A unit whose board takes the bytes of the line by itself, and runs ahead of what it tells."""

    def announce(self, begin_us: float, data: bytes) -> None:
        """Take bytes that come back to back, the start bit of the first at a device time."""

    def run_ahead(self, until_us: int) -> None:
        """Find out what the board does up to *until_us*: until then nothing else comes."""

    def power_down(self) -> None:
        """Switch the board off."""


class LatchingUnit:
    """The half of a unit that most boards share: it keeps latches, and does nothing by itself."""

    def __init__(self) -> None:
        self.counters: Counter[str] = Counter()
        self._latches: list[PulseLatch] = []
        self._handlers: dict[type[Operation], Callable[[Any, int], None]] = {}

    def take(self, operation: Operation, t_us: int) -> Sequence[Reply | bytes]:
        """Do *operation*, if there is a handler for it."""
        if (handler := self._handlers.get(type(operation))) is not None:
            handler(operation, t_us)
        return []

    def next_event_us(self) -> int | None:
        """Return None: nothing is ever due."""
        return None

    def advance_to(self, t_us: int) -> Sequence[Reply | bytes]:  # noqa: ARG002  nothing is ever due
        """Do nothing."""
        return []

    def take_latches(self) -> list[PulseLatch]:
        """Return the latches since the last call, in order."""
        taken, self._latches = self._latches, []
        return taken
