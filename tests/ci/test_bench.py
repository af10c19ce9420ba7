"""Every benchmark runs, and the documents are made of what it measured."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
BENCHMARKS = ROOT / "ci" / "benchmarks"


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    """Figures of all benchmarks, each run once."""
    pytest.importorskip("numba")
    pytest.importorskip("cobs.cobs")
    written = tmp_path_factory.mktemp("bench") / "bench.json"
    options = ["-q", "-p", "no:cacheprovider", "--once", f"--benchmark-json={written}"]
    places = "pythonpath=. protocol ci ci/benchmarks"
    command = [sys.executable, "-m", "pytest", BENCHMARKS, "-c", ROOT / "pyproject.toml"]
    done = subprocess.run(
        [*command, "-o", places, *options],
        cwd=ROOT,
        env={key: value for key, value in os.environ.items() if not key.startswith("PYTEST_")},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return written


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("report", "headings"),
    [
        ("report.py", ["Arbitrary points", "Focus of one frame", "Solvers for several foci"]),
        ("wire_report.py", ["One phase frame", "Every message", "Wires of other boards"]),
    ],
)
def test_the_documents_are_made_of_every_benchmark(measured, report, headings):
    done = subprocess.run(
        [sys.executable, BENCHMARKS / report, measured, "--stdout"],
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert "was not run" not in done.stdout
    for heading in headings:
        table = done.stdout.partition(f"## {heading}\n")[2].partition("\n## ")[0]
        assert table.count("\n|") > 2, heading
