"""The wire tables on the pages of boards say what the codecs do, byte by byte."""

import re
from pathlib import Path

import pytest

from haptogram_protocol.dialects import interactlab
from haptogram_protocol.dialects.autd3 import messages
from haptogram_protocol.dialects.autd3.link import Autd3BoardEnd, Autd3HostEnd
from haptogram_protocol.dialects.autd3.payload import PAYLOAD_BYTES, parse_autd3_operation
from haptogram_protocol.dialects.table import DIALECTS

PAGES = Path(__file__).parents[3] / "docs" / "boards"
POSES = (messages.Pose((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)),)


def tables(page):
    """Return the tables under "The wire" of a page: lists of rows of cells, headings first."""
    text = (PAGES / f"{page}.md").read_text().split("## The wire\n")[1].split("\n## ")[0]
    found = re.findall(r"(?:^\|.*\n)+", text, re.MULTILINE)
    return [
        [[cell.strip() for cell in row.strip().strip("|").split("|")] for row in table.splitlines()]
        for table in found
    ]


def named_bytes(cell, rows):
    """Return the bytes that the first cell of a row names; others are those of no other row."""
    if cell == "others":
        return set(range(256)).difference(*(named_bytes(row[0], []) for row in rows))
    texts = re.findall(r"`([0-9A-F?]{2})`", cell)
    highs = "0123456789ABCDEF" if "?" in cell else [""]
    values = [[int(text.replace("?", high), 16) for text in texts] for high in highs]
    if " to " not in cell:
        return {value for row in values for value in row}
    return {value for first, last in values for value in range(first, last + 1)}


def meanings(page, number, column):
    """Return what a column of a table says of each byte."""
    _, _, *rows = tables(page)[number]
    said = {}
    for at, row in enumerate(rows):
        for byte in named_bytes(row[0], rows[:at] + rows[at + 1 :] if row[0] == "others" else []):
            said[byte] = row[column]
    return said


def board_of(heading):
    """Return a new board of a column: a dialect, and perhaps an option."""
    name, *options = heading.strip("`").split()
    return DIALECTS[name].board(**dict(option.split("=") for option in options))


COLUMNS = [
    (page, number, column, heading)
    for page, number in (("sonicsurface", 0), ("ultraino", 0), ("ultraino", 1))
    for column, heading in enumerate(tables(page)[number][0])
    if 0 < column < len(tables(page)[number][0]) - 1
]


@pytest.mark.parametrize(
    ("page", "number", "column", "heading"), COLUMNS, ids=lambda value: str(value).strip("`")
)
def test_every_byte_is_the_operation_that_the_table_names(page, number, column, heading):
    said = meanings(page, number, column)
    assert set(said) == set(range(256))
    lead, end = (b"\xfe", b"\xfd") if number == 0 else (b"", b"\x00")
    for byte, name in said.items():
        board = board_of(heading)
        plain = [type(one).__name__ for one in board_of(heading).receive_data(lead + end)]
        found = [type(one).__name__ for one in board.receive_data(lead + bytes([byte]) + end)]
        for one in plain:
            found.remove(one)
        assert name in found, f"{byte:02X}: {found}"
        if name == "Forward":
            assert found == ["Forward"], f"{byte:02X}"


def test_every_bit_of_an_interactlab_frame_is_the_field_that_the_table_names():
    _, _, *rows = tables("interactlab")[0]
    base = bytearray(512)
    for at in (0, 25, 34):
        base[at] = 0x80
    board = interactlab.InteractlabBoardEnd

    def fields(frame):
        end = board()
        (found,) = end.receive_data(bytes(frame))
        return {name: getattr(found, name) for name in ("phases", "duties", "colour", "divider")}

    covered = set()
    for places, bits, field, _ in rows:
        first, last = [int(text) for text in places.split(" to ")] * (1 if " to " in places else 2)
        for at in range(first, last + 1):
            for bit in range(0, 7) if bits == "0 to 6" else [7]:
                covered.add((at, bit))
                if field == "start":
                    assert board().receive_data(bytes(512)) == []
                    continue
                frame = bytearray(base)
                frame[at] ^= 1 << bit
                before, after = fields(base), fields(frame)
                changed = {name for name in before if before[name] != after[name]}
                assert changed == (set() if field == "none" else {field}), (at, bit)
    assert covered == {(at, bit) for at in range(512) for bit in range(8)}


def test_every_message_of_the_link_begins_with_the_byte_that_the_table_names():
    _, _, *rows = tables("autd3")[0]
    host, board = Autd3HostEnd(), Autd3BoardEnd()
    made = {
        "Hello": messages.Hello(),
        "Open": messages.Open(POSES),
        "Update": messages.Update(POSES),
        "Read": messages.Read(),
        "Close": messages.Close(),
    }
    for first, name, *_ in rows:
        if name == "Write":
            line = bytes([int(first.strip("`"), 16)]) + bytes(626)
        else:
            line = host.send(made[name])
        assert line[0] == int(first.strip("`"), 16)
        assert [type(one).__name__ for one in board.receive_data(line)] == [name]
    assert {name for _, name, *_ in rows} == {*made, "Write"}


def test_every_tag_is_the_operation_that_the_table_names():
    said = meanings("autd3", 1, 1)
    assert set(said) == set(range(256))
    for tag, name in said.items():
        payload = bytes([tag, 3]).ljust(PAYLOAD_BYTES, b"\x01")
        operation, _ = parse_autd3_operation(payload, 0, 1)
        assert type(operation).__name__ == name, f"{tag:02X}"
