"""The page of a watched board: verdict, defects, latches, and the interactive view."""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from haptogram.acoustics import Drive, saturated_weights
from haptogram.acoustics.arrays import FloatArray
from haptogram.acoustics.reconstruct.patterns.found import OneFocus
from haptogram.evidence.dialects.watched_board import WatchedBoard
from haptogram.machine.provenance import UNSTATED, Provenance
from haptogram.verification import FrameStatus, Verdict
from haptogram.verification.watch import Defect, WatchedLatch, WatchResult

from ..formats.html import write_html_page
from ..viewer.frames import ViewerFrame, judged_viewer_frame
from ..viewer.scene import ViewerScene, other_axes_of_viewer
from .words import watched_pattern_text, watched_place_text

_KEPT: Final = 5_000  # latches of the view: some 3 MB of a page
_LATCH_HEAD: Final = ("latch", "device time (s)", "cause", "pattern", "verdict", "strange")
_LISTED: Final = 200  # rows of a table that a person reads
_MM: Final = 1e3
_TONES: Final = {Verdict.PASS: "good", Verdict.FAIL: "bad", Verdict.INCONCLUSIVE: "doubt"}


class WatchPage:
    """Collects the last latches of a board for its page.

    Parameters
    ----------
    board : WatchedBoard
        The board.
    """

    def __init__(self, board: WatchedBoard) -> None:
        self._board = board
        self._frames: deque[ViewerFrame] = deque(maxlen=_KEPT)
        self._rows: deque[tuple[str, ...]] = deque(maxlen=_LISTED)
        self._taken = 0

    def take(self, seen: WatchedLatch) -> None:
        """Take down a latch."""
        self._taken += 1
        self._frames.append(_shown_watched_frame(seen))
        self._rows.append(self._row(seen))

    def write(
        self,
        path: Path,
        result: WatchResult,
        expected_m: Sequence[FloatArray],
        *,
        provenance: Provenance = UNSTATED,
    ) -> None:
        """Write the page.

        Parameters
        ----------
        result : WatchResult
            The whole run.
        expected_m : sequence of (F, 3) numpy.ndarray
            The foci of each frame that was expected, in the axes of the model.
        provenance : Provenance, optional
            Origin of the result.

        Raises
        ------
        ConfigurationError
            If the extra ``report`` is not installed, or *path* cannot be written.
        """
        frames = list(self._frames)
        head, rows = self._latches()
        write_html_page(
            path,
            "watch.html",
            provenance,
            title=f"Haptogram: {result.verdict}, {result.latches} latches",
            heading=result.sentence,
            tone=_TONES[result.verdict],
            lead=self._lead(result),
            patterns=list(result.kinds.items()),
            statuses=[
                (_watch_status_tone(status), *pair) for status, *pair in _watch_status_rows(result)
            ],
            defects=_watch_defect_rows(result),
            tones={True: "bad", False: "good"},
            torn=list(result.torn[:_LISTED]),
            torn_more=max(0, len(result.torn) - _LISTED),
            remarks=list(dict.fromkeys(result.remarks))[:_LISTED],
            expected=self._expected_rows(expected_m),
            expected_more=max(0, len(expected_m) - _LISTED),
            scene=self._scene(frames),
            latch_head=head,
            rows=rows,
            rows_more=self._taken - len(self._rows),
            board=self._board_rows(),
        )

    def _scene(self, frames: list[ViewerFrame]) -> str | None:
        if not frames:
            return None
        axes = other_axes_of_viewer(self._board.client_axes)
        return ViewerScene.of(self._board.model, frames, client_axes=axes).embedded()

    def _lead(self, result: WatchResult) -> list[str]:
        sentences = [f"The board is {self._board.dialect}."]
        sentences += [f"Not judged: {result.missing}."] if result.missing else []
        if not result.expected:
            sentences.append("No focus was expected, so no latch has a verdict.")
        return sentences

    def _latches(self) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
        """Return head and rows of the table; its last columns only as far as any row has them."""
        width = len(_LATCH_HEAD)
        while width > _LATCH_HEAD.index("verdict") and not any(r[width - 1] for r in self._rows):
            width -= 1
        return _LATCH_HEAD[:width], [row[:width] for row in self._rows]

    def _row(self, seen: WatchedLatch) -> tuple[str, ...]:
        latch, verdict = seen.latch, seen.verdict
        strange = [
            *map(str, seen.defects),
            *([f"torn: {seen.torn_text}"] if seen.torn_text else []),
        ]
        failed = [] if verdict is None else [n for n, ok in verdict.criteria.items() if not ok]
        told = "" if verdict is None else str(verdict.status)
        return (
            str(latch.number),
            "" if latch.t_us is None else f"{latch.t_us / 1e6:.6f}",
            latch.cause,
            watched_pattern_text(seen.pattern, self._board),
            told + (f" ({', '.join(failed)})" if failed else ""),
            "; ".join(strange),
        )

    def _expected_rows(self, expected_m: Sequence[FloatArray]) -> list[tuple[str, str]]:
        return [
            (str(number), ", ".join(map(watched_place_text, self._board.clients_m(foci))))
            for number, foci in enumerate(expected_m[:_LISTED], start=1)
        ]

    def _board_rows(self) -> list[tuple[str, str]]:
        model = self._board.model
        return [
            ("dialect", self._board.dialect),
            ("elements", str(model.array.count)),
            ("speed of sound", f"{model.medium.sound_speed_m_s:.2f} m/s"),
            ("wavelength", f"{_MM * model.wavelength_m:.3f} mm"),
        ]


def _shown_watched_frame(seen: WatchedLatch) -> ViewerFrame:
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


def _watch_status_rows(result: WatchResult) -> list[tuple[FrameStatus, str, int]]:
    return [(status, str(status), count) for status, count in result.statuses.items()]


def _watch_status_tone(status: FrameStatus) -> str:
    if status is FrameStatus.ON_TARGET:
        return "good"
    return "doubt" if status is FrameStatus.NOT_VERIFIED else "bad"


def _watch_defect_rows(result: WatchResult) -> list[tuple[str, bool, str]]:
    """Return each defect that has a name, those that were found first, and the figures."""
    rows = []
    for defect in Defect:
        found = [str(one) for one in result.diagnoses if one.defect is defect]
        figures = "; ".join(text.removeprefix(f"{defect}: ") for text in found)
        rows.append((str(defect), bool(found), figures))
    return sorted(rows, key=lambda row: not row[1])
