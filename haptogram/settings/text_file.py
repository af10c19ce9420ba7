"""Files of text that a user names: read whole, refused in plain words."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from haptogram.errors import ConfigurationError, plain_reason, unreadable_file


def read_text_file(path: Path, option: str) -> str:
    """Return the text of a file in UTF-8, whose name is the value of *option*.

    Raises
    ------
    ConfigurationError
        Names the option, the file and the reason.
    """
    try:
        return path.read_text(encoding="utf-8-sig")
    except (OSError, ValueError) as error:  # ValueError: also a path with a null character
        raise unreadable_file(path, error, option) from error


def read_toml_file(path: Path, option: str) -> dict[str, Any]:
    """Return the document in a TOML file, whose name is the value of *option*.

    Raises
    ------
    ConfigurationError
        As :func:`read_text_file`; also names the line where the file is no TOML.
    """
    import tomllib  # not for --help

    text = read_text_file(path, option)
    try:
        return tomllib.loads(text)
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
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ConfigurationError(f"{option} '{path}' is no JSON: {plain_reason(error)}") from error
