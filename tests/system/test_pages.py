"""Pages of docs whose commands run as they stand there, and print what the page shows."""

import os
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
PATIENCE_S = 300
#: For each page the kinds of its blocks that run; programs of others' clients do not.
PAGES = {
    "start": "console python",
    "captures": "sh",
    "boards/sonicsurface": "bash",
    "boards/ultraino": "bash",
    "boards/interactlab": "bash",
    "boards/autd3": "bash",
}
ADDRESS = "127.0.0.1:8080"
#: What another run prints anew: when a client came, how long a search took, which port is free.
OTHERWISE = re.compile(r"\d+\.\d{6} s|[\d.]+ ms|(?<=127\.0\.0\.1:)\d+")
ELSEWHERE = {"/tmp/board": "./board", "loops=80": "loops=1", "out/": ""}

pytestmark = pytest.mark.pty


def blocks(page: str) -> list[tuple[str, str]]:
    """Return the blocks of a page with their kinds; one that is indented has none."""
    text = (DOCS / f"{page}.md").read_text(encoding="utf-8")
    found = re.finditer(
        r"^```(\w+)\n(.*?)^```|((?:^    [^\n]*\n)+)", text, re.DOTALL | re.MULTILINE
    )
    return [(kind or "", body or indented) for kind, body, indented in (f.groups() for f in found)]


def commands(page: str) -> Iterator[str]:
    """Yield what a shell runs; a command of a console may fail: what it prints says so."""
    for kind, body in blocks(page):
        if kind not in PAGES[page].split():
            continue
        if kind == "python":
            yield f'"{sys.executable}" - <<"END" || exit 1\n{body}END\n'
        for command in re.findall(r"^\$ (.*(?<!\\))$", body, re.MULTILINE):
            yield (
                f"{command} || true\n"
                if "--link" not in command
                else (f"{command} & until [ -e /tmp/board ]; do sleep 0.1; done\n")
            )
        if kind == "bash":
            yield f"set -e\n{body}"
        if kind == "sh":
            yield body


def shown(page: str) -> list[str]:
    """Return the lines that the page shows as printed."""
    texts = [body for kind, body in blocks(page) if kind in ("", "console")]
    texts += [body for kind, body in blocks(page) if kind == "text" and PAGES[page] == "sh"]
    lines = [line for text in texts for line in text.splitlines()]
    return [plain(line) for line in lines if not line.startswith(("$", "#"))]


def plain(line: str) -> str:
    for here, there in ELSEWHERE.items():
        line = line.replace(here, there)
    return " ".join(OTHERWISE.sub("?", line).split())


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
        ["bash", "-c", f"set -m\ntrap 'kill $(jobs -p) 2>/dev/null || :; wait' EXIT\n{script}"],
        cwd=folder,
        env=os.environ | {"PATH": path, "PYTHONPATH": python, "PYTHONUNBUFFERED": "1"},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
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


def test_every_page_of_a_board_is_run() -> None:
    assert {f"boards/{page.stem}" for page in (DOCS / "boards").glob("*.md")} < set(PAGES)


@pytest.mark.nightly
@pytest.mark.parametrize("page", PAGES)
def test_the_commands_of_a_page_print_what_it_shows(page: str, tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        address = "127.0.0.1:{1}".format(*free.getsockname())
    script = "".join(commands(page)).replace(ADDRESS, address)
    script = script.replace(ADDRESS.replace(":", "/"), address.replace(":", "/"))
    for here, there in ELSEWHERE.items():
        script = script.replace(here, there)
    output = run_commands(tmp_path, script)
    printed = [plain(line) for line in output.splitlines()]
    lines = iter(printed)
    assert [line for line in shown(page) if line not in lines] == [], output
    assert any(line.startswith("PASS: ") for line in shown(page))


@pytest.mark.parametrize("page", [page for page in PAGES if "/" in page])
def test_the_programs_of_a_page_are_python(page: str) -> None:
    for kind, body in blocks(page):
        if kind == "python":
            compile(body, page, "exec")
