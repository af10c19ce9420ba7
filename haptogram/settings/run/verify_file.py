"""Settings of a verification run: defaults, then a TOML file, then the command line."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from ...errors import ConfigurationError
from ..arguments import did_you_mean, option_word
from ..option import SettingError, options_of, unknown_setting_text
from ..text_file import read_toml_file
from .verify import VerifyConfig

_SECTION: Final = "verify"


def load_verify_config(path: Path | None, overrides: Mapping[str, Any]) -> VerifyConfig:
    """Return the settings: defaults, then the ``[verify]`` table of *path*, then *overrides*.

    Parameters
    ----------
    path : Path or None
        TOML file.
    overrides : mapping
        Values from the command line; those that are None were not given.

    Raises
    ------
    ConfigurationError
        If the file cannot be read, a key is not known, or a value has the wrong type or size; the
        text names the setting as it was written: the key in the file, or the option.
    """
    in_file = read_settings_table(path) if path is not None else {}
    given = {name: value for name, value in overrides.items() if value is not None}
    try:
        return VerifyConfig.of(**(in_file | given))
    except SettingError as error:
        is_in_file = error.name in in_file and error.name not in given
        written = f"{path}: {error.name}" if is_in_file else option_word(error.name)
        raise ConfigurationError(f"{written} {error.message}") from error


def read_settings_table(path: Path) -> dict[str, Any]:
    """Return the ``[verify]`` table of a TOML file.

    Raises
    ------
    ConfigurationError
        If the file cannot be read, or a table or a key is not known.
    """
    document = read_toml_file(path, "config")
    table = document.get(_SECTION)
    for name in document:
        if name != _SECTION:
            guess = did_you_mean(name, (_SECTION,))
            raise ConfigurationError(
                f"{path}: [{name}] is not read; all settings are in one table [{_SECTION}]{guess}"
            )
    if not isinstance(table, dict):
        raise ConfigurationError(f"{path}: must have one table [{_SECTION}]")
    for name in (name for name in table if name not in options_of(VerifyConfig)):
        known = unknown_setting_text(name, options_of(VerifyConfig))
        raise ConfigurationError(f"{path}: {name!r} is not a setting{known}")
    return table
