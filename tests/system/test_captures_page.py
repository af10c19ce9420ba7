"""docs/captures.md: its commands run as they stand, and say what it says."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

PAGE = (Path(__file__).parents[2] / "docs" / "captures.md").read_text(encoding="utf-8")
pytestmark = pytest.mark.pty


def blocks(kind):
    return re.findall(rf"```{kind}\n(.*?)```", PAGE, re.DOTALL)


@pytest.mark.slow
def test_the_worked_example_runs(tmp_path):
    (tmp_path / "map.toml").write_text(blocks("toml")[0])
    folder = Path(sys.executable).parent
    environment = {**os.environ, "PATH": f"{folder}{os.pathsep}{os.environ['PATH']}"}
    script = "set -m\n" + "\n".join(blocks("sh"))
    done = subprocess.run(
        ["bash", "-c", script],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    for expected in blocks("text"):
        assert expected.strip() in done.stdout, done.stderr
