"""Tests in several processes: every report comes back, and a process that dies fails the run."""

import re
import subprocess
import sys
from pathlib import Path

PASS_AND_FAIL = "def test_right(tmp_path): pass\n\ndef test_wrong(): assert 1 + 1 == 3\n"
DIES = "import os\n\ndef test_first(): pass\n\ndef test_dies(): os._exit(7)\n"


def run(folder, *words, **files):
    for name, text in files.items():
        (folder / f"test_{name}.py").write_text(text)
    (folder / "pytest.ini").touch()
    command = [sys.executable, "-m", "pytest", "-p", "processes", "--processes", "2", *words]
    environment = {"PYTHONPATH": str(Path(__file__).parent), "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)


def test_what_fails_in_another_process_is_reported_as_in_one(tmp_path):
    told = run(tmp_path, **dict.fromkeys("abc", PASS_AND_FAIL))
    assert told.returncode == 1
    assert "3 failed, 3 passed" in told.stdout
    assert (
        told.stdout.count(">       assert 1 + 1 == 3")
        + told.stdout.count("def test_wrong(): assert 1 + 1 == 3")
        == 3
    )
    assert run(tmp_path, "-k", "right").returncode == 0
    assert re.search(r"\b1 failed", run(tmp_path, "-x", "-k", "wrong").stdout)


def test_a_process_that_dies_ends_the_run_and_names_the_test(tmp_path):
    told = run(tmp_path, a=DIES, b="def test_other(): pass\n")
    assert told.returncode == 2
    assert "a process died in test_a.py::test_dies" in told.stdout
