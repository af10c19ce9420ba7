"""Defects of frames on the wire: torn, stopped, never shown, of another array.

Such a defect belongs to a client. It is named when the board has told what is to be told of that
client: bytes of another wire are no frames that lost something.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Collection
from typing import Final

from haptogram.records.remark import UNDECIDED, About

from .defect import Defect, Diagnosis
from .latch import SeenLatch

#: Latches that are kept of each defect, and remarks.
MOST_KEPT: Final = 10_000
_DETAILS: Final = {
    Defect.NO_COMMIT: "{} whole and never shown",
    Defect.BYTES_LOST: "{} torn",
    Defect.STOPPED: "{} torn by it",
    Defect.OTHER_ARRAY: "{} latches of them",
}


class _FoundDefects:
    """Numbers of latches, and what was counted of those that may be torn."""

    def __init__(self) -> None:
        self.counts: Counter[Defect] = Counter()
        self.latches: dict[Defect, list[int]] = defaultdict(list)
        self.torn: list[tuple[int, str]] = []

    def add(self, defect: Defect, number: int | None, count: int = 1) -> None:
        """Take down a latch that shows *defect*; None: nothing was latched."""
        self.counts[defect] += count
        latches = [] if number is None else [number]
        self.latches[defect] = (self.latches[defect] + latches)[:MOST_KEPT]

    def extend(self, other: _FoundDefects, *, without: Collection[Defect] = ()) -> None:
        """Take over what *other* has found."""
        for defect in (defect for defect in other.latches if defect not in without):
            self.counts[defect] += other.counts[defect]
            self.latches[defect] = (self.latches[defect] + other.latches[defect])[:MOST_KEPT]
        self.torn = (self.torn + other.torn)[:MOST_KEPT]

    def add_torn(self, latch: SeenLatch) -> None:
        """Keep what was counted of a latch."""
        if len(self.torn) < MOST_KEPT:
            self.torn.append((latch.number, latch.torn_text))


class FrameDefects:
    """Collects what codecs counted, client by client.

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
        if len(self.remarks) < MOST_KEPT:
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
        """Return True if torn frames, all of another size, suggest that another array was meant."""
        is_torn = Defect.BYTES_LOST in self._of_client.latches
        sizes = About.OTHER_SIZE in self._about and not self._has_whole
        return is_torn and sizes and About.OTHER_ARRAY not in self._about

    def _so_far(self) -> _FoundDefects:
        """Return the defects of the wire until now, without those that a wrong array explains."""
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
