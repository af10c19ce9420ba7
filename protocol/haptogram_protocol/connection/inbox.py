"""Received bytes, given out frame by frame, at either end of a connection.

A frame is decoded when it is asked for: its meaning may depend on the caller's answer to the frame
before (a HELLO opens the session of the next frame).
"""

from __future__ import annotations

from collections import deque
from typing import Final

from ..errors import LocalProtocolError, RemoteProtocolError
from ..framing import FrameDecoder

#: Bytes that may wait undecoded; more means that the caller does not take the events.
INPUT_LIMIT: Final = 1 << 20
_SLICE: Final = 4096  # bytes decoded at a time: a chunk may hold thousands of damaged frames


class ConnectionInbox:
    """Bounded queue of received chunks, cut into frames on demand."""

    def __init__(self, decoder: FrameDecoder) -> None:
        self._chunks: deque[tuple[bytes, int]] = deque()
        self._frames: deque[tuple[bytes | RemoteProtocolError, int]] = deque()
        self._decoder = decoder
        self._waiting = 0
        self.bytes_received = 0

    def receive(self, data: bytes, now_us: int) -> None:
        """Keep *data*, of any content.

        Raises
        ------
        LocalProtocolError
            If :data:`INPUT_LIMIT` bytes are waiting to be asked for.
        """
        if self._waiting >= INPUT_LIMIT:
            raise LocalProtocolError(
                f"{self._waiting} bytes wait; take the events first, the limit is {INPUT_LIMIT}"
            )
        if data:
            self._chunks.append((bytes(data), now_us))
            self._waiting += len(data)
            self.bytes_received += len(data)

    @property
    def buffered(self) -> int:
        """Number of bytes of a frame whose end has not come yet."""
        return self._decoder.buffered

    def next_frame(self) -> tuple[bytes | RemoteProtocolError, int] | None:
        """Return the next body, or its error, and its arrival time; None if no frame is left."""
        while not self._frames and self._chunks:
            chunk, t_us = self._chunks.popleft()
            head, rest = chunk[:_SLICE], chunk[_SLICE:]
            if rest:
                self._chunks.appendleft((rest, t_us))
            self._waiting -= len(head)
            for found in self._decoder.feed(head):
                self._frames.append((found, t_us))
        return self._frames.popleft() if self._frames else None

    def reset(self) -> None:
        """Forget all bytes and frames that wait: the port was closed."""
        self._chunks.clear()
        self._frames.clear()
        self._decoder.reset()
        self._waiting = 0
