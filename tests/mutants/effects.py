"""Boards in which an event touches what it has to leave alone, or MUTE what it has overtaken.

SPEC.md HG-3.8 and chapters 4 to 9.
"""
# ruff: noqa: SLF001 -- a mutant differs from the healthy board inside

from __future__ import annotations

import dataclasses
from typing import Any, Final

from haptogram.acoustics import Drive
from haptogram.records.frame import Evidence
from haptogram_protocol.framing import FrameDecoder
from haptogram_protocol.messages import Config, MessageType, TraceMode, UploadBegin
from haptogram_protocol.state import MuteReason
from sim_device.board.board import Board, BoardParts
from sim_device.board.clock import earliest_board_time
from sim_device.board.counters import BoardArrivalMargins, Drop
from sim_device.board.output import BoardOutput
from sim_device.board.settings import BoardSettings
from sim_device.board.stream_queue import StreamFrame
from sim_device.dialects.haptogram import VirtualHaptogramDialect
from sim_device.mutants import Mutant

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
        due = [one for one in self._waiting if one[0] <= t_us]
        del self._waiting[: len(due)]  # or the board would wait for them within its own step
        for due_us, data in due:
            super().advance_to(due_us)
            super().receive(data, due_us)
        super().advance_to(t_us)

    def play_to(self, t_us: int) -> None:
        """Latch frames of a playback one by one, as frames wait beside them."""

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


class ArmBringsBack(BoardOutput):
    """Radiates the old drive again when ARM follows a mute by the hold."""

    def arm(self) -> None:
        """Allow output."""
        held = self.reason is MuteReason.HOLD_EXPIRED
        super().arm()
        self._sounding = self._sounding or held


class ArmClearsTimeouts(BoardOutput):
    """Clears the counter of mutes by a timer when ARM comes."""

    def arm(self) -> None:
        """Allow output."""
        super().arm()
        self.counters.timeouts = 0


class UntracedLatchesUnnumbered(BoardOutput):
    """Gives a latch no number while no trace is on."""

    def latch(self, *latch: Any, **more: Any) -> None:
        """Swap the buffers."""
        super().latch(*latch, **more)
        self._latches -= self.config.trace_mode is TraceMode.OFF


class WindowFlushes(Board):
    """Flushes the queue when the late window changes."""

    def configure(self, config: Config) -> None:
        """Put *config* in force."""
        changes = config.late_window_us != self.output.config.late_window_us
        super().configure(config)
        if changes:
            self.output.counters.flushed += self._queue.flush()


class UploadClearsMargins(Board):
    """Begins the arrival margins anew when an upload begins."""

    def begin_upload(self, begin: UploadBegin) -> None:
        """Make room for an upload."""
        super().begin_upload(begin)
        self.margins = BoardArrivalMargins()


class ConfigRestartsPlayback(Board):
    """Starts the period of a playback anew with SET_CONFIG."""

    def configure(self, config: Config) -> None:
        """Let the next frame be due a period from now on."""
        super().configure(config)
        if (playback := self._playback) is not None and playback.played:
            playback.start_us = self.output.now_us - (playback.played - 1) * playback.period_us


class QueuedPointsOfTheSpeedSetLast(Board):
    """Computes focal points in the queue anew when another speed of sound is set."""

    def __init__(self, settings: BoardSettings, parts: BoardParts) -> None:
        super().__init__(settings, parts)
        self._points: dict[int, StreamFrame] = {}

    def submit(self, frame: StreamFrame) -> Drop | None:
        """Queue a stream frame, and keep its points."""
        if not isinstance(frame.content, Drive):
            self._points[frame.index] = frame
        return super().submit(frame)

    def configure(self, config: Config) -> None:
        """Configure, and compute what waits anew."""
        super().configure(config)
        entries = self._queue._entries
        for place, entry in enumerate(entries):
            if (frame := self._points.get(entry.index)) is not None:
                drive, _ = self._focuser.registers(frame.content)
                entries[place] = dataclasses.replace(entry, drive=drive)


_WIRE, _SELF = Evidence.WIRE, Evidence.SELF_REPORTED

MUTANTS: Final = (
    Mutant.of(MuteOvertakesNumbers, "HG-4.10/1", _WIRE),
    Mutant.of(ArmBehindMuteDone, "HG-3.8/4", _SELF),
    Mutant.of(ArmBringsBack, "HG-6.11/5", _SELF),
    Mutant.of(ArmClearsTimeouts, "HG-9.2/1", _SELF),
    Mutant.of(UntracedLatchesUnnumbered, "HG-8.5/1", _SELF),
    Mutant.of(WindowFlushes, "HG-7.1/3", _SELF),
    Mutant.of(UploadClearsMargins, "HG-7.4/1", _SELF),
    Mutant.of(ConfigRestartsPlayback, "HG-7.1/3", _SELF),
    Mutant.of(QueuedPointsOfTheSpeedSetLast, "HG-7.1/3", _SELF),
)
