"""The drive that a board holds while the due frame is lost or late, and its consequence."""

from __future__ import annotations

import dataclasses
import itertools
import math
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np

from haptogram.acoustics import AcousticModel, Drive
from haptogram.acoustics.field.reference import arrival_at_point
from haptogram.records.frame import Intended, Observation
from haptogram.settings.frozen import dataclass

from ..frame.verdict import JUDGED, Consequence, FrameVerdict, Vector

_MM: Final = 1e3


@dataclass(frozen=True, slots=True)
class HeldFocus:
    """The drive that the board holds until the next latch.

    Attributes
    ----------
    drive : Drive or None
        None: another one than intended, and not seen.
    focus_m : tuple
        Where its focus was found; where that cannot be observed, or was not, where it was wanted.
    t_latch_us : float
        Device time of its begin: a later silence ends it. Infinite: not known.
    """

    drive: Drive | None
    focus_m: Vector
    t_latch_us: float

    @classmethod
    def after(
        cls, intended: Intended, observation: Observation, verdict: FrameVerdict
    ) -> HeldFocus:
        """Return the hold that begins when the frame of *verdict* is latched."""
        unseen = (None, None, None)
        x, y, z = (
            wanted if bound is None or found is None else found
            for wanted, found, bound in zip(
                verdict.target_m,
                verdict.measured_m or unseen,
                verdict.bound_mm or unseen,
                strict=True,
            )
        )
        by_crc = verdict.status in JUDGED and not verdict.faults
        drive = observation.output or (intended.drive if by_crc else None)
        return cls(drive, (x, y, z), observation.t_latch_us)


class DueFrame(NamedTuple):
    """When a frame should have been latched: not before the one, not after the other."""

    earliest_us: float
    latest_us: float


def due_frames_of_consequences(
    intended: Sequence[Intended], latched: Sequence[Sequence[Observation]]
) -> Iterator[DueFrame]:
    """Yield when each frame, with its latches, was due.

    Without a time that is between those known of its neighbours.
    """
    known = [
        latches[0].t_latch_us if latches else wanted.t_apply_us
        for wanted, latches in zip(intended, latched, strict=True)
    ]
    before = itertools.accumulate((-math.inf if t is None else t for t in known), max)
    after = itertools.accumulate((math.inf if t is None else t for t in reversed(known)), min)
    bounds = zip(intended, before, reversed(list(after)), strict=True)
    for wanted, earliest_us, latest_us in bounds:
        due_us = wanted.t_apply_us
        yield DueFrame(earliest_us, latest_us) if due_us is None else DueFrame(due_us, due_us)


def focus_still_held(
    held: HeldFocus | None, due: DueFrame, quiet_us: Sequence[int]
) -> HeldFocus | None:
    """Return the hold that is left of *held* when a frame is due; None: silence."""
    if held is None or _fell_silent(quiet_us, held.t_latch_us, due.earliest_us):
        return None
    if _fell_silent(quiet_us, due.earliest_us, due.latest_us):
        return dataclasses.replace(held, drive=None)  # before the frame or after it: who knows?
    return held


def _fell_silent(quiet_us: Sequence[int], after_us: float, until_us: float) -> bool:
    """Return True if a time of the sorted *quiet_us* is after *after_us*, up to *until_us*."""
    return bisect_right(quiet_us, after_us) < bisect_right(quiet_us, until_us)


def consequence_of_held_focus(
    model: AcousticModel, intended: Intended, held: HeldFocus | None
) -> Consequence | None:
    """Return the consequence of holding *held* while *intended* was due.

    None as *held*: nothing had been latched yet.  None in return: the drive is not known.
    """
    position = np.array(intended.foci[0].position_m)
    wanted, _ = arrival_at_point(model, intended.drive.weights(), position)
    if held is None:
        return Consequence(None, 0.0, wanted)
    if held.drive is None:
        return None
    pressure_rms_pa, _ = arrival_at_point(model, held.drive.weights(), position)
    if held.drive.is_muted:
        return Consequence(None, pressure_rms_pa, wanted)
    away_m = float(np.linalg.norm(position - np.array(held.focus_m)))
    return Consequence(_MM * away_m, pressure_rms_pa, wanted)
