"""Compilation of the loops: flags, and a cache that never returns stale code."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, ParamSpec, TypeVar, cast

import numba

P = ParamSpec("P")
R = TypeVar("R")


def _kernel_digest() -> str:
    """Return a name for the state of all sources of this package."""
    files = sorted(Path(__file__).parent.glob("*.py"))
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:12]


# Everything of `fastmath` but the reordering of sums, which would cancel the rounding errors that
# `rays` computes on purpose.
_STRICT_SUMS: Final = {"contract", "arcp", "nnan", "ninf", "nsz", "afn"}
_SOURCES: Final = _kernel_digest()


def _numba_jit(**options: Any) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Return `numba.njit` with the types of what it wraps (numba is not typed)."""
    compiled = numba.njit(error_model="numpy", cache=True, **options)

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        # numba's cache watches the file of a function, but not those of what is inlined into it;
        # the name of a cached file holds this one.
        function.__qualname__ += f"-{_SOURCES}"
        return cast("Callable[P, R]", compiled(function))

    return decorate


jit = _numba_jit(fastmath=_STRICT_SUMS)
jit_inline = _numba_jit(fastmath=_STRICT_SUMS, forceinline=True)
jit_checked = _numba_jit()  # keeps the meaning of NaN
jit_sums = _numba_jit(fastmath=True)  # sums may be reordered, and so vectorised
