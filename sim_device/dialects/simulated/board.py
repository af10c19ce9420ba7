"""A board of Haptogram's own wire that another process simulates."""

from __future__ import annotations

from collections.abc import Mapping

from ...board.events import AnyLatch, Notice
from .unit import SimulatedUnit


class SimulatedBoard:
    """A simulator at the end of the line; see :class:`~..virtual_dialect.VirtualDialect`.

    Only its own trace tells which number a latch has.

    Parameters
    ----------
    unit : SimulatedUnit
        The board.
    now_us : int
        Device time at power-up.
    """

    def __init__(self, unit: SimulatedUnit, now_us: int) -> None:
        self.line_free_us = self.now_us = now_us
        self.ahead, self.announce = unit, unit.announce
        self._output = bytearray()

    @property
    def counters(self) -> Mapping[str, int]:
        """Counts of pins that do not repeat."""
        return self.ahead.counters

    @property
    def output_bytes(self) -> int:
        """Bytes that the board has sent."""
        return len(self._output)

    @property
    def room_bytes(self) -> None:
        """Nothing holds its client back."""

    def next_frame_end(self, data: bytes, at: int) -> int:  # noqa: ARG002  the board has them
        """Return the end of *data*."""
        return len(data)

    def receive(self, data: bytes, t_us: int) -> None:  # noqa: ARG002  the board has them
        """Let time pass."""
        self.advance_to(t_us)

    def take_output(self, limit: int | None = None) -> bytes:
        """Return bytes for the line, at most *limit* if given."""
        taken = bytes(self._output[:limit])
        del self._output[: len(taken)]
        return taken

    def next_event_us(self) -> int | None:
        """Return the time of what is known to come, else of the next look at the board."""
        return self.ahead.next_event_us()

    def advance_to(self, t_us: int) -> None:
        """Let time pass at the board."""
        for sent in self.ahead.advance_to(t_us):
            self._output += sent
        self.ahead.take_latches()
        self.now_us = max(self.now_us, t_us)

    def client_left(self) -> None:
        """Do nothing: a serial board does not see it."""

    def power_down(self) -> None:
        """End the simulator."""
        self.ahead.power_down()

    def take_latches(self) -> list[AnyLatch]:
        """Return none."""
        return []

    def take_notices(self) -> list[Notice]:
        """Return none."""
        return []
