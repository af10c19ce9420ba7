"""Boards that latch at the wrong time, or the wrong thing, or say so.  SPEC.md chapters 5, 7, 8."""
# ruff: noqa: SLF001 -- a mutant differs from the healthy board inside

from __future__ import annotations

import dataclasses
from typing import Any, Final

import numpy as np

from haptogram.acoustics import Drive
from haptogram.records.frame import Evidence
from haptogram_protocol.errors import RemoteProtocolError
from haptogram_protocol.messages import (
    DriveKind,
    ErrorCode,
    ReadDrive,
    Trace,
    TracePlayback,
)
from sim_device.board.board import Board
from sim_device.board.counters import Drop
from sim_device.board.output import BoardOutput
from sim_device.board.registers import Content
from sim_device.board.stream_queue import BoardQueue, QueueEntry, StreamFrame
from sim_device.board.uploads import BoardUploads
from sim_device.dialects.haptogram import VirtualHaptogramDialect
from sim_device.mutants import Mutant


class LatchesEarly(Board):
    """Latches on the last carrier boundary before t_apply."""

    def _entry(self, frame: StreamFrame) -> QueueEntry:
        entry = super()._entry(frame)
        early_us = self.output.boundary_us(entry.t_apply_us - self.settings.carrier_us)
        return dataclasses.replace(entry, t_latch_us=early_us)


class LatchesOffTheCarrier(Board):
    """Latches at t_apply itself, in the middle of a carrier period."""

    def _entry(self, frame: StreamFrame) -> QueueEntry:
        entry = super()._entry(frame)
        soon_us = max(entry.t_apply_us, self.output.now_us)
        return dataclasses.replace(entry, t_latch_us=soon_us)


class LateApplied(Board):
    """Latches frames however late they come."""

    def _refuse(self, frame: StreamFrame) -> Drop | None:
        dropped = super()._refuse(frame)
        return None if dropped is Drop.LATE else dropped


class LateWindowInMilliseconds(Board):
    """Takes the microseconds of `late_window_us` for milliseconds."""

    def _refuse(self, frame: StreamFrame) -> Drop | None:
        dropped = super()._refuse(frame)
        window_us = 1000 * self.output.config.late_window_us
        late = dropped is Drop.LATE and frame.t_apply_us is not None
        taken = late and self.output.now_us - (frame.t_apply_us or 0) <= window_us
        return None if taken else dropped


class LateUnmarked(Board):
    """Latches late frames without saying that they were late."""

    def _entry(self, frame: StreamFrame) -> QueueEntry:
        return dataclasses.replace(super()._entry(frame), late=False)


class OffByOneBank(BoardOutput):
    """Latches the drive of the frame before: it swaps the wrong buffer."""

    _filled: Drive | None = None

    def latch(self, key: Any, drive: Drive, bits: int, **how: Any) -> None:
        """Latch the drive before."""
        shown = self._silence if self._filled is None else self._filled
        self._filled = drive
        super().latch(key, shown, bits, **how)


class TwoInOnePeriod(BoardQueue):
    """Latches both of two frames that fall on one carrier period."""

    def push(self, entry: QueueEntry) -> int:
        """Queue *entry* behind whatever is there."""
        self._entries.append(entry)
        return 0


class ReplacedKeepsItsTime(BoardQueue):
    """Leaves the t_apply of a frame in the queue that another one for its period replaces."""

    def push(self, entry: QueueEntry) -> int:
        """Queue *entry*, with the time of the one that it replaces."""
        before = self._entries[-1] if self._entries else entry
        replaced = super().push(entry)
        if replaced:
            self._entries[-1] = dataclasses.replace(entry, t_apply_us=before.t_apply_us)
        return replaced


class DefectsReplace(VirtualHaptogramDialect):
    """Takes the frame off the queue that another one replaces before it has looked at that one."""

    def content(self, message: Any) -> Any:
        try:
            return super().content(message)
        except RemoteProtocolError:
            self.board.output.counters.flushed += self.board._queue.flush()
            raise


class QueueHalfAsDeep(BoardQueue):
    """Has room for half as many frames as it says."""

    def __init__(self, depth: int) -> None:
        super().__init__(depth // 2)


class OrderIgnored(Board):
    """Takes frames whose t_apply is not after that of the last one in the queue."""

    def _refuse(self, frame: StreamFrame) -> Drop | None:
        dropped = super()._refuse(frame)
        return None if dropped is Drop.ORDER else dropped


class PlaybackHidesDrops(Board):
    """Does not count the stream frames that it drops while a sequence plays."""

    def submit(self, frame: StreamFrame) -> Drop | None:
        """Queue a stream frame, or drop it."""
        counted = self.output.counters.dropped_state
        dropped = super().submit(frame)
        if self._playback is not None:
            self.output.counters.dropped_state = counted
        return dropped


class OrderOutlivesTheQueue(Board):
    """Drops a frame for before the last one that was queued as late, though that one is gone."""

    _newest_us = 0

    def _refuse(self, frame: StreamFrame) -> Drop | None:
        dropped = super()._refuse(frame)
        if dropped is not None or frame.t_apply_us is None:
            return dropped
        is_earlier = frame.t_apply_us < self._newest_us
        self._newest_us = max(self._newest_us, frame.t_apply_us)
        return Drop.LATE if is_earlier else None


class HorizonIgnored(Board):
    """Queues frames however far ahead they are."""

    def _refuse(self, frame: StreamFrame) -> Drop | None:
        dropped = super()._refuse(frame)
        return None if dropped is Drop.FUTURE else dropped


class ImmediateKeepsQueue(Board):
    """Does not flush the queue for a frame that is to be latched as soon as complete."""

    def submit(self, frame: StreamFrame) -> Drop | None:
        """Queue a frame, the others staying where they are."""
        if frame.t_apply_us is not None or self._refuse(frame) is not None:
            return super().submit(frame)
        self._queue._entries.appendleft(self._entry(frame))
        self.advance_to(self.output.now_us)
        return None


class PhasesAtHalfAmplitude(VirtualHaptogramDialect):
    """Drives PHASES frames with amplitude 128."""

    def content(self, message: Any) -> Content:
        content = super().content(message)
        if not isinstance(content, Drive) or message.TYPE != 1:
            return content
        half = np.full(self.board.settings.count, 128, dtype=np.uint8)
        return Drive(content.phase_codes, half, content.phase_bits)


class PlaybackRoundsUp(Board):
    """Rounds the period of a sequence up to carrier periods: its rounding accumulates."""

    def play(self, sequence: int, **how: Any) -> None:
        """Play with another period."""
        carrier_us = self.settings.carrier_us
        how["period_us"] = -(-how["period_us"] // carrier_us) * carrier_us
        super().play(sequence, **how)


class UploadUnchecked(BoardUploads):
    """Takes an upload whatever its CRC is."""

    def commit(self) -> Any:
        """Return the uploaded bytes."""
        try:
            return super().commit()
        except Exception as error:
            pending = self._pending
            if getattr(error, "code", None) is not ErrorCode.CRC_MISMATCH or pending is None:
                raise
            pending.begin = dataclasses.replace(pending.begin, crc=getattr(error, "detail", 0))
            return super().commit()


class TraceTimeOfArrival(VirtualHaptogramDialect):
    """Reports the time at which a frame came as that of its latch."""

    def _trace(self, latch: Any) -> None:
        received_us = latch.t_received_us or latch.t_latch_us
        super()._trace(dataclasses.replace(latch, t_latch_us=received_us))


class TraceOfRadiated(VirtualHaptogramDialect):
    """Reports the CRC of what it radiates, not of what it latched."""

    def _trace_message(self, latch: Any) -> Any:
        message = super()._trace_message(latch)
        if isinstance(message, Trace):
            return dataclasses.replace(message, crc=latch.radiated.digest())
        return message


class CrcKeptByIndex(VirtualHaptogramDialect):
    """Computes the CRC of a played frame anew only if its index is another one than before."""

    _kept: tuple[int, int] | None = None

    def _trace_message(self, latch: Any) -> Any:
        message = super()._trace_message(latch)
        if not isinstance(message, TracePlayback):
            return message
        index = message.key.index
        if self._kept is None or self._kept[0] != index:
            self._kept = index, message.crc
        return dataclasses.replace(message, crc=self._kept[1])


class TornReadBack(VirtualHaptogramDialect):
    """Reads back one half of the latched drive and one half of the drive before it."""

    _drives: tuple[Drive, ...] = ()

    def _trace(self, latch: Any) -> None:
        self._drives = (*self._drives[-1:], latch.drive)
        super()._trace(latch)

    def _answer(self, request: Any) -> None:
        board, latch = self.board, self.board.output.latched
        asked = request.message
        lies = isinstance(asked, ReadDrive) and asked.kind is DriveKind.LATCHED
        if latch is not None and lies and len(self._drives) == 2:
            board.output.latched = dataclasses.replace(
                latch, drive=_mutant_halves(latch.drive, self._drives[0])
            )
        super()._answer(request)
        board.output.latched = latch


class ReadBackTimeIsNow(VirtualHaptogramDialect):
    """Reads back a drive with the time of the question, not of the latch."""

    def _answer(self, request: Any) -> None:
        board, latch = self.board, self.board.output.latched
        if latch is not None and isinstance(request.message, ReadDrive):
            board.output.latched = dataclasses.replace(latch, t_latch_us=board.output.now_us)
        super()._answer(request)
        board.output.latched = latch


def _mutant_halves(first: Drive, second: Drive) -> Drive:
    half = len(first.phase_codes) // 2
    phases, amplitudes = first.phase_codes.copy(), first.amplitude_codes.copy()
    phases[half:], amplitudes[half:] = second.phase_codes[half:], second.amplitude_codes[half:]
    return Drive(phases, amplitudes)


_SELF: Final = Evidence.SELF_REPORTED

MUTANTS: Final = (
    Mutant.of(LatchesEarly, "HG-5.8/1", _SELF),
    Mutant.of(LatchesOffTheCarrier, "HG-5.8/1", _SELF),
    Mutant.of(LateApplied, "HG-5.7/5", _SELF),
    Mutant.of(LateWindowInMilliseconds, "HG-5.7/5", _SELF),
    Mutant.of(LateUnmarked, "HG-5.7/6", _SELF),
    Mutant.of(OffByOneBank, "HG-5.8/5", _SELF),
    Mutant.of(TwoInOnePeriod, "HG-5.8/3", _SELF),
    Mutant.of(ReplacedKeepsItsTime, "HG-5.7/2", _SELF),
    Mutant.of(DefectsReplace, "HG-5.8/3", _SELF),
    Mutant.of(QueueHalfAsDeep, "HG-5.7/3", _SELF),
    Mutant.of(OrderIgnored, "HG-5.7/2", _SELF),
    Mutant.of(PlaybackHidesDrops, "HG-5.7/1", _SELF),
    Mutant.of(OrderOutlivesTheQueue, "HG-5.7/2", _SELF),
    Mutant.of(HorizonIgnored, "HG-5.7/4", _SELF),
    Mutant.of(ImmediateKeepsQueue, "HG-5.9/1", _SELF),
    Mutant.of(PhasesAtHalfAmplitude, "HG-5.2/6", _SELF),
    Mutant.of(PlaybackRoundsUp, "HG-7.6/4", _SELF),
    Mutant.of(UploadUnchecked, "HG-7.4/3", Evidence.WIRE),
    Mutant.of(TraceTimeOfArrival, "HG-8.3/1", _SELF),
    Mutant.of(TraceOfRadiated, "HG-8.3/2", _SELF),
    Mutant.of(CrcKeptByIndex, "HG-8.3/2", _SELF),
    Mutant.of(TornReadBack, "HG-8.6/3", _SELF),
    Mutant.of(ReadBackTimeIsNow, "HG-8.6/3", _SELF),
)
