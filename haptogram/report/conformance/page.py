"""The page of one run of the conformance suite, and that of several devices side by side."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from haptogram.conformance.verdict import FAIL, MEANINGS, PASS, Behaviour, CaseResult, SuiteResult

from .. import html

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
_ATTENTION: Final = (Behaviour.FAILED, Behaviour.FLAKY, Behaviour.INCONCLUSIVE)


def write_conformance_page(path: Path, suite: SuiteResult) -> None:
    """Write one run as a page: every case with its requirement, verdict and bytes.

    Raises
    ------
    ConfigurationError
        If the extra ``report`` is not installed, or *path* cannot be written.
    """
    outcome, tone = _outcome(suite)
    html.write_html_page(
        path,
        "conformance.html",
        title=f"Haptogram: conformance, {outcome}",
        heading=f"Conformance: {outcome}",
        tone=tone,
        lead=[
            f"{_name(suite)}: {_counts(suite)}.",
            f"Exit status {suite.exit_status}.",
            *([f"Cut short: {suite.cut_short}."] if suite.cut_short else []),
        ],
        attention=[result for result in suite.results if _needs_attention(result)],
        meanings=[
            (_TONES[behaviour], behaviour, meaning.text) for behaviour, meaning in MEANINGS.items()
        ],
        results=suite.results,
        tone_of=_tone,
    )


def write_comparison_page(path: Path, suites: Sequence[SuiteResult]) -> None:
    """Write several runs side by side: a row for each case, a column for each device.

    Raises
    ------
    ConfigurationError
        If the extra ``report`` is not installed, or *path* cannot be written.
    """
    columns = [{result.case: result for result in suite.results} for suite in suites]
    cases = {result.case: result.summary for suite in suites for result in suite.results}
    names = [_name(suite) for suite in suites]
    html.write_html_page(
        path,
        "comparison.html",
        title="Haptogram: conformance of several devices",
        heading="Conformance of several devices",
        tone="plain",
        lead=[f"{len(cases)} cases on {len(suites)} devices. An empty cell: the case was not run."],
        names=names,
        rows=[
            {"case": case, "what": what, "results": [column.get(case) for column in columns]}
            for case, what in cases.items()
        ],
        totals=list(zip(names, map(_counts, suites), strict=True)),
        tone_of=_tone,
    )


def _outcome(suite: SuiteResult) -> tuple[str, str]:
    outcomes = {PASS: ("pass", "good"), FAIL: ("fail", "bad")}
    return outcomes.get(suite.exit_status, ("inconclusive", "doubt"))


def _name(suite: SuiteResult) -> str:
    firmware = str(suite.device.get("firmware", "no board"))
    return f"{firmware} ({suite.settings.get('port', '')})"


def _counts(suite: SuiteResult) -> str:
    return ", ".join(f"{suite.count(b)} {b}" for b in Behaviour if suite.count(b))


def _needs_attention(result: CaseResult) -> bool:
    return result.behaviour in _ATTENTION or not result.recovers


def _tone(result: CaseResult) -> str:
    return _TONES[result.behaviour] if result.recovers else "bad"
