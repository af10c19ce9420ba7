"""The checks of a run, one for each way in which a run can fail."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, TypeVar

from haptogram.records.frame import FrameKey
from haptogram.verification import (
    LOST_BY_BOARD,
    FrameStatus,
    FrameVerdict,
    RunVerdict,
    Verdict,
    cut_run_verdict_text,
)

from .check import CheckOutcome, RunCheck
from .pins import run_capture_checks
from .wording import run_count_wording, run_frame_wording

COMPLETE: Final = "complete"  # name of the check that the run came to its end
NAMED_FRAMES: Final = 20  # the JSON names all

_Item = TypeVar("_Item")


@dataclass(frozen=True, slots=True)
class _Fault:
    """A fault of a frame, how it shows, and which frames could have shown it.

    Those that another check counts, with a status *besides*, could not.
    """

    name: str
    statement: str
    shows: Callable[[FrameVerdict], bool]
    seen_in: str
    besides: tuple[FrameStatus, ...] = ()


_FAULTS: Final = (
    _Fault(
        "off_target",
        "no drive without a fault has its focus off the target",
        lambda frame: frame.status is FrameStatus.OFF_TARGET,
        "verified",
        (FrameStatus.WRONG_DRIVE, FrameStatus.CORRUPT),
    ),
    _Fault(
        "wrong_drive",
        "no wrong drive is radiated",
        lambda frame: frame.status is FrameStatus.WRONG_DRIVE,
        "verified",
    ),
    _Fault(
        "corrupt",
        "no damaged frame is latched",
        lambda frame: frame.status is FrameStatus.CORRUPT,
        "verified",
    ),
    _Fault("early", "no frame is latched before its time", lambda frame: frame.early, "latched"),
    _Fault(
        "duplicated",
        "no frame is latched more than once",
        lambda frame: frame.latches > 1,
        "latched",
    ),
)


def run_checks_of_result(run: RunVerdict, result: Mapping[str, Any]) -> list[RunCheck]:
    """Return the checks of a run, and those of the captures of its drive pins."""
    own = run_checks(run, result["cut_short"]) if result.get("run_judged", True) else []
    captures = result.get("captures")
    return [*own, *([] if captures is None else run_capture_checks(captures))]


def run_checks(run: RunVerdict, cut_short: str | None = None) -> list[RunCheck]:
    """Return every check with its outcome, in a fixed order.

    A check has failed if and only if the verdict is fail.  If none has failed, a check is
    inconclusive if and only if the verdict is.
    """
    return [
        *(_run_check_of_fault(run, fault) for fault in _FAULTS),
        _check_of_unexpected(run),
        _check_of_lost(run),
        _check_of_held_up(run),
        _check_of_late(run),
        _run_check_of_share_verified(run),
        _check_of_complete_run(run, cut_short),
    ]


def _run_check_of_fault(run: RunVerdict, fault: _Fault) -> RunCheck:
    found = [frame for frame in run.frames if fault.shows(frame)]
    besides = sum(frame.status in fault.besides for frame in run.frames)
    judged = run.counts[fault.seen_in] - besides
    frames = run_count_wording(judged, f"{fault.seen_in} frame")
    if besides:
        frames += f", besides {besides} with a faulty drive"
    if found:
        message = f"{len(found)} of {frames}"
        return RunCheck(
            fault.name,
            fault.statement,
            CheckOutcome.FAILED,
            message,
            _frames_named_in_run_check(found),
        )
    if not judged:
        message = f"no frame was {fault.seen_in}"
        if besides:
            message = f"none of {run_count_wording(besides, 'verified frame')} has a right drive"
        return RunCheck(fault.name, fault.statement, CheckOutcome.NOT_JUDGED, message)
    return RunCheck(fault.name, fault.statement, CheckOutcome.PASSED, f"none of {frames}")


def _check_of_unexpected(run: RunVerdict) -> RunCheck:
    statement = "no frame is latched that was not intended"
    keys = run.unexpected
    if keys:
        details = _listed_in_run_check(keys, _key_in_run_check)
        message = f"{len(keys)} {'latch' if len(keys) == 1 else 'latches'} of an unknown frame"
        return RunCheck("unexpected", statement, CheckOutcome.FAILED, message, details)
    if not run.counts["latched"]:
        return RunCheck(
            "unexpected", statement, CheckOutcome.NOT_JUDGED, "no latch was seen at all"
        )
    return RunCheck("unexpected", statement, CheckOutcome.PASSED, "none")


def _check_of_lost(run: RunVerdict) -> RunCheck:
    lost = [frame for frame in run.frames if frame.status is FrameStatus.LOST]
    statement = "the board loses no frame"
    told = [reason for reason in run.reasons if LOST_BY_BOARD in reason]
    if told:
        details = _frames_named_in_run_check(lost)
        return RunCheck("lost", statement, CheckOutcome.FAILED, "; ".join(told), details)
    if run.due and not run.counts["latched"]:
        return RunCheck("lost", statement, CheckOutcome.NOT_JUDGED, "nobody could see a latch")
    return RunCheck("lost", statement, CheckOutcome.PASSED, "none is known to be")


def _check_of_held_up(run: RunVerdict) -> RunCheck:
    """Frames that this machine held up decide a run only where they leave too few verified."""
    held_up = [frame for frame in run.frames if frame.status is FrameStatus.HELD_UP]
    statement = "host and machine hold up no frame"
    if not held_up:
        return RunCheck("held_up", statement, CheckOutcome.PASSED, "none")
    decisive = run.verdict is Verdict.INCONCLUSIVE and run.too_few
    outcome = CheckOutcome.INCONCLUSIVE if decisive else CheckOutcome.NOTED
    message = f"{len(held_up)} of {run_count_wording(len(run.frames), 'frame')}"
    return RunCheck("held_up", statement, outcome, message, _frames_named_in_run_check(held_up))


def _check_of_late(run: RunVerdict) -> RunCheck:
    late = [frame for frame in run.frames if frame.late]
    statement = "no frame is late"
    latched = run.counts["latched"]
    if not latched:
        return RunCheck("late", statement, CheckOutcome.NOT_JUDGED, "no frame was latched")
    if not late:
        return RunCheck(
            "late", statement, CheckOutcome.PASSED, f"none of {run_count_wording(latched, 'frame')}"
        )
    message = f"{len(late)} of {run_count_wording(latched, 'latched frame')}"
    return RunCheck(
        "late", statement, CheckOutcome.NOTED, message, _frames_named_in_run_check(late)
    )


def _run_check_of_share_verified(run: RunVerdict) -> RunCheck:
    statement = f"at least {100.0 * run.min_verified:.4g} % of the frames are verified"
    message = f"{run.counts['verified']} of {run.due}"
    if not run.too_few:
        return RunCheck("verified", statement, CheckOutcome.PASSED, message)
    missing = [frame for frame in run.frames if frame.status is FrameStatus.NOT_VERIFIED]
    # Beside a fault that was proved, too few frames change nothing.
    failed = run.verdict is Verdict.FAIL
    outcome = CheckOutcome.NOTED if failed else CheckOutcome.INCONCLUSIVE
    return RunCheck("verified", statement, outcome, message, _frames_named_in_run_check(missing))


def _check_of_complete_run(run: RunVerdict, cut_short: str | None) -> RunCheck:
    statement = "the run comes to its end"
    if cut_short is None:
        return RunCheck(COMPLETE, statement, CheckOutcome.PASSED, "it came to its end")
    message = f"{cut_short}{cut_run_verdict_text(run.counts)}"
    return RunCheck(COMPLETE, statement, CheckOutcome.INCONCLUSIVE, message)


def _frames_named_in_run_check(frames: list[FrameVerdict]) -> tuple[str, ...]:
    return _listed_in_run_check(frames, run_frame_wording)


def _listed_in_run_check(
    items: list[_Item], describe_item: Callable[[_Item], str]
) -> tuple[str, ...]:
    lines = [describe_item(item) for item in items[:NAMED_FRAMES]]
    if len(items) > NAMED_FRAMES:
        lines.append(f"... and {len(items) - NAMED_FRAMES} more, in the JSON file")
    return tuple(lines)


def _key_in_run_check(key: FrameKey) -> str:
    return f"session {key.session:#x}, sequence {key.sequence}, loop {key.loop}, index {key.index}"
