"""The lines of the CSV files that describe arrays, directivities and drives."""

from __future__ import annotations

import csv
from pathlib import Path

from haptogram.errors import ConfigurationError


def read_rows(path: Path, unreadable: str) -> list[tuple[int, list[str]]]:
    """Return number and stripped cells of each line that is neither blank nor a comment (``#``).

    Raises
    ------
    ConfigurationError
        A file that cannot be read: *unreadable*, and why; a cell that is too long.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, ValueError) as error:
        raise ConfigurationError(f"{unreadable}: {error}") from error
    return [
        (number, _cells(f"{path}:{number}", line))
        for number, line in enumerate(lines, start=1)
        if line.strip() and not line.lstrip().startswith("#")
    ]


def _cells(where: str, line: str) -> list[str]:
    try:
        return [cell.strip() for cell in next(csv.reader([line]))]
    except csv.Error as error:
        raise ConfigurationError(f"{where}: {error}") from error
