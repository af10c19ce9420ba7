"""Parts of a vector as JSON: frames, outcomes, fields."""

from __future__ import annotations

import zlib
from typing import Any, Final

from haptogram_protocol import messages as m
from haptogram_protocol.framing import CRC_BYTES, HEADER_BYTES, encode_frame
from haptogram_protocol.record import Record

SESSION: Final = 0x5EED
Outcome = dict[str, Any]


def vector_json(value: Any, code: str = "") -> Any:
    """Return *value* as JSON: bytes in hex, u64 in decimal digits, records as objects."""
    if isinstance(value, Record):
        return vector_fields_of(value)
    if isinstance(value, bytes):
        return value.hex()
    if isinstance(value, tuple):
        return [vector_json(item) for item in value]
    if isinstance(value, str | dict | list):
        return value
    return str(value) if code == "Q" else int(value)


def vector_fields_of(record: Record) -> dict[str, Any]:
    """Return every field of *record* by name, the tail too."""
    fields = {name: vector_json(getattr(record, name), f.code) for name, f in record.WIRE.items()}
    if record.TAIL:
        fields[record.TAIL.name] = vector_json(getattr(record, record.TAIL.name))
    return fields


def vector_body(
    message: m.Message, *, flags: int = 0, seq: int = 1, time_us: int = 0, session: int = SESSION
) -> bytes:
    """Return header and payload; everything in the header has a default."""
    return m.build_body(message, flags=flags, seq=seq, time_us=time_us, session=session)


def _vector_header_of(body: bytes) -> dict[str, int]:
    """Return the header of *body* by field."""
    return vector_fields_of(m.Header.unpack(body[:HEADER_BYTES]))


def vector_frame_outcome(message: m.Message, body: bytes) -> Outcome:
    """Return the outcome of a frame that is taken."""
    return {
        "frame": {
            "body": body.hex(),
            "header": _vector_header_of(body),
            "message": message.TYPE.name,
            "fields": vector_fields_of(message),
        }
    }


def vector_dropped_outcome(reason: str) -> Outcome:
    """Return the outcome of bytes that are no frame; *reason* is the counter."""
    return {"drop": reason}


def vector_rejected_outcome(reason: str, body: bytes, offset: int = 0) -> Outcome:
    """Return the outcome of a frame without damage whose message is wrong at *offset*."""
    return {"reject": reason, "header": _vector_header_of(body), "offset": offset}


def vector_entry(
    name: str, line: bytes, outcome: list[Outcome], clauses: str, flags: str, comment: str
) -> dict[str, Any]:
    """Return one vector; *clauses* and *flags* are lists separated by spaces."""
    return {
        "id": name,
        "clauses": clauses.split(),
        "flags": flags.split(),
        "comment": comment,
        "line": line.hex(),
        "outcome": outcome,
    }


def vector_wire(body: bytes) -> bytes:
    """Return the frame around *body*."""
    return encode_frame(body)


def vector_ending_in_run(length: int) -> tuple[m.UploadChunk, bytes]:
    """Return a chunk of *length* bytes without a zero, and its body, whose CRC has none either."""
    chunks = (m.UploadChunk(0, bytes([fill]) * length) for fill in range(1, 256))
    made = ((chunk, vector_body(chunk)) for chunk in chunks)
    return next((chunk, body) for chunk, body in made if 0 not in vector_crc(body))


def vector_crc(body: bytes) -> bytes:
    """Return the CRC-32 of *body* as it stands behind it."""
    return zlib.crc32(body).to_bytes(CRC_BYTES, "little")
