"""Every dialect of a foreign board that the virtual board speaks; packages may add more.

Each module here lists its own in ``EMULATIONS``.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import MappingProxyType
from typing import Final

from haptogram.errors import ConfigurationError, refusals_of
from haptogram.settings.arguments import did_you_mean
from haptogram.settings.option import Settings, options_of
from haptogram_protocol.dialects.table import listed_in_modules

from .emulation import INTERFACE, Emulation

GROUP: Final = "haptogram.dialects"
_FOUND: Final = listed_in_modules(Path(__file__).parent, __name__.rpartition(".")[0], "EMULATIONS")
EMULATIONS: Final[Mapping[str, Emulation]] = MappingProxyType(
    {emulation.dialect.name: emulation for emulation in _FOUND}
)
_LOG: Final = logging.getLogger(__name__)


def emulation_of(name: str) -> Emulation:
    """Return the dialect of that name: one of ours, or of another package.

    Raises
    ------
    ConfigurationError
        If there is none; names those that there are.
    """
    if name in EMULATIONS:
        return EMULATIONS[name]
    others = _emulation_plugins()
    if name not in others:
        known = (*EMULATIONS, *others)
        raise ConfigurationError(
            f"dialect is {name!r}; known are {', '.join(known)}{did_you_mean(name, known)}"
        )
    return others[name]


def read_emulation_options(emulation: Emulation, texts: tuple[str, ...]) -> Settings:
    """Return the options of a dialect from texts like ``boards=2``.

    Raises
    ------
    ConfigurationError
        For a text that is no option of the dialect, or a value that is refused.
    """
    rows, values = options_of(emulation.options), {}
    for text in texts:
        name, equals, value = text.partition("=")
        if name not in rows or not equals:
            known = ", ".join(f"{row.name}={row.unit}" for row in rows.values()) or "none"
            raise ConfigurationError(
                f"dialect_option is {text!r}; {emulation.dialect.name} takes {known}"
            )
        with refusals_of("dialect_option"):
            values[name] = rows[name].read(value)
    with refusals_of("dialect_option"):
        return emulation.options.of(**values)


@cache
def _emulation_plugins() -> dict[str, Emulation]:
    """Return the dialects of installed plugins; log and skip those that fail to load."""
    found = {}
    for point in entry_points(group=GROUP):
        try:
            emulation = _loaded_emulation(point)
        except Exception as error:
            _LOG.warning("dialect %s of %s is left out: %s", point.name, point.value, error)
        else:
            found[point.name] = emulation
    return found


def _loaded_emulation(point: EntryPoint) -> Emulation:
    """Load the dialect that a plugin offers, and check it.

    TypeError if it is no Emulation or for another interface version, ValueError if misnamed.
    """
    emulation = point.load()
    if not isinstance(emulation, Emulation):
        raise TypeError(f"a {type(emulation).__name__}, not an Emulation")
    if emulation.interface != INTERFACE:
        raise TypeError(f"made for version {emulation.interface} of the interface, not {INTERFACE}")
    if emulation.dialect.name != point.name:
        raise ValueError(f"its wire is called {emulation.dialect.name}")
    return emulation
