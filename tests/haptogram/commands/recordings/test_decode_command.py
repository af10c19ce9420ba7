"""``haptogram decode`` on dumps, hex text and garbage, through the command line."""

import io
import json
import re
import sys
from pathlib import Path

import pytest

from haptogram.cli import main
from haptogram_protocol.dialects.table import DIALECTS
from haptogram_protocol.framing import encode_frame
from haptogram_protocol.messages import Header, Ping

CAPTURES = Path(__file__).parents[3] / "data" / "dialects"
PING = encode_frame(Header(Ping.TYPE, 0, 5, 0, 0x1234).pack() + Ping(7).pack())
TEXT = "PING seq 5 session 0x1234 flags 0x00 t 0: payload 7"


def run(capsys, *words):
    assert main(["decode", *map(str, words)]) == 0
    return capsys.readouterr()


@pytest.fixture
def dump(tmp_path):
    path = tmp_path / "dump.bin"
    path.write_bytes(b"boot\x00" + PING)
    return path


def test_a_dump_is_a_line_for_each_frame_damage_included(dump, capsys):
    lines = run(capsys, dump).out.splitlines()
    assert lines[0].split(None, 2)[:2] == ["0", "4"]
    assert "no frame" in lines[0]
    field = next(iter(Ping.WIRE))
    assert lines[1].split(None, 2) == ["6", str(len(PING) - 2), TEXT.replace("payload", field)]


@pytest.mark.parametrize(
    "text",
    [
        PING.hex(),
        PING.hex(" ").upper(),
        ", ".join(f"0x{byte:02x}" for byte in PING),
        "".join(f"\\x{byte:02x}" for byte in PING),
        "\n".join(f"0X{byte:02X}" for byte in PING) + "\n",
    ],
)
def test_hex_text_is_known_by_its_characters(text, tmp_path, capsys, monkeypatch):
    path = tmp_path / "hex.txt"
    path.write_text(text)
    of_file = run(capsys, path).out
    assert "PING seq 5" in of_file
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(text.encode())))
    assert run(capsys, "-").out == of_file


def test_the_examples_of_help_and_page_are_frames(capsys, monkeypatch):
    with pytest.raises(SystemExit):
        main(["decode", "--help"])
    page = (Path(__file__).parents[4] / "docs" / "recordings.md").read_text("utf-8")
    shown = re.findall(r"echo ([^|]*) \| haptogram decode -", capsys.readouterr().out + page)
    assert len(shown) == 2
    for text in shown:
        monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(text.strip("'").encode())))
        assert "PING seq" in run(capsys, "-").out


def test_hex_text_in_many_blocks_is_the_same_as_raw_bytes(tmp_path, capsys):
    raw, text = tmp_path / "raw.bin", tmp_path / "hex.txt"
    raw.write_bytes(PING * 9000)
    text.write_text(" ".join(f"0x{byte:02x}" for byte in raw.read_bytes()))
    assert run(capsys, text).out == run(capsys, raw).out


@pytest.mark.parametrize("text", ["00 0f 0", "00 0f zz", "no hex at all", "0x"])
def test_what_is_no_hex_text_is_refused_where_hex_was_asked_for(text, tmp_path, capsys):
    path = tmp_path / "hex.txt"
    path.write_text(text)
    assert main(["decode", "--input", "hex", str(path)]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "no hex text at character" in error


@pytest.mark.parametrize(
    "path", sorted(CAPTURES.glob("*/*.bin")), ids=lambda path: f"{path.parent.name}/{path.stem}"
)
def test_a_capture_of_a_client_is_recognised_or_chosen(path, capsys):
    found = run(capsys, path, "--json")
    if "look like no wire" in found.err:  # too short to tell: off, commit
        found = run(capsys, path, "--json", "--dialect", "ultraino-mega64")
    pieces = [json.loads(line) for line in found.out.splitlines()]
    assert sum(piece["size"] for piece in pieces) == path.stat().st_size
    assert any(piece["name"] for piece in pieces)
    assert all(piece["name"] or piece["fault"] for piece in pieces)


@pytest.mark.parametrize("name", ["haptogram", *DIALECTS])
@pytest.mark.parametrize("options", [[], ["--verbose"], ["--json"], ["--from-board"]])
def test_noise_is_told_in_every_dialect_and_form(name, options, tmp_path, capsys):
    path = tmp_path / "noise.bin"
    path.write_bytes(bytes(range(256)) * 3)
    out = run(capsys, path, "--dialect", name, *options).out
    assert out
    if "--json" in options:
        assert all(json.loads(line)["size"] >= 0 for line in out.splitlines())


def test_two_wires_that_look_alike_are_named(capsys):
    path = CAPTURES / "sonicsurface" / "focus_0_120_0.bin"
    assert "look like sonicsurface and ultraino-fpga" in run(capsys, path).err
    assert run(capsys, path, "--dialect", "ultraino-fpga").err == ""


def test_verbose_shows_every_field_in_full(dump, capsys):
    lines = run(capsys, dump, "--verbose").out.splitlines()
    field = next(iter(Ping.WIRE))
    assert [line.strip() for line in lines][-1] == f"{field} = 7"


def test_a_file_without_bytes_is_told(tmp_path, capsys):
    path = tmp_path / "empty"
    path.write_bytes(b"")
    assert run(capsys, path) == ("", f"haptogram decode: there are no bytes in {path}\n")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["missing"], "'missing' cannot be read: there is no such file"),
        (["."], "it is a folder"),
        ([""], "must be the name of a file"),
        (["FILE", "--input", "recording"], "is no recording"),
        (["FILE", "--dialect", "sonicsurfac"], "did you mean sonicsurface?"),
    ],
)
def test_what_cannot_be_read_is_refused_in_one_line(words, message, dump, capsys):
    assert main(["decode", *[str(dump) if word == "FILE" else word for word in words]]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert message in error
