"""A run of the conformance suite as a JUnit suite, by the table of its verdicts."""

from __future__ import annotations

from pathlib import Path

from haptogram.conformance.verdict import MEANINGS, CaseResult, SuiteResult
from haptogram.machine.provenance import UNSTATED, Provenance

from ..formats.junit import JUnit, JUnitCase, JUnitSuite, write_junit
from .wording import case_finding


def write_conformance_junit(
    path: Path, suite: SuiteResult, *, provenance: Provenance = UNSTATED
) -> None:
    """Write a run as JUnit XML; times are those of the port's clock.

    Raises
    ------
    ConfigurationError
        If *path* cannot be written.
    """
    known = {**suite.device, **suite.settings, "cut_short": suite.cut_short}
    properties = {name: str(value) for name, value in known.items()} | dict(provenance.rows())
    cases = tuple(map(_conformance_junit_case, suite.results))
    date, seconds = provenance.timestamp, sum(result.seconds or 0.0 for result in suite.results)
    write_junit(
        path,
        JUnitSuite("haptogram.conformance", cases, properties, timestamp=date, seconds=seconds),
    )


def _conformance_junit_case(result: CaseResult) -> JUnitCase:
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
