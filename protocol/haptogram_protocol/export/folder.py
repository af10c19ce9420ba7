"""The commands that rewrite a folder of what is made from the messages."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Final

__all__ = ["rewrite_export_folder"]

_PROTOCOL: Final = Path(__file__).resolve().parents[2]


def rewrite_export_folder(
    name: str,
    description: str,
    write: Callable[[Path], Iterable[Path]],
    arguments: list[str] | None,
) -> int:
    """Rewrite a folder, by default *name* of this checkout, and print its files; return 0.

    Parameters
    ----------
    name : str
        Name of the package in :mod:`haptogram_protocol.export`, and of the folder.
    description : str
        The command in a sentence.
    write : callable
        Writes the files to a folder and returns their paths.
    arguments : list of str or None
        The folder, if another one is meant; None: as on the command line.
    """
    parser = argparse.ArgumentParser(
        prog=f"python -m haptogram_protocol.export.{name}", description=description
    )
    parser.add_argument("folder", nargs="?", type=Path, default=_PROTOCOL / name)
    folder: Path = parser.parse_args(arguments).folder
    if not folder.is_dir():
        parser.error(f"{folder} is no folder")
    for path in write(folder):
        sys.stdout.write(f"{path}\n")
    return 0
