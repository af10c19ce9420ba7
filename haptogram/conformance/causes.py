"""Which failure is the cause: a board that breaks one clause often fails the cases of others.

The sections of SPEC.md stand here from the ground up.  A case relies on everything below its own
section, so that of several failures the lowest is the likeliest cause, and the others may follow.
A clause that two cases of its own find broken stands before those that one case happens to touch,
if that is none of the clauses that stand here themselves.
A case that asks many clauses at once fails with each of them, and stands after the others.
A finding that many failures share says more about the cause than any of their clauses.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Final, NamedTuple

from .verdict import FAIL, MEANINGS, CaseResult

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
    "HG-5.7/7",  # of HELLO_REPLY too
    "HG-6.1/1",  # the state after a reset
    "HG-4",
    "HG-6.9",
    "HG-4.11",
    "HG-7.5",
    "HG-5.1",
    "HG-7.1",
    "HG-5.2",
    "HG-5.3",
    "HG-8.6",
    "HG-8.3/2",  # CRC-32 by which a trace names a drive
    "HG-5.4",
    "HG-6.2",
    "HG-6.6",
    "HG-6.4",
    "HG-6.5",
    "HG-6.3",
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


#: Variants of cases that ask many clauses at once: rules over every frame, all that an event, an
#: end or the same settings again must leave, every reason of a drop, random dialogues.
BROAD: Final = frozenset({"always", "alone", "moments", "same", "dialogues"})

_RELIED_ON: Final = "HG-4.3/"  # capabilities and limits, which every case reckons with
_ENOUGH: Final = 2  # cases of one clause that do not fail by chance together
_LEAST_ALIKE: Final = 3
_LEAST_SHARE: Final = 1 / 3
_MOST_SHARE: Final = 1 / 2  # least share of the failures that a likely cause explains
_LEAST_WORDS: Final = 3  # least words of a part of a finding that is compared
_CONTEXT: Final = re.compile(
    r"; sent (?:before|between): .*?(?= \((?:meanwhile|in its)|$)|[,;] due (?:is|are) [^,;:(]*"
)
_NUMBERS: Final = re.compile(r"0x[0-9a-f]+|-?\d+(?:\.\d+)?")


class CommonFinding(NamedTuple):
    """A finding that many failures share, up to the numbers in it."""

    #: One of the findings, in its own words.
    text: str
    #: Ids of the cases that find it, the likeliest cause first.
    cases: tuple[str, ...]


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
    failures = [result for result in results if result.is_failure]
    directed = Counter(result.clause for result in failures if not _is_broad(result))

    def place(result: CaseResult) -> tuple[bool, bool, bool, int]:
        stands = result.clause in FOUNDATIONS or result.clause.startswith(_RELIED_ON)
        is_alone = directed[result.clause] < _ENOUGH and not stands
        is_left = not _is_found(result)  # the board was not clean after it
        return is_left, _is_broad(result), is_alone, cause_rank(result.clause)

    failures.sort(key=place)
    failed = [result for result in failures if _is_found(result)]
    alike = common_finding(failed)
    if alike is not None and len(alike.cases) >= _MOST_SHARE * len(failed):
        found = [result for result in failed if result.case in alike.cases]
        plainest = min(found, key=lambda result: (_is_broad(result), len(result.detail)))
        failures.sort(key=lambda result: result is not plainest)
    return failures


def _is_found(result: CaseResult) -> bool:
    """Return True if the case itself FAILED; not if only the recovery after it did."""
    return MEANINGS[result.behaviour].exit_status == FAIL


def _is_broad(result: CaseResult) -> bool:
    """Return True if the case is named in BROAD: those that many different faults make fail."""
    return result.case.removeprefix(result.clause).removeprefix("-") in BROAD


def common_finding(failures: Sequence[CaseResult]) -> CommonFinding | None:
    """Return the finding that many failures share, or None if they have too little in common.

    Parameters
    ----------
    failures : sequence of CaseResult
        As :func:`failures_by_cause` returns them.
    """
    failures = [result for result in failures if _is_found(result)]
    parts = [_parts(result.detail) for result in failures]
    times = Counter(part for found in parts for part in found)
    if not times:
        return None
    shared, count = max(times.items(), key=lambda item: (item[1], len(item[0]), item[0]))
    if count < max(_LEAST_ALIKE, _LEAST_SHARE * len(failures)):
        return None
    alike = [result for result, found in zip(failures, parts, strict=True) if shared in found]
    plainest = min(alike, key=lambda result: len(result.detail))
    return CommonFinding(plainest.detail, tuple(result.case for result in alike))


def _parts(finding: str) -> set[str]:
    """Return a finding and its parts between commas and colons, each number replaced by "#".

    Those of fewer than 3 words are left out.
    """
    whole = _NUMBERS.sub("#", _CONTEXT.sub("", finding))
    parts = re.split("[,;:] ", whole)
    return {part for part in (whole, *parts) if len(part.split()) >= _LEAST_WORDS}
