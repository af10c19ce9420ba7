"""The scripts in ci/ and the page that lists them."""

import os
import re
from pathlib import Path

CI = Path(__file__).resolve().parents[2] / "ci"


def test_the_page_lists_every_command():
    commands = {f"ci/{path.name}" for path in CI.iterdir() if path.is_file() and is_program(path)}
    listed = re.findall(
        r"^\| `(ci/[\w-]+)` \|", (CI / "README.md").read_text("utf-8"), re.MULTILINE
    )
    assert len(listed) == len(set(listed))
    assert set(listed) == commands


def is_program(path):
    return os.access(path, os.X_OK)
