"""The cases of the conformance suite as JUnit cases, by the table of its verdicts."""

from __future__ import annotations

from haptogram.conformance.verdict import MEANINGS, CaseResult

from ..formats.junit import JUnit, JUnitCase
from .wording import case_finding


def conformance_junit_case(result: CaseResult) -> JUnitCase:
    """Return a case; its time is that of the port's clock."""
    message = case_finding(result)
    return JUnitCase(
        group=result.clause.partition(".")[0],
        name=f"{result.case} {result.summary}",
        outcome=_conformance_junit_outcome(result),
        message=message,
        kind=result.behaviour.value,
        text="\n".join([message, f"requirement: {result.requirement}", *result.transcript]),
        log=result.traceback,
        seconds=result.seconds,
    )


def _conformance_junit_outcome(result: CaseResult) -> JUnit:
    if result.is_new_failure:
        return JUnit.FAILURE
    if result.is_failure:
        return JUnit.SKIPPED  # the baseline expects it
    element = MEANINGS[result.behaviour].junit
    return JUnit.PASSED if element is None else JUnit(element)
