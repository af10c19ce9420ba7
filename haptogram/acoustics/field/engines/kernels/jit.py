"""Compilation of the loops: flags, and a cache that never returns stale code.

All that an entry calls is compiled into it. A function of its own would have one machine code for
each entry that calls it, whose sums go in other orders; which one serves all of them would depend
on what the process has compiled, and what it has loaded.
"""

from __future__ import annotations

from collections.abc import Callable
from types import FunctionType
from typing import Any, Final, ParamSpec, TypeVar, cast

import numba

from haptogram.acoustics.field.engines.compiled import kernel_digest

P = ParamSpec("P")
R = TypeVar("R")


# Everything of `fastmath` but the reordering of sums, which would cancel the rounding errors that
# `rays` computes on purpose.
_STRICT_SUMS: Final = {"contract", "arcp", "nnan", "ninf", "nsz", "afn"}
_SOURCES: Final = kernel_digest()


def _numba_jit(
    *, is_entry: bool = False, **options: Any
) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Return `numba.njit` with type annotations that mypy understands.

    Only an entry is called from Python and cached. All others are compiled into their callers:
    what Python would call, and files of their own, take a third of the time of compilation.
    """
    options |= {"no_cpython_wrapper": not is_entry, "no_cfunc_wrapper": True}
    options |= {"forceinline": not is_entry, "error_model": "numpy"}
    compiled = numba.njit(cache=is_entry, **options)

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        # numba's cache watches the file of a function, but not those of what is inlined into it;
        # the name of a cached file holds this one.
        function.__qualname__ += f"-{_SOURCES}"
        return cast("Callable[P, R]", compiled(function))

    return decorate


def inlined(entry: Callable[P, R]) -> Callable[P, R]:
    """Return an entry as another one calls it."""
    loop = cast("Any", entry)
    if isinstance(entry, FunctionType):  # numba is told not to compile
        return entry
    options = loop.targetoptions | {"no_cpython_wrapper": True, "forceinline": True}
    return cast("Callable[P, R]", numba.jit(**options)(loop.py_func))


jit_inline = _numba_jit(fastmath=_STRICT_SUMS)
jit_checked = _numba_jit()  # keeps the meaning of NaN
jit_sums = _numba_jit(fastmath=True)  # sums may be reordered, and so vectorised
jit_entry = _numba_jit(is_entry=True, fastmath=_STRICT_SUMS)
jit_checked_entry = _numba_jit(is_entry=True)
