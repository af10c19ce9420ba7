"""Every dialect of a foreign board, by name: each module here lists its own in ``DIALECTS``."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

from .codec import Dialect


def listed_in_modules(folder: Path, package: str, name: str) -> Iterator[Any]:
    """Yield the items of the list *name* of every module in the *folder* of a *package*."""
    for module in pkgutil.walk_packages([str(folder)], f"{package}."):
        listed: Sequence[Any] = getattr(importlib.import_module(module.name), name, ())
        yield from listed


_FOUND: Final = listed_in_modules(Path(__file__).parent, __name__.rpartition(".")[0], "DIALECTS")
DIALECTS: Final[dict[str, Dialect]] = {dialect.name: dialect for dialect in _FOUND}
