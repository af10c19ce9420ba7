"""A board that another process simulates, through the commands and a terminal."""

import json
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
import serial

from haptogram.cli import main
from sim_device.dialects.table import EMULATIONS

EVERY = Path(__file__).with_name("simulated_firmware.py")
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


def test_verify_says_simulated_and_by_what(tmp_path, capsys):
    written = tmp_path / "a.json"
    assert main(["verify", "--virtual-time", *BOARD, *POINT, "--json", str(written)]) == 0
    assert "evidence  simulated" in capsys.readouterr().out
    result = json.loads(written.read_text("utf-8"))
    assert result["board"]["is"] == f"simulated by {SIMULATOR!r}, in virtual time"
    assert result["evidence"] == "simulated"


@pytest.mark.sampled(1)
@pytest.mark.parametrize("slow_down", ["3", "1"])
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


def judged(dialect, capsys, *simulator):
    where = ["--object", "point", "--center-mm", "0,0,55", "--repeat", "2", "--quiet"]
    status = main(["verify", "--virtual-time", "--dialect", dialect, *where, *simulator])
    return status, capsys.readouterr().out.replace("simulated", "external").splitlines()


QUICK = ("interactlab", "autd3")  # both answer


@pytest.mark.parametrize(
    "dialect",
    [
        dialect if dialect in QUICK else pytest.param(dialect, marks=pytest.mark.nightly)
        for dialect in EMULATIONS
    ],
)
def test_firmware_that_is_the_emulation_has_its_verdict(dialect, capsys):
    simulator = shlex.join([sys.executable, str(EVERY), dialect])
    assert judged(dialect, capsys, "--simulator", simulator) == judged(dialect, capsys)


def test_firmware_of_our_own_wire_is_verified_by_its_trace(capsys):
    where = ["--object", "point", "--center-mm", "0,0,55", "--array", "5x3", "--quiet"]
    simulator = ["--simulator", shlex.join([sys.executable, str(EVERY)])]
    assert main(["verify", "--virtual-time", *where, *simulator]) == 0
    assert "evidence  self-reported" in capsys.readouterr().out


def test_a_simulator_that_dies_behind_a_terminal_is_one_line_at_the_end(tmp_path):
    link = tmp_path / "board"
    words = [*HAPTOGRAM, "board", *BOARD[:-1], f"{SIMULATOR} dies", "--link", str(link)]
    with subprocess.Popen(
        words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as board:
        assert board.stdout is not None
        assert "listening" in board.stdout.readline()
        with serial.Serial(str(link), 230_400) as port:
            port.write(b"\xfe" + bytes(256) + b"\xfd")
            _, log = board.communicate(timeout=60)
    assert board.returncode == 1
    assert log.strip().splitlines()[-1].endswith("has ended: out of memory in the 3rd process")
