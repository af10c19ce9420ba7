"""Names in C of records, fields and enumerations."""

from __future__ import annotations

import enum
import re
import textwrap
from collections.abc import Iterable, Iterator
from typing import Final

from haptogram_protocol import messages as m
from haptogram_protocol.errors import LocalProtocolError
from haptogram_protocol.record import Record, WireField
from haptogram_protocol.state import MuteReason, OutputState

from ..tables import RECORDS

_WIDTH: Final = 100
#: Keywords of C and C++ that no member may be called.
_KEYWORDS: Final = re.compile(
    "auto|break|case|char|class|const|continue|default|delete|do|double|else|enum|extern|float|for|"
    "goto|if|inline|int|long|new|private|public|register|restrict|return|short|signed|sizeof|"
    "static|struct|switch|this|typedef|union|unsigned|void|volatile|while"
).fullmatch

#: Name of the C type and of the reader and writer, by the code of :mod:`struct`.
SCALARS: Final = {
    "B": ("uint8_t", "u8"),
    "H": ("uint16_t", "u16"),
    "I": ("uint32_t", "u32"),
    "Q": ("uint64_t", "u64"),
    "h": ("int16_t", "i16"),
    "i": ("int32_t", "i32"),
}

#: Prefix of the members of each enumeration: C has one space of names for all of them.
PREFIXES: Final[dict[type[enum.IntEnum] | type[enum.IntFlag], str]] = {
    m.MessageType: "HG_TYPE",
    m.Flag: "HG_FLAG",
    m.ErrorCode: "HG_ERROR",
    m.Feature: "HG_FEATURE",
    m.TraceMode: "HG_TRACE",
    m.UploadKind: "HG_UPLOAD",
    m.DriveKind: "HG_DRIVE",
    OutputState: "HG_STATE",
    MuteReason: "HG_REASON",
}

ALL: Final[tuple[type[Record], ...]] = (*RECORDS, *m.MESSAGES.values())


def c_upper_name(record: type[Record]) -> str:
    """Return e.g. ``HELLO_REPLY``, ``FOCAL_POINT``."""
    if issubclass(record, m.Message):
        return record.TYPE.name
    return c_snake_name(record.__name__).upper()


def c_lower_name(record: type[Record]) -> str:
    """Return e.g. ``hello_reply``, ``focal_point``."""
    return c_upper_name(record).lower()


def c_snake_name(name: str) -> str:
    """Return e.g. ``focal_point`` for ``FocalPoint``."""
    return re.sub(r"(?<!^)(?=[A-Z])", "_", name).lower()


def is_c_text(field: WireField) -> bool:
    """Return True if *field* holds characters."""
    return field.code.endswith("s")


def c_leaves(record: type[Record]) -> Iterator[tuple[str, int, WireField]]:
    """Yield name, offset and form of every number, nested ones as ``config.hold_ms``."""
    for name, field in record.WIRE.items():
        if field.record is None:
            yield name, field.offset, field
            continue
        for inner, offset, form in c_leaves(field.record):
            yield f"{name}.{inner}", field.offset + offset, form


def c_enumerated(record: type[Record]) -> Iterator[tuple[int, int]]:
    """Yield the offset of every number that may have some values only, and their bit mask.

    Raises
    ------
    LocalProtocolError
        If a value has no place in 32 bits, or stands in a tail, where C would not look for it.
    """
    if record.TAIL and record.TAIL.record and any(c_enumerated(record.TAIL.record)):
        raise LocalProtocolError(f"enumeration in the tail of {record.__name__}")
    for name, offset, form in c_leaves(record):
        if form.enumeration is None:
            continue
        values = [int(member) for member in form.enumeration]
        if max(values) > 31:
            raise LocalProtocolError(f"{record.__name__}.{name}: {max(values)} is over 31")
        yield offset, sum(1 << value for value in values)


def c_members(kind: type[enum.IntEnum] | type[enum.IntFlag]) -> list[enum.IntEnum | enum.IntFlag]:
    """Return the members of an enumeration, in order."""
    return list(kind)


def c_member_name(name: str) -> str:
    """Return the name of a field in C, where some words are taken."""
    return f"{name}_" if _KEYWORDS(name) else name


def c_described(code: str, doc: str) -> str:
    """Return a line of code with its comment: behind it, or above where the line is too long."""
    line = f"{code} /* {doc} */"
    if not doc or len(line) <= _WIDTH:
        return line if doc else code
    indent = code[: len(code) - len(code.lstrip())]
    return f"{c_comment(doc, indent)}\n{code}"


def c_comment(text: str, indent: str = "") -> str:
    """Return *text* as a C comment of at most 100 columns."""
    lines = textwrap.wrap(text.replace("`", ""), _WIDTH - 6 - len(indent))
    body = f"\n{indent}   ".join(lines)
    return f"{indent}/* {body} */"


def c_macro(name: str, rows: Iterable[str]) -> str:
    """Return a macro that applies its argument X to every row."""
    body = " \\\n".join(f"    X({row})" for row in rows)
    return f"#define {name}(X) \\\n{body}"
