"""A board that another process simulates, through the commands and a terminal."""

import json
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
import serial

SCRIPT = Path(__file__).parents[1] / "sim_device" / "dialects" / "python_simulator.py"
SIMULATOR = shlex.join([sys.executable, str(SCRIPT), "16"])
HAPTOGRAM = [sys.executable, "-m", "haptogram"]
BOARD = ["--dialect", "sonicsurface", "--array", "4x4", "--simulator", SIMULATOR]
POINT = [
    "--object",
    "circle",
    "--radius-mm",
    "5",
    "--resolution-mm",
    "8",
    "--center-mm",
    "0,0,60",
    "--quiet",
]


def test_verify_says_simulated_and_by_what(tmp_path):
    written = tmp_path / "a.json"
    words = [*HAPTOGRAM, "verify", "--virtual-time", *BOARD, *POINT, "--json", str(written)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "evidence  simulated" in done.stdout
    result = json.loads(written.read_text("utf-8"))
    assert result["board"]["is"] == f"simulated by {SIMULATOR!r}, in virtual time"
    assert result["evidence"] == "simulated"


@pytest.mark.parametrize("slow_down", ["1", "3"])
def test_a_program_on_a_pseudo_terminal_meets_it_too(tmp_path, slow_down):
    link = tmp_path / "board"
    words = [*HAPTOGRAM, "watch", *BOARD, "--link", str(link), "--slow-down", slow_down]
    with subprocess.Popen(
        [*words, "--latches", "2"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as watch:
        assert watch.stderr is not None
        assert "board at" in watch.stderr.readline()
        with serial.Serial(str(link), 230_400) as port:
            for turn in (1, 2):
                port.write(b"\xfe" + bytes(turn * n % 32 for n in range(256)) + b"\xfd")
            text, _ = watch.communicate(timeout=60)
    assert watch.returncode in (0, 1, 3)
    assert "2 latches of the client" in text
