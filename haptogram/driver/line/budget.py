"""Capacity of a serial line: bytes of a frame, the time they take, the highest frame rate."""

from __future__ import annotations

import math
from typing import Final

from haptogram.errors import ConfigurationError
from haptogram_protocol.dialects.codec import Dialect
from haptogram_protocol.framing import CRC_BYTES, HEADER_BYTES

BITS_PER_BYTE: Final = 10  # 8N1: start bit, eight data bits, stop bit
_DELIMITERS: Final = 2
_COBS_BLOCK: Final = 254


def frame_bytes_on_line(payload_bytes: int) -> int:
    """Return the most bytes that a frame with this payload takes on the line.

    Byte stuffing adds one byte per started block of 254; two delimiters enclose the frame.
    """
    body = HEADER_BYTES + payload_bytes + CRC_BYTES
    return body + math.ceil(body / _COBS_BLOCK) + _DELIMITERS


def line_transmission_ns(size: int, baudrate: int) -> int:
    """Return the transmission time of *size* bytes at 8N1, in whole nanoseconds, rounded up."""
    return -(-size * BITS_PER_BYTE * 1_000_000_000 // baudrate)


def highest_line_rate_hz(size: int, baudrate: int) -> float:
    """Return the number of frames of *size* bytes that the line carries per second."""
    return baudrate / (size * BITS_PER_BYTE)


def line_round_trip_ns(request: int, reply: int, baudrate: int, latency_timer_ns: int = 0) -> int:
    """Return the longest transmission time of a request and its reply.

    Parameters
    ----------
    request, reply : int
        Bytes of the two frames.
    latency_timer_ns : int
        Delay of a USB adapter at the host for a reply shorter than its packet.
    """
    there_and_back = line_transmission_ns(request, baudrate) + line_transmission_ns(reply, baudrate)
    return there_and_back + latency_timer_ns


def check_line_rate(
    size: int,
    *,
    baudrate: int,
    rate_hz: float,
    remedy: str = "lower the rate, raise baud, or send shorter frames",
) -> None:
    """Refuse a rate that the line cannot carry.

    Parameters
    ----------
    size : int
        Bytes of the longest frame on the line.
    remedy : str
        Advice at the end of the error.

    Raises
    ------
    ConfigurationError
        Naming both rates.
    """
    highest_hz = highest_line_rate_hz(size, baudrate)
    if rate_hz > highest_hz:
        raise ConfigurationError(
            f"rate_hz is {rate_hz:g}; {size} bytes a frame at {baudrate} baud carry "
            f"{math.floor(highest_hz)} frames/s: {remedy}"
        )


def check_dialect_rate(
    dialect: Dialect, boards: int, *, baudrate: int | None, rate_hz: float
) -> None:
    """Refuse a rate that the line of *boards* boards cannot carry; without a line there is none.

    Raises
    ------
    ConfigurationError
        Naming the rate, the bytes of a frame, and the highest rate.
    """
    if dialect.bauds and baudrate is not None:
        check_line_rate(
            dialect.frame_bytes(boards),
            baudrate=baudrate,
            rate_hz=rate_hz,
            remedy="lower the rate, or raise baud if the board can",
        )


class LineBudget:
    """When the bytes that were handed to a port have left it, at a given rate.

    A port takes kilobytes at once (60 ms of a 3 Mbaud line), and few tell how many are still in it;
    so their number follows from the rate.

    Parameters
    ----------
    baudrate : int
        Bits per second.
    """

    def __init__(self, baudrate: int) -> None:
        self.baudrate = int(baudrate)  # which may be one of numpy's, of 32 bits
        self.free_ns = 0

    def add(self, size: int, now_ns: int) -> None:
        """Count *size* bytes handed over at *now_ns*."""
        self.free_ns = max(self.free_ns, now_ns) + line_transmission_ns(size, self.baudrate)

    def unsent_bytes(self, now_ns: int) -> int:
        """Return the number of bytes that have not left the port yet."""
        return self.bytes_in(self.free_ns - now_ns) if self.free_ns > now_ns else 0

    def bytes_in(self, duration_ns: int) -> int:
        """Return the number of whole bytes that the line carries in *duration_ns*."""
        return duration_ns * self.baudrate // (BITS_PER_BYTE * 1_000_000_000)

    def room_at_ns(self, unsent: int) -> int:
        """Return when no more than *unsent* bytes will be left in the port."""
        return self.free_ns - line_transmission_ns(unsent, self.baudrate)
