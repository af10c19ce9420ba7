"""Boards that are wrong at one moment, in one slot, in one width of a number.  SPEC.md 2 to 9."""
# ruff: noqa: SLF001 -- a mutant differs from the healthy board inside

from __future__ import annotations

import dataclasses
from typing import Any, Final

import numpy as np

from haptogram.acoustics import Drive
from haptogram.records.frame import Evidence
from haptogram_protocol.connection import BoardConnection
from haptogram_protocol.framing import DELIMITER
from haptogram_protocol.messages import Config, ErrorCode, TraceMode, signed_difference
from haptogram_protocol.state import MuteReason, OutputState
from sim_device.board.board import Board
from sim_device.board.counters import Drop
from sim_device.board.output import BoardOutput
from sim_device.board.stream_queue import BoardQueue, QueueEntry, StreamFrame
from sim_device.board.timers import NEVER_US
from sim_device.dialects.haptogram import VirtualHaptogramDialect
from sim_device.mutants import Mutant

_FULL: Final = 255
_MS: Final = 1000
_PAUSE_US: Final = 50_000


class SlotKeepsAmplitudes(BoardQueue):
    """Sets the amplitudes of PHASES only in a slot of its queue that PHASES never took before."""

    def __init__(self, depth: int) -> None:
        super().__init__(depth)
        self._slots: dict[int, Any] = {}
        self._set: set[int] = set()
        self._next = 0

    def push(self, entry: QueueEntry) -> int:
        """Queue *entry*, in the next slot."""
        slot, self._next = self._next, (self._next + 1) % self._depth
        full = bool((entry.drive.amplitude_codes == _FULL).all())
        if full and slot in self._set:
            drive = Drive(entry.drive.phase_codes, self._slots[slot], entry.drive.phase_bits)
            entry = dataclasses.replace(entry, drive=drive)
        elif full:
            self._set.add(slot)
        self._slots[slot] = np.array(entry.drive.amplitude_codes)
        return super().push(entry)


class TwoOnOneBoundary(BoardOutput):
    """Latches a frame that comes at the moment of a latch on the same carrier boundary."""

    def boundary_us(self, t_us: int) -> int:
        """Return the next carrier boundary, free or not."""
        carrier_us = self.settings.carrier_us
        return -(-max(t_us, self.now_us) // carrier_us) * carrier_us


class LateWindowOf16Bits(Board):
    """Takes the late window modulo 65536 µs."""

    def _refuse(self, frame: StreamFrame) -> Drop | None:
        dropped = super()._refuse(frame)
        if dropped is not None or frame.t_apply_us is None:
            return dropped
        late_us = self.output.now_us - frame.t_apply_us
        return Drop.LATE if late_us > self.output.config.late_window_us & 0xFFFF else None


class LateSticks(Board):
    """Calls the frame behind a late one late as well, if it comes a millisecond ahead or more."""

    _late = False

    def _latch_stream(self) -> None:
        entry = self._queue.head
        assert entry is not None  # it is due
        waits = entry.t_apply_us - entry.t_received_us >= _MS
        late = entry.late or (self._late and waits)
        self._queue._entries[0] = dataclasses.replace(entry, late=late)
        super()._latch_stream()
        self._late = entry.late


class TimesOf24Bits(VirtualHaptogramDialect):
    """Takes the times of stream frames modulo 2^24 µs, which is less than its horizon."""

    def _unwrap(self, t_wire_us: int | None) -> int | None:
        t_us = super()._unwrap(t_wire_us)
        if t_us is None:
            return None
        ahead_us = (t_us - self.board.output.now_us) & 0xFFFFFF
        return self.board.output.now_us + ahead_us - (ahead_us >> 23 << 24)


class HorizonExclusive(Board):
    """Drops a frame that is exactly max_horizon_us ahead."""

    def _refuse(self, frame: StreamFrame) -> Drop | None:
        dropped = super()._refuse(frame)
        at_us = None if frame.t_apply_us is None else frame.t_apply_us - self.output.now_us
        exact = dropped is None and at_us == self.settings.max_horizon_us
        return Drop.FUTURE if exact else dropped


class FullQueueReplaces(Board):
    """Lets a frame replace the last one of a full queue on its carrier boundary."""

    def _refuse(self, frame: StreamFrame) -> Drop | None:
        dropped = super()._refuse(frame)
        if dropped is not Drop.FULL or frame.t_apply_us is None:
            return dropped
        last = self._queue._entries[-1]
        same = last.t_latch_us == self.output.boundary_us(frame.t_apply_us)
        return None if same else dropped


class FullQueueHasNoMargin(Board):
    """Leaves frames that meet a full queue out of the margins."""

    def _refuse(self, frame: StreamFrame) -> Drop | None:
        kept = dataclasses.astuple(self.margins)
        dropped = super()._refuse(frame)
        if dropped is Drop.FULL:
            self.margins.count, self.margins.least_us, self.margins.total_us = kept
        return dropped


class SessionClearsMargins(Board):
    """Begins the margins anew with a session."""

    def open_session(self, nonce: int) -> None:
        """Begin a session."""
        super().open_session(nonce)
        self.margins.take()


class ConfigurationClearsMargins(Board):
    """Begins the margins anew with a configuration."""

    def configure(self, config: Config) -> None:
        """Put *config* in force."""
        super().configure(config)
        self.margins.take()


class StatusKeepsMargins(VirtualHaptogramDialect):
    """Goes on with the old margins after STATUS; only STATUS_REPLY begins them anew."""

    def _send_status(self, t_us: int) -> None:
        margins = self.board.margins
        kept = margins.count, margins.least_us, margins.total_us
        super()._send_status(t_us)
        margins.count, margins.least_us, margins.total_us = kept


class PartialFrameForgotten(BoardConnection):
    """Forgets the beginning of a frame after a pause of 50 ms."""

    _last_us = 0

    def receive_data(self, data: bytes, now_us: int) -> None:
        """Take bytes."""
        paused, self._last_us = now_us - self._last_us > _PAUSE_US, now_us
        super().receive_data((DELIMITER if paused else b"") + data, now_us)


class DuplicatesOf8Bits(BoardConnection):
    """Counts duplicates modulo 256."""

    def count(self, reason: str, number: int = 1) -> None:
        """Count."""
        super().count(reason, number)
        self.counters["duplicate"] &= 0xFF


class RequestJumpsOf14Bits(BoardConnection):
    """Takes a request for an old one that is 16384 numbers or more ahead."""

    def _judge_control_seq(self, frame: Any) -> Any:
        seq = frame.header.seq
        far = signed_difference(seq, self._control_newest, 16) >= 1 << 14
        if not far:
            return super()._judge_control_seq(frame)
        return self._refuse(frame, ErrorCode.SEQUENCE_REUSED, seq)


class LastSeqOfPlayback(Board):
    """Counts the frames of a sequence in last_seq."""

    def _latch_playback(self) -> None:
        super()._latch_playback()
        self.last_stream_index += 1


class SessionClearsGaps(BoardConnection):
    """Counts the gaps of the stream from 0 in every session."""

    def open_session(self, nonce: int) -> None:
        """Begin anew."""
        super().open_session(nonce)
        self.counters["gap"] = 0


class NewTimeoutNextFrame(BoardOutput):
    """Takes a new host_timeout_ms with the frame behind SET_CONFIG."""

    def configure(self, config: Config) -> None:
        """Put *config* in force, but for the lease that runs."""
        before = self.config
        super().configure(dataclasses.replace(config, host_timeout_ms=before.host_timeout_ms))
        self.config = config


class PlayInLateWindow(Board):
    """Takes a PLAY whose start has passed, within the late window."""

    def _check_play(self, start_us: int | None, ready_us: int, unattended_ms: int) -> None:
        super()._check_play(start_us, ready_us - self.output.config.late_window_us, unattended_ms)


class SilenceNotHeld(BoardOutput):
    """Lets no hold run for a drive without amplitude."""

    def latch(self, key: Any, drive: Drive, bits: int, **how: Any) -> None:
        """Latch a drive."""
        super().latch(key, drive, bits, **how)
        if not drive.amplitude_codes.any():
            self._timers._hold.deadline_us = NEVER_US


class DividerOfCrcs(VirtualHaptogramDialect):
    """Divides traces of mode CRC as well."""

    def _trace_message(self, latch: Any) -> Any:
        message = super()._trace_message(latch)
        if self.board.output.config.trace_mode is not TraceMode.CRC:
            return message
        self._traced += 1
        return message if (self._traced - 1) % self.board.output.config.trace_divider == 0 else None


class MuteEmptiesRing(BoardOutput):
    """Empties the trace ring with MUTE."""

    def mute(self, *, requested: bool = True) -> None:
        """Mute."""
        super().mute(requested=requested)
        self._ring.clear()


class DisarmAgainTells(BoardOutput):
    """Takes DISARM for the reason of a state that is DISARMED already."""

    def disarm(self) -> None:
        """Disarm."""
        super().disarm()
        if self.state is OutputState.DISARMED:
            self.reason = MuteReason.DISARM


class GapsOfPlaybackUncounted(VirtualHaptogramDialect):
    """Counts no gaps while a sequence plays."""

    _gaps = 0

    def _stream(self, event: Any) -> None:
        super()._stream(event)
        gaps = self._link.counters["gap"]
        if self.board._playback is not None:
            self._link.counters["gap"] = self._gaps
        else:
            self._gaps = gaps


_SELF: Final = Evidence.SELF_REPORTED

MUTANTS: Final = (
    Mutant.of(SlotKeepsAmplitudes, "HG-5.2/6", _SELF),
    Mutant.of(TwoOnOneBoundary, "HG-5.8/3", _SELF),
    Mutant.of(LateWindowOf16Bits, "HG-5.7/6", _SELF),
    Mutant.of(LateSticks, "HG-5.7/6", _SELF),
    Mutant.of(TimesOf24Bits, "HG-5.7/4", _SELF),
    Mutant.of(HorizonExclusive, "HG-5.7/4", _SELF),
    Mutant.of(FullQueueReplaces, "HG-5.7/3", _SELF),
    Mutant.of(FullQueueHasNoMargin, "HG-9.3/1", _SELF),
    Mutant.of(SessionClearsMargins, "HG-9.3/1", _SELF),
    Mutant.of(ConfigurationClearsMargins, "HG-9.3/1", _SELF),
    Mutant.of(StatusKeepsMargins, "HG-9.3/1", _SELF),
    Mutant.of(PartialFrameForgotten, "HG-2.1/3", Evidence.WIRE),
    Mutant.of(DuplicatesOf8Bits, "HG-9.2/1", _SELF),
    Mutant.of(RequestJumpsOf14Bits, "HG-4.9/3", Evidence.WIRE),
    Mutant.of(LastSeqOfPlayback, "HG-9.1/2", _SELF),
    Mutant.of(SessionClearsGaps, "HG-9.2/1", _SELF),
    Mutant.of(NewTimeoutNextFrame, "HG-7.1/3", Evidence.WIRE),
    Mutant.of(PlayInLateWindow, "HG-7.6/2", Evidence.WIRE),
    Mutant.of(SilenceNotHeld, "HG-6.10/1", Evidence.WIRE),
    Mutant.of(DividerOfCrcs, "HG-8.1/1", _SELF),
    Mutant.of(MuteEmptiesRing, "HG-8.5/1", _SELF),
    Mutant.of(DisarmAgainTells, "HG-6.2/3", _SELF),
    Mutant.of(GapsOfPlaybackUncounted, "HG-5.5/2", _SELF),
)
