"""Environments of clients: a Python that suits, the packages pinned, in a cache of the checkout."""

from __future__ import annotations

import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Final

__all__ = ["CACHE", "ENVIRONMENTS", "Environment", "EnvironmentMissing"]

CACHE: Final = Path(".cache") / "clients"
INSTALL_S: Final = 600
RUN_S: Final = 120


class EnvironmentMissing(Exception):
    """There is no environment, and why."""


@dataclass(frozen=True)
class Environment:
    """An environment of one client.

    Attributes
    ----------
    client, version : str
        Package under test.
    pythons : tuple of str
        Versions of Python that it runs on, the best first.
    packages : tuple of str
        What is installed, pinned.
    """

    client: str
    version: str
    pythons: tuple[str, ...]
    packages: tuple[str, ...]

    @property
    def folder(self) -> Path:
        """Where it lies."""
        return CACHE / self.client

    @property
    def python(self) -> Path:
        """Its interpreter."""
        return self.folder / "bin" / "python"

    def make(self) -> None:
        """Make the environment, unless it is there with these packages.

        Raises
        ------
        EnvironmentMissing
            If no Python suits, or the packages cannot be installed.
        """
        note = self.folder / "packages.txt"
        wanted = "\n".join((*self.pythons, *self.packages))
        if note.exists() and note.read_text() == wanted and self.python.exists():
            return
        shutil.rmtree(self.folder, ignore_errors=True)
        _call([find_python(self.pythons), "-m", "venv", str(self.folder)], "no environment")
        _call(
            [str(self.python), "-m", "pip", "install", "--quiet", *self.packages],
            f"{' '.join(self.packages)} could not be installed",
        )
        note.write_text(wanted)

    def run(self, program: Path, *arguments: str) -> str:
        """Return what *program* prints.

        Raises
        ------
        subprocess.SubprocessError
            If it fails, or takes longer than two minutes.
        """
        done = subprocess.run(
            [str(self.python), str(program), *arguments],
            capture_output=True,
            text=True,
            timeout=RUN_S,
            check=True,
        )
        return done.stdout


def find_python(versions: tuple[str, ...]) -> str:
    """Return an interpreter of one of *versions*: of the PATH, or of pyenv.

    Raises
    ------
    EnvironmentMissing
        If there is none.
    """
    for version in versions:
        candidates = [shutil.which(f"python{version}"), *_of_pyenv(version)]
        for candidate in candidates:
            if candidate and _is(candidate, version):
                return candidate
    raise EnvironmentMissing(f"it needs Python {' or '.join(versions)}; none is here")


def _of_pyenv(version: str) -> list[str]:
    root = (
        subprocess.run(["pyenv", "root"], capture_output=True, text=True)
        if shutil.which("pyenv")
        else None
    )
    if root is None or root.returncode:
        return []
    versions = sorted(Path(root.stdout.strip(), "versions").glob(f"{version}.*"), reverse=True)
    return [str(found / "bin" / "python") for found in versions]


def _is(python: str, version: str) -> bool:
    """Return True if *python* starts and is of *version*; a shim of pyenv may not."""
    code = "import sys; print('%d.%d' % sys.version_info[:2])"
    try:
        done = subprocess.run([python, "-c", code], capture_output=True, text=True, timeout=30)
    except (OSError, subprocess.TimeoutExpired):
        return False
    return done.returncode == 0 and done.stdout.strip() == version


def _call(command: list[str], problem: str) -> None:
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=INSTALL_S)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise EnvironmentMissing(f"{problem}: {error}") from error
    if done.returncode:
        last = (done.stderr or done.stdout).strip().splitlines()[-1:]
        raise EnvironmentMissing(f"{problem}: {' '.join(last)}")


ENVIRONMENTS: Final = {
    environment.client: environment
    for environment in (
        Environment(
            "pyautd3", "38.0.1", ("3.12",), ("pyautd3==38.0.1", "pyautd3-emulator==38.0.1")
        ),
        Environment(
            "levitate",
            "3.0.0",
            ("3.11", "3.12", "3.10"),
            ("levitate==3.0.0", "scipy<1.15", "pyserial==3.5"),
        ),
    )
}
