"""A watched board as a document: verdict, defects, latches, and the interactive view."""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from haptogram.acoustics import Drive, saturated_weights
from haptogram.acoustics.arrays import FloatArray
from haptogram.acoustics.reconstruct.patterns.found import OneFocus
from haptogram.evidence.dialects.watched_board import WatchedBoard
from haptogram.verification import FrameStatus, FrameVerdict, grouped_frame_findings
from haptogram.verification.frame.verdict import WRONG
from haptogram.verification.watch import Defect, WatchedLatch, WatchResult

from ..formats import document as parts
from ..viewer.frames import ViewerFrame, judged_viewer_frame
from ..viewer.scene import ViewerScene, other_axes_of_viewer
from .words import watched_pattern_text, watched_place_text

_KEPT: Final = 5_000  # latches of the view: some 3 MB of a page
_LATCH_HEAD: Final = ("latch", "device time (s)", "cause", "pattern", "verdict", "strange")
_LISTED: Final = 200  # latches of a table that a person reads
_MM: Final = 1e3
_IN_SECTIONS: Final = ("defect", "torn", "remark")  # lines of a result that a section holds


class WatchReport:
    """Collects what a document tells of the latches of a board.

    Parameters
    ----------
    board : WatchedBoard
        The board.
    has_page : bool
        Whether the last latches are kept, for a page.
    has_checks : bool
        Whether a latch that is right is a check as well.
    """

    def __init__(self, board: WatchedBoard, *, has_page: bool, has_checks: bool) -> None:
        self._board, self._has_page, self._has_checks = board, has_page, has_checks
        self._frames: deque[ViewerFrame] = deque(maxlen=_KEPT)
        self._rows: deque[tuple[str, ...]] = deque(maxlen=_LISTED)
        self._count = 0
        self._verdicts: list[FrameVerdict] = []

    def take(self, seen: WatchedLatch) -> None:
        """Take down a latch."""
        verdict = seen.verdict
        if verdict is not None and (
            self._has_checks or verdict.status is not FrameStatus.ON_TARGET
        ):
            self._verdicts.append(verdict)
        if self._has_page:
            self._count += 1
            self._frames.append(_shown_watched_frame(seen))
            self._rows.append(self._row(seen))

    def document(
        self, result: WatchResult, expected_m: Sequence[FloatArray], seconds: float | None
    ) -> parts.Document:
        """Return *result* as a document.

        Parameters
        ----------
        expected_m : sequence of (F, 3) numpy.ndarray
            The foci of each frame that was expected, in the axes of the model.
        seconds : float or None
            How long the board was watched.
        """
        sentence, *lines = result.lines()
        facts = [line.split(maxsplit=1) for line in lines]
        unjudged = "no focus was expected, so no latch has a verdict"
        remarks = list(dict.fromkeys(result.remarks))
        return parts.Document(
            command="watch",
            heading=sentence,
            title=f"{result.verdict}, {result.latches} latches",
            tone=parts.TONES[result.verdict],
            findings=list(_watch_findings(result, self._verdicts)),
            lead=[
                f"the board is {self._board.dialect}",
                *(f"{kind}: {text}" for kind, text in facts if kind not in _IN_SECTIONS),
                *([] if result.expected else [unjudged]),
            ],
            sections=[
                *self._view_sections(),
                _watch_table_section(
                    "Latches that may be torn",
                    parts.Table(
                        ("latch", "counted"), [(str(n), text) for n, text in result.torn], (0,)
                    ),
                ),
                parts.Section(
                    "What the board said of its client", [parts.Listing(remarks)] if remarks else []
                ),
                self._expected_section(expected_m),
                *self._latch_sections(),
            ],
            checks=[
                *(_watch_defect_check(result, defect) for defect in Defect),
                _watch_seen_check(result, seconds),
                *map(_watch_frame_check, self._verdicts),
            ],
            properties={"verdict": str(result.verdict), "latches": str(result.latches)},
            seconds=seconds,
        )

    def _view_sections(self) -> Iterator[parts.Section]:
        """Yield the interactive view, in the axes of the array; nothing without frames."""
        if self._frames:
            axes = other_axes_of_viewer(self._board.client_axes)
            scene = ViewerScene.of(self._board.model, list(self._frames), client_axes=axes)
            note = (
                "The view has the axes of the array, with +z up; all tables have those of the "
                "board's own programs."
            )
            yield parts.Section("View", [parts.View(scene.embedded(), note)])

    def _expected_section(self, expected_m: Sequence[FloatArray]) -> parts.Section:
        """Return the table of expected foci in mm, in the client's axes; empty without foci."""
        rows = [
            (str(number), ", ".join(map(watched_place_text, self._board.clients_m(foci))))
            for number, foci in enumerate(expected_m, start=1)
        ]
        note = parts.Listing(["After the last frame the first follows again."])
        return _watch_table_section(
            "Expected foci", parts.Table(("frame", "foci x, y, z (mm)"), rows, (0,)), note
        )

    def _latch_sections(self) -> Iterator[parts.Section]:
        """Yield a table of the last latches and one of the board; nothing without an HTML page.

        The last columns, from the verdict on, are left out if no row has them.
        """
        if not self._has_page:
            return
        width = len(_LATCH_HEAD)
        while width > _LATCH_HEAD.index("verdict") and not any(r[width - 1] for r in self._rows):
            width -= 1
        table = parts.Table(
            _LATCH_HEAD[:width], [row[:width] for row in self._rows], (0, 1), (3, 5)
        )
        more = self._count > len(self._rows)
        note = parts.Listing([f"The last of {self._count}."] if more else [])
        yield _watch_table_section("Latches", table, note)
        model = self._board.model
        rows = [
            ("dialect", self._board.dialect),
            ("elements", str(model.array.count)),
            ("speed of sound", f"{model.medium.sound_speed_m_s:.2f} m/s"),
            ("wavelength", f"{_MM * model.wavelength_m:.3f} mm"),
        ]
        yield parts.Section("Board", [parts.Table((), rows)])

    def _row(self, seen: WatchedLatch) -> tuple[str, ...]:
        """Return the table row of a latch: number, time in s, cause, pattern, verdict, defects."""
        latch, verdict = seen.latch, seen.verdict
        return (
            str(latch.number),
            "" if latch.t_us is None else f"{latch.t_us / 1e6:.6f}",
            latch.cause,
            watched_pattern_text(seen.pattern, self._board),
            "" if verdict is None else watched_status_text(verdict),
            "; ".join(watched_defect_texts(seen)),
        )


def watched_defect_texts(seen: WatchedLatch) -> list[str]:
    """Return the defects of a latch, and the reason why it may be torn."""
    return [*map(str, seen.defects), *([f"torn: {seen.torn_text}"] if seen.torn_text else [])]


def watched_status_text(verdict: FrameVerdict) -> str:
    """Return the status of a frame, with the criteria that it failed."""
    failed = [name for name, passed in verdict.criteria.items() if not passed]
    return f"{verdict.status} ({', '.join(failed)})" if failed else str(verdict.status)


def _watch_table_section(title: str, table: parts.Table, *notes: parts.Block) -> parts.Section:
    """Return a section with a table, then *notes*; without rows it is empty."""
    return parts.Section(title, [table, *notes] if table.rows else [])


def _shown_watched_frame(seen: WatchedLatch) -> ViewerFrame:
    """Return a latch as a frame of the view, with its verdict if it has one."""
    latch, pattern = seen.latch, seen.pattern
    drive = Drive.from_weights(saturated_weights(np.nan_to_num(latch.weights)))
    if (verdict := seen.verdict) is not None:
        frame = judged_viewer_frame(lambda name: getattr(verdict, name), str(verdict))
    else:
        frame = ViewerFrame(number=latch.number, text=seen.torn_text)
    frame = dataclasses.replace(frame, number=latch.number, latched_us=latch.t_us, drive=drive)
    if frame.found_m is None and isinstance(pattern, OneFocus):
        bounds = [_MM * b if math.isfinite(b) else None for b in pattern.bound_m]
        frame = dataclasses.replace(frame, found_m=pattern.position_m, bound_mm=bounds)
    return frame


def _watch_findings(
    result: WatchResult, verdicts: Sequence[FrameVerdict]
) -> Iterator[parts.Finding]:
    """Yield diagnoses, wrong and unjudged frames in groups, and missing latches, as errors."""
    for diagnosis in result.diagnoses:
        yield parts.Finding(parts.Level.ERROR, str(diagnosis.defect), str(diagnosis))
    wrong = [verdict for verdict in verdicts if verdict.status in WRONG]
    passed = {*WRONG, FrameStatus.ON_TARGET}
    unjudged = [verdict for verdict in verdicts if verdict.status not in passed]
    for line, frames in (*grouped_frame_findings(wrong), *grouped_frame_findings(unjudged)):
        name = f"latch {frames[0].number}" if len(frames) == 1 else f"{len(frames)} latches"
        yield parts.Finding(parts.Level.ERROR, name, line)
    if result.missing:
        yield parts.Finding(parts.Level.ERROR, "missing", result.missing)


def _watch_frame_check(verdict: FrameVerdict) -> parts.Check:
    """Return the check that a latch has its expected foci: failed if it has others.

    Inconclusive if it was not verified.
    """
    outcome = parts.Outcome.PASSED
    if verdict.status in WRONG:
        outcome = parts.Outcome.FAILED
    elif verdict.status is not FrameStatus.ON_TARGET:
        outcome = parts.Outcome.INCONCLUSIVE
    name = f"latch {verdict.number} is where it was expected"
    return parts.Check("expected", name, outcome, watched_status_text(verdict), [str(verdict)])


def _watch_defect_check(result: WatchResult, defect: Defect) -> parts.Check:
    """Return the check that *defect* was not found: failed, with each diagnosis, if it was."""
    found = [str(diagnosis) for diagnosis in result.diagnoses if diagnosis.defect is defect]
    outcome = parts.Outcome.FAILED if found else parts.Outcome.PASSED
    message, *more = found or ["not found"]
    return parts.Check("defects", f"absent: {defect}", outcome, message, more, kind="defect")


def _watch_seen_check(result: WatchResult, seconds: float | None) -> parts.Check:
    """Return the check that no latch is missing; inconclusive if one is, or none was seen.

    *seconds* is how long the watch took.
    """
    count = sum(result.kinds.values())
    missing = result.missing or ("" if count else "no latch of a client was seen")
    outcome = parts.Outcome.INCONCLUSIVE if missing else parts.Outcome.PASSED
    message = missing or f"{count} latches"
    return parts.Check("seen", "every latch was seen", outcome, message, seconds=seconds)
