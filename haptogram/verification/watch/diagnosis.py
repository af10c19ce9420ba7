"""Defects by name, from what latches show without anybody who says what was meant.

A defect is named only if the data prove it: chance, or another defect, would hardly look the same.
"""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Collection, Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics.arrays import FloatArray
from haptogram.acoustics.reconstruct.patterns.found import Pattern, Placed
from haptogram.acoustics.solvers.focus_fit import wrapped_phases
from haptogram.records.remark import UNDECIDED, About

from .defect import Defect, Diagnosis
from .latch import SeenLatch

#: Latches that are kept of each defect, and remarks.
_MOST_KEPT: Final = 10_000
_DETAILS: Final = {
    Defect.NO_COMMIT: "{} whole and never shown",
    Defect.BYTES_LOST: "{} torn",
    Defect.STOPPED: "{} torn by it",
    Defect.OTHER_ARRAY: "{} latches of them",
}
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
            if len(self._latches[defect]) < _MOST_KEPT:
                self._latches[defect].append(latch.number)
        if isinstance(pattern, Placed) and not latch.torn:
            self._take_polarities(latch, pattern)
        return shown

    def diagnoses(self) -> list[Diagnosis]:
        """Return the defects so far."""
        details = {}
        if stray := sorted(self._stray):
            text = f"{len(stray)}, from channel {stray[0]} to {stray[-1]}"
            details[Defect.STRAY_CHANNELS] = text
        for silent, _ in self._silent.most_common(1):
            names = ", ".join(map(str, sorted(silent)[:8])) + (", ..." if len(silent) > 8 else "")
            elements = f"{_watched_elements_text(len(silent))} {names}"
            details[Defect.SILENT] = f"{elements} beside a pattern of all the others"
        if self._latches[Defect.AMPLITUDES_AS_PHASES]:
            text = f"FB and {self._channels} amplitudes came after the phases and replaced them"
            details[Defect.AMPLITUDES_AS_PHASES] = text
        found = [Diagnosis(d, text, tuple(self._latches[d])) for d, text in details.items()]
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
        """Return True if a frame of amplitudes, byte FB and a code per channel, set phases.

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
        """Return the silent elements if they look dead: scattered, at most 20 % of the array.

        Else none: a row, a rim or a half that is off is a part that somebody left out.
        """
        silent = ~(np.abs(np.nan_to_num(latch.weights)) > _SOUNDING)
        is_one = isinstance(pattern, Placed) and self._is_near(pattern) and not latch.torn
        if not is_one or not silent.any() or silent.mean() > _FEW:
            return frozenset()
        if silent[self._neighbours[silent]].mean() > 1.0 - _SCATTERED or self._is_rim(silent):
            return frozenset()
        return frozenset(int(n) for n in np.flatnonzero(silent))

    def _is_near(self, pattern: Placed) -> bool:
        """Return True if a position is certain enough to tell a focus from a plane wave.

        Its error is less than its distance plus the array's radius.
        """
        distance_m = float(np.linalg.norm(np.array(pattern.position_m) - self._centre_m))
        return bool(np.linalg.norm(pattern.bound_m) < distance_m + self._distance_m.max())

    def _is_rim(self, silent: NDArray[np.bool_]) -> bool:
        """Return True if the silent elements are the outermost ones, such as corners."""
        return bool(self._distance_m[silent].min() >= self._distance_m[~silent].max() - _SAME_M)

    def _take_polarities(self, latch: SeenLatch, pattern: Placed) -> None:
        """Record which elements are half a turn off the pattern, to within a phase step."""
        drive = hash(latch.weights.tobytes())
        limit_rad = math.pi / latch.steps
        away = np.abs(np.abs(wrapped_phases(np.array(pattern.outlier_rad))) - np.pi)
        for element, away_rad in zip(pattern.outliers, away.tolist(), strict=True):
            is_half = away_rad <= 2.0 * limit_rad
            self._reversed[element].add(drive, limit_rad, is_half=is_half)
        for element, seen in self._reversed.items():
            if element not in pattern.outliers and abs(latch.weights[element]) > _SOUNDING:
                seen.contradicted = True

    @property
    def reversed_elements(self) -> frozenset[int]:
        """The elements that are proven to be half a turn off."""
        return frozenset(n for n, seen in self._reversed.items() if seen.is_proven)

    def _reversals(self) -> list[Diagnosis]:
        """Return the diagnosis of elements with reversed polarity; [] if none is proven."""
        if not (proven := sorted(self.reversed_elements)):
            return []
        names = ", ".join(map(str, proven[:12])) + (", ..." if len(proven) > 12 else "")
        latches = max((self._reversed[n].drives for n in proven), key=len)
        detail = f"{_watched_elements_text(len(proven))} {names} in {len(latches)} different drives"
        return [Diagnosis(Defect.REVERSED, detail, ())]


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
        """Whether chance hardly (1 in 10 000) turns it by half in each of 2 or more drives."""
        enough = len(self.drives) >= _LEAST_LATCHES and self._log_chance <= math.log(_CHANCE)
        return enough and not self.contradicted


def _watched_elements_text(count: int) -> str:
    """Return "element" for one, "N elements" for several: the numbers follow."""
    return "element" if count == 1 else f"{count} elements,"


def _nearest_elements(positions_m: FloatArray) -> NDArray[np.intp]:
    """Return (N, 4) the indices of the nearest elements of each, the nearest first."""
    found = [
        np.argsort(np.linalg.norm(positions_m - place, axis=1), kind="stable")
        for place in positions_m
    ]
    return np.array(found)[:, 1 : 1 + _NEIGHBOURS]


# --- Frames on the wire: torn, stopped, never shown, of another array ----------------------------


class _FoundDefects:
    """Numbers of latches, and what was counted of those that may be torn."""

    def __init__(self) -> None:
        self.counts: Counter[Defect] = Counter()
        self.latches: dict[Defect, list[int]] = defaultdict(list)
        self.torn: list[tuple[int, str]] = []

    def add(self, defect: Defect, number: int | None, count: int = 1) -> None:
        """Take down *count* latches that show *defect*; *number* None: nothing was latched."""
        self.counts[defect] += count
        latches = [] if number is None else [number]
        self.latches[defect] = (self.latches[defect] + latches)[:_MOST_KEPT]

    def extend(self, other: _FoundDefects, *, without: Collection[Defect] = ()) -> None:
        """Take over what *other* has found."""
        for defect in (defect for defect in other.latches if defect not in without):
            self.counts[defect] += other.counts[defect]
            self.latches[defect] = (self.latches[defect] + other.latches[defect])[:_MOST_KEPT]
        self.torn = (self.torn + other.torn)[:_MOST_KEPT]

    def add_torn(self, latch: SeenLatch) -> None:
        """Keep what was counted of a latch."""
        if len(self.torn) < _MOST_KEPT:
            self.torn.append((latch.number, latch.torn_text))


class FrameDefects:
    """Collects what codecs counted, client by client.

    A defect is named when the board has told all of its client: bytes of another wire
    are no frames that lost something.

    Attributes
    ----------
    remarks : list of str
        Remarks of the board about its clients.
    """

    def __init__(self) -> None:
        self._judged, self._of_client = _FoundDefects(), _FoundDefects()
        self._about: dict[About, str] = {}
        self._undecided: str | None = None
        self._has_whole = self._is_stopped = False
        self._is_own: bool | None = None  # None: not known
        self.remarks: list[str] = []

    def take(self, latch: SeenLatch, *, is_named: bool = False) -> None:
        """Take down a latch; *is_named*: what was counted of it has another name."""
        count = latch.counted.get("frames_without_commit", 0)
        if count and self._is_stopped:
            count -= 1  # that of the client before
        if count:
            self._of_client.add(Defect.NO_COMMIT, latch.number, count)
        if not latch.torn:
            self._has_whole, self._is_stopped = True, False
        elif not is_named:
            defect = Defect.STOPPED if self._is_stopped else Defect.BYTES_LOST
            self._of_client.add(defect, latch.number)
            self._of_client.add_torn(latch)

    def remark(self, about: About, text: str) -> None:
        """Take down what the board says of its client."""
        if len(self.remarks) < _MOST_KEPT:
            self.remarks.append(text)
        self._about.setdefault(about, text)
        self._is_stopped |= about in (About.STOPPED, About.OTHER_WIRE)
        if about is About.NO_COMMIT:
            self._of_client.add(Defect.NO_COMMIT, None, 0)

    def client_left(self) -> None:
        """Judge the frames of the client, and start over with the next client."""
        self._judged = self._so_far()
        self._undecided = self.undecided
        self._of_client, self._about = _FoundDefects(), {}
        self._has_whole, self._is_own = False, None

    def wire_compared(self, *, is_own: bool) -> None:
        """Learn that the bytes of the client look like no other wire, and whether like its own."""
        self._is_own = is_own

    def cut_short(self) -> None:
        """Mark the end of the reports: torn frames of an unknown wire are not judged."""
        if self.waits_for_wire:
            self._is_own = False

    @property
    def waits_for_wire(self) -> bool:
        """True if frames of the client are torn, and the board has not reported their wire yet."""
        is_told = self._is_own is not None or About.OTHER_WIRE in self._about
        return bool(self._of_client.latches) and not is_told

    @property
    def undecided(self) -> str | None:
        """Why the frames of a client are not judged; None: all are."""
        of_client = next((self._about[about] for about in UNDECIDED if about in self._about), None)
        if of_client is None and self._is_own is False and self._of_client.latches:
            of_client = "the client's bytes were not recognised as those of this board"
        if of_client is None and self._may_be_of_another_array:
            of_client = self._about[About.OTHER_SIZE]
        return self._undecided or of_client

    @property
    def torn(self) -> list[tuple[int, str]]:
        """Latches that may be torn, and what was counted of each."""
        return self._so_far().torn

    def diagnoses(self) -> list[Diagnosis]:
        """Return the defects so far."""
        found = self._so_far()
        return [
            Diagnosis(
                defect,
                text.format(found.counts[defect] or "frame after frame"),
                tuple(found.latches[defect]),
            )
            for defect, text in _DETAILS.items()
            if defect in found.latches
        ]

    @property
    def _may_be_of_another_array(self) -> bool:
        """Return True if torn frames suggest that the client sends for an array of another size.

        So it is if the board remarked on frames of another size, and none was whole.
        """
        is_torn = Defect.BYTES_LOST in self._of_client.latches
        sizes = About.OTHER_SIZE in self._about and not self._has_whole
        return is_torn and sizes and About.OTHER_ARRAY not in self._about

    def _so_far(self) -> _FoundDefects:
        """Return the defects found until now in the drives and in the client's frames.

        Bytes lost in a frame are left out if the client sends for another array, as that explains
        them. If its bytes were not for this board, all defects of its frames are left out.
        """
        found, of_client = _FoundDefects(), self._of_client
        found.extend(self._judged)
        if About.OTHER_WIRE in self._about or self._is_own is False:
            return found
        of_another = About.OTHER_ARRAY in self._about
        hidden = [Defect.BYTES_LOST] if of_another or self._may_be_of_another_array else []
        found.extend(of_client, without=hidden)
        if of_another:
            for number in of_client.latches.get(Defect.BYTES_LOST, ()):
                found.add(Defect.OTHER_ARRAY, number)
        return found
