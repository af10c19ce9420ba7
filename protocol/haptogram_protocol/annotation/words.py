"""One frame of Haptogram's wire in words, and its fields in full."""

from __future__ import annotations

import dataclasses
import enum
from typing import Any

from ..messages import Error, ErrorCode, Header, Message, MessageType
from ..record import Record


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
    if isinstance(record, Record):
        names = [*record.WIRE, *([record.TAIL.name] if record.TAIL else [])]
    else:
        names = [field.name for field in dataclasses.fields(record)]
    return [(name, getattr(record, name)) for name in names]
