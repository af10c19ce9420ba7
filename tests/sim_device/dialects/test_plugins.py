"""Dialects of other packages: the example of docs/examples/dialect, installed; and broken ones."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[3] / "docs" / "examples" / "dialect"
LONGEST = 62  # lines of the example, blank ones left out
DRIVE = """
import json, sys
import serial, sim_device
sim_device.register_url_handler()
port = serial.serial_for_url(
    "haptogram://?dialect={name}&clock=virtual&reconstruct=0", timeout=0.1
)
codes = bytes(range(16))
port.write(b"\\x55" + codes + bytes([sum(codes) & 0xFF]) + b"\\x55" + codes + b"\\x00")
answers = port.read(2)
counters = port.simulation.dialect.counters
port.close()
latches = [(r["cause"], r["counted"]) for r in port.records if r["kind"] == "pulses"]
print(json.dumps([answers.hex(), counters, latches, port.records[0]["transducers"]]))
"""


def example():
    return (EXAMPLES / "our_board.py").read_text("utf-8")


def driven_example():
    return (EXAMPLES / "our_driven_board.py").read_text("utf-8")


def install(folder, module, code, points):
    """Install a package as pip does: a module, and metadata with its entry points."""
    (folder / f"{module}.py").write_text(code)
    metadata = folder / f"{module}-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {module}\nVersion: 1.0\n")
    lines = [f"{name} = {value}" for name, value in points.items()]
    (metadata / "entry_points.txt").write_text("\n".join(["[haptogram.dialects]", *lines]) + "\n")


def run(folder, *words):
    path = os.pathsep.join([str(folder), *filter(None, sys.path)])
    return subprocess.run(
        [sys.executable, *words],
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


def test_the_example_is_short():
    assert len([line for line in example().splitlines() if line.strip()]) < LONGEST


def test_the_example_runs_out_of_another_package(tmp_path):
    install(tmp_path, "our_board", example(), {"ours": "our_board:EMULATION"})
    done = run(tmp_path, "-c", DRIVE.format(name="ours"))
    assert done.returncode == 0, done.stderr
    assert done.stdout == ('["0615", {"sums_wrong": 1}, [["power-up", {}], ["frame", {}]], 16]\n')


def test_our_objects_are_verified_on_a_board_of_another_package(tmp_path):
    install(tmp_path, "our_board", example(), {})
    point = ("--object", "point", "--center-mm", "4,3,40", "--virtual-time", "--quiet")
    verify = ("-m", "haptogram", "verify", "--dialect", "ours", *point)
    install(tmp_path, "our_driven_board", driven_example(), {"ours": "our_driven_board:EMULATION"})
    done = run(tmp_path, *verify)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("PASS: every focus is on target")


def test_a_wire_without_a_display_is_emulated_and_not_driven(tmp_path):
    install(tmp_path, "our_board", example(), {"ours": "our_board:EMULATION"})
    done = run(tmp_path, "-m", "haptogram", "verify", "--dialect", "ours", "--quiet")
    assert done.returncode == 2
    assert "--dialect ours can be emulated and not driven" in done.stderr


BROKEN = {
    "raises": ("raise RuntimeError('no such board')", "no such board"),
    "lacks": ("EMULATION = 3", "not an Emulation"),
    "later": (
        "import dataclasses\nfrom our_board import EMULATION as OURS\n"
        "EMULATION = dataclasses.replace(OURS, interface=2)",
        "version 2",
    ),
    "other": ("from our_board import EMULATION", "called ours"),
}


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", BROKEN)
def test_one_that_fails_to_load_is_named_and_stops_nothing(tmp_path, name):
    code, says = BROKEN[name]
    install(tmp_path, "our_board", example(), {"ours": "our_board:EMULATION"})
    install(tmp_path, f"broken_{name}", code, {name: f"broken_{name}:EMULATION"})
    done = run(tmp_path, "-c", DRIVE.format(name="ours"))
    assert done.returncode == 0, done.stderr
    (line,) = [line for line in done.stderr.splitlines() if name in line]
    assert says in line
    refused = run(tmp_path, "-m", "sim_device", f"--link={tmp_path / 'board'}", "--dialect", name)
    assert refused.returncode == 2
    assert f"--dialect is '{name}'; known are" in refused.stderr
    assert "ours" in refused.stderr
    assert "Traceback" not in refused.stderr
