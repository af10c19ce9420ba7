"""Modules of Python that only POSIX systems have, imported where a function needs them."""

from __future__ import annotations

import importlib
from typing import Any

from haptogram.errors import ConfigurationError


def posix_module(name: str, user: str, instead: str) -> Any:
    """Return the module *name*, such as ``termios``.

    Parameters
    ----------
    user : str
        Subject of the message: the service that needs the module.
    instead : str
        Service that the reader of the message can use without it.

    Raises
    ------
    ConfigurationError
        If this Python has no such module.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise ConfigurationError(
            f"{user} needs the module {name}, which this system lacks: use {instead}"
        ) from error
