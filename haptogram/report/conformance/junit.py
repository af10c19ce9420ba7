"""A run of the conformance suite as a JUnit suite, by the table of its verdicts."""

from __future__ import annotations

from pathlib import Path

from haptogram.conformance.verdict import MEANINGS, CaseResult, SuiteResult

from ..junit import JUnit, JUnitCase, JUnitSuite, write_junit


def write_conformance_junit(path: Path, suite: SuiteResult) -> None:
    """Write a run as JUnit XML.

    Raises
    ------
    ConfigurationError
        If *path* cannot be written.
    """
    known = {**suite.device, **suite.settings, "cut_short": suite.cut_short}
    properties = {name: str(value) for name, value in known.items()}
    cases = tuple(map(_case, suite.results))
    write_junit(path, JUnitSuite("haptogram.conformance", cases, properties))


def _case(result: CaseResult) -> JUnitCase:
    message = f"{result.behaviour} [{result.evidence.upper()}] {result.detail}".strip()
    if not result.recovers:
        message += f"; recovery {result.recovery}"
    if result.expected is not None:
        message += f" (baseline: {result.expected})"
    return JUnitCase(
        group=result.clause.partition(".")[0],
        name=f"{result.case} {result.summary}",
        outcome=_outcome(result),
        message=message,
        kind=result.behaviour.value,
        text="\n".join([message, f"requirement: {result.requirement}", *result.transcript]),
        log=result.traceback,
    )


def _outcome(result: CaseResult) -> JUnit:
    if result.is_new_failure:
        return JUnit.FAILURE
    if result.is_failure:
        return JUnit.SKIPPED  # the baseline expects it
    element = MEANINGS[result.behaviour].junit
    return JUnit.PASSED if element is None else JUnit(element)
