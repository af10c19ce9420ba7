"""What ci/bootstrap installs, and when; a pip that writes down its calls takes the place of pip."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PYTHON = f"""#!/bin/sh
[ "$1" = -m ] || exec {sys.executable} "$@"
for last; do :; done
printf '%s\\n' "$last" >>"$(dirname "$0")/calls"
"""


class Checkout:
    """A project of constraints alone, with an environment of its own."""

    def __init__(self, root: Path) -> None:
        self.ci, self.bin = root / "ci", root / ".venv" / "bin"
        self.ci.mkdir()
        self.bin.mkdir(parents=True)
        shutil.copy(ROOT / "ci" / "bootstrap", self.ci)
        (root / "pyproject.toml").touch()
        (self.bin / "python").write_text(PYTHON)
        (self.bin / "python").chmod(0o755)
        (self.bin / "pip").write_text(f"#!{self.bin / 'python'}\n")

    def installs(self, extras: str, constraints: str) -> bool:
        """Return whether *extras* are installed by a call at these *constraints*."""
        calls = self.bin / "calls"
        calls.unlink(missing_ok=True)
        (self.ci / "constraints.txt").write_text(constraints)
        subprocess.run([self.ci / "bootstrap", extras], check=True, capture_output=True)
        return calls.exists() and calls.read_text() == f".[{extras}]\n"


@pytest.fixture
def checkout(tmp_path: Path) -> Checkout:
    return Checkout(tmp_path)


def test_extras_that_are_there_among_others_are_not_installed_again(checkout: Checkout) -> None:
    assert checkout.installs("report,mesh,test", "numpy==1")
    assert not checkout.installs("mesh,report", "numpy==1")
    assert checkout.installs("mesh,docs", "numpy==1")


def test_versions_that_another_call_has_changed_are_installed_again(checkout: Checkout) -> None:
    assert checkout.installs("report,test", "numpy==1")
    assert checkout.installs("report", "numpy==2")
    assert checkout.installs("report", "numpy==1")
