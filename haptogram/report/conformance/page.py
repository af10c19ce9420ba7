"""The page of one run of the conformance suite, and that of several devices side by side."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

from haptogram.conformance.causes import common_finding, failures_by_cause
from haptogram.conformance.clauses import load_clauses
from haptogram.conformance.verdict import MEANINGS, Behaviour, CaseResult, SuiteResult
from haptogram.machine.provenance import UNSTATED, Provenance

from ..formats.html import html_setting_rows, write_html_page
from .matrix import (
    conformance_chapters_of_cases,
    conformance_chapters_of_clauses,
    conformance_messages_of_cases,
)
from .transcript import marked_transcript
from .wording import (
    case_counts,
    common_finding_line,
    evidence_text,
    suite_board,
    suite_counts,
    suite_verdict,
)

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
_VERDICT_TONES: Final = {"PASS": "good", "FAIL": "bad", "INCONCLUSIVE": "doubt"}


def write_conformance_page(
    path: Path, suite: SuiteResult, *, provenance: Provenance = UNSTATED
) -> None:
    """Write one run as a page: every case with its requirement, verdict and bytes.

    Raises
    ------
    ConfigurationError
        If the extra ``report`` is not installed, or *path* cannot be written.
    """
    verdict = suite_verdict(suite)
    failures = failures_by_cause(suite.results)
    alike = common_finding(failures)
    cases_of: dict[str, list[CaseResult]] = {number: [] for number in load_clauses()}
    for result in suite.results:
        cases_of[result.clause].append(result)
    write_html_page(
        path,
        "conformance.html",
        provenance,
        title=f"Haptogram: conformance, {verdict.lower()}",
        heading=f"{verdict}: {suite_counts(suite)}",
        tone=_VERDICT_TONES[verdict],
        lead=[
            f"Conformance of {suite_board(suite)}. Exit status {suite.exit_status}.",
            *([f"Cut short: {suite.cut_short}."] if suite.cut_short else []),
            *([common_finding_line(alike, len(failures))] if alike else []),
        ],
        attention=list(_conformance_attention_rows(suite)),
        chapters=conformance_chapters_of_cases(suite.results),
        messages=conformance_messages_of_cases(suite.results),
        meanings=[
            (_TONES[behaviour], behaviour, meaning.text) for behaviour, meaning in MEANINGS.items()
        ],
        counts_of=case_counts,
        spec=conformance_chapters_of_clauses(),
        cases_of=cases_of,
        marked_transcript=marked_transcript,
        evidence_text=evidence_text,
        settings=[*html_setting_rows(suite.device), *html_setting_rows(suite.settings)],
        tone_of=_conformance_case_tone,
    )


def write_conformance_comparison_page(
    path: Path, suites: Sequence[SuiteResult], *, provenance: Provenance = UNSTATED
) -> None:
    """Write several runs side by side: a row for each case, a column for each device.

    Raises
    ------
    ConfigurationError
        If the extra ``report`` is not installed, or *path* cannot be written.
    """
    columns = [{result.case: result for result in suite.results} for suite in suites]
    cases = {result.case: result.summary for suite in suites for result in suite.results}
    names = [suite_board(suite) for suite in suites]
    failed = {result.case for suite in suites for result in suite.results if result.is_failure}
    ordered = sorted(cases, key=lambda case: case not in failed)
    write_html_page(
        path,
        "comparison.html",
        provenance,
        title="Haptogram: conformance of several devices",
        heading="Conformance of several devices",
        tone="plain",
        lead=[f"{len(cases)} cases on {len(suites)} devices. A dash: the case was not run."],
        names=names,
        rows=[
            {"case": case, "what": cases[case], "results": [c.get(case) for c in columns]}
            for case in ordered
        ],
        totals=list(zip(names, map(suite_counts, suites), strict=True)),
        tone_of=_conformance_case_tone,
    )


def _conformance_attention_rows(suite: SuiteResult) -> Iterator[CaseResult]:
    """Yield the failures by cause, then the cases that were not judged."""
    yield from failures_by_cause(suite.results)
    for result in suite.results:
        if result.behaviour is Behaviour.INCONCLUSIVE and not result.is_failure:
            yield result


def _conformance_case_tone(result: CaseResult) -> str:
    return _TONES[result.behaviour] if result.recovers else "bad"
