"""Every refusal comes before the work: one line with option, value and limit, and status 2."""

from __future__ import annotations

import argparse
import math
import os
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from haptogram.cli import COMMANDS, command_parser, main
from haptogram.commands.verify.options import GROUPS
from haptogram.settings.option import options_of
from haptogram.settings.run.verify import VerifyConfig

#: What a command needs besides the option in question, to be a command line.
NEEDED = {
    "board": ["--link", "board"],
    "soak": ["--hours", "0.01"],
    "modulation": ["am"],
    "sweep": ["sweep.toml"],
}
LIMITS = re.compile(r"must be (a number, |a whole number, )?(\S+) to (\S+)")
CHOICES = re.compile(r"known are (.*)")
ABSENT = 99  # of no clause of that section
UNKNOWN_CLAUSE = "there is no such case or clause; --list shows all cases"
COORDINATES = re.compile(r"must be X,Y,Z, each (\S+) to (\S+) mm")


def actions_with_values(command: str) -> list[argparse.Action]:
    """Return the options of a command that take a value."""
    actions = {id(a): a for a in command_parser(command).option_actions.values()}
    return [action for action in actions.values() if action.nargs != 0]


def refusal(action: argparse.Action, value: str) -> str | None:
    """Return what the parser says of a value; None: it takes it."""
    try:
        action.type(value) if callable(action.type) else None
    except argparse.ArgumentTypeError as error:
        return str(error)
    return None


def is_numeric(action: argparse.Action) -> bool:
    told = refusal(action, "xyzzy") or ""
    return LIMITS.search(told) is not None


NUMERIC = [
    (command, action.option_strings[0])
    for command in COMMANDS
    for action in actions_with_values(command)
    if is_numeric(action)
]
POSITIONS = [
    (command, action.option_strings[0])
    for command in COMMANDS
    for action in actions_with_values(command)
    if action.metavar == "X,Y,Z"
]
CHOSEN = [
    (command, action.option_strings[0])
    for command in COMMANDS
    for action in actions_with_values(command)
    if action.choices or "known are" in (refusal(action, "xyzzy") or "")
]


VALUED = [
    (command, action.option_strings[-1])
    for command in COMMANDS
    for action in actions_with_values(command)
    if action.option_strings
]


@pytest.fixture
def refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[[str, list[str]], str]:
    """Run commands in an empty folder; each must end with status 2, one line and no file."""
    monkeypatch.chdir(tmp_path)

    def line_of(command: str, words: list[str]) -> str:
        is_instead = words[0] in (*NEEDED.get(command, []), "--serial")
        needed = [] if is_instead else NEEDED.get(command, [])
        assert main([command, *needed, *words]) == 2
        out, err = capsys.readouterr()
        assert out == ""
        assert err.count("\n") == 1
        assert "Traceback" not in err
        assert "Errno" not in err
        assert list(tmp_path.iterdir()) == []
        name = f"haptogram {command}: {words[0].partition('=')[0]} "
        assert err.startswith(name)
        return err.removeprefix(name)

    return line_of


def test_the_lists_are_those_of_the_commands() -> None:
    without = {"presets", "decode", "repair", "view", "capture"}
    assert {command for command, _ in NUMERIC} >= {*COMMANDS} - without
    assert len(NUMERIC) > 60
    assert ("verify", "--center-mm") in POSITIONS
    assert ("conform", "--dtr") in CHOSEN


def test_every_setting_of_a_run_is_in_one_group_of_the_help() -> None:
    names = [name for group in GROUPS.values() for name in group]
    assert sorted(names) == sorted(options_of(VerifyConfig))


@pytest.mark.sampled(20)
@pytest.mark.parametrize(("command", "word"), NUMERIC)
def test_a_number_beyond_its_limits_or_none_is_refused_with_the_limits(
    command: str,
    word: str,
    refused: Callable[[str, list[str]], str],
) -> None:
    told = refused(command, [f"{word}=xyzzy"])
    assert told.startswith("is 'xyzzy', ")
    limits = LIMITS.search(told)
    assert limits
    low, high = float(limits[2]), float(limits[3])
    assert math.isfinite(low)
    assert low < high < math.inf
    beyond = {
        f"{low - 1 - abs(low):.17g}": "must be",
        f"{high + 1 + abs(high):.20g}": "must be",
        "nan": "is ",
        "inf": "is ",
        "-inf": "is ",
        "": "is '', ",
        " ": "is ' ', ",
    }
    for value, begins in beyond.items():
        line = refused(command, [f"{word}={value}"])
        assert begins in line
        assert f"{limits[2]} to {limits[3]}" in line


@pytest.mark.sampled(20)
@pytest.mark.parametrize(("command", "word"), VALUED)
def test_two_dashes_are_no_value(
    command: str, word: str, refused: Callable[[str, list[str]], str]
) -> None:
    """Argparse takes them away, and leaves an empty list for the value."""
    assert refused(command, [f"{word}=--"]) == "needs a value\n"


@pytest.mark.sampled(20)
@pytest.mark.parametrize(("command", "word"), POSITIONS)
@pytest.mark.parametrize(
    "value", ["a\nb", "", "1", "1,2", "1,2,3,4", "a,b,c", "nan,0,0", "0,0,1e9", "1;2"]
)
def test_a_position_that_is_none_is_refused_with_its_form_and_limits(
    command: str,
    word: str,
    value: str,
    refused: Callable[[str, list[str]], str],
) -> None:
    assert COORDINATES.search(refused(command, [f"{word}={value}"]))


@pytest.mark.parametrize(("command", "word"), CHOSEN)
def test_a_choice_that_is_none_is_refused_with_those_that_are_known(
    command: str,
    word: str,
    refused: Callable[[str, list[str]], str],
) -> None:
    for value in ("xyzzy", "", "7.0"):
        line = refused(command, [f"{word}={value}"])
        assert line.startswith(f"is '{value}'")
        assert CHOICES.search(line)


OTHERS = [
    ("verify", "--array 0x0", "is '0x0', must be a grid of 1 to 1024 elements"),
    ("verify", "--array nowhere.csv", "'nowhere.csv' cannot be read: there is no such file"),
    ("verify", "--array .", "'.' cannot be read: it is a folder; name a file"),
    ("verify", "--config nowhere.toml", "'nowhere.toml' cannot be read: there is no such file"),
    ("verify", "--calibration nowhere.csv", "'nowhere.csv' cannot be read: there is no such"),
    ("verify", "--fault-plan nowhere.toml", "'nowhere.toml' cannot be read: there is no such"),
    ("verify", "--fault line.flop", "'line.flop' is no fault; did you mean line.flip?"),
    ("verify", "--fault line.flip\xa0ber=7", "line.flip ber=7, must be 0 to 1"),
    ("verify", "--object nowhere.stl", "'nowhere.stl' cannot be read: there is no such file"),
    ("verify", "--json .", "'.' cannot be written: it is a folder; name a file"),
    ("verify", "--json /proc/new", "'/proc/new' cannot be written: no file can be made in '/proc'"),
    ("verify", "--array 16", "'16' cannot be read: there is no such file; a grid is written NXxNY"),
    ("verify", "--fault device.off\xa0bank=4", "device.off bank=4, must be 0 to 3 (256 trans"),
    ("board", "--fault device.off\xa0column=16", "device.off column=16, must be 0 to 15 (256 "),
    ("board", "--dialect sonic --mutant crc-61", "is 'sonic'; known are autd3, "),
    ("board", "--mutant x --dialect autd3", "x acts only on Haptogram's own firmware, not on a "),
    ("board", "--latch-lead-us 5 --dialect autd3", "5 acts only on Haptogram's own firmware, "),
    ("board", "--pitch-mm 5 --dialect autd3", "acts only on an array that is a grid; leave it out"),
    ("board", "--array 16x16 --dialect ultraino-mega64", "of 256 elements on channels up to 255; "),
    ("board", "--mutant crc-61", "is 'crc-61'; known are crc-unchecked"),
    ("board", "--latency-ms 16", "needs a baud rate"),
    ("board", "--serial /dev/null", "/dev/null cannot be opened: it is no serial port"),
    ("soak", "--mutant crc-61 --record a.mcap", "is 'crc-61'; known are crc-unchecked"),
    ("conform", "--clause HG-99", f"HG-99: {UNKNOWN_CLAUSE}"),
    ("conform", "--clause 2.4/2", f"2.4/2: {UNKNOWN_CLAUSE}; did you mean HG-2.4/2?"),
    (
        "conform",
        f"--clause HG-2.4/{ABSENT}",
        f"HG-2.4/{ABSENT}: {UNKNOWN_CLAUSE}; did you mean HG-2.4/",
    ),
    ("conform", "--spawn x --port y --record a.mcap", "names its own port: --port is one too many"),
    ("conform", "--port-regex ( --spawn true", "'(' is no regular expression: "),
    ("conform", "--port-regex x --spawn true", "'x' has no group; put the port in parentheses"),
    ("conform", "--spawn ./nowhere", "./nowhere cannot be started: there is no such file"),
    ("conform", "--baseline no.toml --record a.mcap", "'no.toml' cannot be read: there is no such"),
    *(
        (command, "--channels no.toml --port none --capture a.vcd", "'no.toml' cannot be read")
        for command in ("verify", "conform")
    ),
    ("conform", "--compare nowhere.json --html a.html", "'nowhere.json' cannot be read: there"),
    ("bench", "--compare nowhere.json", "'nowhere.json' cannot be read: there is no such file"),
    ("field", "--drive nowhere.csv", "'nowhere.csv' cannot be read: there is no such file"),
    ("field", "--step-mm 0.01 --half-width-mm 900 --picture a.png", "is 0.01; with --half-width"),
    ("field", "--step-mm 90 --picture a.png", "is 90, must be below 60 mm with --half-width-mm"),
]


@pytest.mark.sampled(11)
@pytest.mark.parametrize(("command", "line", "told"), OTHERS)
def test_other_values_that_cannot_be_used_are_refused_as_plainly(
    command: str,
    line: str,
    told: str,
    refused: Callable[[str, list[str]], str],
) -> None:
    words = [word.replace("\xa0", " ") for word in line.split(" ")]
    assert refused(command, words).startswith(told)


#: Options that read a file of text, and what a command needs to come to read it.
TEXTS = [
    ("verify", "--array"),
    ("verify", "--calibration"),
    ("verify", "--config"),
    ("verify", "--fault-plan"),
    ("conform", "--baseline"),
    ("bench", "--compare"),
    ("field", "--drive"),
]


@pytest.mark.parametrize(("command", "word"), TEXTS)
def test_a_file_that_is_no_text_is_refused_in_plain_words(
    command: str, word: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "latin"
    path.write_bytes(b"a = \xe9\n")
    assert main([command, word, str(path)]) == 2
    told = capsys.readouterr().err
    assert f"{word} '{path}' cannot be read: it is no text in UTF-8, from byte 4 on\n" in told
    assert told.count("\n") == 1


@pytest.mark.parametrize(("command", "word"), TEXTS)
@pytest.mark.parametrize(
    ("name", "told"), [("n" * 300, "the name is too long"), ("a\nb", "there is no such file")]
)
def test_a_name_that_no_file_has_is_refused_in_one_line(
    command: str, word: str, name: str, told: str, refused: Callable[[str, list[str]], str]
) -> None:
    said = refused(command, [word, name])
    assert said.startswith(f"'{name}' cannot be read: {told}".replace("\n", " "))


def test_a_calibration_in_a_pipe_is_refused_since_two_read_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    os.mkfifo(tmp_path / "pipe")
    assert main(["verify", "--virtual-time", "--calibration", str(tmp_path / "pipe")]) == 2
    assert "is a pipe, and is read more than once; name a file" in capsys.readouterr().err


def test_names_in_an_obj_file_may_be_in_any_encoding(tmp_path: Path) -> None:
    path = tmp_path / "triangle.obj"
    path.write_bytes(b"# \xe9\no T\xe9l\xe9\nv 0 0 0\nv 50 0 0\nv 0 50 0\nf 1 2 3\n")
    assert main(["modulation", "dwell", "--object", str(path), "--array", "6x6"]) == 0


def test_a_new_folder_is_told_before_the_work_and_made(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "a" / "b" / "figures.json"
    assert main(["presets", "paper", "--json", str(path)]) == 0
    assert capsys.readouterr().err.startswith(f"{path.parent}: a new folder, to be made for what")
    assert path.exists()


@pytest.mark.parametrize(
    "line",
    [
        "presets paper --json",
        "verify --virtual-time --record",
        "board --tcp 0 --backdoor",
        "board --link",
    ],
)
def test_no_folder_is_made_beside_those_of_the_system(
    line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*line.split(), "/no-such-folder/b"]) == 2
    assert "there is no folder '/no-such-folder'" in capsys.readouterr().err
    assert not Path("/no-such-folder").exists()
