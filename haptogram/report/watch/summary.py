"""A watched board for the page of a CI job."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from haptogram.verification import FrameStatus, FrameVerdict
from haptogram.verification.frame.verdict import WRONG
from haptogram.verification.watch import WatchResult

from ..formats.job_summary import Finding, JobSummary, Level


def watch_summary(result: WatchResult, verdicts: Sequence[FrameVerdict]) -> JobSummary:
    """Return the summary of *result*.

    Parameters
    ----------
    verdicts : sequence of FrameVerdict
        Of the latches of which a frame was expected.
    """
    sentence, *lines = result.lines()
    return JobSummary(
        "watch", sentence, list(_watch_findings(result, verdicts)), [line.strip() for line in lines]
    )


def _watch_findings(result: WatchResult, verdicts: Sequence[FrameVerdict]) -> Iterator[Finding]:
    for diagnosis in result.diagnoses:
        yield Finding(Level.ERROR, str(diagnosis.defect), str(diagnosis))
    for verdict in verdicts:
        if verdict.status in WRONG:
            yield Finding(Level.ERROR, f"latch {verdict.number}", str(verdict))
    for verdict in verdicts:
        if verdict.status not in WRONG and verdict.status is not FrameStatus.ON_TARGET:
            yield Finding(Level.ERROR, f"latch {verdict.number}", str(verdict))
    if result.missing:
        yield Finding(Level.ERROR, "missing", result.missing)
