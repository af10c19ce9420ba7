"""The queue between a stream frame's arrival and its latch.  SPEC.md chapter 5."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from haptogram.acoustics import Drive

from .registers import Content

# These two are not frozen: one of each is made for every frame, in a quarter of the time.


@dataclass(slots=True)
class StreamFrame:
    """A stream frame, its values checked.

    Attributes
    ----------
    index : int
        Unwrapped sequence number.
    t_apply_us : int or None
        Unwrapped device time; None: as soon as possible, before everything that is queued.
    content : Content
        A drive in the resolution it was commanded in, or focal points.
    """

    index: int
    t_apply_us: int | None
    content: Content


@dataclass(slots=True)
class QueueEntry:
    """A stream frame whose drive is ready to be latched.

    Attributes
    ----------
    index : int
        Unwrapped sequence number.
    t_apply_us, t_ready_us, t_latch_us : int
        When it was asked for, when it can be latched at the soonest, and the carrier boundary on
        which it will be.
    late : bool
        Whether it is ready after its t_apply.
    t_received_us : int
        When it was complete.
    drive, commanded_bits
        As in :class:`~sim_device.board.events.Latch`.
    """

    index: int
    t_apply_us: int
    t_ready_us: int
    t_latch_us: int
    late: bool
    t_received_us: int
    drive: Drive
    commanded_bits: int


class BoardQueue:
    """A first-in-first-out queue of bounded depth, never sorted."""

    def __init__(self, depth: int) -> None:
        self._depth = depth
        self._entries: deque[QueueEntry] = deque()

    def __len__(self) -> int:
        return len(self._entries)

    @property
    def head(self) -> QueueEntry | None:
        """The entry that is latched next."""
        return self._entries[0] if self._entries else None

    @property
    def is_full(self) -> bool:
        """True if one more frame finds no room."""
        return len(self._entries) >= self._depth

    def precedes(self, t_apply_us: int) -> bool:
        """Return True if *t_apply_us* is after that of every queued frame."""
        return not self._entries or self._entries[-1].t_apply_us < t_apply_us

    def push(self, entry: QueueEntry) -> int:
        """Queue *entry*; return how many frames it replaced on its carrier boundary (0 or 1)."""
        replaced = 0
        if self._entries and self._entries[-1].t_latch_us == entry.t_latch_us:
            self._entries.pop()
            replaced = 1
        self._entries.append(entry)
        return replaced

    def pop(self) -> QueueEntry:
        """Take the head off the queue."""
        return self._entries.popleft()

    def pass_over(self, t_us: int) -> list[QueueEntry]:
        """Take all entries that are due up to *t_us* off the queue, but for the last of them."""
        entries, passed = self._entries, []
        while len(entries) > 1 and entries[1].t_latch_us <= t_us:
            passed.append(entries.popleft())
        return passed

    @property
    def last_apply_us(self) -> int:
        """The t_apply of the newest entry; 0: there is none."""
        return self._entries[-1].t_apply_us if self._entries else 0

    def flush(self) -> int:
        """Discard every entry; return how many there were."""
        count = len(self._entries)
        self._entries.clear()
        return count
