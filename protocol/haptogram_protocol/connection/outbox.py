"""Frames that wait for the line at the board, in bounded memory."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import Final

OUTPUT_LIMIT: Final = 65_536  # bytes that may wait for the line


class ConnectionOutbox:
    """Queue of whole frames; a frame without room is refused, never cut.

    Attributes
    ----------
    waiting : int
        Bytes of the frames in the queue.
    """

    def __init__(self) -> None:
        self._frames: deque[bytes] = deque()
        self.waiting = 0

    def put(self, wire: bytes, limit: int) -> bool:
        """Queue a frame unless more than *limit* bytes would wait then; return True if queued."""
        room = self.waiting + len(wire) <= limit
        if room:
            self._frames.append(wire)
            self.waiting += len(wire)
        return room

    def take(self, limit: int | None = None) -> bytes:
        """Return and forget the oldest frames: at most *limit* bytes, all of them if None."""
        if limit is None or self.waiting <= limit:
            taken = b"".join(self._frames)
            self._frames.clear()
        else:
            taken = b"".join(self._oldest(limit))
        self.waiting -= len(taken)
        return taken

    def _oldest(self, limit: int) -> Iterator[bytes]:
        while self._frames and len(self._frames[0]) <= limit:
            limit -= len(self._frames[0])
            yield self._frames.popleft()
