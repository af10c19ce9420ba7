"""Every option of bench and conform with values that it cannot take: one line and status 2."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from haptogram.cli import command_parser, main

#: Words that make a run quick, if one begins.
QUICK = {"bench": ["--seconds=0.05"], "conform": ["--clause=HG-2.3/1", "--quiet"]}
FOLDER = "folder"
PLACES = ["", FOLDER]
VALUES = [
    *PLACES,
    *("text", "-1", "0", "nan", "inf", "-inf", "1e308", "9" * 40, "1,2"),
    *("µ漢😀", "\udcff", "a\nb", "absent.file", "binary.bin", "unix:", os.devnull),
]
#: Options that take any name, of a file that is written.
OUTPUTS = {"html", "json", "junit", "picture", "pin_calibration", "record", "summary"}
OUTPUTS |= {"write_baseline"}
#: What makes sense after all.
GOOD = {("--explore", "0"), ("--seed", "0"), ("--spin-us", "0")}
ROWS = [
    (command, word)
    for command in QUICK
    for word, action in command_parser(command).option_actions.items()
    if action.nargs != 0 and action.dest != "help"
]


@pytest.mark.parametrize(("command", "word"), ROWS)
def test_a_value_that_an_option_cannot_take_is_refused_in_one_line(
    command: str,
    word: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path(FOLDER).mkdir()
    Path("binary.bin").write_bytes(bytes(range(256)) * 8)
    is_output = command_parser(command).option_actions[word].dest in OUTPUTS
    for value in PLACES if is_output else VALUES:
        if (word, value) in GOOD:
            continue
        assert main([command, *QUICK[command], f"{word}={value}"]) == 2, value
        said = capsys.readouterr()
        assert said.err.startswith(f"haptogram {command}: "), value
        assert (said.out, said.err.count("\n")) == ("", 1), value
    assert {path.name for path in tmp_path.iterdir()} == {FOLDER, "binary.bin"}


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
@pytest.mark.parametrize(
    "words",
    [
        ["bench", "--compare"],
        ["conform", "--compare"],
        ["conform", "--baseline"],
    ],
)
def test_a_file_without_permission_is_refused(
    words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "secret"
    path.write_text("{}")
    path.chmod(0)
    assert main([*words, str(path)]) == 2
    assert "cannot be read: there is no permission\n" in capsys.readouterr().err
