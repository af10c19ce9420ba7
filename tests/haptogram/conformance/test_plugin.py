"""The suite inside pytest, in a repository that has its own ``protocol/`` and ``tests/``."""

import os
import re
import subprocess
import sys
from importlib.metadata import entry_points
from pathlib import Path

import pytest

from protocol_c.building import compiler, make

ROOT = Path(__file__).parents[3]
OWN = """
from haptogram_protocol.messages import Ping, Pong

def test_own_case(haptogram_link):
    assert haptogram_link.call(Ping(5), Pong).echo == 5

def test_own_case_that_arms(haptogram_board):
    board = haptogram_board.session()
    board.arm()
    with board.counting(requests=1, frames=1):
        board.link.call(Ping(6), Pong)

def test_board(haptogram_board):
    from haptogram.conformance.cases import all_cases
    case = next(case for case in all_cases() if case.id == "HG-2.3/1")
    assert haptogram_board.result(case).behaviour == "OK"
"""

# An installed package registers its plugin itself; a checkout that is only on the path does not.
_INSTALLED = any(point.name == "haptogram" for point in entry_points(group="pytest11"))
_PLUGIN = [] if _INSTALLED else ["-p", "haptogram.conformance.pytest_plugin"]


@pytest.mark.slow
@pytest.mark.pty
def test_in_a_foreign_repository(tmp_path):
    for folder in ("protocol", "tests"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "__init__.py").write_text("raise RuntimeError('not ours')\n")
    (tmp_path / "test_own.py").write_text(OWN)
    done = subprocess.run(
        [
            *(sys.executable, "-m", "pytest", "-q", *_PLUGIN),
            *("-p", "no:cacheprovider", "--haptogram-timeout=5", "test_own.py"),
            *("--pyargs", "haptogram.conformance"),
            *("-k", "test_own or test_board or HG-2.3 or HG-4.1/1 or HG-6.1/1"),
        ],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": f"{ROOT}:{ROOT / 'protocol'}"},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout
    assert "skipped" in done.stdout  # HG-4.1/1 is about the host


def test_the_plugin_imports_nothing_heavy():
    done = subprocess.run(
        [
            *(sys.executable, "-c"),
            "import sys, haptogram.conformance.pytest_plugin; "
            "print({'numpy', 'scipy', 'numba', 'serial', 'haptogram_protocol'} & set(sys.modules))",
        ],
        env=os.environ | {"PYTHONPATH": f"{ROOT}:{ROOT / 'protocol'}"},
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    assert done.stdout == "set()\n"


WITHOUT = """
import sys

sys.modules |= dict.fromkeys(["numba", "scipy", "matplotlib", "trimesh"])  # as if not installed
from haptogram.cli import main
port = ["--port", "haptogram://?clock=virtual&array=6x6"]
clauses = ["--clause", "HG-5.4", "--clause", "HG-5.2/1", "--clause", "HG-6.1"]
sys.exit(main(["conform", "--quiet", *port, *clauses]))
"""


@pytest.mark.nightly
def test_the_suite_runs_where_neither_scipy_nor_numba_is():
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT],
        env=os.environ | {"PYTHONPATH": f"{ROOT}:{ROOT / 'protocol'}"},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout
    assert re.search(r"cases +(\d+) cases: \1 OK\n", done.stdout)


def run_with_faults(*words):
    return subprocess.run(
        [
            *(sys.executable, "-m", "pytest", "-q", *_PLUGIN, "-p", "no:cacheprovider"),
            *("--haptogram-fault-cmd", "kill -USR1 $BOARD_PID", *words),
            *("--pyargs", "haptogram.conformance", "-k", "6.6/1-fault or 6.8/1-fault"),
        ],
        env=os.environ | {"PYTHONPATH": f"{ROOT}:{ROOT / 'protocol'}"},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )


@pytest.mark.nightly
@pytest.mark.pty
def test_faults_of_the_hardware_are_judged_where_a_command_brings_them_about(tmp_path):
    compiler()
    status, printed = make(tmp_path, tmp_path / "reference_board", CFLAGS="-O0")
    assert status == 0, printed
    done = run_with_faults("--haptogram-spawn", f"{tmp_path / 'reference_board'} --grid 3x2")
    assert done.returncode == 0, done.stdout
    assert "2 passed" in done.stdout, done.stdout


@pytest.mark.nightly
def test_a_command_for_faults_without_a_board_of_ones_own_is_refused():
    assert "there is none" in run_with_faults().stdout
