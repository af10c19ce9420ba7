"""The description, its hash, and the command that rewrites SPEC.md."""

import json
from pathlib import Path

import pytest

from haptogram_protocol.errors import LocalProtocolError
from haptogram_protocol.messages import MESSAGES, FocalPoint, Header
from haptogram_protocol.record import Record, record, wire
from wire_export.__main__ import export_wire
from wire_export.c import HEADERS
from wire_export.tables import schema as export
from wire_export.tables.spec import update_spec
from wire_export.vectors import FILES


def test_the_description_is_json_and_complete() -> None:
    described = json.loads(json.dumps(export.wire_description()))
    assert {m["type"] for m in described["messages"].values()} == set(MESSAGES)
    for name, number in (("HELLO", 8), ("HELLO_REPLY", 110), ("PLAY", 14)):
        message = described["messages"][name]
        assert message["size"] == number == sum(field["size"] for field in message["fields"])
    header = described["records"]["Header"]["fields"]
    assert [(f["name"], f["offset"], f["type"]) for f in header] == [
        ("type", 0, "u8"),
        ("flags", 1, "u8"),
        ("seq", 2, "u16"),
        ("time_us", 4, "u32"),
        ("session", 8, "u16"),
    ]
    assert described["enumerations"]["ErrorCode"]["NOT_FOUND"]["value"] == 13
    assert described["messages"]["POINTS"]["tail"] == {
        "name": "points",
        "unit": FocalPoint.LAYOUT.size,
        "least": 1,
        "record": "FocalPoint",
        "doc": "focal points",
    }


def test_every_nested_record_is_described() -> None:
    described = export.wire_description()
    used = {
        field["type"]
        for group in ("records", "messages")
        for entry in described[group].values()
        for field in entry["fields"]
        if field["type"][0].isupper()
    }
    assert used <= set(described["records"])


def test_layouts_follow_from_the_declared_fields() -> None:
    @record
    class Example(Record):
        """An example."""

        small: int = wire("B", "one byte")
        large: int = wire("Q", "eight bytes")

    assert {name: (f.offset, f.size) for name, f in Example.WIRE.items()} == {
        "small": (0, 1),
        "large": (1, 8),  # without padding
    }
    assert Header.LAYOUT.size == 10


def test_a_marker_that_nothing_is_generated_for_is_refused() -> None:
    with pytest.raises(LocalProtocolError, match="poem"):
        update_spec("<!-- generated: poem -->\n<!-- end -->")


def test_only_what_stands_between_markers_is_rewritten() -> None:
    text = "before\n<!-- generated: record Arm -->\nold\n<!-- end -->\nafter <!-- end -->\n"
    made = update_spec(text)
    assert made.startswith("before\n<!-- generated: record Arm -->\n\n**`0x41` ARM**")
    assert made.endswith("<!-- end -->\nafter <!-- end -->\n")
    assert "old" not in made
    assert update_spec(made) == made


def test_the_command_rewrites_every_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "c").mkdir()
    (tmp_path / "vectors").mkdir()
    spec = tmp_path / "SPEC.md"
    spec.write_text("λ\n<!-- generated: constants -->\nold\n<!-- end -->\n", "utf-8")
    assert export_wire([str(tmp_path)]) == 0
    assert "`VERSION_MAJOR`" in spec.read_text("utf-8")
    files = [spec, *(tmp_path / "c" / name for name in HEADERS)]
    files += [tmp_path / "vectors" / name for name in FILES]
    assert capsys.readouterr().out.split() == list(map(str, files))
    assert {path for path in tmp_path.rglob("*") if path.is_file()} == set(files)


def test_the_command_prints_the_description(capsys: pytest.CaptureFixture[str]) -> None:
    assert export_wire(["--json"]) == 0
    assert json.loads(capsys.readouterr().out) == export.wire_description()


def test_the_command_refuses_a_folder_of_something_else(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit, match="2"):
        export_wire([str(tmp_path)])
    assert "must have a SPEC.md and the folders c and vectors" in capsys.readouterr().err
