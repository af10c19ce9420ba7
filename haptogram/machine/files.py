"""Writes a result as a whole or not at all, and finds out before the work if it can be written."""

from __future__ import annotations

import contextlib
import enum
import errno
import os
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final, TextIO

from haptogram.errors import (
    ConfigurationError,
    plain_reason,
    reading_file,
    refusals_of,
    unwritable_file,
    writing_file,
)

#: The path that is standard output.
STANDARD_OUTPUT: Final = Path("-")


class Kind(enum.Enum):
    """Kinds of places that an output can name; each is written in a way of its own."""

    STANDARD_OUTPUT = "standard output"
    STANDARD_ERROR = "standard error"
    FOLDER = "folder"
    PIPE = "pipe"
    DEVICE = "device"
    FILE = "file"


def kind_of_file(path: Path) -> Kind:
    """Return the kind of *path*: of what it leads to, or a file where nothing is yet.

    ``-`` is standard output, and so is a name of what standard output leads to (``/dev/stdout``, a
    file that the shell redirects it to): two writers of their own would overwrite each other.

    Raises
    ------
    OSError, ValueError
        If the system refuses the path; ValueError: it has a null character.
    """
    if path == STANDARD_OUTPUT or _is_file_open_as(1, path):
        return Kind.STANDARD_OUTPUT
    if _is_file_open_as(2, path):
        return Kind.STANDARD_ERROR
    target = Path(os.path.realpath(path))
    if target.is_dir():
        return Kind.FOLDER
    if target.is_fifo():
        return Kind.PIPE
    return Kind.FILE if target.is_file() or not target.exists() else Kind.DEVICE


def is_standard_output(path: Path) -> bool:
    """Return True if *path* is standard output, by whatever name."""
    try:
        return kind_of_file(path) is Kind.STANDARD_OUTPUT
    except (OSError, ValueError):
        return False


def _is_file_open_as(descriptor: int, path: Path) -> bool:
    """Return True if the descriptor is open on the file *path*; never for the null device."""
    with contextlib.suppress(OSError):
        found = path.stat()
        nothing = os.stat(os.devnull)  # takes everything, from everybody
        return os.path.samestat(found, os.fstat(descriptor)) and not os.path.samestat(
            found, nothing
        )
    return False


def write_file_atomically(path: Path, content: bytes) -> None:
    """Write *content* to *path*: a reader meets the old file or the new one, never a part.

    The folder is created where there is none.  What exists and is no regular file (a pipe, a
    device) is written to, not replaced; see :func:`kind_of_file` for standard output.

    Raises
    ------
    ConfigurationError
        If it cannot be written; the text names the path and the reason.
    """
    with writing_file(path, kinds=(OSError, ValueError)):  # ValueError: a null character
        kind = kind_of_file(path)
        target = Path(os.path.realpath(path))  # a link keeps pointing to the result
        if kind is Kind.STANDARD_OUTPUT:
            _write_stream_or_pipe(sys.stdout, content)
        elif kind is Kind.STANDARD_ERROR:
            _write_stream_or_pipe(sys.stderr, content)
        elif kind in (Kind.PIPE, Kind.DEVICE):
            target.write_bytes(content)
        else:
            _make_output_folder(path, target)
            _replace_file(target, content)


def write_json_file(path: Path, document: Mapping[str, Any]) -> None:
    """Write *document* as JSON in ASCII; see :func:`write_file_atomically`.

    Raises
    ------
    ConfigurationError
        If it cannot be written.
    """
    import json  # not for --help

    text = json.dumps(document, indent=2, allow_nan=False) + "\n"
    write_file_atomically(path, text.encode("ascii"))


def check_file_has_content(path: Path, option: str) -> None:
    """Refuse a path that is no readable file with content; *option* is the one that names it.

    Raises
    ------
    ConfigurationError
        If it is none.
    """
    # ValueError: a path with a null character
    with reading_file(path, option, (OSError, ValueError)), path.open("rb") as file:
        is_empty = not file.read(1)
    if is_empty:
        raise ConfigurationError(f"{path}: the file is empty")


def check_file_writable(path: Path) -> None:
    """Raise, without a trace on the disk, if :func:`write_file_atomically` could not write *path*.

    Raises
    ------
    ConfigurationError
        Names the path and the reason.
    """
    with writing_file(path, kinds=(OSError, ValueError)):
        kind, target = kind_of_file(path), Path(os.path.realpath(path))
        if kind is Kind.STANDARD_OUTPUT:
            if sys.stdout is None or sys.stdout.closed:
                raise ConfigurationError(f"{path}: standard output is closed; name a file")
        elif kind is Kind.FOLDER:
            raise unwritable_file(path, IsADirectoryError(errno.EISDIR, ""))
        elif kind is Kind.PIPE:  # opened and closed, it would send its reader away
            if not os.access(target, os.W_OK):
                raise unwritable_file(path, PermissionError(errno.EACCES, ""))
        elif kind is Kind.DEVICE:
            os.close(os.open(target, os.O_WRONLY | os.O_NONBLOCK))
        elif kind is Kind.FILE:
            _check_folder_takes_files(path, target)


def check_files_writable(outputs: Mapping[str, Path], *, in_place: bool = False) -> None:
    """Raise, without a trace on the disk, if one of the files cannot be written.

    Parameters
    ----------
    outputs : mapping of str to Path
        The files by option.
    in_place : bool
        True if a file that exists is opened and overwritten; otherwise another one replaces it.

    Raises
    ------
    ConfigurationError
        Names the option, the path and the reason.
    """
    for option, path in outputs.items():
        if in_place and path.is_file():
            if not os.access(path, os.W_OK):
                raise unwritable_file(path, PermissionError(errno.EACCES, ""), option)
            continue
        with refusals_of(option):
            check_file_writable(path)


def _check_folder_takes_files(path: Path, target: Path) -> None:
    """Raise ConfigurationError unless the nearest folder above *target* that exists takes a file.

    The error names *path*, as the user gave it.
    """
    folder = next(parent for parent in target.parents if parent.exists())
    _refuse_folder_in_root(path, folder)
    if not folder.is_dir():
        raise unwritable_file(path, NotADirectoryError(errno.ENOTDIR, ""))
    temporary = _temporary_file(folder)
    try:
        temporary.touch(exist_ok=False)
        temporary.unlink()
    except OSError as error:
        # The folder is there: a file system such as /proc says so of any new name.
        why = "" if error.errno == errno.ENOENT else f": {plain_reason(error)}"
        raise ConfigurationError(
            f"'{path}' cannot be written: no file can be made in '{folder}'{why}"
        ) from error


def make_folder_of(path: Path, purpose: str = "what is written") -> None:
    """Make the folder of *path* if there is none, and say so, and for what, in the log.

    Raises
    ------
    OSError
        If it cannot be made.
    """
    import logging  # not for --help

    if not (folder := path.parent).exists():
        _make_output_folder(path, path)
        logging.getLogger(__name__).info("%s: a new folder, made for %s", folder, purpose)


def _make_output_folder(path: Path, target: Path) -> None:
    """Make the folders above *target*; an error names *path*, as the user gave it."""
    found = next((parent for parent in target.parents if parent.exists()), target)
    _refuse_folder_in_root(path, found)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)  # another process may make it meanwhile
    except FileExistsError as error:
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR)) from error


def _refuse_folder_in_root(path: Path, found: Path) -> None:
    """Raise OSError if *path* would create a folder in the root of the file system.

    *found* is the nearest folder above it that exists. A relative path creates one there, where the
    root is the current folder.
    """
    if path.is_absolute() and found == Path(path.anchor) and path.parent != found:
        folder = Path(*path.parts[:2])
        raise OSError(f"there is no folder '{folder}', and none is made in '{found}'")


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
        Names both options; or the one whose path the system refuses.
    """
    readers, options = list(inputs), dict[str, str]()
    for option, path in outputs.items():
        with writing_file(path, option, (OSError, ValueError)):
            kind = kind_of_file(path)
        is_stream = kind is Kind.STANDARD_OUTPUT
        place = str(kind.value) if is_stream else os.path.realpath(path)
        is_shared = is_stream or kind is Kind.FILE
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
    """Return True if both paths are the same file, also by a link."""
    return path.is_file() and other.is_file() and path.samefile(other)


def _write_stream_or_pipe(stream: TextIO, content: bytes) -> None:
    """Write bytes to a text stream, behind what was printed before."""
    stream.flush()
    stream.buffer.write(content)
    stream.buffer.flush()


def _replace_file(target: Path, content: bytes) -> None:
    """Write *content* to a temporary file, then rename it to *target*: never half a file."""
    temporary = _temporary_file(target.parent)
    try:
        with temporary.open("xb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, target)
    finally:
        temporary.unlink(missing_ok=True)


def _temporary_file(folder: Path) -> Path:
    # In the folder of the target: a rename is atomic within one file system only.
    """Return a random path in *folder*, in which a rename to the target is atomic."""
    return folder / f".haptogram-{os.urandom(8).hex()}.tmp"
