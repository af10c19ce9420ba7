"""Compiling the C side.  Without a compiler the tests say so and are not run."""

import functools
import shutil
import subprocess
from pathlib import Path

import pytest

FOLDER = Path(__file__).resolve().parents[2] / "protocol" / "c"


@functools.cache
def compilers():
    """The C compilers of this machine, by name."""
    return [name for name in ("gcc", "clang") if shutil.which(name)] or (
        ["cc"] if shutil.which("cc") else []
    )


def compiler():
    """One of them; the test is skipped where there is none."""
    if not compilers() or not shutil.which("make"):
        pytest.skip("not run: no C compiler")
    return compilers()[0]


def run(*command, **options):
    """Run *command*; return its status and what it printed."""
    done = subprocess.run(
        [str(part) for part in command],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
        timeout=120,
        **options,
    )
    return done.returncode, done.stdout


def make(folder, *targets, source=FOLDER, **variables):
    """Build with the Makefile of *source* into *folder*; return status and output."""
    settings = [f"{name}={value}" for name, value in {"BUILD": folder, **variables}.items()]
    return run("make", "-s", "-C", source, *settings, *targets)


def rebuilt(tmp_path, objects, source, program):
    """Build *program* from spoilt *source*: only what differs from *objects* is compiled."""
    folder = tmp_path / "build"
    shutil.copytree(objects, folder)  # with its times, by which make knows what is old
    (folder / program).unlink()
    variables = {"SANITIZE": 1} if (folder / "sanitized").exists() else {}
    settings = {"CC": compiler(), "CFLAGS": "-O0 -w", **variables}
    status, output = make(folder, folder / program, source=source, **settings)
    assert status == 0, output
    return folder


def spoilt(tmp_path, name, old, new):
    """A copy of the sources in which one text of one file is another."""
    copied = tmp_path / "c"
    shutil.copytree(FOLDER, copied, ignore=shutil.ignore_patterns("build"))
    text = (copied / name).read_text()
    assert text.count(old) >= 1, f"{name} has no {old!r}"
    (copied / name).write_text(text.replace(old, new))
    return copied
