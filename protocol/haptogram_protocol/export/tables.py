"""What other languages and SPEC.md take from the messages: description, tables, worked frames.

``python -m haptogram_protocol.export.tables --spec protocol/SPEC.md`` rewrites the parts of SPEC.md
that stand between a ``generated`` marker and an ``end`` marker.
"""

from __future__ import annotations

import argparse
import enum
import json
import re
import sys
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

from .. import messages as m
from ..errors import LocalProtocolError
from ..framing import CRC_BYTES, HEADER_BYTES, MAX_BODY_BYTES, MAX_ENCODED_BYTES
from ..record import Record, WireField
from ..state import (
    LINK_TRANSITIONS,
    OUTPUT_TRANSITIONS,
    LinkInput,
    LinkState,
    MuteReason,
    OutputInput,
    OutputState,
)
from .worked import EXCHANGE, WORKED_FRAMES, worked_frame

_TYPE_NAMES: Final = {"B": "u8", "H": "u16", "I": "u32", "Q": "u64", "h": "i16", "i": "i32"}

ENUMERATIONS: Final[tuple[type[enum.IntEnum] | type[enum.IntFlag], ...]] = (
    m.MessageType,
    m.Flag,
    m.ErrorCode,
    m.Feature,
    m.PhaseFormat,
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


# --- Description (HG-11.3) ---------------------------------------------------------------------


def description() -> dict[str, Any]:
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
        "records": {record.__name__: _record(record) for record in RECORDS},
        "messages": {
            kind.TYPE.name: {"type": int(kind.TYPE), **_record(kind)}
            for kind in m.MESSAGES.values()
        },
    }


def _record(record: type[Record]) -> dict[str, Any]:
    tail = record.TAIL
    return {
        "doc": _summary(record),
        "size": record.LAYOUT.size,
        "fields": [_field(name, field) for name, field in record.WIRE.items()],
        "tail": tail
        and {
            "name": tail.name,
            "unit": tail.unit,
            "least": tail.least,
            "record": tail.record and tail.record.__name__,
            "doc": tail.doc,
        },
    }


def _field(name: str, field: WireField) -> dict[str, Any]:
    return {
        "name": name,
        "offset": field.offset,
        "size": field.size,
        "type": type_name(field),
        "enumeration": field.enumeration and field.enumeration.__name__,
        "doc": field.doc,
    }


def type_name(field: WireField) -> str:
    """Return the name of a field's type in SPEC.md: ``u16``, ``i32``, ``text[16]``, a record."""
    if field.record is not None:
        return field.record.__name__
    if field.code.endswith("s"):
        return f"text[{field.code[:-1]}]"
    return _TYPE_NAMES[field.code]


def _summary(kind: type) -> str:
    """Return the docstring of a message without its section number, on one line of Markdown."""
    text = " ".join((kind.__doc__ or "").split()).replace("``", "`")
    return re.sub(r" HG-[\d.]+$", "", text)


def description_hash() -> int:
    """Return the CRC-32 of the canonical JSON of what matters on the wire.  HG-11.3.

    Words do not matter: two ends whose comments differ understand each other.
    """
    text = json.dumps(_without_docs(description()), sort_keys=True, separators=(",", ":"))
    return zlib.crc32(text.encode("ascii"))


def _without_docs(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_docs(item) for key, item in value.items() if key != "doc"}
    if isinstance(value, list):
        return [_without_docs(item) for item in value]
    return value


# --- Tables of SPEC.md -------------------------------------------------------------------------


def _table(head: list[str], rows: list[list[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def record_table(name: str) -> str:
    """Return the byte table of a record or message, given the name of its class."""
    record = getattr(m, name)
    rows = [
        [str(field.offset), str(field.size), type_name(field), f"`{key}`", field.doc]
        for key, field in record.WIRE.items()
    ]
    if tail := record.TAIL:
        kind = tail.record.__name__ if tail.record else "bytes"
        size = f"{tail.unit} x n" if tail.unit > 1 else "n"
        doc = f"{tail.doc}; n is {tail.least} or more"
        rows.append([str(record.LAYOUT.size), size, f"{kind}[]", f"`{tail.name}`", doc])
    title = f"`{record.TYPE:#04x}` {record.TYPE.name}" if hasattr(record, "TYPE") else name
    head = f"**{title}**, {record.LAYOUT.size} bytes{' and a tail' if tail else ''}. "
    return (
        head
        + _summary(record)
        + ("\n\n" + _table(["offset", "size", "type", "field", "meaning"], rows) if rows else "")
    )


def enumeration_table(name: str) -> str:
    """Return the table of an enumeration of :data:`ENUMERATIONS`."""
    kind = next(kind for kind in ENUMERATIONS if kind.__name__ == name)
    flags = issubclass(kind, enum.IntFlag)
    rows = [
        [f"{int(member):#x}" if flags else str(int(member)), f"`{member.name}`", _doc(member)]
        for member in kind
    ]
    return _table(["bit" if flags else "value", "name", "meaning"], rows)


def _doc(member: enum.IntEnum | enum.IntFlag) -> str:
    return str(getattr(member, "doc", ""))


def types_table(_: str = "") -> str:
    """Return the table of all message types."""
    rows = [
        [f"`{kind.TYPE:#04x}`", kind.TYPE.name, _length(kind), _summary(kind)]
        for kind in m.MESSAGES.values()
    ]
    return _table(["type", "name", "payload, bytes", "what it is"], rows)


def _length(kind: type[m.Message]) -> str:
    if not kind.TAIL:
        return str(kind.LAYOUT.size)
    tail = f"{kind.TAIL.unit} n" if kind.TAIL.unit > 1 else "n"
    return f"{kind.LAYOUT.size} + {tail}" if kind.LAYOUT.size else tail


def _transitions(
    table: Mapping[Any, enum.Enum], states: type[enum.Enum], inputs: type[enum.Enum]
) -> str:
    rows = [
        [event.name, *(_target(table.get((state, event))) for state in states)] for event in inputs
    ]
    return _table(["input \\ state", *(state.name for state in states)], rows)


def _target(state: enum.Enum | None) -> str:
    return state.name if state is not None else "-"


def output_table(_: str = "") -> str:
    """Return the transition table of the board's output."""
    return _transitions(OUTPUT_TRANSITIONS, OutputState, OutputInput)


def link_table(_: str = "") -> str:
    """Return the transition table of the host's link."""
    return _transitions(LINK_TRANSITIONS, LinkState, LinkInput)


def constants_table(_: str = "") -> str:
    """Return the table of the numbers that both ends must agree on."""
    return _table(
        ["constant", "value", "hex"],
        [[f"`{name}`", str(value), f"`{value:#x}`"] for name, value in CONSTANTS.items()],
    )


def hash_line(_: str = "") -> str:
    """Return the description hash of this version."""
    return f"`description_hash` of this version: `{description_hash():#010x}`."


# --- Worked frames and exchange (chapter 13) -----------------------------------------------------


def frames_text(_: str = "") -> str:
    """Return every worked frame in hex: header and payload, then the bytes on the line."""
    parts = []
    for number, title in enumerate(WORKED_FRAMES, 1):
        body, wire = worked_frame(title)
        parts.append(
            f"**Frame {number}.** {title}.\n\n```\nbody {_hex(body)}\nline {_hex(wire)}\n```"
        )
    return "\n\n".join(parts)


def exchange_text(_: str = "") -> str:
    """Return the worked exchange: when, who, what, and header and payload in hex."""
    lines = ["   us  from"]
    for step in EXCHANGE:
        lines.append(f"{step.t_us:5}  {'host ' if step.from_host else 'board'}  {step.words}")
        lines += [f"{'':14}{line}" for line in _rows(step.body)]
    return "```\n" + "\n".join(lines) + "\n```"


def _hex(data: bytes) -> str:
    return "\n     ".join(_rows(data))


def _rows(data: bytes, width: int = 24) -> list[str]:
    return [data[i : i + width].hex(" ") for i in range(0, len(data), width)]


# --- SPEC.md -----------------------------------------------------------------------------------

_GENERATORS: Final[Mapping[str, Callable[[str], str]]] = {
    "record": record_table,
    "enumeration": enumeration_table,
    "types": types_table,
    "output-states": output_table,
    "link-states": link_table,
    "constants": constants_table,
    "hash": hash_line,
    "frames": frames_text,
    "exchange": exchange_text,
}

_BLOCK: Final = re.compile(
    r"(<!-- generated: (?P<kind>[\w-]+)(?: (?P<name>\w+))? -->\n).*?(<!-- end -->)", re.DOTALL
)


def update_spec(text: str) -> str:
    """Return the text of SPEC.md with every generated block made anew.

    Raises
    ------
    LocalProtocolError
        If a marker names something that is not generated.
    """

    def block(match: re.Match[str]) -> str:
        kind, name = match["kind"], match["name"] or ""
        if kind not in _GENERATORS:
            raise LocalProtocolError(f"marker {kind!r}; there are {', '.join(_GENERATORS)}")
        return f"{match[1]}\n{_GENERATORS[kind](name)}\n\n{match[4]}"

    return _BLOCK.sub(block, text)


def main(arguments: list[str] | None = None) -> int:
    """Rewrite SPEC.md, or print the description; return the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m haptogram_protocol.export.tables", description=str(__doc__).splitlines()[0]
    )
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--spec", type=Path, help="rewrite the generated parts of this SPEC.md")
    what.add_argument("--json", action="store_true", help="write the description as JSON")
    options = parser.parse_args(arguments)
    if options.json:
        sys.stdout.write(json.dumps(description(), indent=2) + "\n")
    else:
        options.spec.write_text(update_spec(options.spec.read_text("utf-8")), "utf-8")
    return 0


if __name__ == "__main__":  # pragma: no cover - a test runs it in a process of its own
    raise SystemExit(main())
