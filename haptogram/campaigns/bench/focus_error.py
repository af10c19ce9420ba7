"""What late frames did in space: how far from its target the focus stood meanwhile.

A board holds the last drive until the next one.  So while a frame is late or lost, the old focus
stands where the new one should be.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class FocusError:
    """Distance of the held focus from the one that was due, over a run.

    Attributes
    ----------
    frames : int
        Frames for whose time, or a part of it, an older focus was held.
    held_us : float
        How long that was altogether, in microseconds.
    greatest_mm : float
        Largest distance meanwhile.
    mean_mm : float
        Mean distance over the time in which an older focus was held.
    run_mean_mm : float
        Mean distance over the whole run.
    """

    frames: int
    held_us: float
    greatest_mm: float
    mean_mm: float
    run_mean_mm: float

    def as_dict(self) -> dict[str, Any]:
        """Return it for JSON."""
        return {
            "frames": self.frames,
            "held_us": self.held_us,
            "max_mm": self.greatest_mm,
            "mean_mm": self.mean_mm,
            "run_mean_mm": self.run_mean_mm,
        }


def focus_error(
    targets_m: NDArray[np.float64],
    due_us: NDArray[np.int64],
    latched_us: NDArray[np.float64],
    *,
    carrier_us: int,
) -> FocusError:
    """Compare, at every moment from the first due time on, the due focus with the held one.

    Parameters
    ----------
    targets_m : (n, 3) numpy.ndarray
        Focus of each frame, metres.
    due_us : (n,) numpy.ndarray of int
        When it was due, rising.
    latched_us : (n,) numpy.ndarray
        When it was latched, nan: never.
    carrier_us : int
        Rounding up to a carrier period is no lateness.
    """
    period_us = float(np.median(np.diff(due_us))) if len(due_us) > 1 else 0.0
    ends = np.append(due_us[1:], due_us[-1] + period_us).astype(np.float64)
    on_time = latched_us - due_us < carrier_us
    # Until its latch a frame's place is taken by the newest one latched before it was due.
    until = np.where(
        on_time, due_us, np.fmin(np.where(np.isnan(latched_us), ends, latched_us), ends)
    )
    held_us = np.maximum(0.0, until - due_us)
    before = _newest_before(latched_us)
    seen = (held_us > 0) & (before >= 0)  # before the first latch there was no focus to be wrong
    distance_mm = np.zeros(len(due_us))
    distance_mm[seen] = 1e3 * np.linalg.norm(targets_m[seen] - targets_m[before[seen]], axis=1)
    held = float(held_us[seen].sum())
    weighted = float((held_us * distance_mm).sum())
    return FocusError(
        frames=int(seen.sum()),
        held_us=held,
        greatest_mm=float(distance_mm.max(initial=0.0)),
        mean_mm=weighted / held if held else 0.0,
        run_mean_mm=weighted / float(ends[-1] - due_us[0]) if ends[-1] > due_us[0] else 0.0,
    )


def _newest_before(latched_us: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return for each frame the newest one before it that was latched at all, -1: none."""
    places = np.where(np.isnan(latched_us), -1, np.arange(len(latched_us)))
    newest = np.maximum.accumulate(places)
    return np.concatenate([[-1], newest[:-1]]).astype(np.int64)
