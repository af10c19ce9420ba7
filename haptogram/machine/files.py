"""Writes a result as a whole or not at all."""

from __future__ import annotations

import os
import secrets
from pathlib import Path

from haptogram.errors import ConfigurationError


def write_atomically(path: Path, content: bytes) -> None:
    """Write *content* to *path*: a reader meets the old file or the new one, never a part.

    The folder is created where there is none.  What exists and is no regular file (``/dev/stdout``,
    a pipe) is written to, not replaced.

    Raises
    ------
    ConfigurationError
        If it cannot be written; the text names the path and the reason.
    """
    try:
        target = Path(os.path.realpath(path))  # a link keeps pointing to the result
        if target.exists() and not (target.is_file() or target.is_dir()):
            target.write_bytes(content)
            return
        target.parent.mkdir(parents=True, exist_ok=True)
        _replace(target, content)
    except (OSError, ValueError) as error:  # ValueError: a path with a null character
        reason = getattr(error, "strerror", None) or str(error)
        raise ConfigurationError(f"{path}: cannot be written: {reason}") from error


def _replace(target: Path, content: bytes) -> None:
    # Beside the target: a rename is atomic within one file system only.
    temporary = target.parent / f".haptogram-{secrets.token_hex(8)}.tmp"
    try:
        with temporary.open("xb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, target)
    finally:
        temporary.unlink(missing_ok=True)
