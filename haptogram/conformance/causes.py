"""Which failure is the cause: a board that breaks one clause often fails the cases of others.

The sections of SPEC.md stand here from the ground up.  A case relies on everything below its own
section, so that of several failures the lowest is the likeliest cause, and the others may follow.
A case that asks many clauses at once fails with each of them, and stands behind the others.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from .verdict import CaseResult

#: Clauses, sections and chapters from the ground up; the longest name that fits a clause counts.
FOUNDATIONS: Final = (
    "HG-2",
    "HG-3.1",
    "HG-3.2",
    "HG-3.3",
    "HG-3.4",
    "HG-3.5",
    "HG-3.7",
    "HG-4.3",
    "HG-4",
    "HG-6.9",
    "HG-4.11",
    "HG-7.5",
    "HG-5.1",
    "HG-7.1",
    "HG-5.2",
    "HG-5.3",
    "HG-8.6",
    "HG-5.4",
    "HG-6.2",
    "HG-6.3",
    "HG-6.4",
    "HG-6.5",
    "HG-6.1",
    "HG-6.7",
    "HG-3.6",
    "HG-5.5",
    "HG-5.6",
    "HG-5.9",
    "HG-5.8",
    "HG-5.7",
    "HG-7.2",
    "HG-7.3",
    "HG-7.4",
    "HG-7",
    "HG-8",
    "HG-12",
    "HG-6",
    "HG-5",
    "HG-9.3",
    "HG-9",
    "HG-3.9",  # sums over everything else
    "HG-3.8",  # the order of all checks
    "HG-10",
    "HG-11",
    "HG-1",
)


#: Variants of cases that ask many clauses at once: rules over every frame, all that an event or an
#: end must leave, every reason of a drop before and behind the wrap, random dialogues.
BROAD: Final = frozenset({"always", "alone", "moments", "sides", "dialogues"})


def cause_rank(clause: str) -> int:
    """Return the place of a clause in :data:`FOUNDATIONS`: 0 is the ground."""
    fits = [
        (len(name), -place)
        for place, name in enumerate(FOUNDATIONS)
        if clause == name or clause.startswith((f"{name}/", f"{name}."))
    ]
    return -max(fits)[1]


def failures_by_cause(results: Iterable[CaseResult]) -> list[CaseResult]:
    """Return the failures among *results*, the likeliest cause first."""

    def place(result: CaseResult) -> tuple[bool, int]:
        variant = result.case.removeprefix(result.clause).removeprefix("-")
        return variant in BROAD, cause_rank(result.clause)

    return sorted((result for result in results if result.is_failure), key=place)
