"""Boards that get the bytes wrong.  SPEC.md chapters 2 and 3."""

from __future__ import annotations

import binascii
from typing import Any, Final

from haptogram.records.frame import Evidence
from haptogram_protocol.cobs import BLOCK, Cobs, cobs_decode, cobs_encode
from haptogram_protocol.connection import BoardConnection
from haptogram_protocol.errors import RemoteProtocolError
from haptogram_protocol.framing import (
    CRC_BYTES,
    DELIMITER,
    HEADER_BYTES,
    FrameDecoder,
    encode_frame,
)
from haptogram_protocol.messages import MESSAGES, Error, ErrorCode, MessageType
from sim_device.dialects.haptogram import VirtualHaptogramDialect
from sim_device.mutants import Mutant

_QUIET_US: Final = 5_000
_LONG_PAUSE_US: Final = 1_000_000
_FIRMWARE_BUFFER: Final = 512


class CrcHalf(FrameDecoder):
    """Compares 16 bits of the CRC only."""

    def _decode(self, encoded: bytes) -> bytes | RemoteProtocolError:
        found = super()._decode(encoded)
        if not isinstance(found, RemoteProtocolError) or found.reason != "crc":
            return found
        decoded = cobs_decode(encoded)
        body = decoded[:-CRC_BYTES]
        right = cobs_decode(encode_frame(body)[1:-1])[-CRC_BYTES:]
        return body if decoded[-CRC_BYTES:-2] == right[:2] else found


class Crc16(BoardConnection):
    """Has CRC-16/CCITT in place of CRC-32, in both directions."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options | {"decoder": _Crc16Decoder()})

    def _queue(self, wire: bytes, limit: int) -> bool:
        body = cobs_decode(wire[1:-1])[:-CRC_BYTES]
        return super()._queue(
            DELIMITER + cobs_encode(body + _mutant_crc16(body)) + DELIMITER, limit
        )


class _Crc16Decoder(FrameDecoder):
    def _decode(self, encoded: bytes) -> bytes | RemoteProtocolError:
        found = super()._decode(encoded)
        if isinstance(found, RemoteProtocolError) and found.reason != "crc":
            return found
        decoded = cobs_decode(encoded)
        body = decoded[:-CRC_BYTES]
        right = decoded[-CRC_BYTES:] == _mutant_crc16(body)
        return body if right else RemoteProtocolError("CRC-16 is wrong", reason="crc")


class CobsAt254(FrameDecoder):
    """Adds a zero behind every full piece, as if its code byte were an ordinary one."""

    def __init__(self) -> None:
        super().__init__(Cobs(decode=_mutant_cobs_encoding))


class SpareCodeByteSent(BoardConnection):
    """Begins the next piece as soon as one is full: a code byte 01 ends some of its frames."""

    def _queue(self, wire: bytes, limit: int) -> bool:
        run = len(cobs_decode(wire[1:-1]).rpartition(DELIMITER)[2])
        is_full = run > 0 and run % BLOCK == 0
        return super()._queue(wire[:-1] + b"\x01\x00" if is_full else wire, limit)


class TextBetweenFrames(BoardConnection):
    """Prints a line of text for whoever debugs it when its output state changes by itself."""

    def _queue(self, wire: bytes, limit: int) -> bool:
        says = wire[2] == MessageType.STATE_CHANGED
        return super()._queue(b"muted by a timer\r\n" + wire if says else wire, limit)


class SpareCodeByteRefused(FrameDecoder):
    """Refuses the code byte 01 that some encoders add behind a full piece."""

    def _decode(self, encoded: bytes) -> bytes | RemoteProtocolError:
        found = super()._decode(encoded)
        if isinstance(found, bytes) and encode_frame(found)[1:-1] != encoded:
            return RemoteProtocolError("not the shortest form", reason="cobs")
        return found


class CobsErrorIsShort(FrameDecoder):
    """Counts a code byte that points past the end as a frame that is too short."""

    def _decode(self, encoded: bytes) -> bytes | RemoteProtocolError:
        found = super()._decode(encoded)
        if isinstance(found, RemoteProtocolError) and found.reason == "cobs":
            return RemoteProtocolError(str(found), reason="short")
        return found


class SharedDelimiterRefused(FrameDecoder):
    """Wants a zero of its own before every frame."""

    _after_zero = False
    _owned = True

    def feed(self, chunk: bytes) -> list[bytes | RemoteProtocolError]:
        """Drop, uncounted, what began with the zero that ended the frame before."""
        found: list[bytes | RemoteProtocolError] = []
        for k in range(len(chunk)):
            byte = chunk[k : k + 1]
            ended = super().feed(byte)
            found += ended if self._owned else []
            if byte == DELIMITER:
                self._owned, self._after_zero = self._after_zero, True
            else:
                self._after_zero = False
        return found


class EmptyFramesCounted(FrameDecoder):
    """Counts nothing between two zeros as a frame that is too short."""

    _last = b""

    def feed(self, chunk: bytes) -> list[bytes | RemoteProtocolError]:
        """Report empty frames too."""
        line = self._last + chunk
        self._last = line[-1:]
        zeros = sum(line[k : k + 2] == DELIMITER * 2 for k in range(len(line) - 1))
        empty = RemoteProtocolError("empty frame", reason="short")
        return super().feed(chunk) + [empty] * zeros


class BufferOf512(FrameDecoder):
    """Has no room for frames of more than 512 bytes."""

    def _decode(self, encoded: bytes) -> bytes | RemoteProtocolError:
        if len(encoded) > _FIRMWARE_BUFFER:
            return RemoteProtocolError("no room", reason="oversize")
        return super()._decode(encoded)


class OversizeCountedAgain(FrameDecoder):
    """Counts a run that is too long again after every 4096 bytes of it."""

    def feed(self, chunk: bytes) -> list[bytes | RemoteProtocolError]:
        """Begin anew inside a run."""
        found: list[bytes | RemoteProtocolError] = []
        for byte in (chunk[k : k + 1] for k in range(len(chunk))):
            found += super().feed(byte)
            self._discarding = False
        return found


class ResyncByTimeout(BoardConnection):
    """Hears nothing after a damaged frame until the line was quiet for 5 ms."""

    _deaf = False
    _last_us = 0

    def receive_data(self, data: bytes, now_us: int) -> None:
        """Take bytes, unless it waits for a pause."""
        self._deaf = self._deaf and now_us - self._last_us < _QUIET_US
        self._last_us = now_us
        if not self._deaf:
            super().receive_data(data, now_us)

    def count(self, reason: str, number: int = 1) -> None:
        """Go deaf because of damage."""
        super().count(reason, number)
        if reason in ("crc", "cobs", "short", "oversize"):
            self._deaf = True


class PauseEndsTheFrame(BoardConnection):
    """Forgets the bytes of a frame if the line pauses for a second within it."""

    _last_us = 0

    def receive_data(self, data: bytes, now_us: int) -> None:
        """Take bytes; behind a pause they begin anew."""
        if now_us - self._last_us > _LONG_PAUSE_US:
            self._forget_received()
        self._last_us = now_us
        super().receive_data(data, now_us)


class BytesRenewTheLease(VirtualHaptogramDialect):
    """Renews the lease with every byte that comes: the host is not silent."""

    def receive(self, data: bytes, t_us: int) -> None:
        """Take bytes."""
        super().receive(data, t_us)
        if self._link.session and data.strip(DELIMITER):
            self.board.output.renew_lease()


class ArrivalOfFirstByte(BoardConnection):
    """Takes the time at which a frame begins for that of its arrival."""

    _began_us, _is_within = 0, False

    def receive_data(self, data: bytes, now_us: int) -> None:
        """Note when a frame begins."""
        if not self._is_within:
            self._began_us = now_us
        self._is_within = not data.endswith(DELIMITER)
        super().receive_data(data, now_us)

    def _judge(self, body: bytes, t_rx_us: int) -> Any:
        return super()._judge(body, min(self._began_us, t_rx_us))


class LengthTrusted(BoardConnection):
    """Reads what it knows of a payload and does not mind what follows."""

    def _judge(self, body: bytes, t_rx_us: int) -> Any:
        kind = MESSAGES.get(body[0])
        fixed = kind is not None and not kind.TAIL
        size = HEADER_BYTES + kind.LAYOUT.size if kind is not None and fixed else len(body)
        return super()._judge(body[:size], t_rx_us)


class LowFlagsRefused(BoardConnection):
    """Drops stream frames with a bit in the low nibble of the flags, which it must ignore."""

    def _judge_stream(self, frame: Any) -> Any:
        if frame.header.flags & 0x0F:
            return self._drop(frame, "unsupported")
        return super()._judge_stream(frame)


class UnknownFlagsTaken(BoardConnection):
    """Does not look at flags that it must understand."""

    def _judge(self, body: bytes, t_rx_us: int) -> Any:
        return super()._judge(body[:1] + bytes([body[1] & 0x1F]) + body[2:], t_rx_us)


class UnknownTypeIsDamage(BoardConnection):
    """Counts a stream frame of an unknown type as one with a wrong CRC."""

    def _drop(self, frame: Any, reason: str) -> Any:
        return super()._drop(frame, "crc" if reason == "unknown_type" else reason)


class NumbersAligned(FrameDecoder):
    """Reads the 64 bits of a PING from the even address before them."""

    _address = _begins = 0

    def feed(self, chunk: bytes) -> list[bytes | RemoteProtocolError]:
        """Return the frames as this board reads them."""
        found: list[bytes | RemoteProtocolError] = []
        for byte in chunk:
            self._address += 1
            found += [self._read(frame) for frame in super().feed(bytes([byte]))]
            if byte == 0:
                self._begins = self._address
        return found

    def _read(self, frame: bytes | RemoteProtocolError) -> bytes | RemoteProtocolError:
        if isinstance(frame, RemoteProtocolError) or frame[0] != MessageType.PING:
            return frame
        back = self._begins % 2
        return frame[:HEADER_BYTES] + frame[HEADER_BYTES - back : len(frame) - back]


class StreamAnswered(BoardConnection):
    """Answers a stream frame that it drops with ERROR."""

    def _judge_stream(self, frame: Any) -> Any:
        event = super()._judge_stream(frame)
        if hasattr(event, "reason"):
            error = Error(frame.header.type, ErrorCode.BAD_VALUE, 0)
            self._queue(self._response(error, frame.header.seq, frame.t_rx_us), 1 << 14)
        return event


class CountersBigEndian(VirtualHaptogramDialect):
    """Sends its counters with the highest byte first."""

    @property
    def counters(self) -> dict[str, int]:
        """Every counter, its bytes swapped."""
        right = super().counters
        return {n: int.from_bytes(v.to_bytes(4, "little"), "big") for n, v in right.items()}


def _mutant_crc16(body: bytes) -> bytes:
    return binascii.crc_hqx(body, 0xFFFF).to_bytes(CRC_BYTES, "little")


def _mutant_cobs_encoding(encoded: bytes) -> bytes:
    out, start = bytearray(), 0
    while start < len(encoded):
        stop = start + encoded[start]
        if stop > len(encoded):
            raise RemoteProtocolError("points past the end", reason="cobs")
        out += encoded[start + 1 : stop] + DELIMITER
        start = stop
    return bytes(out[:-1])


_WIRE, _SELF = Evidence.WIRE, Evidence.SELF_REPORTED

MUTANTS: Final = (
    Mutant.of(CrcHalf, "HG-2.4/2", _WIRE),
    Mutant.of(Crc16, "HG-2.4/1", _WIRE),
    Mutant.of(CobsAt254, "HG-2.2/1", _WIRE),
    Mutant.of(SpareCodeByteSent, "HG-2.2/1", _WIRE, array="16x16"),
    Mutant.of(TextBetweenFrames, "HG-2.2/1", _WIRE),
    Mutant.of(SpareCodeByteRefused, "HG-2.2/3", _WIRE),
    Mutant.of(CobsErrorIsShort, "HG-2.2/2", _SELF),
    Mutant.of(SharedDelimiterRefused, "HG-2.1/2", _WIRE),
    Mutant.of(EmptyFramesCounted, "HG-2.3/1", _SELF),
    Mutant.of(BufferOf512, "HG-2.6/2", _WIRE),
    Mutant.of(OversizeCountedAgain, "HG-2.6/3", _SELF),
    Mutant.of(ResyncByTimeout, "HG-2.1/3", _WIRE),
    Mutant.of(PauseEndsTheFrame, "HG-2.1/3", _WIRE),
    Mutant.of(BytesRenewTheLease, "HG-6.7/1", _WIRE),
    Mutant.of(LengthTrusted, "HG-3.2/4", _WIRE),
    Mutant.of(LowFlagsRefused, "HG-3.4/2", _SELF),
    Mutant.of(ArrivalOfFirstByte, "HG-6.9/2", _WIRE),
    Mutant.of(UnknownFlagsTaken, "HG-3.4/1", _WIRE),
    Mutant.of(UnknownTypeIsDamage, "HG-3.3/2", _SELF),
    Mutant.of(StreamAnswered, "HG-10.1/2", _WIRE),
    Mutant.of(CountersBigEndian, "HG-3.2/1", _SELF),
    Mutant.of(NumbersAligned, "HG-3.2/6", _WIRE),
)
