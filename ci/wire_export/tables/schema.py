"""The protocol as data."""

from __future__ import annotations

import enum
import re
from collections.abc import Mapping
from typing import Any, Final

from haptogram_protocol import messages as m
from haptogram_protocol.framing import CRC_BYTES, HEADER_BYTES, MAX_BODY_BYTES, MAX_ENCODED_BYTES
from haptogram_protocol.record import Record, WireField
from haptogram_protocol.state import MuteReason, OutputState

_TYPE_NAMES: Final = {"B": "u8", "H": "u16", "I": "u32", "Q": "u64", "h": "i16", "i": "i32"}

ENUMERATIONS: Final[tuple[type[enum.IntEnum] | type[enum.IntFlag], ...]] = (
    m.MessageType,
    m.Flag,
    m.ErrorCode,
    m.Feature,
    m.TraceMode,
    m.UploadKind,
    m.DriveKind,
    OutputState,
    MuteReason,
)

RECORDS: Final[tuple[type[Record], ...]] = (
    m.Header,
    m.FocalPoint,
    m.Counters,
    m.Config,
    m.Element,
    m.LatchKey,
    m.TraceRecord,
)

CONSTANTS: Final[Mapping[str, int]] = {
    "VERSION_MAJOR": m.VERSION_MAJOR,
    "VERSION_MINOR": m.VERSION_MINOR,
    "HEADER_BYTES": HEADER_BYTES,
    "CRC_BYTES": CRC_BYTES,
    "MAX_ENCODED_BYTES": MAX_ENCODED_BYTES,
    "MAX_BODY_BYTES": MAX_BODY_BYTES,
    "MAX_TRANSDUCERS": m.MAX_TRANSDUCERS,
    "FIRST_STREAM_SEQ": m.FIRST_STREAM_SEQ,
    "RESPONSE_OFFSET": m.RESPONSE_OFFSET,
    "MUST_UNDERSTAND": m.MUST_UNDERSTAND,
}


def wire_description() -> dict[str, Any]:
    """Return the protocol as data that JSON can hold: what a generator for a language needs."""
    return {
        "constants": dict(CONSTANTS),
        "enumerations": {
            kind.__name__: {
                member.name: {"value": int(member), "doc": getattr(member, "doc", "")}
                for member in kind
            }
            for kind in ENUMERATIONS
        },
        "records": {record.__name__: _described_record(record) for record in RECORDS},
        "messages": {
            kind.TYPE.name: {"type": int(kind.TYPE), **_described_record(kind)}
            for kind in m.MESSAGES.values()
        },
    }


def _described_record(record: type[Record]) -> dict[str, Any]:
    tail = record.TAIL
    return {
        "doc": spec_summary(record),
        "size": record.LAYOUT.size,
        "fields": [_described_field(name, field) for name, field in record.WIRE.items()],
        "tail": tail
        and {
            "name": tail.name,
            "unit": tail.unit,
            "least": tail.least,
            "record": tail.record and tail.record.__name__,
            "doc": tail.doc,
        },
    }


def _described_field(name: str, field: WireField) -> dict[str, Any]:
    return {
        "name": name,
        "offset": field.offset,
        "size": field.size,
        "type": spec_type_name(field),
        "enumeration": field.enumeration and field.enumeration.__name__,
        "doc": field.doc,
    }


def spec_type_name(field: WireField) -> str:
    """Return the name of a field's type in SPEC.md: ``u16``, ``i32``, ``text[16]``, a record."""
    if field.record is not None:
        return field.record.__name__
    if field.code.endswith("s"):
        return f"text[{field.code[:-1]}]"
    return _TYPE_NAMES[field.code]


def spec_summary(kind: type) -> str:
    """Return the docstring of a message without its section number, on one line of Markdown."""
    text = " ".join((kind.__doc__ or "").split()).replace("``", "`")
    return re.sub(r" HG-[\d.]+$", "", text)
