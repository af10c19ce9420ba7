"""A watched board as a JUnit suite: a case for each verdict, and one for each kind of defect."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from haptogram.machine.provenance import UNSTATED, Provenance
from haptogram.verification import FrameStatus, FrameVerdict
from haptogram.verification.frame.verdict import WRONG
from haptogram.verification.watch import Defect, WatchResult

from ..formats.junit import JUnit, JUnitCase, JUnitSuite, write_junit

_SUITE: Final = "haptogram.watch"


def write_watch_junit(
    path: Path,
    result: WatchResult,
    verdicts: Sequence[FrameVerdict],
    *,
    provenance: Provenance = UNSTATED,
    seconds: float | None = None,
) -> None:
    """Write the result as JUnit XML.

    Parameters
    ----------
    verdicts : sequence of FrameVerdict
        Of the latches of which a frame was expected.
    provenance : Provenance, optional
        Origin of the result.
    seconds : float or None
        How long the board was watched: the time of the case that every latch was seen.

    Raises
    ------
    ConfigurationError
        If *path* cannot be written.
    """
    cases = [_watch_junit_frame(verdict) for verdict in verdicts]
    cases += [_watch_junit_defect(result, defect) for defect in Defect]
    cases.append(_watch_junit_seen(result, seconds))
    properties = {"verdict": str(result.verdict), "latches": str(result.latches)}
    properties |= dict(provenance.rows())
    log = "\n".join(result.lines())
    date = provenance.timestamp
    write_junit(path, JUnitSuite(_SUITE, tuple(cases), properties, log, date, seconds))


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
