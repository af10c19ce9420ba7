"""A watched board as JUnit cases: one for each verdict, and one for each kind of defect."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from haptogram.verification import FrameStatus, FrameVerdict
from haptogram.verification.frame.verdict import WRONG
from haptogram.verification.watch import Defect, WatchResult

from ..formats.junit import JUnit, JUnitCase


def watch_junit_cases(
    result: WatchResult, verdicts: Sequence[FrameVerdict], seconds: float | None
) -> Iterator[JUnitCase]:
    """Yield the cases; *seconds* is the time of the case that every latch was seen."""
    yield from map(_watch_junit_frame, verdicts)
    yield from (_watch_junit_defect(result, defect) for defect in Defect)
    yield _watch_junit_seen(result, seconds)


def _watch_junit_frame(verdict: FrameVerdict) -> JUnitCase:
    outcome = JUnit.PASSED
    if verdict.status in WRONG:
        outcome = JUnit.FAILURE
    elif verdict.status is not FrameStatus.ON_TARGET:
        outcome = JUnit.ERROR
    name = f"latch {verdict.number} is where it was expected"
    return JUnitCase("expected", name, outcome, str(verdict.status), "expected", str(verdict))


def _watch_junit_defect(result: WatchResult, defect: Defect) -> JUnitCase:
    found = [str(diagnosis) for diagnosis in result.diagnoses if diagnosis.defect is defect]
    outcome = JUnit.FAILURE if found else JUnit.PASSED
    message = found[0] if found else "not found"
    return JUnitCase("defects", f"no {defect}", outcome, message, "defect", "\n".join(found))


def _watch_junit_seen(result: WatchResult, seconds: float | None) -> JUnitCase:
    count = sum(result.kinds.values())
    missing = result.missing or ("" if count else "no latch of a client was seen")
    outcome = JUnit.ERROR if missing else JUnit.PASSED
    message = missing or f"{count} latches"
    name = "every latch was seen"
    return JUnitCase("seen", name, outcome, message, "seen", message, seconds=seconds)
