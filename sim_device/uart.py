"""One direction of a serial line: ten bits a byte, one byte after the other.

Times are whole nanoseconds on the clock of the simulation; a byte is there when its stop bit has
ended. Without a baud rate the line takes no time, as a pseudo-terminal does.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Final

_BITS_PER_BYTE: Final = 10  # start bit, 8 data bits, stop bit
_NS_PER_S: Final = 1_000_000_000


@dataclass(slots=True)
class _Burst:
    """Bytes that travel back to back; ``taken`` of them have been received."""

    start_ns: int
    data: bytes
    taken: int = 0


class Line:
    """A line in one direction.

    Parameters
    ----------
    baud : int or None
        Bits per second; None: no time at all.
    """

    def __init__(self, baud: int | None) -> None:
        self._baud = baud
        self._bursts: deque[_Burst] = deque()
        self._in_transit = 0
        self._free_ns = 0

    @property
    def free_ns(self) -> int:
        """When the last byte has been sent."""
        return self._free_ns

    @property
    def in_transit(self) -> int:
        """Bytes sent and not yet received."""
        return self._in_transit

    def send(self, data: bytes, t_ns: int) -> None:
        """Put *data* on the line at *t_ns*, behind what is there already."""
        if not data:
            return
        start_ns = max(t_ns, self._free_ns)
        self._bursts.append(_Burst(start_ns, bytes(data)))
        self._in_transit += len(data)
        self._free_ns = self._end_ns(start_ns, len(data))

    def next_delimiter_ns(self, delimiter: bytes) -> int | None:
        """Return when the next *delimiter* has been received, or else the last byte; None: idle.

        Nothing can depend on the bytes before it, so that a frame costs one event and not one for
        every byte.
        """
        if not self._bursts:
            return None
        burst = self._bursts[0]
        found = burst.data.find(delimiter, burst.taken)
        count = len(burst.data) if found < 0 else found + 1
        return self._end_ns(burst.start_ns, count)

    def receive(self, t_ns: int) -> bytes:
        """Return the bytes that are complete by *t_ns*, each once."""
        received = bytearray()
        while self._bursts:
            burst = self._bursts[0]
            there = self._arrived(burst, t_ns)
            received += burst.data[burst.taken : there]
            burst.taken = max(burst.taken, there)
            if burst.taken < len(burst.data):
                break
            self._bursts.popleft()
        self._in_transit -= len(received)
        return bytes(received)

    def cut(self) -> None:
        """Lose what is on the line."""
        self._bursts.clear()
        self._in_transit = 0
        self._free_ns = 0

    def _end_ns(self, start_ns: int, count: int) -> int:
        """Return when *count* bytes that start at *start_ns* have been sent, rounded up."""
        if self._baud is None:
            return start_ns
        return start_ns - (-count * _BITS_PER_BYTE * _NS_PER_S // self._baud)

    def _arrived(self, burst: _Burst, t_ns: int) -> int:
        if t_ns < burst.start_ns:
            return 0
        if self._baud is None:
            return len(burst.data)
        whole = (t_ns - burst.start_ns) * self._baud // (_BITS_PER_BYTE * _NS_PER_S)
        return min(len(burst.data), whole)
