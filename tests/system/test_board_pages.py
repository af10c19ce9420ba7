"""The commands of the pages docs/boards, run as they stand there, and the focus that they show."""

import os
import re
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = ROOT / "docs" / "boards"
PATIENCE_S = 120
# For each page what its commands say
SHOWN = {
    "sonicsurface": "one focus at (20.0, 150.0, -15.0) mm",
    "ultraino": "one focus at (0.0, 51.2, 0.0) mm",
    "interactlab": "one focus at (0.0, 0.0, 100.5) mm",
    "autd3": "one focus at (96.6, 76.7, 150.0) mm",
}
ADDRESS = "127.0.0.1:8080"

pytestmark = [pytest.mark.pty, pytest.mark.slow]


def blocks(page: str, language: str) -> list[str]:
    text = (PAGES / f"{page}.md").read_text(encoding="utf-8")
    return re.findall(rf"```{language}\n(.*?)```", text, re.DOTALL)


def run_commands(folder: Path, script: str) -> str:
    """Run *script* where the files of the checkout are, with this haptogram."""
    (folder / "bin").mkdir()
    command = folder / "bin" / "haptogram"
    command.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m haptogram "$@"\n')
    command.chmod(0o755)
    (folder / "tests").symlink_to(ROOT / "tests")
    python = os.pathsep.join(path for path in sys.path if path)
    path = f"{folder / 'bin'}{os.pathsep}{os.environ['PATH']}"
    process = subprocess.Popen(
        ["bash", "-e", "-c", script],
        cwd=folder,
        env=os.environ | {"PATH": path, "PYTHONPATH": python},
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        output, _ = process.communicate(timeout=PATIENCE_S)
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
    assert process.returncode == 0, output
    return output


def test_every_page_is_run() -> None:
    assert {page.stem for page in PAGES.glob("*.md")} == set(SHOWN)


@pytest.mark.parametrize("page", SHOWN)
def test_the_commands_of_a_page_show_the_focus_that_it_names(page: str, tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        address = "127.0.0.1:{1}".format(*free.getsockname())
    script = "".join(blocks(page, "bash")).replace(ADDRESS, address)
    script = script.replace(ADDRESS.replace(":", "/"), address.replace(":", "/"))
    output = run_commands(tmp_path, script)
    assert SHOWN[page] in output
    assert "PASS: " in output
    assert "PASS: every focus is on target" in output  # our objects on that board
    assert SHOWN[page] in (PAGES / f"{page}.md").read_text(encoding="utf-8")
    if page == "ultraino":
        assert "amplitude frame taken for phases" in output


@pytest.mark.parametrize("page", SHOWN)
def test_the_programs_of_a_page_are_python(page: str) -> None:
    for block in blocks(page, "python"):
        compile(block, page, "exec")
