"""SPEC.md says what the code does: tables, frames, clauses, counters, codes."""

import re
from pathlib import Path

import pytest

from haptogram_protocol.connection import (
    INITIAL_RTO_US,
    MAX_ATTEMPTS,
    MAX_RTO_US,
    MIN_RTO_US,
    NEED_DATA,
    HostConnection,
)
from haptogram_protocol.connection.events import FrameDropped, ReplyReceived
from haptogram_protocol.framing import FrameDecoder, encode_frame
from haptogram_protocol.messages import (
    MESSAGES,
    Counters,
    ErrorCode,
    Feature,
    Flag,
    Hello,
    MessageType,
    Mute,
    Phases,
    build_body,
    parse_body,
)
from haptogram_protocol.state import MuteReason, OutputState
from wire_export.tables import ENUMERATIONS, RECORDS
from wire_export.tables.spec import update_spec
from wire_export.tables.worked import EXCHANGE, WORKED_FRAMES, WorkedStep
from wire_oracles import frame_bytewise

ROOT = Path(__file__).parents[2]
SPEC = (ROOT / "protocol" / "SPEC.md").read_text("utf-8")
CLAUSE = re.compile(r"^- \*\*(HG-\d+\.\d+)/(\d+)\*\* ((?:.|\n  )*)", re.MULTILINE)
CLAUSES = [match.groups() for match in CLAUSE.finditer(SPEC)]
SECTIONS = re.findall(r"^### (HG-\d+\.\d+) ", SPEC, re.MULTILINE)
WITHDRAWN = [
    clause
    for row in re.findall(r"^\| (.*) \| withdrawn", SPEC, re.MULTILINE)
    for clause in row.split(", ")
]
SOURCES = [
    path
    for folder in ("protocol", "haptogram", "sim_device", "tests")
    for path in (ROOT / folder).rglob("*.py")
]
SESSION = 0x5EED
FRAMES = re.findall(r"\*\*Frame \d+\.\*\* (.*)\.\n\n```\nbody ([^`]*)line ([^`]*)```", SPEC)


def test_what_is_generated_is_up_to_date() -> None:
    assert update_spec(SPEC) == SPEC, "run ci/export-wire"


def test_every_section_stands_in_its_chapter_in_order() -> None:
    chapters = re.findall(r"^## (\d+) ", SPEC, re.MULTILINE)
    assert chapters == [str(number) for number in range(1, 15)]
    numbers = [tuple(map(int, section[3:].split("."))) for section in SECTIONS]
    wanted = [
        (chapter, number + 1)
        for chapter in range(1, 13)
        for number in range(sum(first == chapter for first, _ in numbers))
    ]
    assert numbers == wanted


def test_every_clause_is_in_its_section_and_numbered_without_a_gap() -> None:
    position = {section: SPEC.index(f"### {section} ") for section in SECTIONS}
    seen: dict[str, int] = {}
    for match in CLAUSE.finditer(SPEC):
        section, number, _ = match.groups()
        before = [name for name in SECTIONS if position[name] < match.start()]
        assert before[-1] == section
        next_number = seen.get(section, 0) + 1
        while f"{section}/{next_number}" in WITHDRAWN:
            next_number += 1
        assert int(number) == next_number, section
        seen[section] = next_number
    assert len(CLAUSES) > 200


def test_every_clause_demands_something() -> None:
    assert [
        clause for clause in CLAUSES if not re.search(r"\b(MUST|SHOULD|MAY)\b", clause[2])
    ] == []


def test_nothing_is_demanded_without_a_number() -> None:
    prose = CLAUSE.sub("", SPEC)
    lines = [line for line in prose.splitlines() if re.search(r"\b(MUST|SHOULD|MAY)\b", line)]
    assert [line for line in lines if "RFC 2119" not in line] == []


def test_every_section_and_clause_quoted_in_code_exists() -> None:
    known = {f"{section}/{number}" for section, number, _ in CLAUSES} | set(SECTIONS)
    for path in SOURCES:
        quoted = set(re.findall(r"\bHG-\d+\.\d+(?:/\d+)?", path.read_text("utf-8")))
        assert quoted <= known, path


@pytest.mark.parametrize("kind", MESSAGES.values(), ids=lambda kind: kind.__name__)
def test_every_message_has_its_byte_table_in_the_chapter_of_its_docstring(kind: type) -> None:
    section = re.search(r"HG-\d+\.\d+", kind.__doc__ or "")
    at = SPEC.index(f"<!-- generated: record {kind.__name__} -->")
    if section:
        before = [name for name in SECTIONS if SPEC.index(f"### {name} ") < at]
        assert before[-1] == section[0]


def test_every_record_and_enumeration_has_its_table() -> None:
    for record in RECORDS:
        assert f"<!-- generated: record {record.__name__} -->" in SPEC
    for kind in set(ENUMERATIONS) - {MessageType}:  # which has a table of its own
        assert f"<!-- generated: enumeration {kind.__name__} -->" in SPEC


def _hand_written() -> str:
    return re.sub(r"<!-- generated.*?<!-- end -->", "", SPEC, flags=re.DOTALL)


def test_every_counter_error_code_state_and_flag_is_spoken_of() -> None:
    text = _hand_written()
    words = [f"`{name}`" for name in Counters.WIRE]
    words += [rf"\b{word.name}\b" for word in (*ErrorCode, *OutputState, *Flag)]
    assert [word for word in words if not re.search(word, text)] == []


def test_what_code_and_text_both_say_is_the_same() -> None:
    for number in (INITIAL_RTO_US, MIN_RTO_US):
        assert f"{number // 1000} ms" in SPEC
    assert f"at most {MAX_RTO_US // 1_000_000} s" in SPEC
    assert f"sent {MAX_ATTEMPTS} times" in SPEC
    for reason in (MuteReason.HOST_SILENT, MuteReason.HOLD_EXPIRED, MuteReason.UNATTENDED):
        assert f"MUTED({reason.name})" in SPEC
    for feature in (Feature.AMPLITUDE, Feature.POINTS, Feature.CONFIG, Feature.CONFIG_KEPT):
        assert f"`{feature.name}`" in _hand_written()


def test_all_worked_frames_are_there() -> None:
    assert [title for title, _, _ in FRAMES] == list(WORKED_FRAMES)
    assert {WORKED_FRAMES[title][0].TYPE for title, _, _ in FRAMES} >= {
        MessageType.PHASES,
        MessageType.DRIVES,
        MessageType.POINTS,
        MessageType.HELLO,
        MessageType.PLAY,
        MessageType.ERROR,
        MessageType.TRACE,
    }


@pytest.mark.parametrize(("title", "body", "line"), FRAMES)
def test_worked_frames_as_printed(title: str, body: str, line: str) -> None:
    body_bytes, line_bytes = bytes.fromhex(body), bytes.fromhex(line)
    assert frame_bytewise(body_bytes) == line_bytes
    assert FrameDecoder().feed(line_bytes) == [body_bytes]
    header, message = parse_body(body_bytes)
    assert message == WORKED_FRAMES[title][0]
    fields = {"flags": header.flags, "seq": header.seq, "time_us": header.time_us}
    assert encode_frame(build_body(message, **fields, session=header.session)) == line_bytes


def test_the_worked_exchange_as_printed_is_what_a_host_says_and_takes() -> None:
    (block,) = re.findall(r"<!-- generated: exchange -->\n\n```\n(.*?)```", SPEC, re.DOTALL)
    printed = re.findall(
        r"^ *\d+  (host |board)  (\w+)(?:.*)\n((?: {14}.*\n)+)", block, re.MULTILINE
    )
    assert len(printed) == len(EXCHANGE)
    for (end, name, hexes), step in zip(printed, EXCHANGE, strict=True):
        header, message = parse_body(bytes.fromhex(hexes))
        assert (end == "host ", name) == (header.type < 0x80, message.TYPE.name)
        assert message == step.message
    host = HostConnection(nonce=SESSION)
    events = []
    for step in EXCHANGE:
        line = encode_frame(step.body)
        if not step.from_host:
            host.receive_data(line, step.t_us)
            events += iter(host.next_event, NEED_DATA)
        elif isinstance(step.message, Phases):
            t_apply_us = step.header["time_us"]
            assert host.stream_frame(step.message, t_apply_us=t_apply_us)[1] == line
        else:
            _say(host, step)
            assert host.data_to_send() == line
    assert [event for event in events if isinstance(event, FrameDropped)] == []
    assert [event.message for event in events if isinstance(event, ReplyReceived)] == [
        step.message for step in EXCHANGE if not step.from_host and step.message.TYPE < 0xC0
    ]


def _say(host: HostConnection, step: WorkedStep) -> None:
    if isinstance(step.message, Hello):
        host.send_hello(step.t_us)
    elif isinstance(step.message, Mute):
        host.send_mute(step.t_us)
    else:
        host.send_request(step.message, step.t_us)
