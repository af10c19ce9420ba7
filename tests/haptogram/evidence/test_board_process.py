"""The start of a board's process: waited for while it works, and told if it is slow."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from haptogram.errors import ConfigurationError
from haptogram.evidence import board_process
from haptogram.evidence.board_process import BoardProcess

LISTENS = "print('listening on x', flush=True); input()"
STARTS = "print('starting: compiling', flush=True)\n"


def start(program: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> BoardProcess:
    """Start a process that is no board, and wait for it with short patience."""
    popen = board_process.subprocess.Popen
    monkeypatch.setattr(
        board_process.subprocess,
        "Popen",
        lambda _, **options: popen([sys.executable, "-c", program], **options),
    )
    monkeypatch.setattr(board_process, "_SLOW_S", 0.2)
    return BoardProcess([], tmp_path / "log")


def test_a_slow_start_is_waited_for_and_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The process goes on once it is told what it is at."""
    told, go = [], tmp_path / "go"

    def write(text: str) -> int:
        told.append(text)
        if text.endswith(": compiling\n"):
            go.touch()
        return len(text)

    monkeypatch.setattr(sys.stderr, "write", write)
    works = f"import os, time\nwhile not os.path.exists({str(go)!r}): time.sleep(0.01)\n"
    board = start(STARTS + works + LISTENS, tmp_path, monkeypatch)
    try:
        board.wait_until_ready()
    finally:
        board.kill()
        board.close_pipe()
    assert "the virtual board is still starting after " in told[-1]


@pytest.mark.parametrize(
    ("program", "said"),
    [
        (STARTS + "input()", r"the virtual board hangs: .* after 1 s \(compiling\)"),
        ("input()", r"hangs: .* \(starting the Python interpreter\)"),
        ("print('no memory'); raise SystemExit(3)", "ended with status 3: no memory"),
        ("raise SystemExit(3)", "ended with status 3: it said nothing"),
    ],
)
def test_one_that_hangs_or_ends_is_an_error_with_its_last_words(
    program: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(board_process, "_LONGEST_START_S", 1.0)
    board = start(program, tmp_path, monkeypatch)
    try:
        with pytest.raises(ConfigurationError, match=said):
            board.wait_until_ready()
    finally:
        board.kill()
        board.close_pipe()
