"""Boards that let MUTE overtake, and mishandle what it has overtaken.  SPEC.md HG-3.8, HG-4.10."""
# ruff: noqa: SLF001 -- a mutant differs from the healthy board inside

from __future__ import annotations

from typing import Any, Final

from haptogram.records.frame import Evidence
from haptogram_protocol.framing import FrameDecoder
from haptogram_protocol.messages import MessageType

from ..board.clock import earliest_board_time
from ..dialects.haptogram import VirtualHaptogramDialect
from .mutant import Mutant

_BEHIND_US: Final = 500  # that the main loop takes for other frames


class _Overtaking(VirtualHaptogramDialect):
    """Carries MUTE out as it arrives, and everything else half a millisecond later."""

    def __init__(self, *parts: Any) -> None:
        super().__init__(*parts)
        self._began = b""
        self._waiting: list[tuple[int, bytes]] = []

    def next_event_us(self) -> int | None:
        """Return when something happens next by itself, or None."""
        due_us = self._waiting[0][0] if self._waiting else None
        return earliest_board_time(super().next_event_us(), due_us)

    def advance_to(self, t_us: int) -> None:
        """Let everything happen that is due up to *t_us*, frames that wait among it."""
        while self._waiting and self._waiting[0][0] <= t_us:
            due_us, data = self._waiting.pop(0)
            super().advance_to(due_us)
            super().receive(data, due_us)
        super().advance_to(t_us)

    def receive(self, data: bytes, t_us: int) -> None:
        """Take bytes whose last one is complete at *t_us*."""
        self.advance_to(t_us)
        *frames, self._began = (self._began + data).split(b"\x00")
        for frame in frames:
            if self._is_mute(frame):
                self.overtake(frame + b"\x00", t_us)
            else:
                self._waiting.append((t_us + _BEHIND_US, frame + b"\x00"))

    def overtake(self, data: bytes, t_us: int) -> None:
        """Carry MUTE out before the frames that wait."""
        waiting, self._waiting = self._waiting, []
        super().receive(data, t_us)
        self._waiting = waiting

    @staticmethod
    def _is_mute(frame: bytes) -> bool:
        found = FrameDecoder().feed(frame + b"\x00")
        return any(isinstance(body, bytes) and body[0] == MessageType.MUTE for body in found)


class MuteOvertakesNumbers(_Overtaking):
    """Refuses requests that MUTE has overtaken, because its number is newer."""


class ArmBehindMuteDone(_Overtaking):
    """Carries out an ARM that MUTE has overtaken."""

    def overtake(self, data: bytes, t_us: int) -> None:
        """Carry MUTE out, and leave its number free."""
        newest = self._link._control_newest
        super().overtake(data, t_us)
        self._link._control_newest = newest


_WIRE, _SELF = Evidence.WIRE, Evidence.SELF_REPORTED

MUTANTS: Final = (
    Mutant.of(MuteOvertakesNumbers, "HG-4.10/1", _WIRE),
    Mutant.of(ArmBehindMuteDone, "HG-3.8/4", _SELF),
)
