"""Received bytes, given out frame by frame, at either end of a connection.

A frame is decoded when it is asked for: its meaning may depend on the caller's answer to the frame
before (a HELLO opens the session of the next frame).
"""

from __future__ import annotations

from collections import deque
from typing import Final

from ..cobs import Cobs
from ..errors import LocalProtocolError, RemoteProtocolError
from ..framing import FrameDecoder

#: Bytes that may wait undecoded; more means that the caller does not take the events.
INPUT_LIMIT: Final = 1 << 20
_SLICE: Final = 4096  # bytes decoded at a time: a chunk may hold thousands of damaged frames


class ConnectionInbox:
    """Received bytes of one end of a connection: a bounded queue, cut into frames.

    Attributes
    ----------
    bytes_received : int
        Number of bytes received, of any content.
    """

    def __init__(self, cobs: Cobs, decoder: FrameDecoder | None = None) -> None:
        self._chunks: deque[tuple[bytes, int]] = deque()
        self._received: deque[tuple[bytes | RemoteProtocolError, int]] = deque()
        self._decoder = FrameDecoder(cobs) if decoder is None else decoder
        self._waiting = 0
        self.bytes_received = 0

    def receive_data(self, data: bytes, now_us: int) -> None:
        """Take bytes from the line; no content of them raises an error.

        Parameters
        ----------
        data : bytes
            Any number of bytes.
        now_us : int
            Time, unwrapped, at which the last of them came: of the device, or at a host on the
            clock of its deadlines.

        Raises
        ------
        LocalProtocolError
            If the caller does not take the events (more than 1 MiB of bytes are waiting).
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
        """Number of bytes kept for a frame whose end has not come yet."""
        return self._decoder.buffered

    def _next_frame(self) -> tuple[bytes | RemoteProtocolError, int] | None:
        """Return the next body, or its error, and its arrival time; None if no frame is left."""
        while not self._received and self._chunks:
            chunk, t_us = self._chunks.popleft()
            if len(chunk) > _SLICE:
                self._chunks.appendleft((chunk[_SLICE:], t_us))
                chunk = chunk[:_SLICE]
            self._waiting -= len(chunk)
            for found in self._decoder.feed(chunk):
                self._received.append((found, t_us))
        return self._received.popleft() if self._received else None

    def _forget_received(self) -> None:
        """Forget all bytes and frames that wait: the port was closed."""
        self._chunks.clear()
        self._received.clear()
        self._decoder.reset()
        self._waiting = 0
