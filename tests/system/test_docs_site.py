"""The documentation: it builds without a warning, its examples run, its commands exist."""

from __future__ import annotations

import ast
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from haptogram import VirtualBoard
from haptogram.acoustics import SingleFocus
from haptogram.cli import COMMANDS, command_parser, main

pytestmark = pytest.mark.nightly

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", *sorted(DOCS.glob("**/*.md"))]
#: Placeholders of the pages, which a command line may have.
_PLACEHOLDER = re.compile(r"[<\[]|\bCOMMAND\b|\.\.\.|^haptogram  ")


def test_site_builds_without_a_warning(tmp_path: Path) -> None:
    pytest.importorskip("sphinx", reason="needs the extra docs: ci/docs")
    pytest.importorskip("furo")
    pytest.importorskip("myst_parser")
    done = subprocess.run(
        [
            *(sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-b", "html"),
            *("-d", str(tmp_path / "cache"), str(DOCS), str(tmp_path / "site")),
        ],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    pages = {page.relative_to(tmp_path / "site") for page in (tmp_path / "site").glob("**/*.html")}
    assert {Path("index.html"), Path("start.html"), Path("python.html"), Path("spec.html")} <= pages
    # Links to a page in another folder, and to a file of the checkout that is a page.
    for page, link in (("start", "tutorials/firmware-in-ci.html"), ("glossary", "spec.html")):
        assert f'href="{link}"><span' in (tmp_path / "site" / f"{page}.html").read_text()
    index = (tmp_path / "site" / "index.html").read_text()
    assert not re.search(r'(?:src|href)="https?://(?!github\.com|www\.sphinx-doc|pradyunsg)', index)


def _commands() -> Iterator[tuple[str, str]]:
    for page in PAGES:
        for block in re.findall(
            r"```(?:console|sh|)\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL
        ):
            for line in block.replace("\\\n", " ").splitlines():
                words = line.removeprefix("$ ").strip()
                if words.startswith("haptogram ") and not _PLACEHOLDER.search(words):
                    yield str(page.relative_to(ROOT)), words


@pytest.mark.parametrize(("page", "line"), list(_commands()))
def test_a_command_of_a_page_has_the_options_that_it_uses(page: str, line: str) -> None:
    words = [word for word in shlex.split(line, comments=True) if word != "&"][1:]
    if "|" in words:
        words = words[: words.index("|")]
    assert words[0] in COMMANDS, page
    command_parser(words[0]).parse_args(words[1:])


def test_the_tutorial_installs_what_its_examples_import() -> None:
    """Modules of linked examples: of the standard library, dependencies, or of an extra."""
    page = (DOCS / "tutorials" / "driver-without-hardware.md").read_text("utf-8")
    needed: set[str] = set()
    for name in re.findall(r"\]\(\.\./(examples/\w+\.py)\)", page):
        for node in ast.walk(ast.parse((DOCS / name).read_text("utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            needed |= {name.partition(".")[0] for name in names}
    needed -= {*sys.stdlib_module_names, "haptogram"}
    assert needed == {"pytest", "serial"}
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    extras = set(re.findall(r"pip install -e '\.\[(\w+)\]'", page))
    lists = [project["dependencies"], *(project["optional-dependencies"][name] for name in extras)]
    packages = {re.split(r"[^\w-]", text)[0] for one in lists for text in one}
    assert {"pyserial" if name == "serial" else name for name in needed} <= packages


def test_what_is_told_to_install_is_this_checkout_and_leaves_it_editable() -> None:
    """A copy in .venv would be tested in place of the checkout; no package index has the name."""
    pages = [ROOT / "README.md", *DOCS.rglob("*.md"), *(ROOT / "haptogram").rglob("*.py")]
    told = [
        line for page in pages for line in re.findall("pip install .*", page.read_text("utf-8"))
    ]
    assert len(told) > 5
    assert [line for line in told if re.search(r"""install ['"]?(\.['[]|haptogram)""", line)] == []


@pytest.fixture
def c_host(tmp_path: Path) -> list[str]:
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        pytest.skip("not run: no C compiler")
    codec = ROOT / "protocol" / "c"
    program = str(tmp_path / "host")
    sources = [str(DOCS / "examples" / "host.c"), str(codec / "haptogram_codec.c")]
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", f"-I{codec}"]
    subprocess.run([compiler, *flags, *sources, "-lm", "-o", program], check=True)
    return [program]


@pytest.mark.pty
@pytest.mark.parametrize("language", ["python", "c"])
def test_a_host_in_40_lines_makes_its_focus(language: str, request: pytest.FixtureRequest) -> None:
    host = (
        [sys.executable, str(DOCS / "examples" / "host.py")]
        if language == "python"
        else request.getfixturevalue("c_host")
    )
    for _ in range(5):  # on a busy machine the lease may run out
        with VirtualBoard(clock="wall") as board:
            done = subprocess.run(
                [*host, board.url], check=True, timeout=120, stdout=subprocess.PIPE, text=True
            )
            assert done.stdout == "100 frames sent, the board is muted\n"
            board.finish()
            seen, output = board.observations(), board.records()
        found = [latch.reconstruction for latch in seen]
        if len(found) >= 50:
            break
    assert len(found) >= 50
    for focus in found:
        assert isinstance(focus, SingleFocus)
        assert focus.position_m == pytest.approx((0.0, 0.0, 0.15), abs=1e-3)
    states = [record["state"] for record in output if record.get("event") == "state"]
    assert states[-1] == "MUTED"


def test_the_exercise_shows_the_sign_of_the_phases(capsys: pytest.CaptureFixture[str]) -> None:
    page = (DOCS / "tutorials" / "broken-firmware.md").read_text("utf-8")
    (words,) = re.findall(r"`haptogram (verify --port \S+ --mode points .*?)`", page)
    (mutant,) = re.findall(r"`(\S+)` \| points are computed", page)
    words = words.replace("/tmp/board", f"haptogram://?clock=virtual&mutant={mutant}")
    assert main([*words.split(), "--object", "circle", "--quiet"]) == 1
    assert "opposite sign of all phases" in capsys.readouterr().out
