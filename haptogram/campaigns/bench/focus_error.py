"""The distance of the focus from its target while frames were late or lost.

A board holds the last drive until the next latch.  So while a frame is late or lost, the old focus
stands where the new one should be.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class BenchFocusError:
    """Distance of the held focus from the one that was due, over a run.

    Attributes
    ----------
    frames : int
        Number of frames in whose period, or a part of it, an older focus was held.
    held_us : float
        Total time in which an older focus was held, in microseconds.
    greatest_mm : float
        Largest distance in that time.
    mean_mm : float
        Mean distance over that time.
    run_mean_mm : float
        Mean distance over the whole run.
    """

    frames: int
    held_us: float
    greatest_mm: float
    mean_mm: float
    run_mean_mm: float

    def as_dict(self) -> dict[str, Any]:
        """Return the fields for JSON."""
        return {
            "frames": self.frames,
            "held_us": self.held_us,
            "max_mm": self.greatest_mm,
            "mean_mm": self.mean_mm,
            "run_mean_mm": self.run_mean_mm,
        }


def bench_focus_error(
    targets_m: NDArray[np.float64],
    due_us: NDArray[np.int64],
    latched_us: NDArray[np.float64],
    *,
    carrier_us: int,
) -> BenchFocusError:
    """Compare, at every moment from the first due time on, the due focus with the held one.

    Parameters
    ----------
    targets_m : (n, 3) numpy.ndarray
        Focus of each frame, metres.
    due_us : (n,) numpy.ndarray of int
        Rising time at which each frame was due, microseconds.
    latched_us : (n,) numpy.ndarray
        Time of its latch, microseconds; nan for a frame that was never latched.
    carrier_us : int
        Carrier period, microseconds: rounding up to a period is no lateness.
    """
    period_us = float(np.median(np.diff(due_us))) if len(due_us) > 1 else 0.0
    ends = np.append(due_us[1:], due_us[-1] + period_us).astype(np.float64)
    on_time = latched_us - due_us < carrier_us
    # Until the latch of a frame the board holds the newest drive that it latched before.
    until = np.where(
        on_time, due_us, np.fmin(np.where(np.isnan(latched_us), ends, latched_us), ends)
    )
    held_us = np.maximum(0.0, until - due_us)
    before = _newest_bench_latch_before(latched_us)
    seen = (held_us > 0) & (before >= 0)  # before the first latch there was no focus to be wrong
    distance_mm = np.zeros(len(due_us))
    distance_mm[seen] = 1e3 * np.linalg.norm(targets_m[seen] - targets_m[before[seen]], axis=1)
    held = float(held_us[seen].sum())
    weighted = float((held_us * distance_mm).sum())
    return BenchFocusError(
        frames=int(seen.sum()),
        held_us=held,
        greatest_mm=float(distance_mm.max(initial=0.0)),
        mean_mm=weighted / held if held else 0.0,
        run_mean_mm=weighted / float(ends[-1] - due_us[0]) if ends[-1] > due_us[0] else 0.0,
    )


def _newest_bench_latch_before(latched_us: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the index of the newest latched frame before each frame, -1: none."""
    places = np.where(np.isnan(latched_us), -1, np.arange(len(latched_us)))
    newest = np.maximum.accumulate(places)
    return np.concatenate([[-1], newest[:-1]]).astype(np.int64)
