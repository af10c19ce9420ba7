"""Results as files, each whole or not at all; - is standard output."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from haptogram.errors import ConfigurationError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STANDARD_OUTPUT: Final = "-"


def check_file(path: Path | str | None) -> None:
    """Raise before some seconds of work, not after, if *path* is a folder where a file is wanted.

    Raises
    ------
    ConfigurationError
        Names it.
    """
    if path is not None and Path(path).is_dir():
        raise ConfigurationError(f"'{path}' is a folder; a file is wanted")


def write_json(name: str, document: Mapping[str, Any]) -> None:
    """Write *document* as JSON to the file *name*; - is standard output.

    Raises
    ------
    ConfigurationError
        If it cannot be written.
    """
    from haptogram.machine.files import write_atomically

    text = json.dumps(document, indent=2, allow_nan=False) + "\n"
    if name == STANDARD_OUTPUT:
        sys.stdout.write(text)
    else:
        write_atomically(Path(name), text.encode("ascii"))


def write_picture(path: Path, figure: Figure) -> None:
    """Write *figure* in the format of the suffix of *path*.

    Raises
    ------
    ConfigurationError
        A suffix that is not a format, or a path that cannot be written.
    """
    from haptogram.machine.files import write_atomically
    from haptogram.report.figures import check_format, encode

    check_format(path)
    write_atomically(path, encode(figure, path.suffix.lower()))
