"""What the README and the pages behind it show, run as it stands there."""

from __future__ import annotations

import doctest
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "README.md").read_text(encoding="utf-8")
#: Files in the current folder that a command line writes.
WRITTEN = re.compile(
    r"(?: > |--(?:backdoor|capture|csv|frames|html|json|junit|link|picture|record|resume|summary|"
    r"write-baseline) )(?:\./)?(\w[\w/-]*\.\w+|board|liar)\b"
)
SNIPPETS = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)


@pytest.mark.parametrize("snippet", SNIPPETS, ids=range(len(SNIPPETS)))
def test_a_python_snippet_runs(snippet: str) -> None:
    paths = os.pathsep.join(path for path in sys.path if path)
    run = subprocess.run(
        [sys.executable, "-c", snippet],
        capture_output=True,
        text=True,
        env=os.environ | {"PYTHONPATH": paths},
        timeout=120,
        check=False,
    )
    assert run.returncode == 0, run.stdout + run.stderr
    assert "verify" not in snippet or run.stdout.startswith("PASS: every focus is on target\n")


def test_there_are_snippets() -> None:
    assert len(SNIPPETS) == 2


def test_what_the_commands_of_the_pages_write_is_ignored_by_git() -> None:
    if shutil.which("git") is None or not (ROOT / ".git").exists():
        pytest.skip("no checkout of git")
    blocks = (
        block
        for page in (ROOT / "README.md", *(ROOT / "docs").rglob("*.md"))
        for kind, block in re.findall(r"```(\w*)\n(.*?)```", page.read_text("utf-8"), re.DOTALL)
        if kind in ("", "bash", "console", "sh")
    )
    found = {name for block in blocks for name in WRITTEN.findall(block)}
    assert {"verify.html", "run.mcap", "liar.toml", "expected.toml"} <= found
    command = ["git", "-C", str(ROOT), "check-ignore", "--no-index", "--stdin"]
    ignored = subprocess.run(
        command, input="\n".join(found), capture_output=True, text=True, check=True, timeout=60
    )
    assert found - set(ignored.stdout.split()) == set()


def test_the_page_of_the_acoustics_is_true(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    result = doctest.testfile(str(ROOT / "docs" / "acoustics.md"), module_relative=False)
    assert result.attempted > 20
    assert result.failed == 0
    assert (tmp_path / "focus.png").read_bytes().startswith(b"\x89PNG")
