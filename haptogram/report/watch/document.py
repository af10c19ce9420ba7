"""A watched board as a document, for JUnit XML and job summary."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from haptogram.verification import FrameStatus, FrameVerdict, grouped_frame_findings
from haptogram.verification.frame.verdict import WRONG
from haptogram.verification.watch import WatchResult

from ..formats.document import Document, Finding, Level
from .junit import watch_junit_cases


def watch_document(
    result: WatchResult, verdicts: Sequence[FrameVerdict], seconds: float | None = None
) -> Document:
    """Return *result* as a document.

    Parameters
    ----------
    verdicts : sequence of FrameVerdict
        Of the latches of which a frame was expected.
    seconds : float or None
        How long the board was watched.
    """
    sentence, *lines = result.lines()
    return Document(
        command="watch",
        heading=sentence,
        findings=list(_watch_findings(result, verdicts)),
        lead=[line.strip() for line in lines],
        cases=list(watch_junit_cases(result, verdicts, seconds)),
        properties={"verdict": str(result.verdict), "latches": str(result.latches)},
        seconds=seconds,
    )


def _watch_findings(result: WatchResult, verdicts: Sequence[FrameVerdict]) -> Iterator[Finding]:
    for diagnosis in result.diagnoses:
        yield Finding(Level.ERROR, str(diagnosis.defect), str(diagnosis))
    wrong = [verdict for verdict in verdicts if verdict.status in WRONG]
    passed = {*WRONG, FrameStatus.ON_TARGET}
    unjudged = [verdict for verdict in verdicts if verdict.status not in passed]
    for line, frames in (*grouped_frame_findings(wrong), *grouped_frame_findings(unjudged)):
        name = f"latch {frames[0].number}" if len(frames) == 1 else f"{len(frames)} latches"
        yield Finding(Level.ERROR, name, line)
    if result.missing:
        yield Finding(Level.ERROR, "missing", result.missing)
