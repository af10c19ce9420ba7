"""Frames as a sender of this version emits them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

from haptogram_protocol import messages as m
from haptogram_protocol.framing import MAX_BODY_BYTES

from ..tables.worked import WORKED_FRAMES, worked_spec_frame
from .samples import HOW, vector_sample
from .vector import (
    SESSION,
    vector_body,
    vector_ending_in_run,
    vector_entry,
    vector_frame_outcome,
    vector_wire,
)

# The header goes along with the payload: from all zeros to all ones.
_HEADERS: Final[dict[str, dict[str, int]]] = {
    "least": {"flags": 0, "seq": 0, "time_us": 0, "session": 0},
    "most": {"flags": 0, "seq": 0xFFFF, "time_us": 0xFFFFFFFF, "session": 0xFFFF},
    "ordered": {"flags": 0, "seq": 0x0201, "time_us": 0x06050403, "session": 0x0807},
    "random": {"flags": 0, "seq": 0xFFF0, "time_us": 0x80000000, "session": SESSION},
}
_SAMPLE_FLAGS: Final = {
    "least": "zeros cobs",
    "most": "range signed",
    "ordered": "endianness layout",
    "random": "layout",
}


def valid_frame_vectors() -> list[dict[str, Any]]:
    """Return every vector of ``frames-valid.json``."""
    return [
        *_worked_vectors(),
        *_sample_vectors(),
        *_run_vectors(),
        *_array_vectors(),
        _fullest_vector(),
    ]


def _worked_vectors() -> Iterator[dict[str, Any]]:
    for number, (title, (message, _)) in enumerate(WORKED_FRAMES.items(), 1):
        body, line = worked_spec_frame(title)
        outcome = [vector_frame_outcome(message, body)]
        yield vector_entry(
            f"valid/worked/{number}", line, outcome, "HG-2.1/1 HG-3.1/1", "worked-frame", title
        )


def _sample_vectors() -> Iterator[dict[str, Any]]:
    for kind in m.MESSAGES.values():
        for how, about in HOW.items():
            message = vector_sample(kind, how)
            body = vector_body(message, **_HEADERS[how])
            yield vector_entry(
                f"valid/{kind.TYPE.name.lower()}/{how}",
                vector_wire(body),
                [vector_frame_outcome(message, body)],
                "HG-2.2/1 HG-2.4/1 HG-3.2/1 HG-3.2/3",
                _SAMPLE_FLAGS[how],
                f"{kind.TYPE.name}: {about}",
            )


def _run_vectors() -> Iterator[dict[str, Any]]:
    """Yield runs without a zero around the 254 bytes of a full COBS piece."""
    for length in (*range(236, 262), 500, 508, 512, 762, 1016):
        chunk = m.UploadChunk(0x01010101, bytes([0xAA]) * length)
        body = vector_body(chunk, seq=0x0101, time_us=0x01010101)
        text = f"{length} bytes of data, no zero in the whole body"
        yield _run_vector(f"no-zero-{length}", chunk, body, text)
    for length in (253, 254, 255):
        chunk = m.UploadChunk(0, bytes([0x55]) * length + bytes(1) + bytes([0x55]) * 3)
        text = f"a zero behind {length} bytes without one"
        yield _run_vector(f"zero-behind-{length}", chunk, vector_body(chunk), text)
    for length in (249, 250, 251):
        chunk, body = vector_ending_in_run(length)
        yield _run_vector(
            f"ends-{length}", chunk, body, f"ends in {length} bytes of data and the CRC"
        )


def _run_vector(name: str, chunk: m.UploadChunk, body: bytes, text: str) -> dict[str, Any]:
    return vector_entry(
        f"valid/cobs/{name}",
        vector_wire(body),
        [vector_frame_outcome(chunk, body)],
        "HG-2.2/1",
        "cobs-254",
        text,
    )


def _array_vectors() -> Iterator[dict[str, Any]]:
    """Yield stream frames of arrays of many sizes."""
    for count in (1, 2, 63, 64, 100, 255, 256, 257, 512, 1024):
        codes = bytes(n * 37 % 256 for n in range(count))
        yield _stream_vector(f"phases-{count}", m.Phases(codes), f"{count} phases")
        drives = m.Drives(codes + codes[::-1])
        yield _stream_vector(
            f"drives-{count}", drives, f"phases and amplitudes of {count} transducers"
        )


def _stream_vector(name: str, message: m.Message, text: str) -> dict[str, Any]:
    body = vector_body(message, seq=m.FIRST_STREAM_SEQ, time_us=0xFF676980)
    return vector_entry(
        f"valid/array/{name}",
        vector_wire(body),
        [vector_frame_outcome(message, body)],
        "HG-5.2/1",
        "array-size",
        text,
    )


def _fullest_vector() -> dict[str, Any]:
    size = MAX_BODY_BYTES - m.Header.LAYOUT.size - m.UploadChunk.LAYOUT.size
    chunk = m.UploadChunk(0x01010101, bytes([0xA5]) * size)
    body = vector_body(chunk, flags=0x01, seq=0x0101, time_us=0x01010101)
    text = "largest body that always fits, 4096 bytes between the delimiters"
    return vector_entry(
        "valid/longest",
        vector_wire(body),
        [vector_frame_outcome(chunk, body)],
        "HG-2.6/1 HG-2.6/2",
        "buffer",
        text,
    )
