"""A run of the conformance suite as a document, and several devices side by side."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from haptogram.conformance.causes import common_finding, failures_by_cause
from haptogram.conformance.clauses import load_clauses
from haptogram.conformance.verdict import MEANINGS, Behaviour, CaseResult, SuiteResult

from ..formats.document import TONES, Check, Document, Finding, Level, Outcome, Section, Table
from ..formats.html import html_setting_rows
from . import wording
from .text import marked_transcript

_TONES: Final = {
    Behaviour.OK: "good",
    Behaviour.NON_STRICT: "doubt",
    Behaviour.INFORMATIONAL: "note",
    Behaviour.UNIMPLEMENTED: "plain",
    Behaviour.NOT_OBSERVED: "plain",
    Behaviour.INCONCLUSIVE: "doubt",
    Behaviour.FLAKY: "bad",
    Behaviour.FAILED: "bad",
}
#: Outcomes by the elements of JUnit in the table of the verdicts.
_OUTCOMES: Final = {
    None: Outcome.PASSED,
    "failure": Outcome.FAILED,
    "error": Outcome.INCONCLUSIVE,
    "skipped": Outcome.NOT_JUDGED,
}


def suite_document(suite: SuiteResult) -> Document:
    """Return *suite* as a document: failures by cause, then the cases that were not judged.

    Its page holds every case with its requirement, verdict and bytes.
    """
    verdict, failures = wording.suite_verdict(suite), failures_by_cause(suite.results)
    alike = common_finding(failures)
    known = {**suite.device, **suite.settings, "cut_short": suite.cut_short}
    return Document(
        command="conform",
        heading=f"{verdict}: {wording.suite_counts(suite)}",
        title=f"conformance, {verdict.lower()}",
        tone=TONES[verdict.lower()],
        findings=list(_case_findings(suite)),
        lead=[
            f"board {wording.suite_board(suite)}; exit status {suite.exit_status}",
            *([wording.common_finding_line(alike, len(failures))] if alike else []),
            *([f"drive pins: {captured}"] if (captured := suite.settings.get("captured")) else []),
            *([f"cut short: {suite.cut_short}"] if suite.cut_short else []),
        ],
        sections=[Section("Chapters of SPEC.md", [_chapter_table(suite)])],
        checks=list(map(_case_check, suite.results)),
        properties={name: str(value) for name, value in known.items()},
        seconds=sum(result.seconds or 0.0 for result in suite.results),
        template="conformance.html",
        content=lambda: _suite_page_content(suite),
    )


def _suite_page_content(suite: SuiteResult) -> dict[str, Any]:
    """Return what a suite's HTML page shows and its other forms do not: all cases, settings."""
    cases_of: dict[str, list[CaseResult]] = {number: [] for number in load_clauses()}
    for result in suite.results:
        cases_of[result.clause].append(result)
    return {
        "attention": [*failures_by_cause(suite.results), *_cases_not_judged(suite)],
        "chapters": wording.conformance_chapters_of_cases(suite.results),
        "messages": wording.conformance_messages_of_cases(suite.results),
        "meanings": [(_TONES[kind], kind, meaning.text) for kind, meaning in MEANINGS.items()],
        "counts_of": wording.case_counts,
        "spec": wording.conformance_chapters_of_clauses(),
        "cases_of": cases_of,
        "marked_transcript": marked_transcript,
        "evidence_text": wording.evidence_text,
        "settings": [*html_setting_rows(suite.device), *html_setting_rows(suite.settings)],
        "tone_of": _case_tone,
    }


def suite_comparison_document(suites: Sequence[SuiteResult]) -> Document:
    """Return several runs side by side: a row for each case, a column for each device."""
    columns = [{result.case: result for result in suite.results} for suite in suites]
    cases = {result.case: result.summary for suite in suites for result in suite.results}
    names = [wording.suite_board(suite) for suite in suites]
    failed = {result.case for suite in suites for result in suite.results if result.is_failure}
    content: Mapping[str, Any] = {
        "names": names,
        "rows": [
            {"case": case, "what": cases[case], "results": [c.get(case) for c in columns]}
            for case in sorted(cases, key=lambda case: case not in failed)
        ],
        "totals": list(zip(names, map(wording.suite_counts, suites), strict=True)),
        "tone_of": _case_tone,
    }
    return Document(
        command="conform",
        heading="Conformance of several devices",
        title="conformance of several devices",
        lead=[f"{len(cases)} cases on {len(suites)} devices. A dash: the case was not run"],
        template="comparison.html",
        content=lambda: content,
    )


def _case_tone(result: CaseResult) -> str:
    """Return the colour of a case: by its behaviour, bad if the board did not recover."""
    return _TONES[result.behaviour] if result.recovers else "bad"


def _case_findings(suite: SuiteResult) -> Iterator[Finding]:
    """Yield each cause with its failures, then each reason why cases were not judged."""
    for result in failures_by_cause(suite.results):
        level = Level.ERROR if result.is_new_failure else Level.WARNING
        yield Finding(level, result.case, f"{wording.case_finding(result)}: {result.requirement}")
    # A board that is gone leaves many cases with one reason.
    reasons: dict[str, list[CaseResult]] = {}
    for result in _cases_not_judged(suite):
        reasons.setdefault(result.detail, []).append(result)
    for reason, cases in reasons.items():
        name = cases[0].case if len(cases) == 1 else f"{len(cases)} cases"
        yield Finding(Level.ERROR, name, f"{Behaviour.INCONCLUSIVE}: {reason}")


def _cases_not_judged(suite: SuiteResult) -> list[CaseResult]:
    """Return the inconclusive cases, except those that count as failures."""
    found = (result for result in suite.results if result.behaviour is Behaviour.INCONCLUSIVE)
    return [result for result in found if not result.is_failure]


def _case_check(result: CaseResult) -> Check:
    """Return a case as a check; a failure that the baseline expects is not judged.

    The check is in the group of its chapter, such as HG-5.
    """
    outcome = _OUTCOMES[MEANINGS[result.behaviour].junit]
    if result.is_failure:  # one that the baseline expects is none
        outcome = Outcome.FAILED if result.is_new_failure else Outcome.NOT_JUDGED
    return Check(
        group=result.clause.partition(".")[0],
        name=f"{result.case} {result.summary}",
        outcome=outcome,
        message=wording.case_finding(result),
        details=[f"requirement: {result.requirement}", *result.transcript],
        kind=result.behaviour.value,
        log=result.traceback,
        seconds=result.seconds,
    )


def _chapter_table(suite: SuiteResult) -> Table:
    """Return a table of the number of cases in each chapter, a column for each behaviour."""
    shown = wording.ordered_behaviours(result.behaviour for result in suite.results)
    rows = []
    for chapter, results in wording.conformance_chapters_of_cases(suite.results).items():
        counts = Counter(result.behaviour for result in results)
        rows.append([chapter, *(str(counts[behaviour] or "") for behaviour in shown)])
    return Table(["", *map(str, shown)], rows)
