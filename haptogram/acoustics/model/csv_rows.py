"""The lines of the CSV files that describe arrays, directivities and drives."""

from __future__ import annotations

import csv
from pathlib import Path

from haptogram.errors import ConfigurationError, reading_file
from haptogram.settings.text_file import read_text_file


def read_element_rows(path: Path, option: str) -> list[tuple[int, list[str]]]:
    """Return number and stripped cells of each line that is neither blank nor a comment (``#``).

    Raises
    ------
    ConfigurationError
        A file that cannot be read, with the *option* that names it; a cell that is too long.
    """
    with reading_file(path, option, (OSError, ValueError)):
        is_pipe = path.is_fifo()
    if is_pipe:  # the second reader would find nothing
        raise ConfigurationError(
            f"{option} '{path}' is a pipe, and is read more than once; name a file"
        )
    lines = read_text_file(path, option).splitlines()
    return [
        (number, _element_row_cells(f"{path}:{number}", line))
        for number, line in enumerate(lines, start=1)
        if line.strip() and not line.lstrip().startswith("#")
    ]


def _element_row_cells(where: str, line: str) -> list[str]:
    """Return the stripped cells of a CSV line; raise ConfigurationError if it cannot be split.

    The error begins with *where*.
    """
    try:
        return [cell.strip() for cell in next(csv.reader([line]))]
    except csv.Error as error:
        raise ConfigurationError(f"{where}: {error}") from error
