"""Outputs that would replace a file which the same command reads: refused before the work."""

from __future__ import annotations

import argparse
import itertools
import os
from pathlib import Path

import pytest

from haptogram.cli import COMMANDS, command_parser, main
from haptogram.commands.shell.output_files import INPUTS
from haptogram.settings.parser import file_name_option
from sim_device.command import command as board_command

OUTPUTS = {
    *(
        "csv",
        "frames",
        "html",
        "json",
        "junit",
        "picture",
        "pin_calibration",
        "record",
        "rows",
        "summary",
        "write_baseline",
    )
}
#: Read and written on purpose.
BOTH = {"resume"}
#: A file that each input takes: suffix and content.
FILES = {
    "object": (".stl", ""),
    "config": (".toml", "[verify]\n"),
    "fault_plan": (".toml", "seed = 1\n"),
    "drive": (".svg", ""),
}
NEEDED = {
    "capture": ["pins.vcd"],
    "replay": ["run.mcap"],
    "modulation": ["am"],
    "soak": ["--hours", "0.0001"],
    "sweep": ["sweep.toml"],
}
#: What an input of a command that judges captures makes sense with.
BESIDE = {
    "capture": ["--port", "none", "--channels", "map.toml"],
    "channels": ["--port", "none", "--capture", "pins.vcd"],
    "from_recording": ["--capture", "pins.vcd", "--channels", "map.toml"],
    "pin_calibration": ["--port", "none", "--capture", "pins.vcd", "--channels", "map.toml"],
}
CAPTURED = {"conform", "verify"}
SUFFIX = {"picture": ".svg"}
SPELLINGS = ("same", "dot", "link", "hard link")


def file_options(command: str) -> dict[str, argparse.Action]:
    """Return the options of a command that take the name of a file."""
    actions = command_parser(command).option_actions.values()
    return {action.dest: action for action in actions if takes_file(action)}


def takes_file(action: argparse.Action) -> bool:
    is_path = action.type is file_name_option or action.dest == "object"
    return is_path or any(word in str(action.metavar) for word in ("FILE", "JSON", "json"))


def beside(command: str, *names: str) -> list[str]:
    """Return the words that one of the options makes sense with."""
    words = [BESIDE[name] for name in names if name in BESIDE]
    return words[0] if words and command in CAPTURED else []


#: A recording is judged where nothing runs; faults are of a board that has no pins to capture.
EXCLUSIVE = {("from_recording", "record"), ("fault_plan", "pin_calibration")}
PAIRS = [
    (command, reader, writer)
    for command in COMMANDS
    if command != "board"
    for reader in sorted(file_options(command).keys() & INPUTS.keys())
    for writer in sorted(file_options(command).keys() & OUTPUTS)
    if reader != "compare" or (command, writer) in (("conform", "html"), ("bench", "json"))
    if (reader, writer) not in EXCLUSIVE
]


@pytest.mark.parametrize("command", [name for name in COMMANDS if name != "board"])
def test_every_option_that_takes_a_file_is_an_input_or_an_output(command: str) -> None:
    for name in file_options(command):
        assert sum((name in INPUTS, name in OUTPUTS, name in BOTH)) == 1, name


@pytest.mark.parametrize(
    ("command", "reader", "writer", "spelling"),
    [(*pair, way) for pair, way in zip(PAIRS, itertools.cycle(SPELLINGS), strict=False)],
)
def test_an_output_does_not_replace_an_input(
    command: str,
    reader: str,
    writer: str,
    spelling: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    suffix, content = FILES.get(reader, (".txt", "kept"))
    suffix = SUFFIX.get(writer, suffix) if reader != "object" else suffix
    source = Path(f"input{suffix}")
    source.write_text(content)
    other = f"other{SUFFIX.get(writer, suffix)}"
    if spelling == "link" or (reader == "object" and writer == "picture"):
        os.symlink(source, other)
    elif spelling == "hard link":
        os.link(source, other)
    else:
        other = str(source) if spelling == "same" else f"./{source}"
    options = file_options(command)
    options_words = [f"{word(options[reader])}={source}", f"{word(options[writer])}={other}"]
    needed = [*NEEDED.get(command, []), *beside(command, reader, writer)]
    assert main([command, *needed, *options_words]) == 2
    said = capsys.readouterr()
    assert said.err == (
        f"haptogram {command}: {word(options[writer])} {Path(other)}: would replace the file that "
        f"{named(options[reader])} reads; name another one\n"
    )
    assert said.out == ""
    assert source.read_text() == content


def named(action: argparse.Action) -> str:
    return word(action) if action.option_strings else "this command"


def word(action: argparse.Action) -> str:
    return action.option_strings[0]


@pytest.mark.parametrize("command", [name for name in COMMANDS if name != "board"])
def test_an_empty_name_is_no_folder(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    for name, action in file_options(command).items():
        if name in ("object", "array"):
            continue
        needed = NEEDED.get(command, [])
        assert main([command, *needed, word(action), ""]) == 2
        assert capsys.readouterr().err == (
            f"haptogram {command}: {word(action)} is '', must be the name of a file\n"
        )


def test_devices_may_be_read_and_written() -> None:
    words = ["--virtual-time", "--object", "point", "--array", "6x6", "--quiet"]
    files = ("--fault-plan", "--frames", "--json")
    assert main(["verify", *words, *(f"{option}={os.devnull}" for option in files)]) == 0


def test_a_shape_and_a_grid_are_no_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("point", "6x6"):
        Path(name).write_text("a result of yesterday")
    words = ["--virtual-time", "--object", "point", "--array", "6x6", "--quiet"]
    assert main(["verify", *words, "--json", "point", "--frames", "6x6"]) == 0


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--link x --backdoor x", "--link and --backdoor are both the same file, x"),
        ("--link x --backdoor ./x", "--link and --backdoor are both the same file, x"),
        (
            "--link x --backdoor in --fault-plan in",
            "--backdoor in: would replace the file that --fault-plan reads",
        ),
        ("--link in --calibration in", "--link in: would replace the file that --calibration"),
        ("--link x --backdoor in --array in", "--backdoor in: would replace the file that --array"),
    ],
)
def test_a_board_refuses_one_name_for_two_files(
    words: str,
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("in").write_text("kept")
    assert board_command.main(words.split()) == 2
    said = capsys.readouterr().err
    assert message in said
    assert said.count("\n") == 1
    assert os.listdir() == ["in"]
    assert Path("in").read_text() == "kept"
