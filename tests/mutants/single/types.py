"""Boards that are wrong at one type, one length or one field of a frame.  SPEC.md 2, 3, 4."""

from __future__ import annotations

import dataclasses
import zlib
from typing import Any, Final

from haptogram.records.frame import Evidence
from haptogram_protocol.cobs import cobs_decode
from haptogram_protocol.connection import BoardConnection, FrameDropped
from haptogram_protocol.errors import RemoteProtocolError
from haptogram_protocol.framing import CRC_BYTES, DELIMITER, HEADER_BYTES, FrameDecoder
from haptogram_protocol.messages import (
    REQUEST_RANGE,
    RESPONSE_RANGE,
    ErrorCode,
    Flag,
    Hello,
    MessageType,
    Mute,
    Play,
    Status,
    signed_difference,
)
from sim_device.dialects.haptogram import VirtualHaptogramDialect
from sim_device.mutants import Mutant

_LONG: Final = 2048
_ANSWER_BYTES: Final = 128  # of a memory for one reply
_FULL: Final = 0xFF
_ENDS_KEPT: Final = 64
_FRAME_US: Final = 200


class LongFramesUnchecked(FrameDecoder):
    """Does not check the CRC of frames of more than 2048 bytes."""

    def _decode(self, encoded: bytes) -> bytes | RemoteProtocolError:
        found = super()._decode(encoded)
        damaged = isinstance(found, RemoteProtocolError) and found.reason == "crc"
        taken = damaged and len(encoded) > _LONG
        return cobs_decode(encoded)[:-CRC_BYTES] if taken else found


class MuteFoundByItsType(FrameDecoder):
    """Finds MUTE among the bytes by its type and length, before it has compared a CRC."""

    def _decode(self, encoded: bytes) -> bytes | RemoteProtocolError:
        found = super()._decode(encoded)
        damaged = isinstance(found, RemoteProtocolError) and found.reason == "crc"
        is_mute = encoded[1:2] == bytes([MessageType.MUTE])
        return cobs_decode(encoded)[:-CRC_BYTES] if damaged and is_mute else found


class FewFramesAtOnce(BoardConnection):
    """Needs 200 us for a frame, keeps the ends of 64 that wait, and loses those that come then."""

    _waiting = 0.0
    _last_us = 0

    def receive_data(self, data: bytes, now_us: int) -> None:
        """Take bytes, unless too many frames wait."""
        self._waiting = max(0.0, self._waiting - (now_us - self._last_us) / _FRAME_US)
        self._last_us = now_us
        self._waiting += data.count(DELIMITER) / 2
        if self._waiting <= _ENDS_KEPT:
            super().receive_data(data, now_us)


class PiecesOf253(FrameDecoder):
    """Takes a piece of 253 bytes for a full one, in frames of more than 512 bytes."""

    def _decode(self, encoded: bytes) -> bytes | RemoteProtocolError:
        if len(encoded) > 512 and _FULL - 1 in _mutant_codes(encoded)[:-1]:
            return RemoteProtocolError("a zero is lost", reason="crc")
        return super()._decode(encoded)


class ZeroBehindFullPieceLost(BoardConnection):
    """Loses a zero that follows exactly 254 other bytes in a frame that it sends."""

    def _queue(self, wire: bytes, limit: int) -> bool:
        out, at, behind_full = bytearray(), 1, False
        while at < len(wire) - 1:
            code = wire[at]
            lost = behind_full and code == 1
            out += b"" if lost else wire[at : at + code]
            at, behind_full = at + code, code == _FULL
        return super()._queue(wire[:1] + bytes(out) + wire[-1:], limit)


class ChunkOfFourBytes(BoardConnection):
    """Says of an UPLOAD_CHUNK that is too short that 4 bytes is its length, which varies."""

    def _refuse(self, frame: Any, code: ErrorCode, number: int, **how: Any) -> Any:
        is_chunk = frame.header.type == MessageType.UPLOAD_CHUNK and code is ErrorCode.BAD_LENGTH
        return super()._refuse(frame, code, 4 if is_chunk else number, **how)


class PlayComparesAllFlags(BoardConnection):
    """Takes IMMEDIATE in PLAY only if no other flag is set beside it."""

    def _request(self, frame: Any, message: Any, **how: Any) -> Any:
        event = super()._request(frame, message, **how)
        if not isinstance(message, Play):
            return event
        return dataclasses.replace(event, immediate=frame.header.flags == Flag.IMMEDIATE)


class _PartOfRequest(BoardConnection):
    """Remembers a request by some of its bytes."""

    def part(self, body: bytes) -> bytes:
        """Return the bytes that count."""
        raise NotImplementedError

    def _judge_request(self, frame: Any) -> Any:
        body = frame.header.pack() + frame.payload
        return super()._judge_request(dataclasses.replace(frame, crc=zlib.crc32(self.part(body))))


class TimeForgotten(_PartOfRequest):
    """Takes a request with another time in its header for the remembered one."""

    def part(self, body: bytes) -> bytes:
        """Return all but the time."""
        return body[:4] + body[8:]


class FlagsForgotten(_PartOfRequest):
    """Takes a request with other flags for the remembered one."""

    def part(self, body: bytes) -> bytes:
        """Return all but the flags."""
        return body[:1] + body[2:]


class TailForgotten(_PartOfRequest):
    """Takes a request whose ninth byte of the payload, or a later one, differs for the same."""

    def part(self, body: bytes) -> bytes:
        """Return header and 8 bytes."""
        return body[: HEADER_BYTES + 8]


class ChunkForgetsReply(BoardConnection):
    """Forgets the reply that it remembers when an UPLOAD_CHUNK comes."""

    def _judge_control_seq(self, frame: Any) -> Any:
        if frame.header.type == MessageType.UPLOAD_CHUNK:
            self._answered = None
        return super()._judge_control_seq(frame)


class LongRepliesForgotten(BoardConnection):
    """Remembers no reply of more than 128 bytes."""

    def _answer(self, request: Any, message: Any, now_us: int) -> None:
        super()._answer(request, message, now_us)
        if self._answered is not None and len(self._answered.wire) > _ANSWER_BYTES:
            self._answered = None


class RepeatedHelloTakesItsNumber(BoardConnection):
    """Takes the number of a repeated HELLO for the newest one of the session."""

    def _judge_hello(self, frame: Any, hello: Hello) -> Any:
        event = super()._judge_hello(frame, hello)
        again = isinstance(event, FrameDropped) and event.reason == "repeated"
        if again and signed_difference(frame.header.seq, self._control_newest, 16) > 0:
            self._control_newest = frame.header.seq
        return event


class MuteReplyOfItsSession(BoardConnection):
    """Sends MUTE_REPLY with the session of the MUTE, not with the open one."""

    _echoed: int | None = None

    def reply(self, request: Any, message: Any, now_us: int) -> None:
        """Answer."""
        self._echoed = request.session if isinstance(request.message, Mute) else None
        super().reply(request, message, now_us)
        self._echoed = None

    def _response(self, message: Any, seq: int, now_us: int, session: int | None = None) -> bytes:
        return super()._response(
            message, seq, now_us, session if self._echoed is None else self._echoed
        )


class ChunkUsesNoNumber(BoardConnection):
    """Leaves the number of an UPLOAD_CHUNK free."""

    def _request(self, frame: Any, message: Any, **how: Any) -> Any:
        newest = self._control_newest
        event = super()._request(frame, message, **how)
        if frame.header.type == MessageType.UPLOAD_CHUNK:
            self._control_newest = newest
        return event


class WrongConfigUsesItsNumber(BoardConnection):
    """Takes the number of a SET_CONFIG of a wrong length for used."""

    def _refuse(self, frame: Any, code: ErrorCode, number: int, **how: Any) -> Any:
        if frame.header.type == MessageType.SET_CONFIG and code is ErrorCode.BAD_LENGTH:
            self._control_newest = frame.header.seq
        return super()._refuse(frame, code, number, **how)


class StopCountedAgain(BoardConnection):
    """Counts a repeated STOP in `requests` as well as in `repeated`."""

    def _judge_control_seq(self, frame: Any) -> Any:
        event = super()._judge_control_seq(frame)
        again = event is not None and event.reason == "repeated"
        self.count("requests", int(again and frame.header.type == MessageType.STOP))
        return event


class StatusSaysLate(BoardConnection):
    """Leaves LATE set in STATUS behind the trace of a late latch."""

    _late = False

    def send_event(self, message: Any, *, flags: int = 0, **how: Any) -> bool:
        """Send an event."""
        is_status = isinstance(message, Status)
        self._late = self._late if is_status else bool(flags & Flag.LATE)
        return super().send_event(message, flags=flags | Flag.LATE * self._late, **how)


class NonceOf8Bits(BoardConnection):
    """Takes a HELLO whose nonce has the low byte of the open one for its repetition."""

    def _judge_hello(self, frame: Any, hello: Hello) -> Any:
        if self.session and hello.nonce and not (hello.nonce ^ self.session) & 0xFF:
            hello = dataclasses.replace(hello, nonce=self.session)
        return super()._judge_hello(frame, hello)


class StreamSessionOf8Bits(BoardConnection):
    """Compares the session of stream frames by its low byte."""

    def _judge_stream(self, frame: Any) -> Any:
        same = self.session and not (frame.header.session ^ self.session) & 0xFF
        return super()._judge_stream(dataclasses.replace(frame, in_session=bool(same)))


class GapOf8Bits(BoardConnection):
    """Counts missing stream frames modulo 256."""

    def count(self, reason: str, number: int = 1) -> None:
        """Count."""
        super().count(reason, number & 0xFF if reason == "gap" else number)


class EventsOfOthersAreStale(BoardConnection):
    """Counts a response or event of another session as one of a stale session."""

    def _judge(self, body: bytes, t_rx_us: int) -> Any:
        stale = int.from_bytes(body[8:10], "little") != self.session
        self._stale = stale and body[0] >= RESPONSE_RANGE.start
        return super()._judge(body, t_rx_us)

    _stale = False

    def _drop(self, frame: Any, reason: str) -> Any:
        return super()._drop(frame, "stale_session" if self._stale else reason)


class UnknownRequestsOfOthersAreStale(BoardConnection):
    """Looks at the session of a request before its type."""

    def _judge_request(self, frame: Any) -> Any:
        if frame.header.type in REQUEST_RANGE and not frame.in_session:
            known = frame.header.type in (MessageType.HELLO, MessageType.MUTE)
            if not known:
                return self._refuse(frame, ErrorCode.STALE_SESSION, self.session)
        return super()._judge_request(frame)


class RefusedPlayUncounted(BoardConnection):
    """Leaves a PLAY that the board refuses out of `requests`."""

    def refuse(self, request: Any, code: ErrorCode, detail: int, now_us: int) -> None:
        """Refuse."""
        super().refuse(request, code, detail, now_us)
        self.count("requests", -isinstance(request.message, Play))


class DamageRenewsPlayback(VirtualHaptogramDialect):
    """Renews the unattended time for a frame with a wrong CRC."""

    def _dispatch(self, event: Any) -> None:
        damaged = isinstance(event, FrameDropped) and event.reason == "crc"
        if damaged and self.board.output.unattended_ms is not None:
            self.board.output.renew_lease()
        super()._dispatch(event)


def _mutant_codes(encoded: bytes) -> list[int]:
    """Return the code bytes of a frame."""
    found, at = [], 0
    while at < len(encoded) and encoded[at]:
        found.append(encoded[at])
        at += encoded[at]
    return found


_WIRE, _SELF = Evidence.WIRE, Evidence.SELF_REPORTED

MUTANTS: Final = (
    Mutant.of(MuteFoundByItsType, "HG-2.4/2", _WIRE),
    Mutant.of(FewFramesAtOnce, "HG-2.7/2", _SELF),
    Mutant.of(LongFramesUnchecked, "HG-2.4/2", _WIRE),
    Mutant.of(PiecesOf253, "HG-2.2/1", _WIRE),
    Mutant.of(ZeroBehindFullPieceLost, "HG-2.2/1", _WIRE, array="16x16"),
    Mutant.of(ChunkOfFourBytes, "HG-3.2/4", _WIRE),
    Mutant.of(PlayComparesAllFlags, "HG-3.4/2", _WIRE),
    Mutant.of(TimeForgotten, "HG-4.9/2", _WIRE),
    Mutant.of(FlagsForgotten, "HG-4.9/2", _WIRE),
    Mutant.of(TailForgotten, "HG-4.9/2", _WIRE),
    Mutant.of(ChunkForgetsReply, "HG-4.10/1", _WIRE),
    Mutant.of(LongRepliesForgotten, "HG-4.9/1", _WIRE),
    Mutant.of(RepeatedHelloTakesItsNumber, "HG-4.6/1", _WIRE),
    Mutant.of(MuteReplyOfItsSession, "HG-4.11/1", _WIRE),
    Mutant.of(ChunkUsesNoNumber, "HG-4.10/1", _WIRE),
    Mutant.of(WrongConfigUsesItsNumber, "HG-4.9/4", _WIRE),
    Mutant.of(StopCountedAgain, "HG-4.9/1", _SELF),
    Mutant.of(StatusSaysLate, "HG-3.4/3", _WIRE),
    Mutant.of(NonceOf8Bits, "HG-4.6/2", _WIRE),
    Mutant.of(StreamSessionOf8Bits, "HG-3.7/2", _SELF),
    Mutant.of(GapOf8Bits, "HG-5.5/2", _SELF),
    Mutant.of(EventsOfOthersAreStale, "HG-3.3/2", _SELF),
    Mutant.of(UnknownRequestsOfOthersAreStale, "HG-3.8/1", _WIRE),
    Mutant.of(RefusedPlayUncounted, "HG-3.9/2", _SELF),
    Mutant.of(DamageRenewsPlayback, "HG-2.4/2", _WIRE),
)
