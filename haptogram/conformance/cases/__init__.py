"""The cases, one module per chapter of SPEC.md or part of one."""

from __future__ import annotations

import importlib
from collections.abc import Iterator, Sequence
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


def select(cases: Sequence[Case], wanted: Sequence[str]) -> Iterator[Case]:
    """Yield the cases of the clauses, sections or chapters named: HG-3.4/1, HG-3.4, HG-3."""
    for case in cases:
        if not wanted or any(_is_of(case, name) for name in wanted):
            yield case


def _is_of(case: Case, name: str) -> bool:
    if name in (case.id, case.clause):
        return True
    return case.clause.startswith((f"{name}/", f"{name}.")) and "/" not in name
