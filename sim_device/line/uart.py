"""One direction of a serial line: ten bits a byte, one byte after the other.

Times are whole nanoseconds on the clock of the simulation; a byte is there when its stop bit has
ended. Without a baud rate the line takes no time, as a pseudo-terminal does.

A receiver may be more than a wire: :class:`PolledUart` ends in the FIFO of a board's UART,
:class:`UsbUart` in a USB adapter with its latency timer.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from typing import Final, TypeAlias

from haptogram.settings.line import LineSettings

from .sampling import BITS_PER_BYTE, is_baud_understood, sample_uart_characters

USB_PACKET_BYTES: Final = 62  # payload of a 64 byte packet; two bytes hold the modem status
_NS_PER_S: Final = 1_000_000_000
_NS_PER_US: Final = 1_000
_MILLION: Final = 1_000_000

# Data and an index to the index after the first byte from there on that may end a message.
NextEnd: TypeAlias = Callable[[bytes, int], int]


@dataclass(slots=True)
class _Burst:
    """Bytes that travel back to back; ``taken`` of them have been received.

    ``data`` is what the receiver makes of the ``sent`` bytes, more or fewer if it misreads them, in
    the time that those take.
    """

    start_ns: int
    data: bytes
    sent: int
    taken: int = 0


class Uart:
    """A line in one direction.

    Parameters
    ----------
    baud : int or None
        Bits per second; None: no time at all.
    sender_ppm, receiver_ppm : int
        By how much the clock of either end is fast.

    Attributes
    ----------
    overrun : int
        Bytes that were lost because they were not read in time.
    framing : int
        Characters without a stop bit: the rates of the two ends differ too much.
    free_ns : int
        When the last byte has been sent.
    """

    def __init__(self, baud: int | None, *, sender_ppm: int = 0, receiver_ppm: int = 0) -> None:
        sender = None if baud is None else Fraction(baud * (_MILLION + sender_ppm), _MILLION)
        byte_ns = Fraction(0) if sender is None else BITS_PER_BYTE * _NS_PER_S / sender
        self._byte_ns, self._per_bytes = byte_ns.numerator, byte_ns.denominator
        self._ratio = (_MILLION + sender_ppm) / (_MILLION + receiver_ppm)
        self._is_understood = is_baud_understood(self._ratio)
        self._bursts: deque[_Burst] = deque()
        self._in_transit = 0
        self.free_ns = 0
        self._next_ns: int | None = None  # of the first burst, as long as none of it is taken
        self.overrun = self.framing = 0

    @property
    def in_transit(self) -> int:
        """Bytes sent and not yet received."""
        return self._in_transit

    def send(self, data: bytes, t_ns: int) -> None:
        """Put *data* on the line at *t_ns*, after what is there already."""
        if not data:
            return
        received = data
        if not self._is_understood:
            received, errors = sample_uart_characters(data, self._ratio)
            self.framing += errors
        burst = _Burst(max(t_ns, self.free_ns), bytes(received), len(data))
        self.free_ns = self._end_ns(burst, len(received))
        self._bursts.append(burst)
        self._in_transit += len(received)

    def next_event_ns(self, next_frame_end: NextEnd) -> int | None:
        """Return when the next message may have been received, or else the last byte; None: idle.

        Nothing can depend on the bytes before it, so that a frame costs one event and not one for
        every byte.
        """
        if not self._bursts:
            return None
        if self._next_ns is None:
            burst = self._bursts[0]
            self._next_ns = self._end_ns(burst, next_frame_end(burst.data, burst.taken))
        return self._next_ns

    def receive(self, t_ns: int) -> bytes:
        """Return the bytes that are complete by *t_ns*, each once."""
        received = bytearray()
        while self._bursts:
            burst = self._bursts[0]
            there = self._arrived(burst, t_ns)
            if there <= burst.taken < len(burst.data):
                break
            self._next_ns = None
            received += burst.data[burst.taken : there]
            burst.taken = there
            if there < len(burst.data):
                break
            self._bursts.popleft()
        self._in_transit -= len(received)
        return bytes(received)

    def cut(self) -> None:
        """Lose what is on the line."""
        self._bursts.clear()
        self._next_ns = None
        self._in_transit = 0
        self.free_ns = 0

    def arrival_ns(self, count: int) -> int | None:
        """Return when *count* more bytes will have arrived; None: fewer were sent."""
        for burst in self._bursts:
            left = len(burst.data) - burst.taken
            if count <= left:
                return self._end_ns(burst, burst.taken + count)
            count -= left
        return None

    def _end_ns(self, burst: _Burst, count: int) -> int:
        """Return the time at which *count* bytes of *burst* have been received, rounded up."""
        sent_ns = burst.sent * self._byte_ns
        return burst.start_ns - (-count * sent_ns // (len(burst.data) * self._per_bytes))

    def _arrived(self, burst: _Burst, t_ns: int) -> int:
        """Return the number of bytes of a burst that have arrived by *t_ns*."""
        if t_ns < burst.start_ns:
            return 0
        if not self._byte_ns:
            return len(burst.data)
        count = len(burst.data)
        passed = (t_ns - burst.start_ns) * self._per_bytes
        return min(count, passed * count // (burst.sent * self._byte_ns))


class PolledUart(Uart):
    """A line to a UART whose firmware empties the receive FIFO every so often.

    Bytes that arrive while the FIFO is full are lost and counted (``overrun``), often bytes in
    the middle of a frame, whose CRC is wrong then.

    Parameters
    ----------
    fifo : int
        Bytes that it holds.
    poll_ns : int
        How often it is emptied, at the multiples of this time.
    """

    def __init__(
        self, baud: int | None, fifo: int, poll_ns: int, *, sender_ppm: int = 0, receiver_ppm: int
    ) -> None:
        super().__init__(baud, sender_ppm=sender_ppm, receiver_ppm=receiver_ppm)
        self._fifo, self._poll_ns = fifo, poll_ns

    def next_event_ns(self, next_frame_end: NextEnd) -> int | None:
        """Return when the firmware next finds the end of a message in its FIFO."""
        t_ns = super().next_event_ns(next_frame_end)
        return None if t_ns is None else self._next_poll_ns(t_ns)

    def receive(self, t_ns: int) -> bytes:
        """Return the bytes that the firmware has read from its FIFO up to *t_ns*."""
        found = bytearray()
        while (first_ns := self.arrival_ns(1)) is not None:
            if (poll_ns := self._next_poll_ns(first_ns)) > t_ns:
                break
            came = super().receive(poll_ns)
            found += came[: self._fifo]
            self.overrun += max(0, len(came) - self._fifo)
        return bytes(found)

    def _next_poll_ns(self, t_ns: int) -> int:
        """Return the time of the first poll at or after *t_ns*."""
        return -(-t_ns // self._poll_ns) * self._poll_ns


class UsbUart(Uart):
    """A line to a USB serial adapter: bytes reach the host in packets.

    A packet goes to the host when :data:`USB_PACKET_BYTES` are there, or with fewer when the
    latency timer runs out, which starts anew with every packet.  FTDI, AN232B-04, "Data Throughput,
    Latency and Handshaking"; the timer of its chips is 16 ms, unless it is set: 1 ms with the low
    latency mode of Linux.

    Parameters
    ----------
    latency_ns : int
        The latency timer.
    """

    def __init__(self, baud: int | None, latency_ns: int, *, sender_ppm: int = 0) -> None:
        super().__init__(baud, sender_ppm=sender_ppm)
        self._latency_ns = latency_ns
        self._held = b""
        self._sent_ns = 0  # when the last packet went, maybe one without data

    @property
    def in_transit(self) -> int:
        """Bytes sent that the host does not have yet."""
        return self._in_transit + len(self._held)

    def next_event_ns(self, next_frame_end: NextEnd | None = None) -> int | None:  # noqa: ARG002  it knows no frames
        """Return when the next packet goes to the host."""
        full_ns = self.arrival_ns(USB_PACKET_BYTES - len(self._held))
        timer_ns = self._timer_ns()
        return timer_ns if full_ns is None or timer_ns is None else min(full_ns, timer_ns)

    def receive(self, t_ns: int) -> bytes:
        """Return the packets that have gone to the host by *t_ns*."""
        packets = b""
        while (next_ns := self.next_event_ns()) is not None and next_ns <= t_ns:
            runs_out = next_ns == self._timer_ns()
            self._held += super().receive(next_ns)
            count = len(self._held)
            count -= 0 if runs_out else count % USB_PACKET_BYTES
            packets, self._held = packets + self._held[:count], self._held[count:]
            self._sent_ns = next_ns
        return packets

    def cut(self) -> None:
        """Lose what is on the line and in the adapter."""
        super().cut()
        self._held = b""

    def _timer_ns(self) -> int | None:
        """Return when the latency timer next delivers bytes; None if none are held or coming."""
        first_ns = self._sent_ns if self._held else self.arrival_ns(1)
        if first_ns is None:
            return None
        periods = max(1, -(-(first_ns - self._sent_ns) // self._latency_ns))
        return self._sent_ns + periods * self._latency_ns


def uart_to_board(line: LineSettings) -> Uart:
    """Return the direction from host to board."""
    ppm = line.baud_error_ppm
    if line.rx_fifo is None:
        return Uart(line.baud, receiver_ppm=ppm)
    return PolledUart(line.baud, line.rx_fifo, line.poll_us * _NS_PER_US, receiver_ppm=ppm)


def uart_to_host(line: LineSettings) -> Uart:
    """Return the direction from board to host."""
    ppm = line.baud_error_ppm
    if line.latency_us is None:
        return Uart(line.baud, sender_ppm=ppm)
    return UsbUart(line.baud, line.latency_us * _NS_PER_US, sender_ppm=ppm)
