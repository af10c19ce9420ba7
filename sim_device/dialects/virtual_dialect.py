"""A board at the end of a line, as the simulation sees it: of any dialect."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from ..board.events import Notice
from .unit import RunsAheadUnit


class VirtualDialect:
    """One board, or all boards on one line, behind the end of that line.

    Time is device time, unwrapped, in microseconds; bytes that come at a moment find everything
    done that was due at it.

    Parameters
    ----------
    now_us : int
        Device time at power-up.

    Attributes
    ----------
    line_free_us : int
        When the line has sent what was taken from here. Whoever takes the output keeps it up to
        date.
    ahead : RunsAheadUnit or None
        The board, if it takes the bytes of the line by itself, and runs ahead.
    announce : callable or None
        Takes bytes that the line begins to carry at a device time; None: nobody hears them.
    """

    ahead: RunsAheadUnit | None = None
    announce: Callable[[float, bytes], None] | None = None

    def __init__(self, now_us: int) -> None:
        self.line_free_us = self._now_us = now_us
        self._output = bytearray()
        self._latches: list[Any] = []
        self._notices: list[Notice] = []

    @property
    def now_us(self) -> int:
        """Time up to which everything has happened."""
        return self._now_us

    @property
    def counters(self) -> Mapping[str, int]:
        """Every counter by name."""
        raise NotImplementedError

    @property
    def output_bytes(self) -> int:
        """Bytes that wait for the line."""
        return len(self._output)

    @property
    def room_bytes(self) -> int | None:
        """Bytes that the board takes now; None if nothing holds its client back."""
        return None

    def next_frame_end(self, data: bytes, at: int) -> int:
        """Return the index after the first byte of *data* from *at* on that may end a message."""
        raise NotImplementedError

    def receive(self, data: bytes, t_us: int) -> None:
        """Take bytes whose last one is complete at *t_us*."""
        raise NotImplementedError

    def next_event_us(self) -> int | None:
        """Return when something happens next by itself, or None."""
        raise NotImplementedError

    def advance_to(self, t_us: int) -> None:
        """Let everything happen that is due up to *t_us*."""
        raise NotImplementedError

    def take_output(self, limit: int | None = None) -> bytes:
        """Return bytes for the line, at most *limit* if given."""
        taken = bytes(self._output[:limit])
        del self._output[: len(taken)]
        return taken

    def take_latches(self) -> list[Any]:
        """Return the latches since the last call, in order."""
        taken, self._latches = self._latches, []
        return taken

    def take_notices(self) -> list[Notice]:
        """Return the notices of the board since the last call, in order."""
        taken = list(self._notices)
        self._notices.clear()
        return taken

    def client_left(self) -> None:
        """Learn that the client has closed the port, which most boards do not see."""

    def power_down(self) -> None:
        """Stop radiating for good."""
        if self.ahead is not None:
            self.ahead.power_down()
