"""A run of the conformance suite in words, for all reports alike."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Final

from haptogram.conformance.causes import CommonFinding
from haptogram.conformance.verdict import (
    FAIL,
    INCONCLUSIVE_STATUS,
    MEANINGS,
    PASS,
    Behaviour,
    CaseResult,
    SuiteResult,
)
from haptogram.records.frame import Evidence

_EVIDENCE: Final = {
    Evidence.WIRE: "seen in the bytes and times on the line",
    Evidence.SELF_REPORTED: "the board's own word: counters, read-back, traces",
    Evidence.EXTERNAL: "seen from outside: back door, drive pins",
    Evidence.SIMULATED: "seen at the pins of firmware in a simulator",
}


def evidence_text(evidence: Evidence) -> str:
    """Return an evidence class and what it means."""
    return f"{evidence.upper()}: {_EVIDENCE[evidence]}"


def suite_verdict(suite: SuiteResult) -> str:
    """Return PASS, FAIL or INCONCLUSIVE."""
    return {PASS: "PASS", FAIL: "FAIL"}.get(suite.exit_status, "INCONCLUSIVE")


def suite_counts(suite: SuiteResult) -> str:
    """Return the number of cases, and of those with each verdict, what decides first."""
    return case_counts(suite.results)


def case_counts(results: Sequence[CaseResult]) -> str:
    """Return the number of *results*, and of those with each verdict, what decides first."""
    found = Counter(result.behaviour for result in results)
    counts = ", ".join(f"{found[behaviour]} {behaviour}" for behaviour in ordered_behaviours(found))
    return f"{len(results)} case{'s' * (len(results) != 1)}: {counts}"


def ordered_behaviours(found: Iterable[Behaviour]) -> list[Behaviour]:
    """Return the verdicts: failures first, then those that were not judged."""
    first = (FAIL, INCONCLUSIVE_STATUS, PASS)
    kinds = [behaviour for behaviour in Behaviour if behaviour in set(found)]
    return sorted(kinds, key=lambda behaviour: first.index(MEANINGS[behaviour].exit_status))


def suite_board(suite: SuiteResult) -> str:
    """Return the firmware of the board and its port."""
    firmware = str(suite.device.get("firmware", "no board"))
    return f"{firmware} ({suite.settings.get('port', '')})"


def case_finding(result: CaseResult) -> str:
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
