"""Samples that an analyser lost, where the reference of the capture is an element.

Such a reference counts no periods: each latch moves it. Samples that are missing then turn all pins
together, and bring all later frames forward. No board does the one, and none is ahead of its time.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from haptogram.records.pins import PinRecord

from .run_drives import Bools, PinRunDrives
from .shown_frames import LATE_PERIODS, FramesShownByPins, frames_shown_by_pins

_MOST: Final = 8  # places at which samples are missing that are sought
_BEFORE: Final = 0.5  # periods of a frame that its drive is not judged in
_HALF: Final = 0.5
_LEAST_SHIFT: Final = 1.25  # periods by which a part of the run is ahead of the other
_COMPARED: Final = 32  # frames of a part, at most, whose times are compared
_FEWEST_DRIVES: Final = 8  # of pins in frames that show such a part
_MOST_SPREADS: Final = 6.0  # of the phase from frame to frame, beyond which it jumps
_NEAR: Final = 3  # frames behind a wrong one in which the phase is right again


def frames_before_lost_samples(
    record: PinRecord, run: PinRunDrives
) -> tuple[PinRecord, FramesShownByPins]:
    """Return the part of a capture beside which samples are missing, and the frames that it shows.

    A clock of the carrier jumps itself where samples are missing, unless they are those of a whole
    number of periods: then the frames alone tell, as they do beside an element.
    """
    shown = frames_shown_by_pins(record, run)
    for _ in range(_MOST):
        end = _end_before_lost_samples(record, run, shown)
        if end is None:
            break
        record = record.between(0.0, end, _why_samples_are_missing(record, end))
        shown = frames_shown_by_pins(record, run)
    return record, shown


def _why_samples_are_missing(record: PinRecord, at: float) -> str:
    where = f"samples are missing behind {at * record.period_s * 1e3:.3f} ms, where "
    if record.reference_element is not None:
        return where + (
            "all pins jump together or the frames go on too early: capture at a lower rate, fewer "
            "channels, or with another cable; beside the clock of the carrier fewer are mistaken"
        )
    return where + (
        "the frames go on too early by whole periods: a board that latches early from there on "
        "looks the same; capture again to know"
    )


def _fitting_pins(shown: FramesShownByPins) -> Bools:
    """Return the (E,) pins that show the run; the others are wrong whatever is missing."""
    judged = shown.seen & ~shown.lost
    fitting: Bools = shown.right[judged].sum(axis=0) >= max(_HALF * judged.sum(), _HALF)
    return fitting


def _end_before_lost_samples(
    record: PinRecord, run: PinRunDrives, shown: FramesShownByPins
) -> float | None:
    """Return the period up to which no sample is missing; None: none is, or nobody knows."""
    judged, fitting = shown.seen & ~shown.lost, _fitting_pins(shown)
    if not fitting.any():
        return None
    right = shown.right[:, fitting].all(axis=1) & judged & ~shown.torn
    right &= shown.late <= LATE_PERIODS
    wrong = np.flatnonzero(judged & ~right)
    if not len(wrong):
        return None
    first, last = int(wrong[0]), int(wrong[-1])
    end = float(shown.starts[first])
    behind = frames_shown_by_pins(record.between(end, record.end, ""), run)
    if _shows_part_of_run(behind, fitting) and _periods_ahead(run, behind, shown) > _LEAST_SHIFT:
        return end - _BEFORE
    is_late = shown.late[last] > LATE_PERIODS  # the samples before its latch are those that lack
    end = float(shown.starts[last] + shown.late[last] if is_late else shown.ends[last])
    for _ in range(_MOST):  # before the part that was taken for the run lies one of another pass
        before = frames_shown_by_pins(record.between(0.0, end, ""), run)
        if not _shows_part_of_run(before, fitting):
            break
        seen = np.flatnonzero(before.seen & before.right[:, fitting].all(axis=1))
        if _periods_ahead(run, before, shown) < -_LEAST_SHIFT:
            return float(before.ends[seen[-1]]) - _BEFORE
        late = before.late[seen] > LATE_PERIODS  # by a loss of less than a frame, before these
        in_time = np.flatnonzero(late[:-1] & ~late[1:]) + 1
        end = float(before.starts[seen[in_time[0] if len(in_time) else 0]])
        if end <= run.gap:
            break
    return None


def _shows_part_of_run(part: FramesShownByPins, fitting: Bools) -> bool:
    """Return True if a part of a capture shows frames of the run, nearly all of them right."""
    judged = part.seen & ~part.lost
    if judged.sum() * fitting.sum() < _FEWEST_DRIVES:
        return False
    return float(part.right[judged][:, fitting].all(axis=1).mean()) >= _HALF


def _periods_ahead(run: PinRunDrives, part: FramesShownByPins, whole: FramesShownByPins) -> float:
    """Return by how much a part of a capture shows its frames earlier than the whole has them.

    An object that repeats may be found in any of its passes. Between two frames of one drive lies a
    whole number of them, so that of these times the one counts which leaves the least.
    """
    drives = np.hstack([run.phases[:, run.elements], run.amplitudes[:, run.elements]])
    shown = np.flatnonzero(part.seen & ~part.lost)
    ahead = []
    for frame in shown[:: -(-len(shown) // _COMPARED)]:
        starts = whole.starts[(drives == drives[frame]).all(axis=1)]
        times = starts + part.starts[frame] - whole.starts[frame]
        if len(starts) > 1:  # a pass before the run, and one behind it
            starts = np.concatenate(
                [2.0 * starts[:1] - starts[1:2], starts, 2.0 * starts[-1:] - starts[-2:-1]]
            )
        behind = np.searchsorted(starts, times).clip(max=len(starts) - 1)
        away = np.concatenate([starts[behind] - times, starts[np.maximum(behind - 1, 0)] - times])
        ahead.append(away[np.abs(away).argmin()])
    return float(np.median(ahead))
