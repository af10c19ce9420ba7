"""The cases of a run by the chapters of SPEC.md, and by the messages that they are about."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Final

from haptogram.conformance.clauses import Clause, load_clauses, read_spec_of_clauses
from haptogram.conformance.verdict import CaseResult
from haptogram_protocol.messages import MessageType

_CHAPTER: Final = re.compile(r"^## (\d+) (.+)$", re.MULTILINE)
_MESSAGE: Final = re.compile(
    rf"\b({'|'.join(sorted((t.name for t in MessageType), key=len)[::-1])})\b"
)


def conformance_chapter_titles() -> dict[str, str]:
    """Return number and title of each chapter of SPEC.md, in order."""
    return {
        number: f"{number} {title}" for number, title in _CHAPTER.findall(read_spec_of_clauses())
    }


def conformance_chapters_of_cases(results: Iterable[CaseResult]) -> dict[str, list[CaseResult]]:
    """Return the cases by the title of their chapter, in the order of SPEC.md."""
    titles = conformance_chapter_titles()
    found: dict[str, list[CaseResult]] = {title: [] for title in titles.values()}
    for result in results:
        found[titles[_conformance_chapter_of_clause(result.clause)]].append(result)
    return {title: cases for title, cases in found.items() if cases}


def conformance_messages_of_cases(results: Iterable[CaseResult]) -> dict[str, list[CaseResult]]:
    """Return the cases by the messages that their clause or their experiment names."""
    found: dict[str, list[CaseResult]] = {kind.name: [] for kind in MessageType}
    for result in results:
        names = _MESSAGE.findall(f"{result.requirement} {result.summary}")
        for name in dict.fromkeys(names):
            found[name].append(result)
    return {name: cases for name, cases in found.items() if cases}


def conformance_chapters_of_clauses() -> dict[str, list[Clause]]:
    """Return the clauses by the title of their chapter, in the order of SPEC.md."""
    found: dict[str, list[Clause]] = {}
    titles = conformance_chapter_titles()
    for clause in load_clauses().values():
        found.setdefault(titles[_conformance_chapter_of_clause(clause.number)], []).append(clause)
    return found


def _conformance_chapter_of_clause(clause: str) -> str:
    return clause.removeprefix("HG-").partition(".")[0]
