"""Haptogram's wire, cut into frames and what is none, each with its place in the stream."""

from __future__ import annotations

import dataclasses
import enum
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Protocol

from ..errors import RemoteProtocolError
from ..framing import DELIMITER, MAX_ENCODED_BYTES, decode_frame
from ..messages import Error, ErrorCode, Header, Message, MessageType, parse_body
from ..record import Record, text_as_utf8


def annotated_header_text(header: Header) -> str:
    """Return a header in words."""
    return (
        f"{annotated_type_name(header.type)} seq {header.seq} session {header.session:#06x} "
        f"flags {header.flags:#04x} t {header.time_us}"
    )


def annotated_message_text(message: Message) -> str:
    """Return the fields of a message; bytes and lists by their length."""
    if isinstance(message, Error):
        code = ErrorCode._value2member_map_.get(message.code)
        return (
            f"request {annotated_type_name(message.request)}, "
            f"code {getattr(code, 'name', message.code)}, detail {message.detail:#x}"
        )
    fields = []
    for name, value in _annotated_values(message):
        if isinstance(value, bytes | tuple):
            fields.append(f"{len(value)} {name}")
        else:
            fields.append(f"{name} {getattr(value, 'name', value)}")
    return ", ".join(fields) or "no payload"


def annotated_type_name(number: int) -> str:
    """Return the name of a message type, its number if it has none."""
    known = MessageType._value2member_map_.get(number)
    return known.name if isinstance(known, MessageType) else f"type {number:#04x}"


def annotated_fields_of(record: Any) -> dict[str, Any]:
    """Return every field of a record in full, of JSON types: bytes as hex, names for values."""
    return {name: annotated_value(value) for name, value in _annotated_values(record)}


def annotated_value(value: Any) -> Any:
    """Return *value* as JSON can hold it."""
    if isinstance(value, bytes | bytearray):
        return value.hex()
    if isinstance(value, enum.Enum):
        return value.name
    if isinstance(value, Record):
        return annotated_fields_of(value)
    if dataclasses.is_dataclass(value):
        return {"is": type(value).__name__} | annotated_fields_of(value)
    if isinstance(value, tuple | list):
        return [annotated_value(item) for item in value]
    return value


def _annotated_values(record: Any) -> list[tuple[str, Any]]:
    """Return the fields of a record by name, its tail included; U+FFFD for what is no UTF-8."""
    if isinstance(record, Record):
        names = [*record.WIRE, *([record.TAIL.name] if record.TAIL else [])]
    else:
        names = [field.name for field in dataclasses.fields(record)]
    values = [getattr(record, name) for name in names]
    shown = [text_as_utf8(value) if isinstance(value, str) else value for value in values]
    return list(zip(names, shown, strict=True))


@dataclass(frozen=True, slots=True)
class Annotated:
    """A piece of a stream, and its meaning.

    Attributes
    ----------
    offset, size : int
        Its first byte in the stream, from 0, and its length, without delimiters.
    name : str
        Type of the frame, or name of the operation; empty: the bytes are neither.
    text : str
        Its meaning in one line.
    fault : str
        Description of the damage; empty: there is none.
    fields : dict
        Every field in full, of JSON types.
    header : Header or None
        Header of an undamaged frame of Haptogram's wire.
    message : Message or None
        Message of such a frame; None: its payload cannot be read.
    """

    offset: int
    size: int
    name: str
    text: str
    fault: str = ""
    fields: dict[str, Any] = field(default_factory=dict)
    header: Header | None = None
    message: Message | None = None


class Annotator(Protocol):
    """Takes a stream in any chunks and gives its pieces; what it keeps is bounded."""

    def feed(self, chunk: bytes) -> Iterator[Annotated]:
        """Yield the pieces that *chunk* completes."""

    def end(self) -> Iterator[Annotated]:
        """Yield the frame that the end of the stream leaves unfinished."""


class FrameAnnotator:
    """Annotates a stream of Haptogram's wire, of either direction."""

    def __init__(self) -> None:
        self._partial = b""
        self._begin = 0  # offset of the piece that has not ended
        self._size = 0  # size of the whole piece, which may be longer than the kept part

    def feed(self, chunk: bytes) -> Iterator[Annotated]:
        """Yield a piece for every frame, and for every run of bytes that is none."""
        *ended, rest = chunk.split(DELIMITER)
        for piece in ended:
            self._keep(piece)
            yield from self._close()
        self._keep(rest)

    def end(self) -> Iterator[Annotated]:
        """Yield the bytes after the last delimiter, if there are any."""
        if self._size:
            fault = f"{self._size} bytes without a delimiter behind them"
            yield Annotated(self._begin, self._size, "", f"no frame: {fault}", fault)

    def _keep(self, piece: bytes) -> None:
        """Add bytes to the current frame: keep up to 4097 of them, count all."""
        self._partial += piece[: MAX_ENCODED_BYTES + 1 - len(self._partial)]
        self._size += len(piece)

    def _close(self) -> Iterator[Annotated]:
        """Yield the annotation of the complete frame; nothing if it is empty."""
        piece, size = self._partial, self._size
        begin, self._begin = self._begin, self._begin + size + len(DELIMITER)
        self._partial, self._size = b"", 0
        if size > MAX_ENCODED_BYTES:
            fault = f"more than {MAX_ENCODED_BYTES} bytes without a delimiter"
            yield Annotated(begin, size, "", f"no frame: {fault}", fault)
        elif size:
            yield annotated_frame(piece, begin)


def annotated_frame(piece: bytes, offset: int = 0) -> Annotated:
    """Return the bytes between two delimiters, annotated."""
    size = len(piece)
    try:
        body = decode_frame(piece)
    except RemoteProtocolError as error:
        return Annotated(offset, size, "", f"no frame: {error}", str(error))
    header = Header.unpack(body[: Header.LAYOUT.size])
    name, head = annotated_type_name(header.type), annotated_header_text(header)
    try:
        _, message = parse_body(body)
    except RemoteProtocolError as error:
        fields = {"payload": body[Header.LAYOUT.size :].hex()}
        return Annotated(offset, size, name, f"{head}: {error}", str(error), fields, header)
    text = f"{head}: {annotated_message_text(message)}"
    return Annotated(offset, size, name, text, "", annotated_fields_of(message), header, message)


def annotated_frame_text(piece: bytes) -> str:
    """Return the bytes between two delimiters in words."""
    return annotated_frame(piece).text
