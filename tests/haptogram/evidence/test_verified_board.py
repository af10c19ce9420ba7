"""``verified_board`` in a repository that has nothing but its own driver."""

import os
import re
import shutil
import subprocess
import sys
from importlib.metadata import entry_points
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
CLIENT = ROOT / "tests" / "data" / "dialects" / "sonicsurface" / "focus_0_120_0.bin"
DRIVER = Path(__file__).with_name("own_driver.py")
_POINTS = {point.value for point in entry_points(group="pytest11")}
# An installed package registers its plugin itself; a checkout that is only on the path does not.
PLUGIN = () if "haptogram.evidence.pytest_plugin" in _POINTS else (
    "-p",
    "haptogram.evidence.pytest_plugin",
)  # fmt: skip

HEAD = """
import pytest
from own_driver import OwnDriver

pytestmark = pytest.mark.haptogram_board(array="8x8", pitch_mm=10)
FOCI = [(0.0, 0.0, 0.1), (0.01, -0.005, 0.1), (0.02, 0.01, 0.12)]

@pytest.fixture
def driver(verified_board):
    with OwnDriver(verified_board.port) as driver:
        yield driver

"""

TESTS = """
def test_beside_a_benchmark(verified_board, benchmark):
    with OwnDriver(verified_board.port) as driver:
        benchmark.pedantic(driver.show, args=(FOCI,), rounds=2)
    verified_board.expect(FOCI, rounds=2)

def test_with_a_driver_that_closes_later(verified_board, driver):
    driver.show(FOCI)
    verified_board.expect(FOCI)

def test_wrong_with_a_driver_that_closes_later(verified_board, driver):
    driver.mirrored = True
    driver.show(FOCI)
    verified_board.expect(FOCI)

def test_wrong(verified_board):
    with OwnDriver(verified_board.port, mirrored=True, skips=[2], mutes=False) as driver:
        driver.show(FOCI * 2)
    verified_board.expect(FOCI, rounds=2)

def test_left_on_as_expected(verified_board):
    with OwnDriver(verified_board.port, mutes=False) as driver:
        driver.show(FOCI)
    verified_board.expect(FOCI, may_stay_armed=True)

@pytest.mark.haptogram_board(dialect="sonicsurface", temperature_c=23.21)  # the client's 346 m/s
def test_a_client_of_another_board(verified_board):
    import serial

    port = serial.serial_for_url(verified_board.port)
    with open("client.bin", "rb") as file:
        port.write(file.read())
    verified_board.expect([(0.0, 0.12, 0.0)], rounds=1, tolerance_mm=1.0)

def test_says_nothing(verified_board):
    assert verified_board.port

def test_fails_by_itself(verified_board):
    assert 1 == 2
"""
#: Without the worker of these tests: pytest-benchmark does not measure in one.
_ENVIRONMENT = {name: text for name, text in os.environ.items() if "XDIST" not in name}


def run(folder, tests, *options):
    """Run *tests* in a repository of their own; return the outcome of each, and what was said."""
    shutil.copy(DRIVER, folder / "own_driver.py")
    (folder / "protocol").mkdir()
    (folder / "protocol" / "__init__.py").write_text("raise RuntimeError('not ours')\n")
    (folder / "test_own.py").write_text(HEAD + tests)
    shutil.copy(ROOT / "docs" / "examples" / "test_my_driver.py", folder)
    shutil.copy(CLIENT, folder / "client.bin")
    (folder / "pytest.ini").write_text("[pytest]\naddopts = --strict-markers\n")
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-v", "-rA", *PLUGIN, "-p", "no:cacheprovider", *options],
        cwd=folder,
        env=_ENVIRONMENT | {"PYTHONPATH": f"{ROOT}:{ROOT / 'protocol'}", "COLUMNS": "200"},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    outcomes = dict(re.findall(r"^test_\w+\.py::(\w+) (PASSED|FAILED|ERROR)", done.stdout, re.M))
    return outcomes, done.stdout


@pytest.mark.nightly
@pytest.mark.slow
@pytest.mark.pty
@pytest.mark.realtime
def test_a_driver_is_judged_by_what_the_board_radiated(tmp_path):
    outcomes, said = run(tmp_path, TESTS)
    assert outcomes == {
        "test_my_driver": "PASSED",  # the example of the tutorial
        "test_beside_a_benchmark": "PASSED",
        "test_with_a_driver_that_closes_later": "PASSED",
        "test_wrong_with_a_driver_that_closes_later": "ERROR",  # after the test had passed
        "test_wrong": "FAILED",
        "test_left_on_as_expected": "PASSED",
        "test_a_client_of_another_board": "PASSED",
        "test_says_nothing": "FAILED",
        "test_fails_by_itself": "FAILED",
    }, said
    assert "3 failed, 6 passed, 1 error" in said
    for text in (
        "verified_board: FAIL: 3 latches of the client",
        "verified_board: FAIL: 5 latches of the client",
        "foci      not all are where they were expected",
        "frames    5 were latched, 2 x 3 were expected",
        "lost      1 frames of the stream were never latched: index 65522",
        "output    was ",
        "not by the driver",
        "call verified_board.expect([(x, y, z), ...]), in metres",
        "assert 1 == 2",
    ):
        assert text in said, said


def test_the_plugin_imports_nothing_heavy():
    heavy = "{'numpy', 'scipy', 'numba', 'serial', 'haptogram_protocol'}"
    done = subprocess.run(
        [
            *(sys.executable, "-c"),
            "import sys, haptogram.evidence.pytest_plugin; print(" + heavy + " & set(sys.modules))",
        ],
        env=_ENVIRONMENT | {"PYTHONPATH": f"{ROOT}:{ROOT / 'protocol'}"},
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    assert done.stdout == "set()\n"
