"""Defects by name, from what latches show without anybody who says what was meant.

A defect is named only if the data prove it: chance, or another defect, would hardly look the same.
"""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics.arrays import FloatArray
from haptogram.acoustics.reconstruct.patterns.found import Pattern, Placed
from haptogram.acoustics.solvers.focus_fit import wrapped_phases

from .defect import Defect, Diagnosis
from .frames import MOST_KEPT, FrameDefects
from .latch import SeenLatch

_SOUNDING: Final = 1e-6
_FEW: Final = 0.2  # share of the elements that can be off by mistake; more are a part of the array
_NEIGHBOURS: Final = 4
_SCATTERED: Final = 0.65  # share of the neighbours of silent elements that sound
_MOST_SETS: Final = 1000  # most sets of silent elements that are compared
_SAME_M: Final = 1e-6
_CHANCE: Final = 1e-4  # probability that so many wrong elements are all half a turn off
_LEAST_LATCHES: Final = 2  # least different drives that show an element reversed
_FB_BYTES: Final = 1  # bytes FB before the amplitudes
_FB_LARGEST: Final = 16 / 32  # turns: the largest amplitude of SimpleFPGA, taken for a phase


class DefectFinder:
    """Collects what latches show of defects that need no expectation.

    It keeps numbers and counts, but no drive: its memory does not grow with their length.

    Parameters
    ----------
    positions_m : (N, 3) numpy.ndarray
        Places of the elements.
    channels : int
        Channels of one board.

    Attributes
    ----------
    frames : FrameDefects
        Defects of frames by the counts of codecs.
    """

    def __init__(self, positions_m: FloatArray, channels: int) -> None:
        self._neighbours = _nearest_elements(positions_m)
        self._centre_m: FloatArray = positions_m.mean(axis=0)
        self._distance_m = np.linalg.norm(positions_m - positions_m.mean(axis=0), axis=1)
        self._channels = channels
        self._latches: dict[Defect, list[int]] = defaultdict(list)
        self._stray: set[int] = set()
        self._silent: Counter[frozenset[int]] = Counter()
        self._reversed: dict[int, _WatchedPolarity] = defaultdict(_WatchedPolarity)
        self.frames = FrameDefects()

    def take(self, latch: SeenLatch, pattern: Pattern) -> tuple[Defect, ...]:
        """Take down a latch, and return the defects that its drive shows by itself."""
        if not latch.is_of_client:
            return ()
        shown = tuple(self._shown(latch, pattern))
        self.frames.take(latch, is_named=Defect.AMPLITUDES_AS_PHASES in shown)
        for defect in shown:
            if len(self._latches[defect]) < MOST_KEPT:
                self._latches[defect].append(latch.number)
        if isinstance(pattern, Placed) and not latch.torn:
            self._take_polarities(latch, pattern)
        return shown

    def diagnoses(self) -> list[Diagnosis]:
        """Return the defects so far."""
        details: dict[Defect, Callable[[], str]] = {
            Defect.STRAY_CHANNELS: self._stray_text,
            Defect.SILENT: self._silent_text,
            Defect.AMPLITUDES_AS_PHASES: self._amplitude_text,
        }
        found = [
            Diagnosis(defect, detail(), tuple(self._latches[defect]))
            for defect, detail in details.items()
            if self._latches[defect]
        ]
        return found + self.frames.diagnoses() + self._reversals()

    # --- one latch -------------------------------------------------------------------------------

    def _shown(self, latch: SeenLatch, pattern: Pattern) -> Iterator[Defect]:
        """Yield the defects of a drive: stray channels, amplitudes as phases, silent elements."""
        if latch.stray:
            self._stray.update(latch.stray)
            yield Defect.STRAY_CHANNELS
        if self._is_amplitude_frame(latch):
            yield Defect.AMPLITUDES_AS_PHASES
        if silent := self._silent_beside(latch, pattern):
            if silent in self._silent or len(self._silent) < _MOST_SETS:
                self._silent[silent] += 1
            yield Defect.SILENT

    def _is_amplitude_frame(self, latch: SeenLatch) -> bool:
        """Return True if a frame of amplitudes was written as phases: FB and a code per channel.

        Two frames in one would have a code less, and amplitudes are at most 16.
        """
        beyond = latch.counted.get("codes_beyond_array", 0)
        strange = latch.counted.get("codes_out_of_range", 0)
        if beyond != self._channels + _FB_BYTES or strange != _FB_BYTES:
            return False
        sounding = np.abs(latch.weights) > _SOUNDING
        turns = np.angle(latch.weights[sounding]) / (2.0 * np.pi)
        # The middle of the pulse is a quarter of a turn behind its rise.
        rises = np.mod(turns - 0.25 + 1e-6, 1.0) if len(turns) else np.zeros(1)
        return bool(rises.max() <= _FB_LARGEST + 1e-3)

    def _silent_beside(self, latch: SeenLatch, pattern: Pattern) -> frozenset[int]:
        """Return silent elements scattered among those that form a pattern.

        A row, a rim or a half of the array that is off is a part of it that somebody left out.
        """
        silent = ~(np.abs(np.nan_to_num(latch.weights)) > _SOUNDING)
        is_one = isinstance(pattern, Placed) and self._is_near(pattern) and not latch.torn
        if not is_one or not silent.any() or silent.mean() > _FEW:
            return frozenset()
        if silent[self._neighbours[silent]].mean() > 1.0 - _SCATTERED or self._is_rim(silent):
            return frozenset()
        return frozenset(int(n) for n in np.flatnonzero(silent))

    def _is_near(self, pattern: Placed) -> bool:
        """Return False if the position is too uncertain to tell a focus from a plane wave."""
        distance_m = float(np.linalg.norm(np.array(pattern.position_m) - self._centre_m))
        return bool(np.linalg.norm(pattern.bound_m) < distance_m + self._distance_m.max())

    def _is_rim(self, silent: NDArray[np.bool_]) -> bool:
        """Return True if the silent elements are the outermost ones, such as corners."""
        return bool(self._distance_m[silent].min() >= self._distance_m[~silent].max() - _SAME_M)

    def _take_polarities(self, latch: SeenLatch, pattern: Placed) -> None:
        """Record which elements are half a turn off the pattern."""
        drive = hash(latch.weights.tobytes())
        limit_rad = math.pi / latch.steps
        off = _half_turned_outliers(pattern, limit_rad)
        for element, is_half in zip(pattern.outliers, off, strict=True):
            self._reversed[element].add(drive, limit_rad, is_half=is_half)
        for element, seen in self._reversed.items():
            if element not in pattern.outliers and abs(latch.weights[element]) > _SOUNDING:
                seen.contradicted = True

    @property
    def reversed_elements(self) -> frozenset[int]:
        """The elements that are proven to be half a turn off."""
        return frozenset(n for n, seen in self._reversed.items() if seen.is_proven)

    def _reversals(self) -> list[Diagnosis]:
        """Return the diagnosis of elements with reversed polarity."""
        if not (proven := sorted(self.reversed_elements)):
            return []
        names = ", ".join(map(str, proven[:12])) + (", ..." if len(proven) > 12 else "")
        latches = max((self._reversed[n].drives for n in proven), key=len)
        detail = f"{_watched_elements_text(len(proven))} {names} in {len(latches)} different drives"
        return [Diagnosis(Defect.REVERSED, detail, ())]

    # --- texts -----------------------------------------------------------------------------------

    def _stray_text(self) -> str:
        """Return the number of stray channels, the first and the last as text."""
        numbers = sorted(self._stray)
        return f"{len(numbers)}, from channel {numbers[0]} to {numbers[-1]}"

    def _silent_text(self) -> str:
        """Return the silent elements that were seen most often as text."""
        (silent, _), *_ = self._silent.most_common(1)
        names = ", ".join(map(str, sorted(silent)[:8])) + (", ..." if len(silent) > 8 else "")
        return f"{_watched_elements_text(len(silent))} {names} beside a pattern of all the others"

    def _amplitude_text(self) -> str:
        """Return the text that amplitudes were written over the phases."""
        return f"FB and {self._channels} amplitudes came after the phases and replaced them"


class _WatchedPolarity:
    """What is seen of one element that is not in step."""

    def __init__(self) -> None:
        self.drives: set[int] = set()
        self.contradicted = False
        self._log_chance = 0.0

    def add(self, drive: int, limit_rad: float, *, is_half: bool) -> None:
        """Take down one drive with the element off; the same drive again proves nothing."""
        if not is_half:
            self.contradicted = True
        elif drive not in self.drives and len(self.drives) < 64:
            self.drives.add(drive)
            self._log_chance += math.log(min(1.0, 4.0 * limit_rad / (2.0 * math.pi)))

    @property
    def is_proven(self) -> bool:
        """Whether chance would hardly turn it by half in each of these drives."""
        enough = len(self.drives) >= _LEAST_LATCHES and self._log_chance <= math.log(_CHANCE)
        return enough and not self.contradicted


def _half_turned_outliers(pattern: Placed, limit_rad: float) -> list[bool]:
    """Return, for each outlier, whether it is within 2 *limit_rad* of half a turn off."""
    off: FloatArray = np.abs(np.abs(wrapped_phases(np.array(pattern.outlier_rad))) - np.pi)
    return [bool(value <= 2.0 * limit_rad) for value in off]


def _watched_elements_text(count: int) -> str:
    """Return "element" for one, "N elements" for several: the numbers follow."""
    return "element" if count == 1 else f"{count} elements,"


def _nearest_elements(positions_m: FloatArray) -> NDArray[np.intp]:
    """Return (N, 4) the nearest elements of each."""
    found = [
        np.argsort(np.linalg.norm(positions_m - place, axis=1), kind="stable")
        for place in positions_m
    ]
    return np.array(found)[:, 1 : 1 + _NEIGHBOURS]
