"""The place of a run in a capture: neither knows the clock of the other.

Each drive that the pins hold is taken for a frame that is like it; a line through their times gives
offset and rate of the two clocks.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from haptogram.acoustics.arrays import FloatArray

from .held.drives import HeldDrives
from .held.matching import matched_drives
from .run_drives import PinRunDrives

_NEAR_PERIODS: Final = 2.5  # distance from the line through the latches of one clock
_FEWEST: Final = 8  # frames that tell the rate


@dataclass(frozen=True, slots=True)
class PinAlignment:
    """Frame at *u* periods of the run is due at ``offset + rate * u`` periods of the capture.

    Attributes
    ----------
    offset, rate : float
        Of the two clocks.
    """

    offset: float
    rate: float = 1.0

    def starts(self, run: PinRunDrives) -> FloatArray:
        """Return (F,) the times at which frames are due in the capture."""
        times: FloatArray = self.offset + self.rate * run.starts
        return times

    def ends(self, run: PinRunDrives) -> FloatArray:
        """Return (F,) the times at which frames are over in the capture."""
        times: FloatArray = self.offset + self.rate * run.ends
        return times


def align_pins_to_run(held: HeldDrives, run: PinRunDrives) -> PinAlignment:
    """Return the place at which most drives of the run begin in time.

    One crystal makes the clocks of the frames and of the carrier; or two do, and then the
    analyser's own clock is the better first guess.
    """
    firsts, pairs = matched_drives(held, run.weights)
    latches = pairs[:, 0] - 1
    # Pins that do not latch together hold drives of no frame: the first of their latches is meant.
    follows = np.diff(pairs[:, 1]) == 1
    latches[1:][follows] = pairs[:-1, 0][follows]
    known = latches >= 0  # when the first drive began is not known
    if not known.any():
        return PinAlignment(0.0)
    due = run.starts[firsts[pairs[known, 1]]]
    begins = np.array([held.latches[place].begin for place in latches[known]])
    lines = [_line_through(due, begins, rate) for rate in (1.0, 1.0 + held.record.drift_ppm * 1e-6)]
    return max(lines, key=lambda line: line[0])[1]


def _line_through(due: FloatArray, begins: FloatArray, rate: float) -> tuple[int, PinAlignment]:
    """Return the best line at about this *rate*, and the number of frames on it."""
    away = begins - rate * due
    ordered = np.sort(away)
    counts = np.searchsorted(ordered, ordered + _NEAR_PERIODS, side="right") - np.arange(len(away))
    best = int(counts.argmax())
    offset = float(np.median(ordered[best : best + counts[best]]))
    near = np.abs(away - offset) < _NEAR_PERIODS
    if near.sum() >= _FEWEST:
        slope, shift = np.polyfit(due[near], away[near] - offset, 1)
        rate, offset = rate + float(slope), offset + float(shift)
    return int(counts[best]), PinAlignment(offset, rate)
