"""Standard output that cannot be written: every command is told of in one place."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from pathlib import Path

import pytest

from haptogram.cli import main
from haptogram.commands.shell.standard_streams import (
    patient_standard_streams,
    text_for_standard_stream,
)

FULL = Path("/dev/full")
needs_full = pytest.mark.skipif(not FULL.exists(), reason="needs /dev/full")


@needs_full
@pytest.mark.parametrize("words", [["budget"], ["--help"], ["board", "--help"]])
def test_a_full_disk_behind_standard_output_is_status_2_and_one_line(
    words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    with FULL.open("w") as full, contextlib.redirect_stdout(full), pytest.raises(SystemExit) as end:
        main(words)
    assert end.value.code == 2
    said = capsys.readouterr().err
    assert said == "haptogram: standard output cannot be written: the disk is full\n"


@needs_full
def test_complaints_that_nobody_can_read_do_not_change_the_status() -> None:
    with FULL.open("w", buffering=1) as full, contextlib.redirect_stderr(full):
        assert main(["budget", "--rate-hz", "-1"]) == 2


def test_a_reader_that_went_away_costs_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    with open(writing, "w") as pipe, contextlib.redirect_stdout(pipe):
        assert main(["budget"]) == 0
    assert capsys.readouterr().err == ""


def test_a_command_goes_on_after_its_words_were_lost() -> None:
    reading, writing = os.pipe()
    os.close(reading)
    done = []
    with (
        open(writing, "w", buffering=1) as pipe,
        contextlib.redirect_stdout(pipe),
        patient_standard_streams(),
    ):
        sys.stdout.write("nobody reads this\n")
        sys.stdout.write("nor this\n")
        done.append("files")
    assert done


def test_a_closed_standard_output_is_no_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdout", None)
    assert main(["budget"]) == 0


@pytest.mark.parametrize(
    ("command", "option"), [("presets", "--json"), ("field", "--picture"), ("verify", "--json")]
)
def test_a_result_for_a_closed_standard_output_is_refused(
    command: str,
    option: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(sys, "stdout", None)
    assert main([command, option, "-"]) == 2
    said = capsys.readouterr().err
    assert said == f"haptogram {command}: {option} -: standard output is closed; name a file\n"


def test_a_shell_may_close_standard_output() -> None:
    words = f"{sys.executable} -m haptogram presets --json - >&-"
    ended = subprocess.run(["sh", "-c", words], stderr=subprocess.PIPE, text=True, check=False)
    assert ended.returncode == 2
    assert ended.stderr.count("\n") == 1
    assert "--json -: standard output is closed" in ended.stderr


def test_a_shell_may_close_all_that_a_board_reads_and_writes() -> None:
    words = f"{sys.executable} -m haptogram board --tcp 0 --until-eof --quiet <&- >&-"
    ended = subprocess.run(["sh", "-c", words], stderr=subprocess.PIPE, text=True, check=False)
    assert (ended.returncode, ended.stderr) == (0, "")


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("encoding", "sign"), [("utf-8", "µs"), ("ascii", "us"), ("cp437", "µs")])
def test_a_terminal_without_a_sign_shows_a_plain_one(encoding: str, sign: str) -> None:
    command = "from haptogram.cli import main; raise SystemExit(main(['budget']))"
    run = subprocess.run(
        [sys.executable, "-c", command],
        capture_output=True,
        env=os.environ | {"PYTHONIOENCODING": encoding},
        check=False,
    )
    assert (run.returncode, run.stderr) == (0, b"")
    assert f"times in {sign};" in run.stdout.decode(encoding)


def test_a_complaint_is_plain_too_and_a_name_without_a_sign_is_escaped() -> None:
    assert (
        text_for_standard_stream("--spin-us is 9 µs", "ascii", "backslashreplace")
        == "--spin-us is 9 us"
    )
    assert text_for_standard_stream("ä.csv", "ascii") == "\\xe4.csv"
    assert text_for_standard_stream("\udce4.csv", "ascii", "surrogateescape") == "\udce4.csv"
