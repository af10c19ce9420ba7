"""The cases, one module per chapter of SPEC.md or part of one."""

from __future__ import annotations

import importlib
from typing import Final

from ..case import Case
from ..clauses import load_clauses

_MODULES: Final = (
    "conformance",
    "framing",
    "line",
    "header",
    "numbers",
    "order",
    "session",
    "requests",
    "stream",
    "latch",
    "output",
    "clock",
    "timers",
    "configuration",
    "uploads",
    "playback",
    "evidence",
    "status",
    "errors",
    "focus",
)


def all_cases() -> tuple[Case, ...]:
    """Return every case, in the order of the clauses; those that need a reset stay in place."""
    order = {number: place for place, number in enumerate(load_clauses())}
    modules = [importlib.import_module(f"{__name__}.{name}") for name in _MODULES]
    cases = [value for module in modules for value in vars(module).values() if _is_case(value)]
    return tuple(sorted(cases, key=lambda case: (order[case.clause], case.variant)))


def _is_case(value: object) -> bool:
    return isinstance(value, Case)
