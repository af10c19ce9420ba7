"""A board of Haptogram's own wire that another process simulates."""

from __future__ import annotations

from collections.abc import Mapping

from ..virtual_dialect import VirtualDialect
from .unit import SimulatedUnit


class SimulatedBoard(VirtualDialect):
    """A simulator at the end of the line.

    What it latches under which number only its own trace tells.

    Parameters
    ----------
    unit : SimulatedUnit
        The board.
    now_us : int
        Device time at power-up.
    """

    def __init__(self, unit: SimulatedUnit, now_us: int) -> None:
        super().__init__(now_us)
        self._unit = self.ahead = unit
        self.announce = unit.announce

    @property
    def counters(self) -> Mapping[str, int]:
        """Counts of pins that do not repeat."""
        return self._unit.counters

    def next_frame_end(self, data: bytes, at: int) -> int:  # noqa: ARG002  the board has them
        """Return the end of *data*."""
        return len(data)

    def receive(self, data: bytes, t_us: int) -> None:  # noqa: ARG002  the board has them
        """Let time pass."""
        self.advance_to(t_us)

    def next_event_us(self) -> int | None:
        """Return the time of what is known to come, else of the next look at the board."""
        return self._unit.next_event_us()

    def advance_to(self, t_us: int) -> None:
        """Let time pass at the board."""
        for sent in self._unit.advance_to(t_us):
            self._output += sent
        self._unit.take_latches()
        self._now_us = max(self._now_us, t_us)
