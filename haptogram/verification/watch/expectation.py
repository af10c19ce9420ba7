"""The foci that a user expects, and the verdict on a latch by them, in their order.

Criteria and bounds are those of :mod:`haptogram.verification.frame`: S1 to S4, for phases of the
steps that the board has. Amplitudes are taken as radiated, so there is no S5; of several foci in a
frame there is S2 alone.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections import deque
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from haptogram.acoustics.arrays import FloatArray, as_point_array
from haptogram.acoustics.field.reference import check_field_points
from haptogram.acoustics.model.model import AcousticModel
from haptogram.acoustics.reconstruct.estimates import as_vector
from haptogram.acoustics.reconstruct.patterns.classifier import PatternClassifier
from haptogram.acoustics.reconstruct.patterns.found import OneFocus, Pattern, SeveralFoci
from haptogram.errors import ConfigurationError
from haptogram.records.frame import FrameKey

from ..frame import criteria
from ..frame.target import FrameTarget, check_frame_tolerance
from ..frame.tolerated import ToleratedHost
from ..frame.verdict import WRONG, FrameStatus, FrameVerdict, Vector
from ..tolerance import Tolerance, Uncertainty
from .defect import Defect, Diagnosis
from .latch import SeenLatch

_FINEST_STEPS: Final = 256
_ROUNDING_RAD: Final = 1e-6
_SOUNDING: Final = 1e-6
_REMEMBERED: Final = 512
_RECENT: Final = 4  # right latches whose drive may come again
_MOST_MISSING: Final = 3  # frames that may be missing at once
_NEAR_M: Final = 0.01  # distance from a focus to the target of its frame
_MOST_NAMED: Final = 10_000


class Expectation:
    """The foci of frame after frame; after the last one the first follows again.

    Parameters
    ----------
    model : AcousticModel
        Array and air.
    frames_m : sequence of (F, 3) array_like
        The foci of each frame, in metres, in the axes of the model; one or several a frame.
    tolerance : Tolerance, optional
        Which misses pass on top of those of rounding; by default none.

    Raises
    ------
    ConfigurationError
        No frame; a point that is no place, behind the array or at one of its elements; a tolerance
        of more than half of the focus.

    Examples
    --------
    >>> expected = Expectation(model, [(0.0, 0.0, 0.15)])
    >>> expected.frame(7).tolist()
    [[0.0, 0.0, 0.15]]
    """

    def __init__(
        self,
        model: AcousticModel,
        frames_m: Sequence[ArrayLike],
        *,
        tolerance: Tolerance | None = None,
    ) -> None:
        if not len(frames_m):
            raise ConfigurationError("frames_m holds no frame, must be at least 1")
        self._model = model
        self._frames = [as_point_array("frames_m", np.atleast_2d(np.asarray(f))) for f in frames_m]
        self.tolerance = Tolerance() if tolerance is None else tolerance
        check_field_points(model, np.concatenate(self._frames))
        check_frame_tolerance(model, np.concatenate(self._frames), self.tolerance)
        self._target = functools.lru_cache(_REMEMBERED)(self._make_target)

    @property
    def frames(self) -> tuple[FloatArray, ...]:
        """The (F, 3) foci of each frame."""
        return tuple(self._frames)

    def frame(self, index: int) -> FloatArray:
        """Return the (F, 3) foci of a frame, counted from 0 without an end."""
        return self._frames[index % len(self._frames)]

    def judge(self, index: int, latch: SeenLatch, pattern: Pattern) -> FrameVerdict:
        """Return the verdict on a latch at which frame *index* is expected."""
        foci = self.frame(index)
        seen = FrameVerdict(
            number=latch.number,
            key=FrameKey(0, 0, 0, latch.number),
            status=FrameStatus.NOT_VERIFIED,
            evidence=latch.evidence,
            target_m=as_vector(foci[0]),
            t_latch_us=latch.t_us,
            latches=1,
        )
        if len(foci) > 1:
            return self._judge_several(seen, foci, pattern)
        return self._judge_one(seen, latch, pattern)

    def _judge_one(self, seen: FrameVerdict, latch: SeenLatch, pattern: Pattern) -> FrameVerdict:
        """Judge a latch where one focus is expected; S2 is left out where phases prove no focus."""
        weights = np.where(np.isfinite(latch.weights), latch.weights, 0.0)
        amplitudes = np.abs(weights)
        if amplitudes.max(initial=0.0) < _SOUNDING:
            return dataclasses.replace(
                seen, status=FrameStatus.WRONG_DRIVE, faults=("nothing was radiated",)
            )
        target = self._target(seen.target_m, amplitudes.tobytes(), latch.steps)
        phases_rad, drive = np.angle(weights), target.drive_of_host
        host = ToleratedHost.nearest(target, Uncertainty(), drive, phases_rad, target.active)
        verdicts, measures = criteria.judge_frame_drive(target, host, weights)
        faults: tuple[str, ...] = ()
        if isinstance(pattern, OneFocus):
            offset_m = np.array(pattern.position_m) - target.position_m
            verdicts["S2"] = criteria.is_frame_on_target(target, offset_m)
            measures |= target.miss(offset_m) | {"pressure_rms_pa": pattern.pressure_rms_pa}
        elif all(verdicts.values()) and not self._shows_focus(target, latch.steps):
            count = int(target.active.sum())
            note = (
                f"{count} elements with {latch.steps} steps do not prove a focus: S2 is not judged"
            )
            return dataclasses.replace(seen, criteria=verdicts, note=note, **measures)
        else:
            verdicts["S2"] = False
            faults = (f"{pattern.kind} where one focus was expected",)
        is_focus, note = isinstance(pattern, OneFocus), ""
        status = criteria.frame_status_of(verdicts, faults, focused=is_focus)
        if status is FrameStatus.ON_TARGET and not target.observable.all():
            status = FrameStatus.NOT_VERIFIED
            note = "the elements that sound cannot tell where the focus is"
        return dataclasses.replace(
            seen,
            status=status,
            criteria=dict(sorted(verdicts.items())),
            faults=faults,
            note=note,
            **target.shown_miss(Uncertainty()) | measures,
        )

    def _shows_focus(self, target: FrameTarget, steps: int) -> bool:
        """Return True if ideal phases, in *steps* a period, are proof of a focus at *target*."""
        step_rad = 2.0 * math.pi / steps
        phases_rad = np.round(target.phases_rad / step_rad) * step_rad
        ideal = np.zeros(len(target.active), dtype=np.complex128)
        ideal[target.active] = np.exp(1j * phases_rad[target.active])
        found = PatternClassifier(self._model, steps).classify(ideal, target.position_m)
        return isinstance(found, OneFocus)

    def _make_target(self, place_m: Vector, amplitudes: bytes, steps: int) -> FrameTarget:
        """Return the target at a place, for amplitudes (float64 bytes) and *steps* in a period."""
        limit_rad = math.pi / min(steps, _FINEST_STEPS) + _ROUNDING_RAD
        levels = np.frombuffer(amplitudes, np.float64)
        return FrameTarget(self._model, np.array(place_m), levels, limit_rad, self.tolerance)

    def _judge_several(
        self, seen: FrameVerdict, foci: FloatArray, pattern: Pattern
    ) -> FrameVerdict:
        """Judge by position alone (S2): WRONG_DRIVE unless as many foci are found as expected.

        OFF_TARGET if one is beyond its bound and tolerance, or two are nearest to one target.
        """
        if not isinstance(pattern, SeveralFoci) or len(pattern.positions_m) != len(foci):
            fault = f"{pattern.kind} where {len(foci)} foci were expected"
            return dataclasses.replace(
                seen, status=FrameStatus.WRONG_DRIVE, criteria={"S2": False}, faults=(fault,)
            )
        places, bounds = np.array(pattern.positions_m), np.array(pattern.bounds_m)
        nearest = np.linalg.norm(places[:, None] - foci, axis=2).argmin(axis=1)
        if len(set(nearest.tolist())) != len(foci):
            return dataclasses.replace(seen, status=FrameStatus.OFF_TARGET, criteria={"S2": False})
        off_m = places - foci[nearest]
        ok = criteria.are_foci_within(off_m, bounds, self.tolerance.miss_mm)
        worst = int(np.linalg.norm(off_m, axis=1).argmax())
        target_m, levels = foci[nearest[worst]], np.ones(self._model.array.count)
        return dataclasses.replace(
            seen,
            status=FrameStatus.ON_TARGET if ok else FrameStatus.OFF_TARGET,
            criteria={"S2": ok},
            target_m=as_vector(target_m),
            **FrameTarget(self._model, target_m, levels, 0.0, Tolerance()).miss(off_m[worst]),
        )


class ExpectedOrder:
    """Counts expected frames, so that one that comes twice or never shifts no other.

    Parameters
    ----------
    expectation : Expectation
        The foci of each frame.
    """

    def __init__(self, expectation: Expectation) -> None:
        self._expectation = expectation
        self._next = 0
        self._after_torn = False
        self._right: deque[tuple[bytes, int]] = deque(maxlen=_RECENT)
        self._again: dict[int, int] = {}  # latch: the one that it repeats
        self._never: list[int] = []  # latches before which a frame is missing
        self._missing = 0

    @property
    def next_foci(self) -> FloatArray:
        """The (F, 3) foci of the frame that is expected next."""
        return self._expectation.frame(self._next)

    def judge(self, latch: SeenLatch, pattern: Pattern) -> tuple[FrameVerdict, FloatArray | None]:
        """Return the verdict on a latch, and the foci of its frame; None: it is no new frame."""
        drive = latch.weights.tobytes()
        verdict = self._expectation.judge(self._next, latch, pattern)
        if verdict.status in WRONG and not latch.torn:
            before = next((number for seen, number in self._right if seen == drive), None)
            if before is not None:
                self._again.setdefault(latch.number, before)
                fault = f"the drive of latch {before} is shown again"
                return dataclasses.replace(verdict, faults=(fault,)), None
            for ahead in self._offsets(pattern):
                found = self._expectation.judge(self._next + ahead, latch, pattern)
                if found.status is FrameStatus.ON_TARGET:
                    verdict = found
                    self._skip(ahead, latch.number)
                    break
        if verdict.status is FrameStatus.ON_TARGET:
            self._right.append((drive, latch.number))
        self._after_torn = bool(latch.torn)
        self._next += 1
        return verdict, self._expectation.frame(self._next - 1)

    def diagnoses(self) -> list[Diagnosis]:
        """Return the frames that came twice, and those that never came."""
        found = []
        if self._again:
            pairs = ", ".join(f"{a} shows {b} again" for a, b in [*self._again.items()][:3])
            latches = tuple(self._again)[:_MOST_NAMED]
            found.append(Diagnosis(Defect.AGAIN, f"latch {pairs}", latches))
        if self._never:
            frames = "1 frame" if self._missing == 1 else f"{self._missing} frames"
            detail = f"{frames} in front of those that came"
            found.append(Diagnosis(Defect.NEVER, detail, tuple(self._never)))
        return found

    def _offsets(self, pattern: Pattern) -> Iterator[int]:
        """Yield by how many places the order must advance to match a latch within 10 mm.

        They are 1 to 3, or -1 where a torn latch may have been counted.
        """
        count = len(self._expectation.frames)
        back = [-1] if self._after_torn else []
        for ahead in (*back, *range(1, _MOST_MISSING + 1)):
            foci = self._expectation.frame(self._next + ahead)
            if not isinstance(pattern, OneFocus) or len(foci) > 1 or ahead % count == 0:
                continue
            if np.linalg.norm(np.array(pattern.position_m) - foci[0]) < _NEAR_M:
                yield ahead

    def _skip(self, ahead: int, number: int) -> None:
        """Advance the order by *ahead*: if positive, frames missing before the latch *number*."""
        self._next += ahead
        if ahead > 0:
            self._missing += ahead
            if len(self._never) < _MOST_NAMED:
                self._never.append(number)
