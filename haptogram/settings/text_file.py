"""Files of text that a user names: read whole, refused in plain words."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from haptogram.errors import ConfigurationError, plain_reason, reading_file

_MOST_TEXT: Final = 1 << 26  # characters; a device such as /dev/zero has no end
_MOST_TOML: Final = 1 << 18  # a thousand faults, or a thousand channels, with room
_DEEPEST: Final = 32
_KEY: Final = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')"""
#: A dotted key as deep as no document here is; the time to read one grows with its square.
_DEEP_KEY: Final = re.compile(rf"(?<![\w-]){_KEY}(?:[ \t]*+\.[ \t]*+{_KEY}){{{_DEEPEST}}}")


def read_text_file(path: Path, option: str, most: int = _MOST_TEXT) -> str:
    """Return the text of a file in UTF-8, whose name is the value of *option*.

    Parameters
    ----------
    most : int
        Characters that it may hold.

    Raises
    ------
    ConfigurationError
        Names the option, the file and the reason.
    """
    # ValueError: also a path with a null character
    with reading_file(path, option, (OSError, ValueError)):
        with path.open(encoding="utf-8-sig") as file:
            text = file.read(most + 1)
        if len(text) > most:
            raise ValueError(f"it has more than {most} characters")
    return text


def read_toml_file(path: Path, option: str) -> dict[str, Any]:
    """Return the document in a TOML file, whose name is the value of *option*.

    Raises
    ------
    ConfigurationError
        As :func:`read_text_file`; also names the line where the file is no TOML.
    """
    import tomllib  # not for --help

    text = read_text_file(path, option, _MOST_TOML)
    try:
        if _DEEP_KEY.search(text):
            raise RecursionError
        document = tomllib.loads(text)
        _check_depth(document)
        return document
    except (ValueError, RecursionError) as error:  # ValueError: also a number of 5000 digits
        raise ConfigurationError(f"{option} '{path}' is no TOML: {plain_reason(error)}") from error


def read_json_file(path: Path, option: str) -> Any:
    """Return the document in a JSON file, whose name is the value of *option*.

    Raises
    ------
    ConfigurationError
        As :func:`read_text_file`; also names the place where the file is no JSON.
    """
    import json  # not for --help

    text = read_text_file(path, option)
    try:
        document = json.loads(text)
        _check_depth([document])
        return document
    except (ValueError, RecursionError) as error:
        raise ConfigurationError(f"{option} '{path}' is no JSON: {plain_reason(error)}") from error


def flat_document(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the dotted name and the value of everything in a nested document.

    Examples
    --------
    >>> dict(flat_document({"frames": {"sent": 3, "late": 0}, "seed": 1}))
    {'frames.sent': 3, 'frames.late': 0, 'seed': 1}
    """
    if isinstance(value, Mapping):
        for key, item in value.items():
            yield from flat_document(item, f"{name}.{key}" if name else str(key))
    else:
        yield name, value


def _check_depth(document: dict[str, Any] | list[Any], left: int = _DEEPEST) -> None:
    """Raise RecursionError for a document nested more than *left* levels deep."""
    if not left:
        raise RecursionError
    for item in document.values() if isinstance(document, dict) else document:
        if isinstance(item, dict | list):
            _check_depth(item, left - 1)
