"""Bytes that no sender of this version emits, and every receiver must take as stated."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

from haptogram_protocol import messages as m
from haptogram_protocol.framing import MAX_ENCODED_BYTES

from .samples import vector_sample
from .vector import (
    Outcome,
    vector_body,
    vector_dropped_outcome,
    vector_ending_in_run,
    vector_entry,
    vector_frame_outcome,
    vector_rejected_outcome,
    vector_wire,
)

_ARM: Final = m.Arm()
_ARM_BODY: Final = vector_body(_ARM)
_ARM_LINE: Final = vector_wire(_ARM_BODY)
_PING_LINE: Final = vector_wire(vector_body(m.Ping(0x0102030405060708)))
_TAKEN: Final = vector_frame_outcome(_ARM, _ARM_BODY)


def acceptable_frame_vectors() -> list[dict[str, Any]]:
    """Return every vector of ``frames-acceptable.json``."""
    return [
        *_delimiter_vectors(),
        *_vectors_after_damage(),
        *_flag_vectors(),
        *_value_vectors(),
        *_grown_vectors(),
        _added_piece_vector(),
    ]


def _acceptable_vector(
    name: str, line: bytes, outcome: list[Outcome], clauses: str, flags: str, comment: str
) -> dict[str, Any]:
    return vector_entry(f"acceptable/{name}", line, outcome, clauses, flags, comment)


def _delimiter_vectors() -> Iterator[dict[str, Any]]:
    ping = m.Ping(7)
    body = vector_body(ping, seq=2)
    both = [_TAKEN, vector_frame_outcome(ping, body)]
    for zeros in (1, 2, 3, 100):
        line = b"\0" + _ARM_LINE[1:-1] + bytes(zeros) + vector_wire(body)[1:-1] + b"\0"
        text = f"{zeros} delimiters between two frames"
        clauses = "HG-2.1/2" if zeros == 1 else "HG-2.3/1"
        yield _acceptable_vector(f"delimiters-{zeros}", line, both, clauses, "delimiter", text)
    text = "100 zeros before a frame and 100 behind it: no frame, no error"
    yield _acceptable_vector(
        "idle-zeros", bytes(100) + _ARM_LINE + bytes(100), [_TAKEN], "HG-2.3/1", "idle", text
    )
    text = "nothing but delimiters"
    yield _acceptable_vector("only-zeros", bytes(64), [], "HG-2.3/1", "idle", text)


def _vectors_after_damage() -> Iterator[dict[str, Any]]:
    flipped = bytearray(_ARM_LINE)
    flipped[2] ^= 0x10
    junk: dict[str, tuple[bytes, str, str]] = {
        "boot-text": (b"\r\nboot ok, 16x16\r\n", "cobs", "text of a boot loader"),
        "short-run": (b"\x03ab", "short", "three bytes that are COBS but no frame"),
        "code-past-end": (b"\xff\x01\x02", "cobs", "a code byte that points past the end"),
        "cut-off": (_PING_LINE[1:16], "cobs", "the first half of a frame"),
        "flipped": (bytes(flipped[1:-1]), "crc", "a frame with one bit flipped"),
        "too-long": (b"U" * (MAX_ENCODED_BYTES + 1), "oversize", "more bytes than any frame has"),
        "far-too-long": (b"U" * 9000, "oversize", "twice as many: counted once"),
    }
    for name, (bytes_before, reason, text) in junk.items():
        line = bytes_before + _ARM_LINE
        outcome = [vector_dropped_outcome(reason), _TAKEN]
        text = f"a frame right behind {text}"
        yield _acceptable_vector(f"after-{name}", line, outcome, "HG-2.1/3", "resync", text)
    unknown = _vector_body_of_type(0x7F)
    yield _acceptable_vector(
        "after-unknown-type",
        vector_wire(unknown) + _ARM_LINE,
        [vector_rejected_outcome("unknown_type", unknown), _TAKEN],
        "HG-3.8/2",
        "resync",
        "a frame behind one of an unknown type",
    )


def _vector_body_of_type(kind: int) -> bytes:
    return bytes([kind]) + _ARM_BODY[1:]


def _flag_vectors() -> Iterator[dict[str, Any]]:
    for flags in (0x01, 0x02, 0x04, 0x08, 0x0F):
        body = vector_body(_ARM, flags=flags)
        text = f"bits {flags:#04x} of the low nibble, which have no meaning here"
        outcome = [vector_frame_outcome(_ARM, body)]
        yield _acceptable_vector(
            f"flags-{flags:02x}", vector_wire(body), outcome, "HG-3.4/2", "may-ignore", text
        )


def _value_vectors() -> Iterator[dict[str, Any]]:
    """Yield values that a later minor version may add, and must not disturb an older receiver."""
    for code in (0, 14, 200, 255):
        error = m.Error(m.MessageType.ARM, code, 1)
        yield _plain_vector(
            f"error-code-{code}", error, "HG-10.1/3", "future", f"unknown error code {code}"
        )
    error = m.Error(0x7F, m.ErrorCode.UNSUPPORTED, 0x7F)
    yield _plain_vector(
        "error-request-7f", error, "HG-10.1/3", "future", "refusal of an unknown request"
    )
    reply = vector_sample(m.HelloReply, "random")
    assert isinstance(reply, m.HelloReply)
    text = "capability bits that this version does not know"
    future = m.HelloReply(
        **{name: getattr(reply, name) for name in reply.WIRE if name not in ("features", "minor")},
        features=0xFFFFFFFF,
        minor=99,
    )
    yield _plain_vector("features-unknown", future, "HG-4.5/2 HG-11.2/1", "future", text)


def _grown_vectors() -> Iterator[dict[str, Any]]:
    """Yield responses and events with what a later minor version may add behind their fields."""
    for kind in m.MESSAGES.values():
        if m.RESPONSE_RANGE.start <= kind.TYPE and not kind.TAIL:
            message = vector_sample(kind, "ordered")
            body = vector_body(message) + b"\x01\x02"
            name, text = kind.TYPE.name, "two bytes behind the last field that this version knows"
            outcome = [vector_frame_outcome(message, body)]
            yield _acceptable_vector(
                f"grown/{name.lower()}", vector_wire(body), outcome, "HG-11.3/1", "future", text
            )


def _plain_vector(
    name: str, message: m.Message, clauses: str, flags: str, text: str
) -> dict[str, Any]:
    body = vector_body(message)
    return _acceptable_vector(
        name, vector_wire(body), [vector_frame_outcome(message, body)], clauses, flags, text
    )


def _added_piece_vector() -> dict[str, Any]:
    """Return a frame that ends in a full COBS piece, and in the code 01 that some encoders add."""
    chunk, body = vector_ending_in_run(250)
    line = vector_wire(body)[:-1] + b"\x01\x00"
    text = "a code 01 behind a full last piece, which stands for nothing"
    return _acceptable_vector(
        "full-piece-then-01",
        line,
        [vector_frame_outcome(chunk, body)],
        "HG-2.2/3",
        "cobs-254",
        text,
    )
