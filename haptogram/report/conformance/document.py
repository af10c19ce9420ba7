"""A run of the conformance suite as a document, for JUnit XML and job summary."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

from haptogram.conformance.causes import common_finding, failures_by_cause
from haptogram.conformance.verdict import Behaviour, CaseResult, SuiteResult

from ..formats.document import Document, Finding, Level, Section, Table
from .junit import conformance_junit_case
from .matrix import conformance_chapters_of_cases
from .wording import (
    case_finding,
    common_finding_line,
    ordered_behaviours,
    suite_board,
    suite_counts,
    suite_verdict,
)


def suite_document(suite: SuiteResult) -> Document:
    """Return *suite* as a document: failures by cause, then the cases that were not judged."""
    failures = failures_by_cause(suite.results)
    alike = common_finding(failures)
    known = {**suite.device, **suite.settings, "cut_short": suite.cut_short}
    return Document(
        command="conform",
        heading=f"{suite_verdict(suite)}: {suite_counts(suite)}",
        findings=list(_case_findings(suite)),
        lead=[
            f"board {suite_board(suite)}",
            *([common_finding_line(alike, len(failures))] if alike else []),
            *([f"drive pins: {captured}"] if (captured := suite.settings.get("captured")) else []),
            *([f"cut short: {suite.cut_short}"] if suite.cut_short else []),
        ],
        sections=[Section("Chapters of SPEC.md", [_chapter_table(suite)])],
        cases=list(map(conformance_junit_case, suite.results)),
        properties={name: str(value) for name, value in known.items()},
        seconds=sum(result.seconds or 0.0 for result in suite.results),
    )


def _case_findings(suite: SuiteResult) -> Iterator[Finding]:
    for result in failures_by_cause(suite.results):
        level = Level.ERROR if result.is_new_failure else Level.WARNING
        yield Finding(level, result.case, f"{case_finding(result)}: {result.requirement}")
    # A board that is gone leaves many cases with one reason.
    reasons: dict[str, list[CaseResult]] = {}
    for result in suite.results:
        if result.behaviour is Behaviour.INCONCLUSIVE and not result.is_failure:
            reasons.setdefault(result.detail, []).append(result)
    for reason, cases in reasons.items():
        name = cases[0].case if len(cases) == 1 else f"{len(cases)} cases"
        yield Finding(Level.ERROR, name, f"{Behaviour.INCONCLUSIVE}: {reason}")


def _chapter_table(suite: SuiteResult) -> Table:
    shown = ordered_behaviours(result.behaviour for result in suite.results)
    rows = []
    for chapter, results in conformance_chapters_of_cases(suite.results).items():
        counts = Counter(result.behaviour for result in results)
        rows.append([chapter, *(str(counts[behaviour] or "") for behaviour in shown)])
    return Table(["", *map(str, shown)], rows)
