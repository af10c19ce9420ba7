"""The latches at which pins take the drives of a run's frames."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics.arrays import FloatArray

from .held.drives import HeldDrives, PinLatch
from .run_drives import Bools, PinRunDrives

#: Longest time from the first to the last pin of a latch: a period, and the error of a cut pulse.
TORN_PERIODS: Final = 1.25
#: A frame is late from here on: one for the boundary that is awaited, one for its pulse in it.
LATE_PERIODS: Final = 2.0
#: Smallest difference of drives that single pulses show: in samples, and as a share of full drive.
_SAMPLES: Final = 8.0
_LEAST_DISTANCE: Final = 0.06


@dataclass(frozen=True, eq=False)
class FrameLatch:
    """The moments at which the pins that a frame moves take its drive; periods of the capture.

    Attributes
    ----------
    due : float
        When the frame is due.
    places : (K,) numpy.ndarray of int
        Places of the pins among the elements; none: no latch was seen.
    after, before : (K,) numpy.ndarray
        Between which times each of them changed.
    is_steady : bool
        Whether each pin changed once: not where the carrier jitters.
    """

    due: float
    places: NDArray[np.int64]
    after: FloatArray
    before: FloatArray
    is_steady: bool

    @cached_property
    def begin(self) -> float:
        """When the first pin has the drive; infinite: no latch was seen."""
        return float(self.before.min(initial=math.inf))

    @property
    def late(self) -> float:
        """Time from when the frame was due to when the first pin has it; 0: not known."""
        return self.begin - self.due if len(self.places) else 0.0

    @property
    def settled(self) -> float:
        """Time from which on all pins have the drive; as far as it is known."""
        return float(self.before.max(initial=-math.inf)) if self.is_steady else -math.inf

    @property
    def apart(self) -> float:
        """Least time from the first pin to the last; 0: all may be one moment."""
        return float((self.after - self.begin).max(initial=0.0)) if self.is_steady else 0.0

    @property
    def behind(self) -> NDArray[np.int64]:
        """Places of the pins that take the drive more than a period after the first."""
        behind: NDArray[np.int64] = self.places[self.after - self.begin > TORN_PERIODS]
        return behind


def latches_of_frames(
    held: HeldDrives, run: PinRunDrives, starts: FloatArray, ends: FloatArray
) -> list[FrameLatch]:
    """Return the latch of each frame, which is due and over at times of the capture."""
    begins = np.array([latch.begin for latch in held.latches])
    firsts = np.searchsorted(begins, starts - LATE_PERIODS)
    lasts = np.searchsorted(begins, ends - LATE_PERIODS)
    least = max(_LEAST_DISTANCE, _SAMPLES * math.pi / held.record.samples)
    moving = np.ones(run.weights.shape, np.bool_)  # what sounds before the run is not known
    moving[1:] = np.abs(np.diff(run.weights, axis=0)) > least
    return [
        _latch_of_frame(due, held.latches[first:last], moves)
        for due, first, last, moves in zip(starts.tolist(), firsts, lasts, moving, strict=True)
    ]


def _latch_of_frame(due: float, latches: list[PinLatch], moving: Bools) -> FrameLatch:
    """Return those that move a pin for the first time; a second time, it is not this frame's."""
    waiting, found = moving.copy(), list[tuple[PinLatch, Bools]]()
    for latch in latches:
        taken = moving[latch.places]
        if taken.any() and waiting[latch.places[taken]].all():
            waiting[latch.places[taken]] = False
            found.append((latch, taken))
    none = np.zeros(0)
    return FrameLatch(
        due,
        np.concatenate([none.astype(np.int64), *(latch.places[taken] for latch, taken in found)]),
        np.concatenate([none, *(latch.after[taken] for latch, taken in found)]),
        np.concatenate([none, *(latch.before[taken] for latch, taken in found)]),
        all(latch.is_steady for latch, _ in found),
    )
