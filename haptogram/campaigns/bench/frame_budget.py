"""The time budget of one frame: each stage measured on this machine in a fraction of a second."""

from __future__ import annotations

import contextlib
import itertools
import os
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from haptogram.driver.line import budget
from haptogram.driver.timing.realtime import PeriodicLoop
from haptogram.errors import ConfigurationError
from haptogram.machine.posix import posix_module
from haptogram.machine.process import real_time_process
from haptogram_protocol import FrameDecoder, encode_frame, messages
from haptogram_protocol.cobs import Stuffing, fastest_cobs

_TIMES: Final = 400  # repetitions of a stage; the median counts
_TICKS: Final = 100
_LONGEST_NS: Final = 10**12  # limit of the ticks on a machine that misses most of them
_SETTLE: Final = 20  # repetitions to warm up
_CARRIER_NS: Final = 25_000  # a frame waits for the next period of a 40 kHz carrier at most


@dataclass(frozen=True, slots=True)
class FrameBudget:
    """The cost of one frame in nanoseconds, and the highest rates of line and host.

    Attributes
    ----------
    name : str
        Format of the frame.
    size : int
        Largest number of bytes on the line.
    encode_ns, write_ns, decode_ns : int
        Median on this machine.
    wire_ns : int
        Time on the line, from the baud rate.
    line_hz : float
        Rate at which the line is full.
    host_hz : float
        Rate at which encoding and writing take all of the host's time.
    """

    name: str
    size: int
    encode_ns: int
    write_ns: int
    wire_ns: int
    decode_ns: int
    line_hz: float
    host_hz: float

    @property
    def highest_hz(self) -> float:
        """The highest rate that fits: stages overlap, so the slowest one decides."""
        return min(self.line_hz, self.host_hz)

    def latency_ns(self, wake_ns: int) -> int:
        """Return the time from the intended moment to the latch, at most one carrier later."""
        parts = (wake_ns, self.encode_ns, self.write_ns, self.wire_ns, self.decode_ns, _CARRIER_NS)
        return sum(parts)


def bench_frame_formats(transducers: int) -> dict[str, messages.Message]:
    """Return a message of every frame format with contents as varied as those of a focus."""
    codes = np.random.default_rng(0).integers(0, 256, transducers, dtype=np.uint8)
    formats: dict[str, messages.Message] = {
        "phases": messages.Phases(codes.tobytes()),
        "phases and amplitudes": messages.Drives(codes.tobytes() * 2),
    }
    for count in (1, 8):
        point = messages.FocalPoint(12_345, -23_456, 150_000, 65_535, 0)
        name = "1 focal point" if count == 1 else f"{count} focal points"
        formats[name] = messages.Points((point,) * count)
    return formats


def measure_frame_budget(name: str, message: messages.Message, *, baudrate: int) -> FrameBudget:
    """Measure the cost of a frame of *message*.

    Raises
    ------
    ConfigurationError
        If *baudrate* is not positive.
    """
    if baudrate < 1:
        raise ConfigurationError(f"baud is {baudrate}, must be 1 or more")
    cobs = fastest_cobs()
    wire = _encode_budget_frame(message, cobs.encode)
    encode_ns = _median_time_ns(lambda: _encode_budget_frame(message, cobs.encode))
    decoder = FrameDecoder(cobs)
    decode_ns = _median_time_ns(lambda: _decode_budget_frame(decoder, wire))
    with _drained_budget_pty() as (fd, drain):
        write_ns = _median_time_ns(lambda: os.write(fd, wire), between=lambda: drain(len(wire)))
    size = budget.frame_bytes_on_line(
        len(messages.build_body(message, flags=0, seq=0, time_us=0, session=1)) - 10
    )
    return FrameBudget(
        name=name,
        size=size,
        encode_ns=encode_ns,
        write_ns=write_ns,
        wire_ns=budget.line_transmission_ns(size, baudrate),
        decode_ns=decode_ns,
        line_hz=budget.highest_line_rate_hz(size, baudrate),
        host_hz=1e9 / (encode_ns + write_ns),
    )


def measure_budget_wake_ns(rate_hz: float) -> int:
    """Return the median lateness of a sleeping loop at *rate_hz*, on this machine now."""
    period_ns = round(1e9 / rate_hz)
    period_ns = min(period_ns, 5_000_000)  # a slow rate would take long
    loop = PeriodicLoop(time.monotonic_ns, _sleep_until_budget_deadline, period_ns=period_ns)
    with real_time_process():
        start_ns = time.monotonic_ns() + period_ns
        ticks = loop.ticks(start_ns, start_ns + _LONGEST_NS)  # a busy machine misses some
        measured = list(itertools.islice(ticks, _SETTLE, _SETTLE + _TICKS))
    return int(np.median([tick.wake_ns - tick.deadline_ns for tick in measured]))


def _sleep_until_budget_deadline(deadline_ns: int) -> None:
    """Sleep until *deadline_ns* of the monotonic clock; return at once if it has passed."""
    wait_ns = deadline_ns - time.monotonic_ns()
    if wait_ns > 0:
        time.sleep(wait_ns / 1e9)


def _encode_budget_frame(message: messages.Message, stuff: Stuffing) -> bytes:
    """Return the bytes of a frame of *message*, stuffed by *stuff*: the work that is timed."""
    body = messages.build_body(message, flags=0, seq=4711, time_us=123_456_789, session=77)
    return encode_frame(body, stuff)


def _decode_budget_frame(decoder: FrameDecoder, wire: bytes) -> None:
    """Decode the frame in *wire* and parse its message: the work that is timed."""
    for body in decoder.feed(wire):
        assert isinstance(body, bytes)
        messages.parse_body(body)


def _median_time_ns(work: Callable[[], object], between: Callable[[], object] | None = None) -> int:
    """Return the median time of 400 calls of *work*; *between*, if given, runs untimed.

    It runs after each call.
    """
    clock, taken = time.perf_counter_ns, []
    for _ in range(_SETTLE + _TIMES):
        begin_ns = clock()
        work()
        taken.append(clock() - begin_ns)
        if between is not None:
            between()
    return int(np.median(taken[_SETTLE:]))


@contextlib.contextmanager
def _drained_budget_pty() -> Iterator[tuple[int, Callable[[int], None]]]:
    """Yield a pseudo-terminal to write to, and a function that reads a number of bytes back."""
    tty = posix_module("tty", "the stage of a pty", "bench of a port")
    master, slave = os.openpty()
    try:
        for fd in (master, slave):
            tty.setraw(fd)

        def drain(size: int) -> None:
            while size > 0:  # the written bytes arrive a little later
                size -= len(os.read(master, size))

        yield slave, drain
    finally:
        os.close(slave)
        os.close(master)
