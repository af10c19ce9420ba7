"""The seconds around each violation of a soak, for its recording."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, TypeAlias

from haptogram.records.latch import LatchRecord

from .tally import MOST_KEPT, SoakTally

if TYPE_CHECKING:
    from haptogram.evidence.recordings.writer import RecordingWriter

BEFORE_NS: Final = 2_000_000_000
AFTER_NS: Final = 1_000_000_000

#: Bytes for the board or for the host, or a latch.
Entry: TypeAlias = tuple[int, bool | None, bytes | LatchRecord]


@dataclass(slots=True)
class SoakExcerpt:
    """The seconds around a violation; times are nanoseconds since the power-up of the board."""

    text: str
    until_ns: int
    entries: list[Entry] = field(default_factory=list)

    def write(self, writer: RecordingWriter, start_ns: int) -> None:
        """Write it into a recording, *start_ns* later."""
        from haptogram.evidence.recordings.channels import LINK

        first_ns = self.entries[0][0] if self.entries else 0
        writer.document(LINK, start_ns + first_ns, {"event": "excerpt", "text": self.text})
        for t_ns, to_board, data in self.entries:
            if isinstance(data, LatchRecord):
                writer.latch(data)
            elif to_board:
                writer.to_board(start_ns + t_ns, data)
            else:
                writer.to_host(start_ns + t_ns, data)


class SoakExcerpts:
    """Keeps the last seconds, and all of them as soon as the tally has another violation.

    Parameters
    ----------
    tally : SoakTally
        The account of the segment.
    kept : bool, keyword-only
        Whether anything is kept.
    """

    def __init__(self, tally: SoakTally, *, kept: bool) -> None:
        self.kept = kept
        self._tally, self._found = tally, tally.excerpts
        self._last: deque[Entry] = deque()
        self._violations = 0

    def add(self, t_ns: int, to_board: bool | None, data: bytes | LatchRecord) -> None:
        """Keep bytes that the board or the host took, or a latch, which goes nowhere."""
        if not self.kept:
            return
        self.look(t_ns)
        entry = t_ns, to_board, data
        if self._found and t_ns <= self._found[-1].until_ns:
            self._found[-1].entries.append(entry)
        self._last.append(entry)
        while self._last[0][0] < t_ns - BEFORE_NS:
            self._last.popleft()

    def look(self, t_ns: int) -> None:
        """Begin or extend an excerpt if there is a violation that is new."""
        violations = self._tally.violations.total()
        if violations == self._violations or not self.kept:
            return
        self._violations = violations
        if self._found and t_ns <= self._found[-1].until_ns:
            self._found[-1].until_ns = t_ns + AFTER_NS
        elif len(self._found) < MOST_KEPT:
            text = self._tally.examples[-1]
            self._found.append(SoakExcerpt(text, t_ns + AFTER_NS, list(self._last)))
