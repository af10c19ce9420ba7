"""Options on a command line: one reader for argparse, and one writer that is its inverse."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Mapping
from typing import Any, Final, TypeVar

from .option import Option, Settings, options_of
from .parser import checked_option_type

_S = TypeVar("_S", bound=Settings)
_FLAG: Final = argparse.BooleanOptionalAction


def add_setting_options(
    group: argparse._ActionsContainer, rows: Iterable[Option], **defaults: str
) -> None:
    """Add the options; one that is not given is None, so that a file or a default can set it.

    *defaults* are the texts of those that this command sets in a way of its own.
    """
    for row in rows:
        default = defaults.get(row.name, row.default_text)
        text = (f"{row.help} [{default}]" if default else row.help).replace("%", "%%")
        if row.kind is bool:
            group.add_argument(row.word, action=_FLAG, help=text)
        else:
            group.add_argument(
                row.word,
                action="append" if row.count == 0 else "store",
                type=checked_option_type(row.checked_item, row.name),
                metavar=row.unit or f"{{{','.join(map(str, row.choices))}}}",
                required=row.is_required,
                help=text,
            )


def add_command_options(
    group: argparse._ActionsContainer, rows: Iterable[Option], **defaults: str
) -> None:
    """Add the options of a command that reads no file of settings; each has its default.

    A flag cannot be switched off again: nothing but the command line switches it on. *defaults*
    are texts, as in :func:`add_setting_options`.
    """
    rows = tuple(rows)
    add_setting_options(group, (row for row in rows if row.kind is not bool), **defaults)
    for row in rows:
        if row.kind is bool:
            group.add_argument(row.word, action="store_true", help=row.help.replace("%", "%%"))
        elif not row.is_required:
            group.set_defaults(**{row.name: [] if row.count == 0 else row.default})


def given_options(arguments: argparse.Namespace, rows: Iterable[str]) -> dict[str, Any]:
    """Return the options that *arguments* hold, by name."""
    values = {name: getattr(arguments, name) for name in rows}
    return {name: value for name, value in values.items() if value is not None}


def settings_of(arguments: argparse.Namespace, kind: type[_S]) -> _S:
    """Return the settings of *kind* that *arguments* hold.

    Raises
    ------
    SettingError
        A value that is refused.
    """
    return kind.of(**given_options(arguments, options_of(kind)))


def written_options(values: Mapping[str, Any], rows: Mapping[str, Option]) -> list[str]:
    """Return the words of a command line that say *values*, which :func:`given_options` returns."""
    words = []
    for name, value in values.items():
        row = rows[name]
        if row.kind is bool:
            words.append(row.word if value else f"--no-{row.word[2:]}")
        else:
            items = value if row.count == 0 else [value]
            words += [f"{row.word}={row.write(item)}" for item in items]
    return words
