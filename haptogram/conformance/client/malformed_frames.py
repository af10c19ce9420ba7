"""Bytes that no host may send, and frames of the longest and shortest kind."""

from __future__ import annotations

import random
import zlib
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Final

from haptogram_protocol import messages as m
from haptogram_protocol.cobs import cobs_encode
from haptogram_protocol.framing import encode_frame
from haptogram_protocol.record import Record

from .request_client import RequestClient

_ZEROS: Final = 64
_TOO_LONG: Final = 4200
BLOCK: Final = 254  # HG-2.2: longest piece of COBS without a zero


def malformed_frame(data: bytes) -> bytes:
    """Return *data*, which ends with its CRC, stuffed and between delimiters."""
    return b"\x00" + cobs_encode(data) + b"\x00"


def malformed_with_crc(body: bytes) -> bytes:
    """Return a body and its CRC-32."""
    return body + zlib.crc32(body).to_bytes(4, "little")


def malformed_with_wrong_crc(body: bytes, flip: int = 1) -> bytes:
    """Return a body and a wrong CRC-32: the right one with the bits *flip* inverted."""
    return body + (zlib.crc32(body) ^ flip).to_bytes(4, "little")


def malformed_noise(source: random.Random, size: int) -> bytes:
    """Return random bytes without a zero, so that they end no frame."""
    return source.randbytes(size).replace(b"\x00", b"\x01")


def malformed_ping(link: RequestClient, flip: int = 1) -> bytes:
    """Return a PING of the next number, which it does not use up, with a wrong CRC-32."""
    body = link.body(m.Ping.TYPE, bytes(8), seq=link.seq + 1)
    return malformed_frame(malformed_with_wrong_crc(body, flip))


def malformed_by_counter(link: RequestClient) -> dict[str, bytes]:
    """Return bytes that no host may send, by the one counter that counts them."""
    body = link.body(m.Ping.TYPE, bytes(8), seq=link.seq + 1)
    return {
        "crc": malformed_ping(link, 1 << link.random.randrange(32)),
        "cobs": b"\x00\xff\x01\x02\x00",
        "short": malformed_frame(malformed_with_crc(body[:9])),
        "oversize": b"\x00" + malformed_noise(link.random, _TOO_LONG) + b"\x00",
        "unknown_type": encode_frame(link.body(0xEE, seq=0)),
    }


def _malformed_mute(link: RequestClient, payload: bytes) -> tuple[bytes, int]:
    """Return body and number of a MUTE that carries *payload*.

    A board carries MUTE out with any payload (HG-6.4/1), so MUTE_REPLY proves that it read this
    frame.
    """
    seq = link.next_seq()
    return link.body(m.Mute.TYPE, payload, seq=seq), seq


def malformed_mute_with_run(link: RequestClient, run: int) -> tuple[bytes, int]:
    """Return a MUTE with its CRC that ends with exactly *run* bytes that are not zero."""
    for filler in range(1, 256):
        payload = bytes([0] + [filler] * (run - 4))
        body, seq = _malformed_mute(link, payload)
        if 0 not in malformed_with_crc(body)[-4:]:
            return malformed_with_crc(body), seq
    raise AssertionError("one of 255 checksums has no zero byte")


def malformed_mute_of_size(link: RequestClient, size: int) -> tuple[bytes, int]:
    """Return a MUTE of *size* stuffed bytes, without delimiters, and its number."""
    for zeros in range(_ZEROS):
        # Where a piece is full one byte more takes two: a zero elsewhere shifts the pieces.
        payload = bytearray(malformed_noise(link.random, size))
        payload[1 : 1 + zeros] = bytes(zeros)
        for length in range(size - 60, size):
            body, seq = _malformed_mute(link, bytes(payload[:length]))
            encoded = cobs_encode(malformed_with_crc(body))
            if len(encoded) == size:
                return encoded, seq
    raise AssertionError(f"no frame of {size} bytes was found")


# --- values of no table ------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class ValueByte:
    """A byte of a payload that may have some values only."""

    name: str
    offset: int
    allowed: Collection[int]

    def wrong_values(self, *, thorough: bool) -> list[int]:
        """Return the values that are not allowed: all, or those a bit away from an allowed one."""
        near = {value ^ 1 << bit for value in self.allowed for bit in range(8)} | {0xFF}
        return sorted((set(range(0x100)) if thorough else near) - set(self.allowed))

    def put(self, payload: bytes, value: int) -> bytes:
        """Return *payload* with *value* in this byte."""
        return payload[: self.offset] + bytes([value]) + payload[self.offset + 1 :]


def value_bytes(kind: type[Record], at: int = 0) -> Iterator[ValueByte]:
    """Yield the bytes of a record that may have some values only, those of its records too."""
    for name, form in kind.WIRE.items():
        offset = at + form.offset
        if form.record is not None:
            yield from value_bytes(form.record, offset)
        elif form.enumeration is not None:
            yield ValueByte(name, offset, [int(value) for value in form.enumeration])


# --- other checksums, to name the one that a board uses ----------------------------------------


def _malformed_crc16(data: bytes, polynomial: int, start: int, *, reflected: bool) -> int:
    """Return the CRC-16 of *data*, bit by bit, from the register *start* on.

    *polynomial* has its low bits first if *reflected*, as the register then has.
    """
    register = start
    for byte in data:
        register ^= byte if reflected else byte << 8
        for _ in range(8):
            if reflected:
                register = register >> 1 ^ (polynomial if register & 1 else 0)
            else:
                register = register << 1 ^ (polynomial if register & 0x8000 else 0)
    return register & 0xFFFF


def _malformed_crc32c(data: bytes) -> int:
    """Return the CRC-32 of Castagnoli, bit by bit."""
    register = 0xFFFFFFFF
    for byte in data:
        register ^= byte
        for _ in range(8):
            register = register >> 1 ^ (0x82F63B78 if register & 1 else 0)
    return register ^ 0xFFFFFFFF


def malformed_checksums(body: bytes) -> dict[str, bytes]:
    """Return *body* with each checksum that a board may use in place of CRC-32, by name."""
    right = zlib.crc32(body)
    ccitt = _malformed_crc16(body, 0x1021, 0xFFFF, reflected=False)
    xmodem = _malformed_crc16(body, 0x1021, 0, reflected=False)
    arc = _malformed_crc16(body, 0xA001, 0, reflected=True)
    ends = {
        "CRC-16/CCITT in 2 bytes": ccitt.to_bytes(2, "little"),
        "CRC-16/CCITT in 4 bytes": ccitt.to_bytes(4, "little"),
        "CRC-16/CCITT twice": ccitt.to_bytes(2, "little") * 2,
        "CRC-16/XMODEM in 2 bytes": xmodem.to_bytes(2, "little"),
        "CRC-16/XMODEM in 4 bytes": xmodem.to_bytes(4, "little"),
        "CRC-16/ARC in 2 bytes": arc.to_bytes(2, "little"),
        "CRC-16/ARC in 4 bytes": arc.to_bytes(4, "little"),
        "CRC-32C": _malformed_crc32c(body).to_bytes(4, "little"),
        "CRC-32 with the highest byte first": right.to_bytes(4, "big"),
        "CRC-32 without the final XOR": (right ^ 0xFFFFFFFF).to_bytes(4, "little"),
        "the low 16 bits of CRC-32": (right & 0xFFFF).to_bytes(4, "little"),
        "no checksum": b"\x00\x00\x00\x00",
    }
    return {
        name: body + end for name, end in ends.items() if body + end != malformed_with_crc(body)
    }
