"""A temporary folder goes with its owner, even one that was killed."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from haptogram.machine.working_folder import WorkingFolder

_OWNER = """\
import os, signal
from haptogram.machine.working_folder import WorkingFolder
(WorkingFolder("test-").path / "records").write_text("much")
os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


def test_what_a_killed_owner_left_is_removed_by_the_next_one(place: Path) -> None:
    environment = os.environ | {"TMPDIR": str(place), "PYTHONPATH": os.pathsep.join(sys.path)}
    subprocess.run([sys.executable, "-c", _OWNER], env=environment, check=False)
    (stale,) = place.iterdir()
    assert (stale / "records").exists()
    fresh = WorkingFolder("test-")
    assert list(place.iterdir()) == [fresh.path]
    fresh.remove()
    fresh.remove()
    assert list(place.iterdir()) == []


def test_what_has_an_owner_or_another_one_made_is_left_alone(place: Path) -> None:
    first = WorkingFolder("test-")
    foreign = place / "test-results"
    foreign.mkdir()
    second = WorkingFolder("test-")
    assert {first.path, foreign, second.path} == set(place.iterdir())
    first.remove()
    second.remove()
