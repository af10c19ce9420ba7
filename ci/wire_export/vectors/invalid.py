"""Bytes that a receiver must drop, each with the counter that counts them."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from typing import Any, Final

from haptogram_protocol import messages as m
from haptogram_protocol.cobs import cobs_encode
from haptogram_protocol.framing import CRC_BYTES, HEADER_BYTES, MAX_ENCODED_BYTES
from haptogram_protocol.record import Record

from .samples import vector_sample
from .vector import (
    Outcome,
    vector_body,
    vector_crc,
    vector_dropped_outcome,
    vector_entry,
    vector_rejected_outcome,
    vector_wire,
)

_ARM_BODY: Final = vector_body(m.Arm())
_ARM_LINE: Final = vector_wire(_ARM_BODY)


def invalid_frame_vectors() -> list[dict[str, Any]]:
    """Return every vector of ``frames-invalid.json``."""
    return [
        *_checksum_vectors(),
        *_stuffing_vectors(),
        *_size_vectors(),
        *_length_vectors(),
        *_enumeration_vectors(),
        *_type_vectors(),
    ]


def _invalid_vector(
    name: str, line: bytes, outcome: list[Outcome], clauses: str, flags: str, comment: str
) -> dict[str, Any]:
    return vector_entry(f"invalid/{name}", line, outcome, clauses, flags, comment)


def _framed_vector(decoded: bytes) -> bytes:
    """Return the bytes on the line for what stands before COBS, right or wrong."""
    return b"\0" + cobs_encode(decoded) + b"\0"


# --- Chapter 2 ---------------------------------------------------------------------------------


def _vector_crc16(data: bytes) -> int:
    """Return the CRC-16/CCITT-FALSE, which some firmware takes for the checksum."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ (0x1021 if crc & 0x8000 else 0)) & 0xFFFF
    return crc


def _checksum_vectors() -> Iterator[dict[str, Any]]:
    body, right = _ARM_BODY, zlib.crc32(_ARM_BODY)
    unreflected = int(f"{right:032b}"[::-1], 2)
    wrong = {
        "zero": (0, "0"),
        "ones": (0xFFFFFFFF, "all ones"),
        "complement": (right ^ 0xFFFFFFFF, "without the final XOR"),
        "big-endian": (int.from_bytes(right.to_bytes(4, "little"), "big"), "big-endian"),
        "unreflected": (unreflected, "with its bits reversed"),
        "no-initial": (zlib.crc32(body, 0xFFFFFFFF), "with the initial value 0"),
        "crc-16": (_vector_crc16(body), "of 16 bits, zero-extended"),
        "off-by-one": (right ^ 1, "with its lowest bit flipped"),
        "of-payload": (zlib.crc32(body[HEADER_BYTES:]), "of the payload alone"),
        "over-itself": (zlib.crc32(body + bytes(4)), "of body and four zeros"),
    }
    for name, (crc, text) in wrong.items():
        line = _framed_vector(body + crc.to_bytes(CRC_BYTES, "little"))
        yield _checksum_vector(f"crc/{name}", line, f"CRC-32 {text}")
    ping = vector_body(m.Ping(0x0102030405060708))
    good = ping + vector_crc(ping)
    for place in range(len(good)):
        damaged = bytearray(good)
        damaged[place] ^= 1 << place % 8
        text = f"bit {place % 8} of byte {place} flipped"
        yield _checksum_vector(f"crc/flip-{place}", _framed_vector(bytes(damaged)), text)
    for text, bad in {
        "first byte missing": good[1:],
        "last byte of the payload missing": ping[:-1] + good[-CRC_BYTES:],
        "last byte of the CRC missing": good[:-1],
        "one byte more": good + b"\x01",
        "two bytes swapped": good[:10] + good[11:9:-1] + good[12:],
    }.items():
        yield _checksum_vector(f"crc/{text.lower().replace(' ', '-')}", _framed_vector(bad), text)


def _checksum_vector(name: str, line: bytes, text: str) -> dict[str, Any]:
    return _invalid_vector(
        name, line, [vector_dropped_outcome("crc")], "HG-2.4/2", "crc-not-checked", text
    )


def _stuffing_vectors() -> Iterator[dict[str, Any]]:
    inside = _ARM_LINE[1:-1]
    for name, encoded, text in (
        ("code-past-end-by-1", inside[:-1], "last byte missing"),
        ("code-past-end-by-2", inside[:-2], "last two bytes missing"),
        ("code-ff-alone", b"\xff", "a code byte FF and nothing behind it"),
        ("code-02-alone", b"\x02", "a code byte 02 and nothing behind it"),
        ("code-ff-short", b"\xff" + b"\x01" * 253, "a full piece with one byte too few"),
        (
            "first-code-too-large",
            b"\xf0" + inside[1:],
            "the first code byte points far past the end",
        ),
        ("not-stuffed", b"\x41\x55\x01\x02", "bytes that were never stuffed"),
    ):
        line = b"\0" + encoded + b"\0"
        yield _invalid_vector(
            f"cobs/{name}", line, [vector_dropped_outcome("cobs")], "HG-2.2/2", "cobs-trusted", text
        )


def _size_vectors() -> Iterator[dict[str, Any]]:
    least = HEADER_BYTES + CRC_BYTES
    for size in range(least):
        body = _ARM_BODY[: max(0, size - CRC_BYTES)]
        text = f"{size} bytes; header and CRC take {least}"
        line = _framed_vector((body + vector_crc(body))[:size])
        yield _invalid_vector(
            f"short/{size}",
            line,
            [vector_dropped_outcome("short")],
            "HG-2.5/1",
            "length-trusted",
            text,
        )
    for size in (MAX_ENCODED_BYTES + 1, MAX_ENCODED_BYTES + 2, 3 * MAX_ENCODED_BYTES):
        line = b"\0" + b"\x7e" * size + b"\0"
        text = f"{size} bytes between two delimiters"
        yield _invalid_vector(
            f"oversize/{size}",
            line,
            [vector_dropped_outcome("oversize")],
            "HG-2.6/3",
            "buffer",
            text,
        )
    body = vector_body(m.UploadChunk(0, bytes(range(1, 256)) * 16))
    text = "a frame that is right but for its length"
    line = _framed_vector(body + vector_crc(body))
    yield _invalid_vector(
        "oversize/frame", line, [vector_dropped_outcome("oversize")], "HG-2.6/3", "buffer", text
    )


# --- Chapter 3 ---------------------------------------------------------------------------------


def _length_vectors() -> Iterator[dict[str, Any]]:
    """Yield every message with a byte too few, and too many where it cannot grow (HG-11.3)."""
    for kind in m.MESSAGES.values():
        message = vector_sample(kind, "ordered")
        body, tail = vector_body(message), kind.TAIL
        wrong = []
        if kind.LAYOUT.size:
            wrong.append(("empty", body[:HEADER_BYTES], "no payload at all"))
        if kind.LAYOUT.size > 1 and not tail:
            wrong.append(("short", body[:-1], "last byte of the payload missing"))
        if not tail and m.RESPONSE_RANGE.start > kind.TYPE:
            wrong.append(("long", body + b"\x01", "one byte behind the payload"))
        if tail and tail.unit > 1:
            wrong.append(("part", body[:-1], f"tail not in units of {tail.unit} bytes"))
        if tail and tail.least:
            wrong.append(("none", body[:HEADER_BYTES], "nothing in the tail"))
        for name, bad, text in wrong:
            yield _invalid_vector(
                f"length/{kind.TYPE.name.lower()}-{name}",
                vector_wire(bad),
                [vector_rejected_outcome("bad_length", bad)],
                "HG-3.2/3 HG-3.2/4",
                "length-trusted",
                f"{kind.TYPE.name}: {text}",
            )


def _enumeration_vectors() -> Iterator[dict[str, Any]]:
    """Yield every field that may have some values only with values that it may not have."""
    for kind in m.MESSAGES.values():
        for name, offset, allowed in _vector_choices(kind):
            good = vector_body(vector_sample(kind, "least"))
            for value in sorted({*range(min(allowed) - 1, max(allowed) + 2), 0xFF} - allowed):
                if value < 0:
                    continue
                place = HEADER_BYTES + offset
                bad = good[:place] + bytes([value]) + good[place + 1 :]
                yield _invalid_vector(
                    f"value/{kind.TYPE.name.lower()}-{name}-{value}",
                    vector_wire(bad),
                    [vector_rejected_outcome("bad_value", bad, offset)],
                    "HG-3.2/5",
                    "value-not-checked",
                    f"{kind.TYPE.name}: {name} is {value}",
                )


def _vector_choices(kind: type[Record], base: int = 0) -> Iterator[tuple[str, int, set[int]]]:
    for name, field in kind.WIRE.items():
        if field.record:
            yield from _vector_choices(field.record, base + field.offset)
        elif field.enumeration:
            yield name, base + field.offset, {int(member) for member in field.enumeration}


def _type_vectors() -> Iterator[dict[str, Any]]:
    for kind in (0x00, 0x04, 0x3F, 0x50, 0x7F, 0x90, 0xBE, 0xC6, 0xFF):
        bad = bytes([kind]) + _ARM_BODY[1:]
        text = f"type {kind:#04x}, which is none: not damage"
        outcome = [vector_rejected_outcome("unknown_type", bad)]
        clauses = "HG-3.3/2 HG-3.3/4" if kind < 0x40 or kind >= 0x80 else "HG-3.3/3"
        yield _invalid_vector(
            f"type/{kind:02x}", vector_wire(bad), outcome, clauses, "unknown-type", text
        )
