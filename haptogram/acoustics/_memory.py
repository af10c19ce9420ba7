"""Refusing work that would not fit, before it starts."""

from __future__ import annotations

import os
from typing import Final

from haptogram.errors import ConfigurationError

_SHARE: Final = 0.5  # of the machine's memory that one result may take


def check_memory(what: str, size_bytes: int) -> None:
    """Raise if *size_bytes* is more than half of the memory of this machine.

    Raises
    ------
    ConfigurationError
        Names both figures.
    """
    limit = int(_SHARE * os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    if size_bytes > limit:
        raise ConfigurationError(
            f"{what} needs {size_bytes / 1e9:.3g} GB, must be at most {limit / 1e9:.3g} GB "
            "(half of the memory)"
        )
