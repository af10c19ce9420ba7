"""ci/differential, on a simulator in Python that is right, and on one that is not."""

import shlex
import sys
from pathlib import Path

from board_differential import main

SCRIPT = Path(__file__).parents[1] / "sim_device" / "dialects" / "python_simulator.py"


def run(*words, examples="12", capsys):
    simulator = shlex.join([sys.executable, str(SCRIPT), *words])
    options = ["--dialect", "sonicsurface", "--array", "4x4", "--examples", examples]
    status = main([*options, "--simulator", simulator])
    return status, "".join(capsys.readouterr())


def test_firmware_that_does_what_the_emulation_does_agrees(capsys):
    status, text = run("16", capsys=capsys)
    assert status == 0, text
    assert "the pins agree" in text


def test_a_command_that_the_firmware_lacks_is_shrunk_to_that_command(capsys):
    status, text = run("16", "no-clocks", examples="60", capsys=capsys)
    assert status == 1
    assert "DIFFERENT: 16 of 16 channels differ" in text
    assert text.endswith("behind: 96\n")


def test_no_simulator_is_one_line(capsys):
    assert main(["--dialect", "sonicsurface", "--simulator", "/nonexistent"]) == 2
    assert "cannot be started" in capsys.readouterr().err
