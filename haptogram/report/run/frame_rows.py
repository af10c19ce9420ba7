"""The frames of a run in the table of its page: those that need a look, and the largest errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import compress
from typing import Final

from haptogram.verification import (
    FrameStatus,
    FrameVerdict,
    RunVerdict,
    verdict_consequence_text,
    worst_frame_of,
)

from .series import plotted_relative_error, worst_frames_of_run
from .wording import run_figure_wording, run_timeliness_wording

_LARGEST: Final = 10
_LISTED: Final = 100  # that a person reads
_NAMED: Final = 8  # frames that are like the one in a row
_TONES: Final = {
    FrameStatus.ON_TARGET: "good",
    FrameStatus.HELD_UP: "doubt",
    FrameStatus.NOT_VERIFIED: "doubt",
    FrameStatus.CANCELLED: "plain",
}


@dataclass(frozen=True, slots=True)
class FrameRow:
    """A frame in words, the worst of those with the same thing wrong.

    Attributes
    ----------
    number : int
        Number of the frame.
    others : str
        How many more frames are like it, and which; empty: none.
    tone, status, timing : str
        Colour of the status, the status, and the time by which it was late or early, if it was.
    cells : tuple of str
        Target, time and errors.
    faults, consequence : str
        Faults of the frame, and what it did to the focus.
    """

    number: int
    others: str
    tone: str
    status: str
    timing: str
    cells: tuple[str, ...]
    faults: str
    consequence: str


_FOUND: Final = "found"
_MEASURES: Final = (
    "target x, y, z (mm)",
    "due (µs, board's clock)",
    "across (mm)",
    "along (mm)",
    "error / bound",
)


@dataclass(frozen=True, slots=True)
class RunFrameTable:
    """The frames that a page lists.

    Attributes
    ----------
    head : tuple of str
        Names of the columns: those that any frame has something for.
    rows : list of FrameRow
        Wrong, lost and late frames, then those with the largest errors.
    odd : int
        Number of frames that are wrong, lost, late or not verified.
    more : int
        Number of those that are not listed.
    """

    head: tuple[str, ...]
    rows: list[FrameRow]
    odd: int
    more: int

    @property
    def numbers(self) -> tuple[int, ...]:
        """Places of the columns of numbers."""
        end = len(self.head) - (self.head[-1] == _FOUND)
        return (0, *range(2, end))


def run_frame_table(run: RunVerdict) -> RunFrameTable:
    """Return the table of the frames that a person looks at."""
    groups = [frames for _, frames in run.findings()]
    groups.sort(key=lambda frames: (not frames[0].is_wrong, frames[0].number))
    odd = {frame.number for frames in groups for frame in frames}
    more = sum(map(len, groups[_LISTED:]))
    largest = [[f] for f in worst_frames_of_run(run, _LARGEST) if f.number not in odd]
    rows = [_run_frame_row(frames) for frames in [*groups[:_LISTED], *largest]]
    used = [any(row.cells[at] for row in rows) for at in range(len(_MEASURES))]
    kept = tuple(name for name, is_used in zip(_MEASURES, used, strict=True) if is_used)
    rows = [replace(row, cells=tuple(compress(row.cells, used))) for row in rows]
    found = (_FOUND,) if any(row.faults or row.consequence for row in rows) else ()
    return RunFrameTable(("frame", "status", *kept, *found), rows, len(odd), more)


def run_frame_place_text(frame: FrameVerdict) -> str:
    """Return the target of *frame* in mm."""
    return ", ".join(f"{round(1e3 * value, 1) + 0.0:.1f}" for value in frame.target_m)


def _run_frame_figure(value: float | None, digits: int = 3) -> str:
    return "" if value is None else run_figure_wording(value, digits)


def _others_in_run_frame_row(frames: Sequence[FrameVerdict], shown: FrameVerdict) -> str:
    others = [str(frame.number) for frame in frames if frame is not shown]
    if not others:
        return ""
    return f"and {len(others)} like it: {', '.join(others[:_NAMED])}" + (
        ", ..." if len(others) > _NAMED else ""
    )


def _run_frame_row(frames: Sequence[FrameVerdict]) -> FrameRow:
    frame = worst_frame_of(frames)
    failed = [name for name, passed in frame.criteria.items() if not passed]
    faults = [*frame.faults, *([f"{', '.join(failed)} failed"] if failed else [])]
    faults += [f"latched {frame.latches} times"] if frame.latches > 1 else []
    faults += [frame.note] if frame.note else []
    return FrameRow(
        frame.number,
        _others_in_run_frame_row(frames, frame),
        _TONES.get(frame.status, "bad"),
        str(frame.status),
        run_timeliness_wording(frame) if frame.late or frame.early else "",
        (
            run_frame_place_text(frame),
            "" if frame.t_apply_us is None else str(frame.t_apply_us),
            _run_frame_figure(frame.lateral_error_mm, 4),
            _run_frame_figure(frame.axial_error_mm, 4),
            _run_frame_figure(plotted_relative_error(frame)),
        ),
        "; ".join(faults),
        "" if frame.consequence is None else verdict_consequence_text(frame.consequence),
    )
