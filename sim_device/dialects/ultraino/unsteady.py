"""Boards whose carrier is not steady: periods are left out, or drawn out while bytes arrive."""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from collections.abc import Sequence
from typing import Final

from haptogram_protocol.dialects.codec import Operation, Reply

from ...board.clock import earliest_board_time
from ...board.events import CarrierState, PulseLatch
from ..unit import LatchingUnit, Unit

UPLOAD: Final = "upload"  # cause of a latch: bytes begin to arrive, or no more do
_HALVED: Final = "pins_at_half_carrier"


class UnsteadyUnit(LatchingUnit):
    """A unit whose processor makes the carrier as well; see :class:`~..unit.Unit`.

    Parameters
    ----------
    unit : Unit
        What the boards do apart from that.
    usual : CarrierState
        The carrier while no byte arrives.
    is_disturbed : bool
        Whether bytes that arrive draw periods out.
    """

    def __init__(self, unit: Unit, usual: CarrierState, *, is_disturbed: bool) -> None:
        super().__init__()
        self.counters = unit.counters
        self._unit, self._usual, self._is_disturbed = unit, usual, is_disturbed
        self._carrier = usual
        self._changes: deque[tuple[int, CarrierState]] = deque()
        self._collect()

    def hear(self, begin_us: float, end_us: float) -> None:
        """Draw the periods out while bytes arrive."""
        if not self._is_disturbed:
            return
        if self._changes and self._changes[-1][0] >= math.floor(begin_us):
            self._changes.pop()  # back to back
        else:
            self._changes.append((math.ceil(begin_us), CarrierState.DRAWN_OUT))
        self._changes.append((math.floor(end_us), self._usual))

    def take(self, operation: Operation, t_us: int) -> Sequence[Reply | bytes]:
        """Do *operation*; return what the boards answer."""
        replies = self._unit.take(operation, t_us)
        self._collect()
        return replies

    def next_event_us(self) -> int | None:
        """Return when the boards, or the carrier, next change by themselves."""
        change_us = self._changes[0][0] if self._changes else None
        return earliest_board_time(self._unit.next_event_us(), change_us)

    def advance_to(self, t_us: int) -> Sequence[Reply | bytes]:
        """Let everything happen that is due up to *t_us*."""
        replies: list[Reply | bytes] = []
        while self._changes and self._changes[0][0] <= t_us:
            changed_us, self._carrier = self._changes.popleft()
            replies += self._unit.advance_to(changed_us)
            self._collect()
            again = dataclasses.replace(self._shown, t_latch_us=changed_us, cause=UPLOAD)
            self._keep(again)
        replies += self._unit.advance_to(t_us)
        self._collect()
        return replies

    def _collect(self) -> None:
        for latch in self._unit.take_latches():
            self._keep(latch)

    def _keep(self, latch: PulseLatch) -> None:
        if self._carrier is CarrierState.HALVED:
            self.counters[_HALVED] += 1
        self._shown = dataclasses.replace(latch, carrier=self._carrier)
        self._latches.append(self._shown)
