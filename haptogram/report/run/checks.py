"""The checks of a run, one for each way in which a run can fail."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, TypeVar

from haptogram import verification
from haptogram.records.frame import FrameKey

from ..formats.document import Check, Outcome
from .pins import run_capture_checks
from .wording import run_count_wording, run_frame_wording

NAMED_FRAMES: Final = 20  # most frames that a check names; the JSON names all

_Item = TypeVar("_Item")


@dataclass(frozen=True, slots=True)
class _Fault:
    """A fault of a frame, how it shows, and which frames could have shown it.

    Those that another check counts, with a status *besides*, could not.
    """

    name: str
    statement: str
    shows: Callable[[verification.FrameVerdict], bool]
    seen_in: str
    besides: tuple[verification.FrameStatus, ...] = ()


_FAULTS: Final = (
    _Fault(
        "off_target",
        "no drive without a fault has its focus off the target",
        lambda frame: frame.status is verification.FrameStatus.OFF_TARGET,
        "verified",
        (verification.FrameStatus.WRONG_DRIVE, verification.FrameStatus.CORRUPT),
    ),
    _Fault(
        "wrong_drive",
        "no wrong drive is radiated",
        lambda frame: frame.status is verification.FrameStatus.WRONG_DRIVE,
        "verified",
    ),
    _Fault(
        "corrupt",
        "no damaged frame is latched",
        lambda frame: frame.status is verification.FrameStatus.CORRUPT,
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


def run_checks_of_result(
    run: verification.RunVerdict, result: Mapping[str, Any], seconds: float | None = None
) -> list[Check]:
    """Return the checks of a run of *seconds*, and those of the captures of its drive pins."""
    is_judged = result.get("run_judged", True)
    own = run_checks(run, result["cut_short"], seconds) if is_judged else []
    captures = result.get("captures")
    return [*own, *([] if captures is None else run_capture_checks(captures))]


def run_checks(
    run: verification.RunVerdict, cut_short: str | None = None, seconds: float | None = None
) -> list[Check]:
    """Return every check with its outcome, in a fixed order.

    A check has failed if and only if the verdict is fail.  If none has failed, a check is
    inconclusive if and only if the verdict is.
    """
    return [
        *(_check_of_fault(run, fault) for fault in _FAULTS),
        _check_of_unexpected(run),
        _check_of_lost(run),
        _check_of_held_up(run),
        _check_of_late(run),
        _check_of_share_verified(run),
        _check_of_complete_run(run, cut_short, seconds),
    ]


def _check_of_fault(run: verification.RunVerdict, fault: _Fault) -> Check:
    """Return the check that no judged frame shows *fault*: failed if one does.

    Not judged if there is no judged frame.
    """
    found = [frame for frame in run.frames if fault.shows(frame)]
    besides = sum(frame.status in fault.besides for frame in run.frames)
    judged = run.counts[fault.seen_in] - besides
    frames = run_count_wording(judged, f"{fault.seen_in} frame")
    if besides:
        frames += f", besides {besides} with a faulty drive"
    outcome, message = Outcome.PASSED, f"none of {frames}"
    if found:
        outcome, message = Outcome.FAILED, f"{len(found)} of {frames}"
    elif not judged:
        outcome, message = Outcome.NOT_JUDGED, f"no frame was {fault.seen_in}"
        if besides:
            message = f"none of {run_count_wording(besides, 'verified frame')} has a right drive"
    return Check(fault.name, fault.statement, outcome, message, _named_frames(found))


def _check_of_unexpected(run: verification.RunVerdict) -> Check:
    """Return the check that only intended frames were latched: failed if one was not intended.

    Not judged without any latch.
    """
    keys, outcome, message = run.unexpected, Outcome.PASSED, "none"
    if keys:
        outcome = Outcome.FAILED
        message = f"{len(keys)} {'latch' if len(keys) == 1 else 'latches'} of an unknown frame"
    elif not run.counts["latched"]:
        outcome, message = Outcome.NOT_JUDGED, "no latch was seen at all"
    statement = "no frame is latched that was not intended"
    return Check("unexpected", statement, outcome, message, _first_lines(keys, _key_text))


def _check_of_lost(run: verification.RunVerdict) -> Check:
    """Return the check that the board has lost no frame: failed if it is known that it did.

    Not judged if no latch could be seen.
    """
    lost = _frames_with(run, verification.FrameStatus.LOST)
    reasons = [reason for reason in run.reasons if verification.LOST_BY_BOARD in reason]
    outcome, message = Outcome.PASSED, "none is known to be"
    if reasons:
        outcome, message = Outcome.FAILED, "; ".join(reasons)
    elif run.due and not run.counts["latched"]:
        outcome, message = Outcome.NOT_JUDGED, "nobody could see a latch"
    details = _named_frames(lost) if reasons else ()
    return Check("lost", "the board loses no frame", outcome, message, details)


def _check_of_held_up(run: verification.RunVerdict) -> Check:
    """Return the check that the host delayed no frame: delayed ones are noted.

    If too few frames are verified and the run is inconclusive, they make the check so too.
    """
    held_up = _frames_with(run, verification.FrameStatus.HELD_UP)
    outcome, message = Outcome.PASSED, "none"
    if held_up:
        decisive = run.verdict is verification.Verdict.INCONCLUSIVE and run.too_few
        outcome = Outcome.INCONCLUSIVE if decisive else Outcome.NOTED
        message = f"{len(held_up)} of {run_count_wording(len(run.frames), 'frame')}"
    statement = "host and machine hold up no frame"
    return Check("held_up", statement, outcome, message, _named_frames(held_up))


def _check_of_late(run: verification.RunVerdict) -> Check:
    """Return the check on late latches: passed if none is, else noted, as they do not fail.

    Not judged if no frame was latched.
    """
    late, latched = [frame for frame in run.frames if frame.late], run.counts["latched"]
    outcome, message = Outcome.NOT_JUDGED, "no frame was latched"
    if latched:
        outcome = Outcome.NOTED if late else Outcome.PASSED
        message = f"{len(late) or 'none'} of {run_count_wording(latched, 'latched frame')}"
    return Check("late", "no frame is late", outcome, message, _named_frames(late))


def _check_of_share_verified(run: verification.RunVerdict) -> Check:
    """Return the check that the asked share of frames was verified: else inconclusive.

    It is only noted if the run fails anyway.
    """
    outcome, missing = Outcome.PASSED, list[verification.FrameVerdict]()
    if run.too_few:
        # Beside a fault that was proved, too few frames change nothing.
        failed = run.verdict is verification.Verdict.FAIL
        outcome = Outcome.NOTED if failed else Outcome.INCONCLUSIVE
        missing = _frames_with(run, verification.FrameStatus.NOT_VERIFIED)
    statement = f"at least {100.0 * run.min_verified:.4g} % of the frames are verified"
    message = f"{run.counts['verified']} of {run.due}"
    return Check("verified", statement, outcome, message, _named_frames(missing))


def _check_of_complete_run(
    run: verification.RunVerdict, cut_short: str | None, seconds: float | None
) -> Check:
    """Return the check that the run came to its end: else inconclusive.

    *cut_short* says why it did not (None: it did); *seconds* is how long it took.
    """
    outcome, message = Outcome.PASSED, "it came to its end"
    if cut_short is not None:
        outcome = Outcome.INCONCLUSIVE
        message = f"{cut_short}{verification.cut_run_verdict_text(run.counts)}"
    return Check("complete", "the run comes to its end", outcome, message, seconds=seconds)


def _frames_with(
    run: verification.RunVerdict, status: verification.FrameStatus
) -> list[verification.FrameVerdict]:
    """Return the frames that have a status."""
    return [frame for frame in run.frames if frame.status is status]


def _named_frames(frames: list[verification.FrameVerdict]) -> list[str]:
    """Return a line for each of the first 20 frames, and the number of the others."""
    return _first_lines(frames, run_frame_wording)


def _first_lines(items: Sequence[_Item], describe_item: Callable[[_Item], str]) -> list[str]:
    """Return a line for each of the first 20 items, and the number of the others."""
    lines = [describe_item(item) for item in items[:NAMED_FRAMES]]
    if len(items) > NAMED_FRAMES:
        lines.append(f"... and {len(items) - NAMED_FRAMES} more, in the JSON file")
    return lines


def _key_text(key: FrameKey) -> str:
    """Return a frame's key as text: session, sequence, loop and index."""
    return f"session {key.session:#x}, sequence {key.sequence}, loop {key.loop}, index {key.index}"
