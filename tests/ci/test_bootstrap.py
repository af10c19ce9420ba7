"""What ci/bootstrap installs, and when; a pip that writes down its calls takes the place of pip."""

import json
import shutil
import subprocess
import sysconfig
import venv
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PIP = """\
import sys, pathlib
pathlib.Path(sys.prefix, "calls").write_text(sys.argv[-1])
"""


class Checkout:
    """A project of constraints alone, with an environment of its own."""

    def __init__(self, root: Path) -> None:
        self.root, self.ci, self.venv = root, root / "ci", root / ".venv"
        self.ci.mkdir()
        shutil.copy(ROOT / "ci" / "bootstrap", self.ci)
        (root / "pyproject.toml").touch()
        venv.create(self.venv, symlinks=True)
        (self.venv / "bin" / "pip").write_text(f"#!{self.venv / 'bin' / 'python'}\n")
        variables = {"base": str(self.venv), "platbase": str(self.venv)}
        site = Path(sysconfig.get_path("purelib", "venv", variables))
        self.distribution = site / "haptogram-1.dist-info"
        self.distribution.mkdir()
        (site / "pip.py").write_text(PIP)
        self.holds(root, editable=True)

    def holds(self, folder: Path, *, editable: bool) -> None:
        """Let the environment hold what pip leaves for an install of *folder*."""
        how = {"dir_info": {"editable": True} if editable else {}, "url": folder.as_uri()}
        (self.distribution / "direct_url.json").write_text(json.dumps(how))

    def installs(self, extras: str, constraints: str) -> bool:
        """Return whether *extras* are installed by a call at these *constraints*."""
        calls = self.venv / "calls"
        calls.unlink(missing_ok=True)
        (self.ci / "constraints.txt").write_text(constraints)
        subprocess.run([self.ci / "bootstrap", extras], check=True, capture_output=True)
        return calls.exists() and calls.read_text() == f".[{extras}]"


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


def test_an_install_that_is_not_this_folder_is_replaced(checkout: Checkout) -> None:
    assert checkout.installs("report", "numpy==1")
    for folder, editable in ((checkout.root, False), (checkout.root.parent, True)):
        checkout.holds(folder, editable=editable)
        assert checkout.installs("report", "numpy==1")
    checkout.holds(checkout.root, editable=True)
    assert not checkout.installs("report", "numpy==1")
