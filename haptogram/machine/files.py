"""Writes a result as a whole or not at all, and finds out before the work if it can be written."""

from __future__ import annotations

import os
import secrets
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Final

from haptogram.errors import ConfigurationError

#: The path that is standard output.
STANDARD_OUTPUT: Final = Path("-")


def write_file_atomically(path: Path, content: bytes) -> None:
    """Write *content* to *path*: a reader meets the old file or the new one, never a part.

    The folder is created where there is none.  What exists and is no regular file (``/dev/stdout``,
    a pipe) is written to, not replaced; ``-`` is standard output.

    Raises
    ------
    ConfigurationError
        If it cannot be written; the text names the path and the reason.
    """
    try:
        if path == STANDARD_OUTPUT:
            _write_standard_output(content)
            return
        target = Path(os.path.realpath(path))  # a link keeps pointing to the result
        if target.exists() and not (target.is_file() or target.is_dir()):
            target.write_bytes(content)
            return
        target.parent.mkdir(parents=True, exist_ok=True)
        _replace(target, content)
    except (OSError, ValueError) as error:  # ValueError: a path with a null character
        raise _refusal(path, error) from error


def check_file_writable(path: Path) -> None:
    """Raise, without a trace on the disk, if :func:`write_file_atomically` could not write *path*.

    Raises
    ------
    ConfigurationError
        Names the path and the reason.
    """
    try:
        target = Path(os.path.realpath(path))
        if target.is_dir():
            raise ConfigurationError(f"{path}: is a folder; name a file")
        if target.is_fifo():  # opened and closed, it would send its reader away
            if not os.access(target, os.W_OK):
                raise ConfigurationError(f"{path}: cannot be written: no permission")
            return
        if target.exists() and not target.is_file():
            os.close(os.open(target, os.O_WRONLY | os.O_NONBLOCK))
            return
        folder = next(parent for parent in target.parents if parent.exists())
        temporary = _temporary(folder)
        temporary.touch(exist_ok=False)
        temporary.unlink()
    except (OSError, ValueError) as error:
        if not isinstance(error, ConfigurationError):
            raise _refusal(path, error) from error
        raise


def check_distinct_files(
    outputs: Mapping[str, Path], inputs: Iterable[tuple[str, Path]] = ()
) -> None:
    """Raise if two outputs are one file, or if an output would replace an input.

    Parameters
    ----------
    outputs : mapping of str to Path
        The files by option.  Devices and pipes may be shared, standard output may not.
    inputs : iterable of (str, Path)
        Options and the files that they read.

    Raises
    ------
    ConfigurationError
        Names both options.
    """
    readers, options = list(inputs), dict[str, str]()
    for option, path in outputs.items():
        is_stream = path == STANDARD_OUTPUT
        place = "standard output" if is_stream else os.path.realpath(path)
        is_shared = is_stream or not os.path.exists(place) or os.path.isfile(place)
        if is_shared and place in options:
            name = place if is_stream else f"the same file, {path}"
            raise ConfigurationError(
                f"{options[place]} and {option} are both {name}; give each a name of its own"
            )
        options[place] = option
        for reader, read in readers:
            if not is_stream and _is_same_file(path, read):
                raise ConfigurationError(
                    f"{option} {path}: would replace the file that {reader} reads; name another one"
                )


def _is_same_file(path: Path, other: Path) -> bool:
    return path.is_file() and other.is_file() and path.samefile(other)


def _refusal(path: Path, error: OSError | ValueError) -> ConfigurationError:
    reason = getattr(error, "strerror", None) or str(error)
    return ConfigurationError(f"{path}: cannot be written: {reason}")


def _write_standard_output(content: bytes) -> None:
    sys.stdout.flush()
    sys.stdout.buffer.write(content)
    sys.stdout.buffer.flush()


def _replace(target: Path, content: bytes) -> None:
    temporary = _temporary(target.parent)
    try:
        with temporary.open("xb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, target)
    finally:
        temporary.unlink(missing_ok=True)


def _temporary(folder: Path) -> Path:
    # In the folder of the target: a rename is atomic within one file system only.
    return folder / f".haptogram-{secrets.token_hex(8)}.tmp"
