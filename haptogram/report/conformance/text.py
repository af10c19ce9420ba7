"""One run of the conformance suite as text for a terminal."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Final

from haptogram.conformance.causes import CommonFinding, common_finding, failures_by_cause
from haptogram.conformance.verdict import FAIL, MEANINGS, Behaviour, CaseResult, SuiteResult

from .transcript import folded_transcript
from .wording import case_finding, common_finding_line, evidence_text, suite_counts, suite_verdict

_LEFT_OUT: Final = "takes longer than this depth"  # begin of the reason of such cases
_CAUSES: Final = 3  # failures with their bytes; the others may follow from these
_IN_FULL = (Behaviour.FAILED, Behaviour.FLAKY, Behaviour.INCONCLUSIVE, Behaviour.NON_STRICT)
_FAILURES: Final = 12  # that are named in the line of all of them
_NAMED: Final = 3  # cases that are named where they have a reason in common
_NEXT_FRAME: Final = "\n" + 17 * " "  # of a dialogue
_LONG_HEX: Final = re.compile(r"\b([0-9a-f]{64})[0-9a-f]{9,}")
_CUT_HEX: Final = r"\1 ..."


def suite_text(suite: SuiteResult, *, verbose: bool = False) -> str:
    """Return a summary of the run, and in full every case that needs a look.

    Parameters
    ----------
    verbose : bool
        Print every case in full.
    """
    return "\n".join(_conformance_suite_lines(suite, verbose=verbose))


def _conformance_suite_lines(suite: SuiteResult, *, verbose: bool) -> Iterator[str]:
    common = _common_conformance_reasons(suite)
    failures = failures_by_cause(suite.results)
    alike = common_finding(failures)
    for result in suite.results:
        if result.is_failure or (not verbose and (result.behaviour, result.detail) in common):
            continue  # below, by cause; or named once, in the summary
        if verbose or (result.behaviour in _IN_FULL and not failures):
            yield from _conformance_case_lines(result)
        elif result.behaviour in _IN_FULL:  # a failure may be the reason
            yield f"{result.case}  {case_finding(result)}"
        elif result.is_unexpected_pass:
            yield f"{result.case}  {result.behaviour}: {result.expected} was expected"
    for number, result in enumerate(failures):
        if verbose or number < _CAUSES or not result.is_new_failure:
            yield from _conformance_case_lines(result)
        elif MEANINGS[result.behaviour].exit_status == FAIL and (
            alike is None or result.case not in alike.cases
        ):
            yield f"{result.case}  {case_finding(result)}"
    yield from () if verbose else _conformance_unclean_lines(failures[_CAUSES:])
    yield from _conformance_summary_line(suite)
    yield from _conformance_failure_lines(failures, alike)
    unseen = suite.unseen_without_reset
    more = f"; --reset-cmd would add {', '.join(unseen)}" if unseen else ""
    yield f"verdict      {suite_verdict(suite)} (exit status {suite.exit_status}){more}"


def _conformance_failure_lines(
    failures: Sequence[CaseResult], alike: CommonFinding | None
) -> Iterator[str]:
    """Yield the failures by cause, and what they have in common; next to the verdict."""
    if len(failures) > 1:
        first = ", ".join(result.case for result in failures[:_FAILURES])
        more = len(failures) - _FAILURES
        rest = f", and {more} more, in --json and --html" if more > 0 else ""
        yield f"failures     the likeliest cause first: {first}{rest}"
    if alike is not None:
        yield f"in common    {common_finding_line(alike, len(failures))}"


def _conformance_unclean_lines(failures: Sequence[CaseResult]) -> Iterator[str]:
    """Yield what was found behind cases that did not fail, with those cases."""
    found: dict[str, list[str]] = {}
    for result in failures:
        if MEANINGS[result.behaviour].exit_status != FAIL:
            found.setdefault(str(result.recovery), []).append(result.case)
    for text, cases in found.items():
        named = ", ".join(cases) if len(cases) <= _NAMED else f"{len(cases)} cases"
        yield f"{named}  not failed; recovery {text}"


def _conformance_case_lines(result: CaseResult) -> Iterator[str]:
    known = f" (expected: {result.expected})" if result.expected and result.is_failure else ""
    yield f"{result.case}  {result.behaviour} [{evidence_text(result.evidence)}]{known}"
    yield f"    requirement  {result.requirement}"
    yield f"    case         {result.summary}"
    if result.detail:
        first, *others = result.detail.split(" || ")  # differences in dialogues
        yield f"    found        {_LONG_HEX.sub(_CUT_HEX, first.replace(' | ', _NEXT_FRAME))}"
        yield from (f"    also         {other.partition('; dialogue ')[0]}" for other in others)
    if result.recovery is not None and not result.recovery.clean:
        yield f"    recovery     {result.recovery}"
    yield from (f"    {line}" for line in folded_transcript(result))


def _common_conformance_reasons(suite: SuiteResult) -> set[tuple[Behaviour, str]]:
    """Return the reasons for which more than a few cases were inconclusive, such as no board."""
    reasons = Counter(
        (result.behaviour, result.detail)
        for result in suite.results
        if result.behaviour is Behaviour.INCONCLUSIVE
    )
    return {reason for reason, count in reasons.items() if count > _NAMED}


def _conformance_cases_by_reason(
    suite: SuiteResult, behaviour: Behaviour
) -> Iterator[tuple[str, str]]:
    """Yield the cases with *behaviour*, those with the same reason together, and the reason."""
    reasons: dict[str, list[str]] = {}
    for result in suite.results:
        if result.behaviour is behaviour:
            reasons.setdefault(result.detail, []).append(result.case)
    for reason, cases in reasons.items():
        yield ", ".join(cases) if len(cases) <= _NAMED else f"{len(cases)} cases", reason


def _conformance_summary_line(suite: SuiteResult) -> Iterator[str]:
    device = suite.device
    if device:
        yield (
            f"board        {device['firmware']}, protocol {device['protocol']}, "
            f"{device['transducers']} transducers"
        )
    time = "virtual time" if suite.settings.get("virtual_time") else "wall time"
    yield f"port         {suite.settings.get('port')} ({time}, seed {suite.settings.get('seed')})"
    if depth := suite.settings.get("depth"):
        left = sum(r.detail.startswith(_LEFT_OUT) for r in suite.results)
        cases = "1 case is" if left == 1 else f"{left} cases are"
        yield f"depth        {depth}" + (f"; {cases} left out" if left else "")
    measured, stated = (suite.settings.get(n) for n in ("measured_baudrate", "baudrate"))
    if measured != stated:
        yield f"line         {measured} Bd as measured, {stated} Bd as stated"
    if captured := suite.settings.get("captured"):
        yield f"captured     {captured}"
    yield f"cases        {suite_counts(suite)}"
    # With the reasons: a number alone would look like a gap.
    for which, reason in _conformance_cases_by_reason(suite, Behaviour.NOT_OBSERVED):
        yield f"not observed {which}: {reason}"
    common = {reason for _, reason in _common_conformance_reasons(suite)}
    for which, reason in _conformance_cases_by_reason(suite, Behaviour.INCONCLUSIVE):
        if reason in common:
            yield f"inconclusive {which}: {reason}"
    unclean = sum(not result.recovers for result in suite.results)
    if unclean:
        yield f"recovery     not clean after {unclean} cases"
    known = sum(result.is_failure and not result.is_new_failure for result in suite.results)
    if known:
        yield f"baseline     {known} failures were expected"
    if broken := [result.case for result in suite.results if result.traceback]:
        named = ", ".join(broken) if len(broken) <= _NAMED else f"{len(broken)} cases"
        yield f"case errors  {named}: not the board; tracebacks are in --json, --junit and --html"
    if suite.cut_short:
        yield f"cut short    {suite.cut_short}"
