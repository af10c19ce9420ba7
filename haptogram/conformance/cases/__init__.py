"""The cases: a folder for every chapter of SPEC.md, a module for one or more of its sections.

A module, or a case, ``every_...`` asks for its clauses at every type, on every path, at every size
and length of time that they speak of; no dialogue of it is recorded for ports.  It lies in the
chapter of its subject, whatever the chapters of its clauses.
"""

from __future__ import annotations

import functools
import importlib
import pkgutil
from collections.abc import Iterator, Sequence
from types import ModuleType

from ..case import Case
from ..clauses import load_clauses


def case_modules() -> tuple[ModuleType, ...]:
    """Import and return every module of every chapter."""
    found = pkgutil.walk_packages(__path__, f"{__name__}.")
    names = [module.name for module in found if not module.ispkg]
    return tuple(importlib.import_module(name) for name in names)


def cases_in(module: ModuleType) -> list[Case]:
    """Return the cases that a module defines, singly or as a tuple of a whole product."""
    found: list[Case] = []
    for value in vars(module).values():
        some = value if isinstance(value, tuple) else (value,)
        found += [one for one in some if isinstance(one, Case)]
    return found


@functools.cache
def all_cases() -> tuple[Case, ...]:
    """Return every case in the order of the clauses; those that need a reset stay in place."""
    order = {number: place for place, number in enumerate(load_clauses())}
    cases = [case for module in case_modules() for case in cases_in(module)]
    return tuple(sorted(cases, key=lambda case: (order[case.clause], case.variant)))


def select(cases: Sequence[Case], wanted: Sequence[str]) -> Iterator[Case]:
    """Yield the cases of the clauses, sections or chapters named: HG-3.4/1, HG-3.4, HG-3."""
    for case in cases:
        if not wanted or any(_is_case_of(case, name) for name in wanted):
            yield case


def _is_case_of(case: Case, name: str) -> bool:
    """Return True if *name* is the case, its clause, or a section that contains the clause."""
    if name in (case.id, case.clause):
        return True
    return case.clause.startswith((f"{name}/", f"{name}.")) and "/" not in name
