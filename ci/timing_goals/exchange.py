"""The rate of frames of which the board's trace confirms every latch.

The CRC-32 of the latched drive is compared with that of the intended one, frame by frame.
"""

from __future__ import annotations

import contextlib
import dataclasses
import secrets
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from haptogram.campaigns.bench.measure import bench_circle
from haptogram.driver.frames.builder import FrameBuilder
from haptogram.driver.frames.targets import as_frame_foci
from haptogram.driver.identity import model_of_identity, read_identified_array
from haptogram.driver.line.link import Link, open_line_session
from haptogram.driver.line.port import open_transport
from haptogram.driver.stream import Streamer, StreamPacing
from haptogram.driver.timing.clock import ClockEstimate
from haptogram.driver.timing.pings import Pinger
from haptogram.driver.timing.schedule import Schedule
from haptogram.errors import NoAnswerError
from haptogram.machine.process import real_time_process
from haptogram.records.frame import Intended
from haptogram.records.kept import KeptRecords
from haptogram_protocol import HostConnection
from haptogram_protocol.cobs import fastest_cobs
from haptogram_protocol.connection import EventReceived, FrameDropped, ReplyReceived
from haptogram_protocol.messages import (
    Arm,
    ArmReply,
    Config,
    ConfigReply,
    GetConfig,
    GetStatus,
    MuteReply,
    Ping,
    Pong,
    SetConfig,
    SetConfigReply,
    StatusReply,
    Trace,
    TraceMode,
)

_UNPACED: Final = 1_000_000_000  # bits per second: a pty carries bytes as fast as they come
_SETTLING_NS: Final = 200_000_000  # for the last traces
_LOWEST_HZ: Final = 1000.0
_HIGHEST_HZ: Final = 40_000.0  # of the carrier: a board latches no faster
_TRIES: Final = 3
_WAIT_NS: Final = 2_000_000_000
_LEADS_US: Final = (8_000, 7_000, 6_000, 5_000, 4_000)  # what the board may stall without a loss
_ROOM: Final = 8  # frames for which the board's queue keeps room
_SMALL: Final = 4  # parts of the queue: a slow machine decodes no more within its lead
_LOST_NS: Final = 20_000_000  # after which frames on their way count as lost


@dataclass(frozen=True, slots=True)
class Exchange:
    """The frames of one exchange, and how many of them were verified.

    Attributes
    ----------
    frames : int
        Number of frames that were sent.
    verified : int
        Number of frames of which the board latched the intended drive.
    seconds : float
        Duration.
    trips_us : (n,) numpy.ndarray
        From handing over a frame to the trace of its latch, in microseconds.
    """

    frames: int
    verified: int
    seconds: float
    trips_us: NDArray[np.float64]

    @property
    def rate_hz(self) -> float:
        """Frames per second."""
        return self.frames / self.seconds


class Exchanger:
    """A session that waits for the trace of every frame.

    Parameters
    ----------
    link : Link
        Open session.
    frames : int
        Number of different frames; the exchanger sends them again and again.
    """

    def __init__(self, link: Link, frames: int = 256) -> None:
        self._link = link
        identity = open_line_session(link)
        model = model_of_identity(read_identified_array(link, identity), identity)
        config: Config = link.request(GetConfig(), ConfigReply).config
        wanted = SetConfig(dataclasses.replace(config, trace_mode=TraceMode.CRC))
        link.request(wanted, SetConfigReply)
        self._clock = ClockEstimate(identity.clock_ppm)
        self._pinger = Pinger(link, self._clock)
        self._frames = FrameBuilder(model, identity).build(
            as_frame_foci(bench_circle(frames, 1000.0)), "phases"
        )
        self._intended = KeptRecords[Intended](None)
        self._streamer = Streamer(
            link, self._pinger, identity, intended=self._intended, status=lambda: None
        )
        self.queue_depth = identity.queue_depth
        self._carrier_us = -(-1_000_000 // identity.carrier_hz)
        self._traced: dict[int, tuple[int, int]] = {}  # by index: CRC, when it came
        self._newest = 0  # index of the last one
        link.handler = self._take
        self._pinger.synchronise()

    def round_trips_us(self, count: int) -> NDArray[np.float64]:
        """Return (count,) round trips of a ping through the whole driver, in microseconds."""
        link, trips = self._link, np.zeros(count)
        with real_time_process():
            for number in range(count):
                begin_ns = link.now_ns()
                link.request(Ping(number), Pong)
                trips[number] = (link.now_ns() - begin_ns) / 1e3
        return trips

    def closed_loop(self, count: int) -> Exchange:
        """Send *count* frames, each as soon as the latch of the one before it was confirmed.

        Raises
        ------
        NoAnswerError
            The board fell silent.
        """
        link = self._begin()
        trips_ns = []
        with real_time_process():
            begin_ns = link.now_ns()
            for number in range(count):
                sent_ns = link.now_ns()
                sent = self._streamer.send_now(self._frames[number % len(self._frames)])
                self._wait_for(sent.key.index)
                trips_ns.append(self._traced[sent.key.index][1] - sent_ns)
            seconds = (link.now_ns() - begin_ns) / 1e9
        return Exchange(count, self._verified(), seconds, np.array(trips_ns) / 1e3)

    def pipelined(self, count: int, window: int, lead_us: int = _LEADS_US[0]) -> Exchange:
        """Send *count* frames as fast as they are confirmed, *window* of them on their way.

        Each frame is due at a time of its own, no two within one carrier period, or the board would
        latch the later one only.
        """
        link, due_us = self._begin(), 0
        with real_time_process():
            begin_ns = link.now_ns()
            for number in range(count):
                soon_us = self._clock.to_device_us(link.now_ns()) + lead_us
                due_us = max(due_us + self._carrier_us, soon_us)
                frame = self._frames[number % len(self._frames)]
                sent = self._streamer.send_for(frame, due_us).key.index
                self._wait_until_traced(sent - window)
            self._wait_until_traced(sent)
            seconds = (link.now_ns() - begin_ns) / 1e9
        return Exchange(count, self._verified(), seconds, np.zeros(0))

    def _wait_until_traced(self, index: int) -> None:
        """Wait until this frame or a later one is traced, or must be lost."""
        deadline_ns = self._link.now_ns() + _LOST_NS
        while self._newest < index:
            self._link.turn(deadline_ns)
            if self._link.now_ns() >= deadline_ns:
                self._newest = index

    def streamed(self, count: int, rate_hz: float) -> Exchange:
        """Stream *count* frames at *rate_hz*, and wait for the traces of their latches."""
        link = self._begin()
        frames = [self._frames[number % len(self._frames)] for number in range(count)]
        schedule = Schedule.at_rate(rate_hz, None, queue_depth=self.queue_depth)
        begin_ns = link.now_ns()
        self._streamer.stream(
            frames, schedule, StreamPacing(), None, lambda: link.request(GetStatus(), StatusReply)
        )
        link.run_until(link.now_ns() + _SETTLING_NS)
        seconds = (link.now_ns() - begin_ns) / 1e9
        return Exchange(count, self._verified(), seconds, np.zeros(0))

    def _begin(self) -> Link:
        self._link.request(Arm(), ArmReply)
        self._intended.clear()
        self._traced.clear()
        return self._link

    def _verified(self) -> int:
        """Return the number of intended frames whose very drive the board traced."""
        return sum(
            self._traced.get(wanted.key.index, (None, 0))[0] == wanted.drive.digest()
            for wanted in self._intended
        )

    def _wait_for(self, index: int) -> None:
        deadline_ns = self._link.now_ns() + _WAIT_NS
        while index not in self._traced:
            self._link.turn(deadline_ns)
            if self._link.now_ns() >= deadline_ns:
                raise NoAnswerError(f"{self._link.url}: the latch of frame {index} was not traced")

    def _take(self, event: EventReceived | ReplyReceived | FrameDropped) -> None:
        if isinstance(event, ReplyReceived):
            self._pinger.take(event)
        elif isinstance(event, EventReceived) and isinstance(event.message, Trace):
            trace = event.message
            self._traced[trace.index] = (trace.crc, self._link.now_ns())
            self._newest = trace.index


def fastest_pipeline(exchanger: Exchanger, count: int) -> Exchange:
    """Return the fastest of the exchanges of *count* frames that verified the most frames.

    The rate is at most the window over the lead. So the window is the queue of the board, and the
    lead as short as the machine allows: with a shorter one frames come too late.
    """
    depth = exchanger.queue_depth
    ways = [(depth // _SMALL, _LEADS_US[0]), *((depth - _ROOM, lead_us) for lead_us in _LEADS_US)]
    tried = (exchanger.pipelined(count, window, lead_us) for window, lead_us in ways)
    return max(tried, key=lambda done: (done.verified, done.rate_hz))


def highest_verified_rate_hz(exchanger: Exchanger, step_s: float) -> float:
    """Return the highest rate, on a ladder of steps of a quarter, at which every frame is verified.

    0 if none is.  Each step streams for *step_s* and gets three tries, because a busy machine may
    delay one of them.
    """
    passed_hz, rate_hz = 0.0, _LOWEST_HZ
    while rate_hz <= _HIGHEST_HZ:
        count = int(rate_hz * step_s)
        if not any(exchanger.streamed(count, rate_hz).verified == count for _ in range(_TRIES)):
            break
        passed_hz, rate_hz = rate_hz, rate_hz * 1.25
    return passed_hz


@contextlib.contextmanager
def exchanger(url: str) -> Iterator[Exchanger]:
    """Open a session for exchanges; leave the board mute."""
    connection = HostConnection(
        nonce=secrets.randbelow(0xFFFF) + 1,
        cobs=fastest_cobs(),
    )
    link = Link(open_transport(url), connection, baudrate=_UNPACED, timeout_s=2.0)
    try:
        yield Exchanger(link)
        link.mute(MuteReply, _WAIT_NS)
    finally:
        link.close()
