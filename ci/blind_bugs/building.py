"""Patched copies of the C board: each patch alone on a copy of ``protocol/c``."""

from __future__ import annotations

import hashlib
import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Self

#: Line of a patch, before its first hunk, that names the clause which the bug breaks.
_CLAUSE: Final = re.compile(r"^\W*Clause: *(HG-\d+\.\d+/\d+)", re.MULTILINE | re.IGNORECASE)
_PROGRAMS: Final = ("reference_board", "board_steps")
_LONGEST_BUILD_S: Final = 300


class BuildError(Exception):
    """A patch does not apply, or what it gives does not compile."""


@dataclass(frozen=True, slots=True)
class Bug:
    """One bug of a board.

    Attributes
    ----------
    name : str
        File name of the patch without its suffix; empty: the board as it is.
    patch : str
        Text of the patch; paths begin at the checkout's root or at ``protocol/c``.
    clause : str
        Clause that the bug breaks; empty if the patch names none.
    """

    name: str
    patch: str
    clause: str

    @classmethod
    def read(cls, path: Path) -> Self:
        """Return the bug in a patch file."""
        patch = path.read_text("utf-8")
        found = _CLAUSE.search(patch)
        return cls(path.stem, patch, found[1] if found else "")


HEALTHY: Final = Bug("", "", "")


def read_bugs(folder: Path) -> list[Bug]:
    """Return the bugs of a folder: every ``*.patch`` and ``*.diff``, by name."""
    files = sorted({*folder.glob("*.patch"), *folder.glob("*.diff")})
    return [Bug.read(path) for path in files]


def build(bug: Bug, source: Path, folder: Path) -> Path:
    """Build the board of *source* with one bug into *folder*; return the folder of programs.

    Raises
    ------
    BuildError
        If the patch does not apply or the board does not compile.
    """
    copied = folder / "protocol" / "c"
    shutil.copytree(source, copied, ignore=shutil.ignore_patterns("build"))
    if bug.patch:
        _apply(bug.patch, folder, copied)
    programs = folder / "programs"
    targets = [str(programs / name) for name in _PROGRAMS]
    command = ["make", "-s", "-C", str(copied), f"BUILD={programs}", "CFLAGS=-O1 -w", *targets]
    done = _run(command)
    if done.returncode:
        raise BuildError(f"does not compile: {_last_line(done.stdout)}")
    return programs


def _apply(patch: str, root: Path, copied: Path) -> None:
    """Apply *patch* in the folder that its paths begin at."""
    for folder in (root, copied):
        command = ["patch", "-p1", "--batch", "--forward", "--fuzz=2", "-d", str(folder)]
        if not _run([*command, "--dry-run"], patch).returncode:
            _run(command, patch)
            return
    raise BuildError("does not apply to this board")


def _run(command: list[str], text: str = "") -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        command,
        input=text,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=_LONGEST_BUILD_S,
        check=False,
    )


def _last_line(text: str) -> str:
    lines = [line for line in text.splitlines() if "error" in line] or text.splitlines() or [""]
    return lines[0]


def digest(*parts: str | Path) -> str:
    """Return a digest of texts and of every C and Python source below folders."""
    found = hashlib.sha256()
    for part in parts:
        files = [part] if isinstance(part, str) else _sources(part)
        for one in files:
            found.update(one.encode() if isinstance(one, str) else one.read_bytes())
    return found.hexdigest()[:16]


def _sources(folder: Path) -> list[Path]:
    return sorted(p for p in folder.rglob("*") if p.suffix in (".c", ".h", ".py"))
