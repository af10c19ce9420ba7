"""The frames of a run in the table of its page: those that need a look, and the largest errors."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import compress
from typing import Any, Final

from haptogram import verification

_LARGEST: Final = 10
_LISTED: Final = 100  # most rows of the table
_NAMED: Final = 8  # frames that are like the one in a row
_TONES: Final = {
    verification.FrameStatus.ON_TARGET: "good",
    verification.FrameStatus.HELD_UP: "doubt",
    verification.FrameStatus.NOT_VERIFIED: "doubt",
    verification.FrameStatus.CANCELLED: "plain",
}


_MEASURES: Final = (
    "target x, y, z (mm)",
    "due (µs, board's clock)",
    "across (mm)",
    "along (mm)",
    "error / bound",
)


def run_frame_table(run: verification.RunVerdict) -> dict[str, Any]:
    """Return the table of the frames that a person looks at, for the template of the page.

    Wrong, lost and late frames, then those with the largest errors; columns that any frame has
    something for; ``odd`` is the number of frames that want attention, ``more`` of those that are
    not listed.
    """
    groups = [frames for _, frames in run.findings()]
    groups.sort(key=lambda frames: (not frames[0].is_wrong, frames[0].number))
    odd = {frame.number for frames in groups for frame in frames}
    judged = [frame for frame in run.frames if frame.criteria or frame.faults]
    largest = [
        [f] for f in sorted(judged, key=_badness, reverse=True)[:_LARGEST] if f.number not in odd
    ]
    rows = [_run_frame_row(frames) for frames in [*groups[:_LISTED], *largest]]
    used = [any(row["cells"][at] for row in rows) for at in range(len(_MEASURES))]
    for row in rows:
        row["cells"] = list(compress(row["cells"], used))
    head = ["frame", "status", *compress(_MEASURES, used)]
    return {
        "numbers": (0, *range(2, len(head))),
        "head": [*head, *(["found"] if any(r["faults"] or r["effect"] for r in rows) else [])],
        "rows": rows,
        "odd": len(odd),
        "more": sum(map(len, groups[_LISTED:])),
    }


def _run_frame_place_text(frame: verification.FrameVerdict) -> str:
    """Return the target of *frame* as text in mm, "x, y, z"."""
    return ", ".join(f"{round(1e3 * value, 1) + 0.0:.1f}" for value in frame.target_m)


def _run_frame_row(frames: Sequence[verification.FrameVerdict]) -> dict[str, Any]:
    """Return a row for frames with the same fault: figures of the worst, numbers of the others."""
    frame = verification.worst_frame_of(frames)
    others = [str(other.number) for other in frames if other is not frame]
    named = ", ".join([*others[:_NAMED], *(["..."] if len(others) > _NAMED else [])])
    failed = [name for name, passed in frame.criteria.items() if not passed]
    faults = [*frame.faults, *([f"{', '.join(failed)} failed"] if failed else [])]
    faults += [f"latched {frame.latches} times"] if frame.latches > 1 else []
    faults += [frame.note] if frame.note else []
    errors = (
        (frame.lateral_error_mm, 4),
        (frame.axial_error_mm, 4),
        (_relative_error(frame), 3),
    )
    return {
        "number": frame.number,
        "others": f"and {len(others)} like it: {named}" if others else "",
        "tone": _TONES.get(frame.status, "bad"),
        "status": str(frame.status),
        "timing": _timing_text(frame),
        "cells": [
            _run_frame_place_text(frame),
            "" if frame.t_apply_us is None else str(frame.t_apply_us),
            *("" if value is None else f"{value:.{digits}f}" for value, digits in errors),
        ],
        "faults": "; ".join(faults),
        "effect": ""
        if frame.consequence is None
        else verification.verdict_consequence_text(frame.consequence),
    }


def _timing_text(frame: verification.FrameVerdict) -> str:
    """Return how many µs a frame was latched early or late, as text; "" if in time or not known."""
    if frame.lateness_us is None or not (frame.late or frame.early):
        return ""
    return f"{abs(frame.lateness_us)} µs {'late' if frame.late else 'early'}"


def _relative_error(frame: verification.FrameVerdict) -> float | None:
    """Return the greatest position error of the axes x, y and z, each as a share of its bound.

    The sign is dropped; None if no axis was measured.
    """
    if frame.measured_m is None or frame.bound_mm is None:
        return None
    axes = zip(frame.target_m, frame.measured_m, frame.bound_mm, strict=True)
    ratios = [
        1e3 * abs(found - target) / bound
        for target, found, bound in axes
        if found is not None and bound  # others cannot be observed
    ]
    return max(ratios, default=None)


def _badness(frame: verification.FrameVerdict) -> tuple[bool, float, int]:
    """Return a sort key, greatest for the worst frame: off target, relative error, low number."""
    wrong = frame.status is not verification.FrameStatus.ON_TARGET
    return wrong, _relative_error(frame) or 0.0, -frame.number
