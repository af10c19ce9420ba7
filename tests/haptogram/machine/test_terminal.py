"""Colour: on a terminal, as NO_COLOR and FORCE_COLOR say, never in pipes or files by itself."""

from __future__ import annotations

import io
import re
import shutil
import subprocess

import pytest

from haptogram.cli import main
from haptogram.machine.terminal import (
    paint_verdicts_on_terminal,
    printable_on_terminal,
    terminal_command_line,
    terminal_error_line,
    terminal_has_colour,
)


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize(
    ("stream", "environment", "expected"),
    [
        (Terminal(), {}, True),
        (io.StringIO(), {}, False),
        (Terminal(), {"NO_COLOR": "1"}, False),
        (Terminal(), {"NO_COLOR": ""}, True),
        (Terminal(), {"TERM": "dumb"}, False),
        (io.StringIO(), {"FORCE_COLOR": "1"}, True),
        (io.StringIO(), {"FORCE_COLOR": "1", "NO_COLOR": "1"}, False),
    ],
)
def test_who_decides(
    stream: io.StringIO,
    environment: dict[str, str],
    expected: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for name in ("NO_COLOR", "FORCE_COLOR", "TERM"):
        monkeypatch.delenv(name, raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    assert terminal_has_colour(stream) is expected


def test_verdicts_at_the_beginning_of_a_line_have_their_colour(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("TERM", "xterm")
    text = "PASS: all\nverdict      FAIL\nno PASS here\nPASSED"
    assert paint_verdicts_on_terminal(text, Terminal()) == (
        "\x1b[1;32mPASS\x1b[0m: all\nverdict      \x1b[1;31mFAIL\x1b[0m\nno PASS here\nPASSED"
    )
    assert paint_verdicts_on_terminal(text, io.StringIO()) == text
    assert terminal_error_line("prog", "why", Terminal()) == "\x1b[1;31mprog:\x1b[0m why"


def test_a_command_in_a_pipe_prints_no_escape(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ["verify", "--object", "point", "--array", "6x6", "--virtual-time", "--quiet"]
    monkeypatch.delenv("FORCE_COLOR", raising=False)
    assert main(words) == 0
    assert "\x1b" not in capsys.readouterr().out
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.delenv("NO_COLOR", raising=False)
    assert main(words) == 0
    assert capsys.readouterr().out.startswith("\x1b[1;32mPASS\x1b[0m: ")
    assert main([*words, "--depth", "0.5"]) == 2
    assert capsys.readouterr().err.startswith("\x1b[1;31mhaptogram verify:\x1b[0m --depth acts")


@pytest.mark.parametrize(
    "text", ["::error::x", "ok\n  ::stop-commands::x", "\t::add-mask::PASS", "a ##[error]x"]
)
def test_in_a_job_of_github_printed_text_is_no_command(
    text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert paint_verdicts_on_terminal(text, io.StringIO()) == text
    monkeypatch.setenv("GITHUB_ACTIONS", "true")
    for shown in (
        paint_verdicts_on_terminal(text, io.StringIO()),
        terminal_error_line("haptogram conform", text, io.StringIO()),
    ):
        assert "".join(shown.split()).endswith("".join(text.split()))
        assert not re.search(r"(?m)^\s*::|##\[", shown)


def test_a_name_has_no_control_characters() -> None:
    assert printable_on_terminal("v1\n\x1b[2J µ") == "v1\ufffd\ufffd[2J µ"


def test_an_error_is_one_line_whatever_a_file_is_called() -> None:
    shown = terminal_error_line("prog", "'a\n\tb\x1b[2J' cannot be read", io.StringIO())
    assert shown == "prog: 'a  b\ufffd[2J' cannot be read"


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
def test_a_command_is_one_line_from_which_a_shell_gets_the_same_words() -> None:
    words = ["printf", "%s\\0", "a b", 'it\'s\n"so"\t\\n $x', "\x1b[2J", "\n", "µ'"]
    line = terminal_command_line(words)
    assert line.isprintable()
    done = subprocess.run(["bash", "-c", line], capture_output=True, text=True, check=True)
    assert done.stdout.split("\0")[:-1] == words[2:]
