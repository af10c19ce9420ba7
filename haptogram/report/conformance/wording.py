"""A run of the conformance suite in words, and its cases by chapter and message."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Final

from haptogram.conformance import verdict
from haptogram.conformance.causes import CommonFinding
from haptogram.conformance.clauses import Clause, load_clauses, read_spec_of_clauses
from haptogram.records.frame import Evidence
from haptogram_protocol.messages import MessageType

_EVIDENCE: Final = {
    Evidence.WIRE: "seen in the bytes and times on the line",
    Evidence.SELF_REPORTED: "the board's own word: counters, read-back, traces",
    Evidence.EXTERNAL: "seen from outside: back door, drive pins",
    Evidence.SIMULATED: "seen at the pins of firmware in a simulator",
}


def evidence_text(evidence: Evidence) -> str:
    """Return an evidence class and what it means."""
    return f"{evidence.upper()}: {_EVIDENCE[evidence]}"


def suite_verdict(suite: verdict.SuiteResult) -> str:
    """Return PASS, FAIL or INCONCLUSIVE."""
    return {verdict.PASS: "PASS", verdict.FAIL: "FAIL"}.get(suite.exit_status, "INCONCLUSIVE")


def suite_counts(suite: verdict.SuiteResult) -> str:
    """Return the number of cases, and of those with each verdict, what decides first."""
    return case_counts(suite.results)


def case_counts(results: Sequence[verdict.CaseResult]) -> str:
    """Return the number of *results*, and of those with each verdict, what decides first."""
    found = Counter(result.behaviour for result in results)
    counts = ", ".join(f"{found[behaviour]} {behaviour}" for behaviour in ordered_behaviours(found))
    return f"{len(results)} case{'s' * (len(results) != 1)}: {counts}"


def ordered_behaviours(found: Iterable[verdict.Behaviour]) -> list[verdict.Behaviour]:
    """Return the verdicts: failures first, then those that were not judged."""
    first = (verdict.FAIL, verdict.INCONCLUSIVE_STATUS, verdict.PASS)
    kinds = [behaviour for behaviour in verdict.Behaviour if behaviour in set(found)]
    return sorted(kinds, key=lambda behaviour: first.index(verdict.MEANINGS[behaviour].exit_status))


def suite_board(suite: verdict.SuiteResult) -> str:
    """Return the firmware of the board and its port."""
    firmware = str(suite.device.get("firmware", "no board"))
    return f"{firmware} ({suite.settings.get('port', '')})"


def case_finding(result: verdict.CaseResult) -> str:
    """Return verdict, evidence, reason and recovery of a case, in a line."""
    text = f"{result.behaviour} [{result.evidence.upper()}] {result.detail}".strip()
    if not result.recovers:
        text += f"; recovery {result.recovery}"
    if result.expected is not None:
        text += f" (baseline: {result.expected})"
    return text


def common_finding_line(alike: CommonFinding, failures: int) -> str:
    """Return the finding that many failures share, and how many do, in a line."""
    return f"{len(alike.cases)} of {failures} failures find much the same: {alike.text}"


_CHAPTER: Final = re.compile(r"^## (\d+) (.+)$", re.MULTILINE)
_MESSAGE: Final = re.compile(
    rf"\b({'|'.join(sorted((t.name for t in MessageType), key=len)[::-1])})\b"
)


def conformance_chapter_titles() -> dict[str, str]:
    """Return number and title of each chapter of SPEC.md, in order."""
    return {
        number: f"{number} {title}" for number, title in _CHAPTER.findall(read_spec_of_clauses())
    }


def conformance_chapters_of_cases(
    results: Iterable[verdict.CaseResult],
) -> dict[str, list[verdict.CaseResult]]:
    """Return the cases by the title of their chapter, in the order of SPEC.md."""
    titles = conformance_chapter_titles()
    found: dict[str, list[verdict.CaseResult]] = {title: [] for title in titles.values()}
    for result in results:
        found[titles[_conformance_chapter_of_clause(result.clause)]].append(result)
    return {title: cases for title, cases in found.items() if cases}


def conformance_messages_of_cases(
    results: Iterable[verdict.CaseResult],
) -> dict[str, list[verdict.CaseResult]]:
    """Return the cases by the messages that their clause or their experiment names."""
    found: dict[str, list[verdict.CaseResult]] = {kind.name: [] for kind in MessageType}
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
    """Return the chapter of a clause: HG-5 of HG-5.8/1."""
    return clause.removeprefix("HG-").partition(".")[0]
