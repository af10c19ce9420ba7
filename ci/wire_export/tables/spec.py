"""The generated parts of SPEC.md: byte tables, enumerations, states, worked frames."""

from __future__ import annotations

import enum
import re
from collections.abc import Callable, Mapping
from typing import Any, Final

from haptogram_protocol import messages as m
from haptogram_protocol.errors import LocalProtocolError
from haptogram_protocol.rules import (
    CONFIG_BOUNDS,
    READ_CAPABILITIES,
    TRACE_CAPABILITIES,
    TYPE_CAPABILITIES,
    UPLOAD_CAPABILITIES,
)
from haptogram_protocol.state import (
    LINK_TRANSITIONS,
    OUTPUT_TRANSITIONS,
    LinkInput,
    LinkState,
    OutputInput,
    OutputState,
)

from .schema import CONSTANTS, ENUMERATIONS, spec_summary, spec_type_name
from .worked import EXCHANGE, WORKED_FRAMES, worked_spec_frame

_HEX_ROW: Final = 24  # bytes in a line of an example


def _spec_table(head: list[str], rows: list[list[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _spec_record_table(name: str) -> str:
    """Return the byte table of a record or message, given the name of its class."""
    record = getattr(m, name)
    rows = [
        [str(field.offset), str(field.size), spec_type_name(field), f"`{key}`", field.doc]
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
        + spec_summary(record)
        + (
            "\n\n" + _spec_table(["offset", "size", "type", "field", "meaning"], rows)
            if rows
            else ""
        )
    )


def _spec_enumeration_table(name: str) -> str:
    """Return the table of an enumeration of :data:`ENUMERATIONS`."""
    kind = next(kind for kind in ENUMERATIONS if kind.__name__ == name)
    flags = issubclass(kind, enum.IntFlag)
    rows = [
        [f"{int(member):#x}" if flags else str(int(member)), f"`{member.name}`", _spec_doc(member)]
        for member in kind
    ]
    return _spec_table(["bit" if flags else "value", "name", "meaning"], rows)


def _spec_doc(member: enum.IntEnum | enum.IntFlag) -> str:
    return str(getattr(member, "doc", ""))


def _spec_types_table(_: str = "") -> str:
    """Return the table of all message types."""
    rows = [
        [f"`{kind.TYPE:#04x}`", kind.TYPE.name, _spec_length(kind), spec_summary(kind)]
        for kind in m.MESSAGES.values()
    ]
    return _spec_table(["type", "name", "payload, bytes", "what it is"], rows)


def _spec_length(kind: type[m.Message]) -> str:
    if not kind.TAIL:
        return str(kind.LAYOUT.size)
    tail = f"{kind.TAIL.unit} n" if kind.TAIL.unit > 1 else "n"
    return f"{kind.LAYOUT.size} + {tail}" if kind.LAYOUT.size else tail


def _spec_transitions(
    table: Mapping[Any, enum.Enum], states: type[enum.Enum], inputs: type[enum.Enum]
) -> str:
    rows = [
        [event.name, *(_spec_target_state(table.get((state, event))) for state in states)]
        for event in inputs
    ]
    return _spec_table(["input \\ state", *(state.name for state in states)], rows)


def _spec_target_state(state: enum.Enum | None) -> str:
    return state.name if state is not None else "-"


def _spec_output_table(_: str = "") -> str:
    """Return the transition table of the board's output."""
    return _spec_transitions(OUTPUT_TRANSITIONS, OutputState, OutputInput)


def _spec_link_table(_: str = "") -> str:
    """Return the transition table of the host's link."""
    return _spec_transitions(LINK_TRANSITIONS, LinkState, LinkInput)


def _spec_constants_table(_: str = "") -> str:
    """Return the table of the numbers that both ends must agree on."""
    return _spec_table(
        ["constant", "value", "hex"],
        [[f"`{name}`", str(value), f"`{value:#x}`"] for name, value in CONSTANTS.items()],
    )


# --- Rules (chapter 14) --------------------------------------------------------------------------


def _spec_bounds_table(_: str = "") -> str:
    """Return least and most of the settings."""
    zero = {"status_period_ms": ", or 0: none"}
    return _spec_table(
        ["field", "least", "most"],
        [
            [f"`{k}`", f"{least}{zero.get(k, '')}", str(most)]
            for k, (least, most) in CONFIG_BOUNDS.items()
        ],
    )


def _spec_capabilities_table(_: str = "") -> str:
    """Return every type and value that needs a capability."""
    rows = [[kind.name, _spec_features(any_of)] for kind, any_of in TYPE_CAPABILITIES.items()]
    for field, capabilities in _VALUE_CAPABILITIES.items():
        rows += [
            [f"{field} = {value.name}", _spec_features(needed)]
            for value, needed in capabilities.items()
            if needed
        ]
    return _spec_table(["request, stream frame or value", "needs"], rows)


_VALUE_CAPABILITIES: Final[Mapping[str, Mapping[Any, m.Feature]]] = {
    "UPLOAD_BEGIN, `kind`": UPLOAD_CAPABILITIES,
    "READ_DRIVE, `kind`": READ_CAPABILITIES,
    "SET_CONFIG, `trace_mode`": TRACE_CAPABILITIES,
}


def _spec_features(any_of: m.Feature) -> str:
    return " or ".join(f"`{feature.name}`" for feature in m.Feature if feature & any_of)


# --- Worked frames and exchange (chapter 13) -----------------------------------------------------


def _spec_frames_text(_: str = "") -> str:
    """Return every worked frame in hex: header and payload, then the bytes on the line."""
    parts = []
    for number, title in enumerate(WORKED_FRAMES, 1):
        body, wire = worked_spec_frame(title)
        parts.append(
            f"**Frame {number}.** {title}.\n\n"
            f"```\nbody {_spec_hex(body)}\nline {_spec_hex(wire)}\n```"
        )
    return "\n\n".join(parts)


def _spec_exchange_text(_: str = "") -> str:
    """Return the worked exchange: when, who, what, and header and payload in hex."""
    lines = ["   µs  from"]
    for step in EXCHANGE:
        lines.append(f"{step.t_us:5}  {'host ' if step.from_host else 'board'}  {step.words}")
        lines += [f"{'':14}{line}" for line in _spec_hex_rows(step.body)]
    return "```\n" + "\n".join(lines) + "\n```"


def _spec_hex(data: bytes) -> str:
    return "\n     ".join(_spec_hex_rows(data))


def _spec_hex_rows(data: bytes) -> list[str]:
    rows = (data[at : at + _HEX_ROW] for at in range(0, len(data), _HEX_ROW))
    return [row.hex(" ") for row in rows]


# --- SPEC.md -----------------------------------------------------------------------------------

_GENERATORS: Final[Mapping[str, Callable[[str], str]]] = {
    "record": _spec_record_table,
    "enumeration": _spec_enumeration_table,
    "types": _spec_types_table,
    "output-states": _spec_output_table,
    "link-states": _spec_link_table,
    "constants": _spec_constants_table,
    "bounds": _spec_bounds_table,
    "capabilities": _spec_capabilities_table,
    "frames": _spec_frames_text,
    "exchange": _spec_exchange_text,
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
