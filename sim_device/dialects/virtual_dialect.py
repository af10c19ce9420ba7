"""A board at the end of a line, as the simulation sees it: of any dialect."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

from ..board.events import AnyLatch, Notice
from .unit import RunsAheadUnit


class VirtualDialect(Protocol):
    """One board, or all boards on one line, behind the end of that line.

    Time is device time, unwrapped, in microseconds; bytes that come at a moment find everything
    done that was due at it.

    Attributes
    ----------
    line_free_us : int
        When the line has sent what was taken from here. Whoever takes the output keeps it up to
        date.
    """

    line_free_us: int

    @property
    def ahead(self) -> RunsAheadUnit | None:
        """The board, if it takes the bytes of the line by itself, and runs ahead."""

    @property
    def announce(self) -> Callable[[float, bytes], None] | None:
        """Takes bytes that the line begins to carry at a device time; None: not recorded."""
        ...

    @property
    def now_us(self) -> int:
        """Time up to which everything has happened."""

    @property
    def counters(self) -> Mapping[str, int]:
        """Every counter by name."""

    @property
    def output_bytes(self) -> int:
        """Bytes that wait for the line."""

    @property
    def room_bytes(self) -> int | None:
        """Bytes that the board takes now; None if nothing holds its client back."""

    def next_frame_end(self, data: bytes, at: int) -> int:
        """Return the index after the first byte of *data* from *at* on that may end a message."""

    def receive(self, data: bytes, t_us: int) -> None:
        """Take bytes whose last one is complete at *t_us*."""

    def take_output(self, limit: int | None = None) -> bytes:
        """Return bytes for the line, at most *limit* if given."""

    def next_event_us(self) -> int | None:
        """Return when something happens next by itself, or None."""

    def advance_to(self, t_us: int) -> None:
        """Let everything happen that is due up to *t_us*."""

    def client_left(self) -> None:
        """Learn that the program at the other end has closed the port."""

    def power_down(self) -> None:
        """Stop radiating for good."""

    def take_latches(self) -> Sequence[AnyLatch]:
        """Return the latches since the last call, in order."""

    def take_notices(self) -> Sequence[Notice]:
        """Return the notices of the board since the last call, in order."""
