"""The place of a run in a capture: neither knows the clock of the other.

Each drive that the pins hold is taken for a frame that is like it; a line through their times gives
offset and rate of the two clocks.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from haptogram.acoustics.arrays import FloatArray
from haptogram.records.pins import PinRecord

from .held.drives import held_pin_drives
from .held.matching import matched_drives
from .run_drives import PinRunDrives

_NEAR_PERIODS: Final = 2.5  # distance from the line through the latches of one clock
_FEWEST: Final = 8  # frames that tell the rate
_WINDOW: Final = 0.5  # part of a frame that holds the changes of one latch


def align_pins_to_run(record: PinRecord, run: PinRunDrives) -> tuple[float, float]:
    """Return the offset and rate at which most drives of the run begin in time.

    A frame at *u* periods of the run is due at ``offset + rate * u`` periods of the capture.

    One crystal makes the clocks of the frames and of the carrier; or two do, and then the
    analyser's own clock is the better first guess.
    """
    held = held_pin_drives(record, window=min(record.latch_window, _WINDOW * run.gap))
    firsts, pairs = matched_drives(held, run.weights)
    pairs = pairs[pairs[:, 0] > 0]  # when the first drive began is not known
    if not len(pairs):
        return 0.0, 1.0
    due = run.starts[firsts[pairs[:, 1]]]
    begins = np.array([held.latches[place - 1].begin for place in pairs[:, 0]])
    lines = [_line_through(due, begins, rate) for rate in (1.0, 1.0 + record.drift_ppm * 1e-6)]
    _, offset, rate = max(lines, key=lambda line: line[0])
    return offset, rate


def _line_through(due: FloatArray, begins: FloatArray, rate: float) -> tuple[int, float, float]:
    """Fit begins = rate x due + offset near *rate*; return the frames on it, offset, rate."""
    away = begins - rate * due
    ordered = np.sort(away)
    counts = np.searchsorted(ordered, ordered + _NEAR_PERIODS, side="right") - np.arange(len(away))
    best = int(counts.argmax())
    offset = float(np.median(ordered[best : best + counts[best]]))
    near = np.abs(away - offset) < _NEAR_PERIODS
    if near.sum() >= _FEWEST:
        slope, shift = np.polyfit(due[near], away[near] - offset, 1)
        rate, offset = rate + float(slope), offset + float(shift)
    return int(counts[best]), offset, rate
