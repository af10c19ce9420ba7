"""conform --simulator: firmware of our own wire in a simulator, by its answers and by its pins."""

import shlex
import sys
from pathlib import Path

import pytest

from haptogram.cli import main

SCRIPT = Path(__file__).parents[2] / "system" / "simulated_firmware.py"
MAP = """\
reference = "carrier"
to_board = "to_board"
to_host = "to_host"
sample_rate_hz = 1e9
elements = "e{}"
"""


def conform(tmp_path, capsys, *words):
    simulator = shlex.join([sys.executable, str(SCRIPT), *words])
    (tmp_path / "map.toml").write_text(MAP)
    files = ["--capture", str(tmp_path / "pins.vcd"), "--channels", str(tmp_path / "map.toml")]
    cases = ["--clause", "HG-6.6", "--quick", "--verbose"]
    status = main(["conform", "--simulator", simulator, *cases, *files])
    return status, capsys.readouterr().out


def test_right_firmware_passes_by_its_answers_and_by_its_pins(tmp_path, capsys):
    status, text = conform(tmp_path, capsys)
    assert status == 0, text
    assert "HG-6.6/1-pins  OK [SIMULATED: seen at the pins of firmware in a simulator]" in text
    assert f"simulated by {shlex.join([sys.executable, str(SCRIPT)])!r}" in text


def test_firmware_that_says_muted_and_sounds_on_fails_by_its_pins(tmp_path, capsys):
    status, text = conform(tmp_path, capsys, "own", "lingers")
    assert status == 1
    assert "HG-6.6/1-pins  FAILED [SIMULATED" in text


def test_a_simulator_and_a_port_are_one_too_many(capsys):
    assert main(["conform", "--simulator", "true", "--port", "/dev/absent"]) == 2
    assert "--simulator is a board of its own" in capsys.readouterr().err


@pytest.mark.parametrize("simulator", ["/nonexistent", "true"])
def test_no_simulator_is_one_line(capsys, simulator):
    assert main(["conform", "--simulator", simulator, "--clause", "HG-2.3"]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1
