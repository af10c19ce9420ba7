"""Memory of a computation: a refusal of too large ones, and parts for the others."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence
from typing import Final

from haptogram.errors import ConfigurationError

_SHARE: Final = 0.5  # share of the machine's memory that one result may take
_ALWAYS_BYTES: Final = 1 << 14  # smallest size that is checked against the system


def check_array_memory(what: str, shape: Sequence[int], item_bytes: int) -> None:
    """Raise if an array of this shape takes more than half of the memory of this machine.

    Raises
    ------
    ConfigurationError
        Names both figures.
    """
    size_bytes = item_bytes * math.prod(shape)
    if size_bytes <= _ALWAYS_BYTES or not hasattr(os, "sysconf"):  # no system without it tells
        return
    limit_bytes = int(_SHARE * os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    if size_bytes > limit_bytes:
        raise ConfigurationError(
            f"{what} of {' x '.join(map(str, shape))} needs {size_bytes // 10**9:,} GB, "
            f"must be at most {limit_bytes / 1e9:.3g} GB (half of the memory)"
        )


def memory_chunks(count: int, size: int) -> Iterator[slice]:
    """Return the slices that divide *count* items into parts of at most *size*."""
    return (slice(start, min(start + size, count)) for start in range(0, count, size))
