"""``haptogram watch`` beside clients on a real pseudo-terminal, while they run."""

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from haptogram.evidence.board_process import BoardProcess

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals")

DATA = Path(__file__).parents[1] / "data" / "dialects"
DEADLINE_S = 60.0


def wait_for(condition):
    end_s = time.monotonic() + DEADLINE_S
    while not condition():
        assert time.monotonic() < end_s
        time.sleep(0.005)


class Watched:
    """The command in a process of its own, and what it prints."""

    def __init__(self, folder, *words, dialect="sonicsurface"):
        self.link, self._log = folder / "board", folder / "out.txt"
        self._output = self._log.open("wb")
        command = ["watch", "--dialect", dialect, "--link", str(self.link), *words]
        self.process = subprocess.Popen(
            [sys.executable, "-m", "haptogram", *command],
            stdout=self._output,
            stderr=subprocess.STDOUT,
            env={**os.environ, "TMPDIR": str(folder)},
        )

    @property
    def told(self):
        return self._log.read_text()

    @contextlib.contextmanager
    def port(self):
        wait_for(self.link.is_symlink)
        port = os.open(self.link, os.O_RDWR | os.O_NOCTTY)
        yield port
        os.close(port)

    def interrupt(self):
        """Press Ctrl-C and return the exit status."""
        self.process.send_signal(signal.SIGINT)
        return self.process.wait(DEADLINE_S)

    def close(self):
        self.process.kill()
        self.process.wait()
        self._output.close()


@pytest.fixture
def watched(tmp_path):
    with contextlib.ExitStack() as parts:

        def start(*words, **values):
            found = Watched(tmp_path, *words, **values)
            parts.callback(found.close)
            return found

        yield start


def frame(name="sonicsurface/focus_0_120_0"):
    return (DATA / f"{name}.bin").read_bytes()


@pytest.mark.nightly
def test_a_client_that_never_commits_reads_so_while_it_runs(watched):
    board = watched()
    with board.port() as port:
        os.write(port, frame()[:-1])
        wait_for(lambda: "a whole frame waits for its commit (FDh), which shows it" in board.told)
        os.write(port, frame()[:-1])
        wait_for(lambda: "frames follow each other without a commit (FDh)" in board.told)
        assert board.interrupt() == 1
    assert "FAIL: 0 latches of the client; frame without its commit" in board.told


@pytest.mark.nightly
def test_a_client_that_starts_when_the_link_appears_loses_nothing(watched):
    """The link is there before the board takes bytes; what comes first waits in the terminal."""
    board = watched("--latches", "30")
    with board.port() as port:
        for _ in range(30):
            os.write(port, frame())
    assert board.process.wait(DEADLINE_S) == 0
    assert "PASS: 30 latches of the client\n  patterns  30 one focus\n" in board.told


def test_ctrl_c_judges_what_was_received_or_counts_it(tmp_path):
    """Drives without a pattern take a tenth of a second each: more wait than are looked at."""
    count, door, link = 80, tmp_path / "door.jsonl", tmp_path / "board"
    codes = np.random.default_rng(1).integers(0, 32, (count, 256), np.uint8)
    board = BoardProcess(
        ["--dialect=sonicsurface", f"--link={link}", f"--backdoor={door}", "--no-reconstruct"],
        tmp_path / "log",
    )
    try:
        board.wait_until_ready()
        port = os.open(link, os.O_RDWR | os.O_NOCTTY)
        for row in codes:
            os.write(port, b"\xfe" + row.tobytes() + b"\xfd")
        wait_for(lambda: door.read_bytes().count(b'"swap"') == count)
        words = [str(door), "--json", str(tmp_path / "out.json")]
        process = subprocess.Popen(
            [sys.executable, "-m", "haptogram", "watch", *words],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        first = process.stdout.readline()  # it looks at the power-up
        process.send_signal(signal.SIGINT)
        told, _ = process.communicate(timeout=DEADLINE_S)
        os.close(port)
    finally:
        board.stop()
        board.close_pipe()
    assert "power-up" in first
    assert "interrupted; the result of what was seen is worked out" in told
    result = json.loads((tmp_path / "out.json").read_text())
    looked_at = sum(result["kinds"].values())
    left = re.match(r"(\d+) latch", result["missing"] or "0 latches")
    assert looked_at > 0
    assert looked_at + int(left[1]) == count
    assert process.returncode == (3 if int(left[1]) else 0)
