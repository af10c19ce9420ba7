"""Files of text that a user names: read whole, refused in plain words."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from haptogram.errors import ConfigurationError

_REASONS: Final = {
    errno.ENOENT: "there is no such file",
    errno.EISDIR: "it is a folder; name a file",
    errno.ENOTDIR: "a folder of its path is a file",
    errno.EACCES: "there is no permission",
    errno.EPERM: "there is no permission",
    errno.EROFS: "the file system is read-only",
    errno.ENOSPC: "the disk is full",
    errno.ENOTTY: "it is no serial port",
    errno.ENAMETOOLONG: "the name is too long",
}


def plain_reason(error: BaseException) -> str:
    """Return the cause of an error of the system, or of a text, without codes and jargon."""
    if isinstance(error, UnicodeDecodeError):
        return f"it is no text in UTF-8, from byte {error.start} on"
    if isinstance(error, RecursionError):
        return "it is nested too deeply"
    code = next(
        (
            found
            for found in map(_text_file_error_code, _text_file_error_chain(error))
            if found is not None
        ),
        None,
    )
    if code is None:
        return " ".join(str(error).split())
    text = _REASONS.get(code) or (os.strerror(code) if code > 0 else str(_plain_strerror(error)))
    return text[:1].lower() + text[1:]


def _text_file_error_chain(error: BaseException | None) -> Iterator[BaseException]:
    while error is not None:
        yield error
        error = error.__cause__ or error.__context__


def _text_file_error_code(error: BaseException) -> int | None:
    """Return the code of an OSError, or of what is like one (termios.error)."""
    code = error.errno if isinstance(error, OSError) else next(iter(error.args), None)
    return code if isinstance(code, int) else None


def _plain_strerror(error: BaseException) -> str | None:
    return getattr(error, "strerror", None)


def read_text(path: Path, option: str) -> str:
    """Return the text of a file in UTF-8, whose name is the value of *option*.

    Raises
    ------
    ConfigurationError
        Names the option, the file and the reason.
    """
    try:
        return path.read_text(encoding="utf-8-sig")
    except (OSError, ValueError) as error:  # ValueError: also a path with a null character
        raise ConfigurationError(
            f"{option} '{path}' cannot be read: {plain_reason(error)}"
        ) from error


def read_toml(path: Path, option: str) -> dict[str, Any]:
    """Return the document in a TOML file, whose name is the value of *option*.

    Raises
    ------
    ConfigurationError
        As :func:`read_text`; also names the line where the file is no TOML.
    """
    import tomllib  # not for --help

    text = read_text(path, option)
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # ValueError: also a number of 5000 digits
        raise ConfigurationError(f"{option} '{path}' is no TOML: {plain_reason(error)}") from error


def read_json(path: Path, option: str) -> Any:
    """Return the document in a JSON file, whose name is the value of *option*.

    Raises
    ------
    ConfigurationError
        As :func:`read_text`; also names the place where the file is no JSON.
    """
    import json  # not for --help

    text = read_text(path, option)
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ConfigurationError(f"{option} '{path}' is no JSON: {plain_reason(error)}") from error
