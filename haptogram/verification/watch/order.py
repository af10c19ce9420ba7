"""Which expected frame a latch is, where frames come twice or never came."""

from __future__ import annotations

import dataclasses
from collections import deque
from collections.abc import Iterator
from typing import Final

import numpy as np

from haptogram.acoustics.arrays import FloatArray
from haptogram.acoustics.reconstruct.patterns.found import OneFocus, Pattern

from ..frame.verdict import WRONG, FrameStatus, FrameVerdict
from .defect import Defect, Diagnosis
from .expectation import Expectation
from .latch import SeenLatch

_REMEMBERED: Final = 4  # right latches whose drive may come again
_MOST_MISSING: Final = 3  # frames that may be missing at once
_NEAR_M: Final = 0.01  # distance from a focus to the target of its frame
_MOST: Final = 10_000


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
        self._right: deque[tuple[bytes, int]] = deque(maxlen=_REMEMBERED)
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
            latches = tuple(self._again)[:_MOST]
            found.append(Diagnosis(Defect.AGAIN, f"latch {pairs}", latches))
        if self._never:
            frames = "1 frame" if self._missing == 1 else f"{self._missing} frames"
            detail = f"{frames} in front of those that came"
            found.append(Diagnosis(Defect.NEVER, detail, tuple(self._never)))
        return found

    def _offsets(self, pattern: Pattern) -> Iterator[int]:
        """Yield by how many places the expected order must advance to match a latch.

        They are 1 and more, or -1 where a torn latch may have been counted.
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
        """Advance the expected order by *ahead*; count the frames missing before latch *number*."""
        self._next += ahead
        if ahead > 0:
            self._missing += ahead
            if len(self._never) < _MOST:
                self._never.append(number)
