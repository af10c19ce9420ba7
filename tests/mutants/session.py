"""Boards that get sequence numbers, sessions, requests, counters wrong.  SPEC.md 3, 4, 9."""

from __future__ import annotations

import dataclasses
from typing import Any, Final

from haptogram.records.frame import Evidence
from haptogram_protocol.connection import NEED_DATA, BoardConnection
from haptogram_protocol.messages import (
    STREAM_RANGE,
    VERSION_MAJOR,
    Feature,
    Hello,
    HelloReply,
    Mute,
    Stop,
    signed_difference,
)
from sim_device.board.counters import BoardCounters
from sim_device.board.output import BoardOutput
from sim_device.dialects.haptogram import VirtualHaptogramDialect
from sim_device.mutants import Mutant

_DAMAGE: Final = frozenset({"crc", "cobs", "short", "oversize"})
_LEAK_BYTES: Final = 16_384


class SequenceOf8Bits(BoardConnection):
    """Compares sequence numbers of the stream by their low 8 bits."""

    def _take_index(self, seq: int) -> int | None:
        ahead = signed_difference(seq & 0xFF, self._stream_expected & 0xFF, 8)
        return super()._take_index((self._stream_expected + ahead) & 0xFFFF)


class UnwrappedTo24Bits(BoardConnection):
    """Unwraps the numbers of stream frames to 24 bits."""

    def _take_index(self, seq: int) -> int | None:
        index = super()._take_index(seq)
        return None if index is None else index & 0xFFFFFF


class SequenceNeverWraps(BoardConnection):
    """Takes sequence number 0 after 65535 for an old one."""

    _highest = -1

    def _take_index(self, seq: int) -> int | None:
        if seq <= self._highest:
            return None
        self._highest = seq
        return super()._take_index(seq)

    def open_session(self, nonce: int) -> None:
        """Begin anew."""
        self._highest = -1
        super().open_session(nonce)


class StaleSessionTaken(BoardConnection):
    """Takes stream frames of any session while one is open."""

    def _judge_stream(self, frame: Any) -> Any:
        return super()._judge_stream(dataclasses.replace(frame, in_session=self.session != 0))


class DuplicatesApplied(BoardConnection):
    """Latches a stream frame as often as it comes."""

    def _take_index(self, seq: int) -> int | None:
        ahead = signed_difference(seq, self._stream_expected, 16)
        return self._stream_expected + ahead if ahead < 0 else super()._take_index(seq)


class RepetitionsDone(BoardConnection):
    """Carries a request out again when its copy comes."""

    def _judge_control_seq(self, frame: Any) -> Any:
        if self._answered and self._answered.seq == frame.header.seq:
            return None
        return super()._judge_control_seq(frame)


class OldRequestsDone(BoardConnection):
    """Carries out a delayed copy of an earlier request."""

    def _judge_control_seq(self, frame: Any) -> Any:
        if signed_difference(frame.header.seq, self._control_newest, 16) < 0:
            return None
        return super()._judge_control_seq(frame)


class HelloAlwaysAnew(BoardConnection):
    """Begins the session anew when a HELLO is repeated."""

    def _judge_hello(self, frame: Any, hello: Hello) -> Any:
        self._greeting = None
        return super()._judge_hello(frame, hello)


class HelloStartsAtZero(BoardConnection):
    """Takes 0 for the number of every HELLO that opens a session."""

    def reply(self, request: Any, message: Any, now_us: int) -> None:
        """Answer, and take no note of the number of a HELLO."""
        super().reply(request, message, now_us)
        if isinstance(message, HelloReply):
            self._control_newest = 0


class EventsFirst(VirtualHaptogramDialect):
    """Tells what a request led to before it answers the request."""

    def _reply_to(self, message: Any, request: Any) -> Any:
        reply = super()._reply_to(message, request)
        if isinstance(message, Mute | Stop):
            self.collect()
        return reply


class VersionIgnored(BoardConnection):
    """Opens a session for a host of any major version."""

    def _judge_hello(self, frame: Any, hello: Hello) -> Any:
        return super()._judge_hello(frame, dataclasses.replace(hello, major=VERSION_MAJOR))


class EventNumbersStuck(BoardConnection):
    """Gives every event the sequence number 0."""

    def send_event(self, message: Any, **how: Any) -> bool:
        """Send an event, number 0."""
        self._event_seq = 0
        return super().send_event(message, **how)


class CountersStuck(BoardConnection):
    """Never counts a damaged frame."""

    def count(self, reason: str, number: int = 1) -> None:
        """Leave damage out."""
        super().count(reason, 0 if reason in _DAMAGE else number)


class FramesUncounted(BoardConnection):
    """Leaves stream frames out of `frames`."""

    def _judge(self, body: bytes, t_rx_us: int) -> Any:
        if body[0] in STREAM_RANGE:
            self.count("frames", -1)
        return super()._judge(body, t_rx_us)


class CountersCleared(VirtualHaptogramDialect):
    """Clears the counters for every new session."""

    def _greet(self, hello: Hello, request: Any) -> None:
        self._link.counters = dict.fromkeys(self._link.counters, 0)
        self.board.output.counters = BoardCounters()
        super()._greet(hello, request)


class DiesOnJunk(BoardConnection):
    """Hangs for good at a frame that is no COBS."""

    _dead = False

    def count(self, reason: str, number: int = 1) -> None:
        """Hang."""
        super().count(reason, number)
        self._dead = self._dead or reason == "cobs"

    def next_event(self) -> Any:
        """Return the next event, as long as it lives."""
        return NEED_DATA if self._dead else super().next_event()

    def receive_data(self, data: bytes, now_us: int) -> None:
        """Take bytes, as long as it lives."""
        if not self._dead:
            super().receive_data(data, now_us)


class LeaksOnJunk(VirtualHaptogramDialect):
    """Loses a buffer of 512 bytes with every damaged frame, and hears nothing once none is left."""

    @property
    def _leaked(self) -> int:
        return 512 * sum(self._link.counters[name] for name in _DAMAGE)

    def receive(self, data: bytes, t_us: int) -> None:
        """Take bytes, as long as there is a buffer for them."""
        if self._leaked < _LEAK_BYTES:
            super().receive(data, t_us)
        else:
            self.advance_to(t_us)

    def _status(self) -> Any:
        fields = super()._status()
        return (*fields[:3], max(0, fields[3] - self._leaked), *fields[4:])


class LeaksSlowly(VirtualHaptogramDialect):
    """Loses 256 bytes of 512 KiB with every damaged frame, unsaid, and is deaf in the end."""

    def receive(self, data: bytes, t_us: int) -> None:
        """Take bytes, as long as there is memory."""
        if 256 * sum(self._link.counters[name] for name in _DAMAGE) < 512 << 10:
            super().receive(data, t_us)
        else:
            self.advance_to(t_us)


class RestartsOnJunk(VirtualHaptogramDialect):
    """Loses its session at a frame that is no COBS."""

    _seen = 0

    def receive(self, data: bytes, t_us: int) -> None:
        """Take bytes; restart because of some."""
        super().receive(data, t_us)
        if self._link.counters["cobs"] > self._seen:
            self._seen = self._link.counters["cobs"]
            self.board.disarm()
            self.board.output.session = self._link.session = 0


class StatusNeverSent(VirtualHaptogramDialect):
    """Sends no STATUS by itself."""

    def _schedule_status(self) -> None:
        self._next_status_us = None


class MarginsKept(VirtualHaptogramDialect):
    """Goes on with the old arrival margins after it has reported them."""

    def _status(self) -> Any:
        margins = self.board.margins
        kept = margins.count, margins.least_us, margins.total_us
        fields = super()._status()
        margins.count, margins.least_us, margins.total_us = kept
        return fields


class RingClaimed(BoardOutput):
    """Advertises a trace ring and keeps one latch in it."""

    @property
    def ring(self) -> list[Any]:
        """The last latch only."""
        return super().ring[-1:]


class ReservedBitClaimed(VirtualHaptogramDialect):
    """Advertises SYNC_IN, which is reserved."""

    def _greet(self, hello: Hello, request: Any) -> None:
        settings = self.board.settings
        lie = settings.features | Feature.SYNC_IN
        self.board.settings = dataclasses.replace(settings, features=lie)
        super()._greet(hello, request)


_WIRE, _SELF = Evidence.WIRE, Evidence.SELF_REPORTED


class GapsUncounted(BoardConnection):
    """Does not count the stream frames that are missing."""

    def count(self, reason: str, number: int = 1) -> None:
        """Leave gaps out."""
        super().count(reason, 0 if reason == "gap" else number)


MUTANTS: Final = (
    Mutant.of(GapsUncounted, "HG-5.5/2", _SELF),
    Mutant.of(SequenceOf8Bits, "HG-5.5/2", _SELF),
    Mutant.of(UnwrappedTo24Bits, "HG-3.6/5", _SELF),
    Mutant.of(SequenceNeverWraps, "HG-3.6/1", _SELF),
    Mutant.of(StaleSessionTaken, "HG-3.7/2", _SELF),
    Mutant.of(DuplicatesApplied, "HG-5.5/1", _SELF),
    Mutant.of(RepetitionsDone, "HG-4.9/1", _WIRE),
    Mutant.of(OldRequestsDone, "HG-4.9/3", _WIRE),
    Mutant.of(HelloAlwaysAnew, "HG-4.6/1", _WIRE),
    Mutant.of(HelloStartsAtZero, "HG-4.6/6", _WIRE),
    Mutant.of(EventsFirst, "HG-4.11/5", _WIRE),
    Mutant.of(VersionIgnored, "HG-4.4/1", _WIRE),
    Mutant.of(EventNumbersStuck, "HG-3.6/2", _WIRE),
    Mutant.of(CountersStuck, "HG-3.9/1", _SELF),
    Mutant.of(FramesUncounted, "HG-3.9/2", _SELF),
    Mutant.of(CountersCleared, "HG-4.6/5", _SELF),
    Mutant.of(DiesOnJunk, "HG-3.9/3", _WIRE),
    Mutant.of(LeaksOnJunk, "HG-3.9/4", _WIRE),
    Mutant.of(LeaksSlowly, "HG-3.9/4", _WIRE),
    Mutant.of(RestartsOnJunk, "HG-3.9/3", _WIRE),
    Mutant.of(StatusNeverSent, "HG-9.1/1", _WIRE),
    Mutant.of(MarginsKept, "HG-9.3/1", _SELF),
    Mutant.of(RingClaimed, "HG-8.5/1", _SELF),
    Mutant.of(ReservedBitClaimed, "HG-11.5/1", _WIRE),
)
