"""Frames at a steady rate: each has its device time, and leaves a lead before it.

A frame is due when its :class:`~haptogram.driver.timing.schedule.Schedule` says.  What became late
on the host is sent at once while it can still be complete at the board before it is due, and
skipped otherwise.  A skipped frame has used its sequence number, and stays among what was intended.

The bytes of a frame are there long before its tick: the first 256 before the first tick, every
other one encoded while the loop has nothing else to do.  A tick is one write.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from itertools import islice
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from haptogram.driver.frames.frame import Frame
from haptogram.driver.line.link import Link
from haptogram.driver.timing import realtime
from haptogram.driver.timing.clock import next_boundary_on_device_clock_us
from haptogram.driver.timing.lead import LeadMargin, LeadTrim
from haptogram.driver.timing.pings import Pinger
from haptogram.driver.timing.schedule import Schedule
from haptogram.errors import LinkError
from haptogram.machine.process import real_time_process
from haptogram.records.frame import FrameKey, Intended
from haptogram.records.kept import KeptRecords
from haptogram.settings.arguments import Progress
from haptogram.settings.frozen import dataclass
from haptogram_protocol.messages import HelloReply, Status, StatusReply

_PROGRESS_HZ: Final = 20
_SETTLING_NS: Final = 5_000_000  # time between the last latch and the request of the status
_START_NS: Final = 2_000_000  # time from the last preparation to the first frame
_AHEAD: Final = 256  # frames that are encoded before they are due
_ENCODING_NS: Final = 40_000  # time to encode one of them on a busy machine
_TOLERATED_JUMP_US: Final = 1000  # jump of the board's clock that every lead covers
_WATCH_NS: Final = 100_000_000  # a wait is cut into pieces no longer than this, to keep the clock

_Encoded: TypeAlias = tuple[Frame, int, int, bytes]  # with index and due time in us


@dataclass(frozen=True, slots=True)
class StreamReport:
    """Counts and times of a stream, as the host measured them.

    Attributes
    ----------
    frames : int
        Frames that were due.
    skipped : tuple of int
        Numbers (:attr:`Intended.number`) of those that could no longer be in time.
    lateness_us : (n,) numpy.ndarray
        How late the host was at each tick, in microseconds.
    late_ticks : int
        Ticks that were late by a period or more.
    write_stalls : int
        How often the port did not take all bytes at once.
    lead_us : int
        How long before its time the last frame was sent.
    lead_moves : int
        How often the trim changed that.
    ticks : TickLog
        Times of the events of each tick.
    not_permitted : tuple of str
        Services for a real-time loop that the system refused.
    clock_uncertainty_us : float
        Stated error of the device clock at the end.
    t0_us : int
        Unwrapped device time at which the first frame was due.
    status : StatusReply
        The board's own counts, after the last frame.
    """

    frames: int
    skipped: tuple[int, ...]
    lateness_us: NDArray[np.float64]
    late_ticks: int
    write_stalls: int
    lead_us: int
    lead_moves: int
    ticks: realtime.TickLog
    not_permitted: tuple[str, ...]
    clock_uncertainty_us: float
    t0_us: int
    status: StatusReply

    @property
    def sent(self) -> int:
        """Frames that were handed to the port."""
        return self.frames - len(self.skipped)


@dataclass(frozen=True, slots=True)
class StreamPacing:
    """Settings by which the loop keeps its deadlines.

    Attributes
    ----------
    spin_us : int
        How long before a deadline to watch the clock instead of sleeping; a quarter of the period
        at most.
    strict : bool
        Whether to ask for fixed priority, locked memory and a frozen collector.
    trim : LeadTrim or None
        Moves the lead; None: it stays.
    refresh_ns : int
        Longest time between two frames of this host that keeps the board's lease.
    """

    spin_us: int = 0
    strict: bool = False
    trim: LeadTrim | None = None
    refresh_ns: int = _WATCH_NS


class Streamer:
    """Sends frames over a link, on a schedule.

    Parameters
    ----------
    link : Link
    pinger : Pinger
        Its clock has an estimate.
    identity : HelloReply
        Session and carrier of the board.
    intended : KeptRecords of Intended
        Grows by every frame that was sent or skipped, at that moment.
    status : callable
        Returns the newest STATUS of the board, None before the first.
    """

    def __init__(
        self,
        link: Link,
        pinger: Pinger,
        identity: HelloReply,
        *,
        intended: KeptRecords[Intended],
        status: Callable[[], Status | None],
    ) -> None:
        self.link = link
        self.pinger = pinger
        self._identity = identity
        self._intended = intended
        self.status = status
        self._queued_until_us = 0  # by a stream that was cut short

    def send_now(self, frame: Frame) -> Intended:
        """Send one frame that is latched as soon as it is complete."""
        return self.send_for(frame, None)

    def send_for(self, frame: Frame, due_us: int | None) -> Intended:
        """Send one frame that is due at the unwrapped device time *due_us*; None: at once."""
        index, wire = self.link.connection.stream_frame(frame.message, t_apply_us=due_us)
        intended = self._record_sent(frame, index, due_us)
        self.link.write_frame(wire)
        return intended

    def stream(
        self,
        frames: list[Frame],
        schedule: Schedule,
        pacing: StreamPacing,
        progress: Progress | None,
        ended: Callable[[], StatusReply],
    ) -> StreamReport:
        """Send *frames*; *ended* then asks the board how it went.

        Raises
        ------
        LinkError
            The link broke, or the board's clock jumped: the frames would come at wrong times.
        """
        stalls = self.link.stalls
        with real_time_process(strict=pacing.strict) as refused:
            run = _StreamRun(self, schedule, pacing, len(frames))
            t0_us = self._start_us(schedule, len(frames))
            coming = self._encoded(frames, schedule, t0_us)
            ready = deque(islice(coming, _AHEAD))
            stride = max(1, int(schedule.rate_hz / _PROGRESS_HZ))
            try:
                for number in range(1, len(frames) + 1):
                    frame, index, due_us, wire = ready.popleft()
                    run.wait(due_us)
                    times_us = run.send(wire, due_us - frame.ready_after_us(self._identity))
                    noted = self._record_sent(frame, index, due_us, *times_us)
                    if noted.t_sent_us is None:
                        run.skipped.append(noted.number)
                    ready.extend(islice(coming, 1))
                    if progress is not None and number % stride == 0:
                        progress(number, len(frames))
            finally:
                if ready:  # cut short: the board would count them as lost
                    self.link.connection.stream_index = ready[0][1]
                    self._queued_until_us = ready[0][2]
            run.wait_for_queue(due_us)
        if progress is not None:
            progress(len(frames), len(frames))
        stalls, lateness_us = self.link.stalls - stalls, run.ticks.lateness_us()
        status = ended()
        return StreamReport(
            frames=run.ticks.count,
            skipped=tuple(run.skipped),
            lateness_us=lateness_us,
            late_ticks=int((lateness_us >= float(schedule.period_us)).sum()),
            write_stalls=stalls,
            lead_us=run.lead_us,
            lead_moves=pacing.trim.moves if pacing.trim else 0,
            ticks=run.ticks,
            not_permitted=tuple(refused),
            clock_uncertainty_us=self.pinger.clock.uncertainty_us,
            t0_us=t0_us,
            status=status,
        )

    def _start_us(self, schedule: Schedule, count: int) -> int:
        """Return the device time of the first frame: after preparation and lead, on the carrier.

        In µs, at the beginning of a carrier period. Not before frames that an earlier stream has
        queued, unless the clock has jumped since.
        """
        begin_ns = self.link.now_ns() + stream_preparation_ns(count)
        begin_us = self.pinger.clock.to_device_us(begin_ns)
        first_us = begin_us + schedule.lead_us
        if self._queued_until_us < begin_us + self._identity.max_horizon_us:
            first_us = max(first_us, self._queued_until_us)
        return next_boundary_on_device_clock_us(first_us, self._identity.carrier_hz)

    def _encoded(self, frames: list[Frame], schedule: Schedule, t0_us: int) -> Iterator[_Encoded]:
        """Yield each frame with its number, due time (device time) and wire bytes."""
        for number, frame in enumerate(frames):
            due_us = t0_us + schedule.offset_us(number)
            index, wire = self.link.connection.stream_frame(frame.message, t_apply_us=due_us)
            yield frame, index, due_us, wire

    def _record_sent(
        self,
        frame: Frame,
        index: int,
        due_us: int | None,
        latest_us: int | None = None,
        sent_us: int | None = None,
    ) -> Intended:
        """Keep a sent frame as intended, with its times in device time, and return it.

        *due_us*: its t_apply. *latest_us*: when its last byte had to be at the board; *sent_us*:
        when that left the host. None: at no certain time, or not known.
        """
        key, number = FrameKey.of_stream(self._identity.nonce, index), self._intended.total
        intended = frame.intended(number, key, due_us, t_latest_us=latest_us, t_sent_us=sent_us)
        self._intended.append(intended)
        return intended


def stream_preparation_ns(count: int) -> int:
    """Return the time before its lead at which a stream of *count* frames begins."""
    return _START_NS + min(count, _AHEAD) * _ENCODING_NS


class _StreamRun:
    """One stream: when each frame is sent, with the lead and what the clock and STATUS say."""

    def __init__(
        self, streamer: Streamer, schedule: Schedule, pacing: StreamPacing, ticks: int
    ) -> None:
        link, pinger, status = streamer.link, streamer.pinger, streamer.status
        self.ticks, self.skipped = realtime.TickLog(ticks), list[int]()
        self.lead_us = schedule.lead_us
        self._link, self._pinger = link, pinger
        self._trim, self._status = pacing.trim, status
        self._refresh_ns = pacing.refresh_ns
        self._seen = status()
        self._jumps = pinger.clock.jumps
        self._loop = realtime.PeriodicLoop(
            link.now_ns,
            link.run_until,
            period_ns=int(schedule.period_us * 1000),
            spin_ns=pacing.spin_us * 1000,
        )
        self._safety = LeadMargin(pinger.clock.uncertainty_us)
        self._deadline_ns = self._wake_ns = 0
        self._lead_changed = True  # until the first report that began with this stream

    def wait(self, due_us: int) -> None:
        """Wait until it is time to send the frame that is due at *due_us*."""
        self._pinger.keep()
        self._read_status()
        # From the newest estimate, so that the lead stays what it is while the clocks drift.
        while (now_ns := self._link.now_ns()) + _WATCH_NS < (deadline_ns := self._send_ns(due_us)):
            self._link.run_until(now_ns + _WATCH_NS)
            self._pinger.keep()
        self._deadline_ns, self._wake_ns = deadline_ns, self._loop.wait(deadline_ns)

    def _send_ns(self, due_us: int) -> int:
        """Return the host time, a lead ahead, to send a frame; raise LinkError if the clock jumped.

        A jump of 1 ms or less is tolerated: every lead covers it.
        """
        clock = self._pinger.clock
        if clock.jumps != self._jumps and abs(clock.jump_us) > _TOLERATED_JUMP_US:
            raise LinkError(
                f"{self._link.url}: the board's clock jumped by {clock.jump_us} µs, noticed after "
                f"{self.ticks.count} frames: what is queued and to come has wrong times"
            )
        return clock.to_host_ns(due_us - self.lead_us)

    def send(self, wire: bytes, arrival_us: int) -> tuple[int, int | None]:
        """Send a frame, unless it can no longer be at the board by *arrival_us*.

        Returns
        -------
        t_latest_us, t_sent_us
            Of :class:`~haptogram.records.frame.Intended`.
        """
        link, margin_ns = self._link, self._safety.ns
        latest_us = arrival_us - -(-margin_ns // 1000)
        ready_ns = room_ns = link.now_ns()
        in_time = realtime.can_arrive_by_deadline(
            now_ns=ready_ns,
            line_free_ns=link.line.free_ns,
            transmission_ns=link.transmission_ns(wire),
            due_ns=self._pinger.clock.to_host_ns(arrival_us) - margin_ns,
        )
        if in_time:
            room_ns = link.write_frame(wire)
        elif self._trim is not None:
            late_ns = ready_ns - self._deadline_ns + link.transmission_ns(wire)
            self.lead_us = self._trim.add(late_ns // 1000, 1)
        done_ns, free_ns = link.now_ns(), link.line.free_ns
        stamps = self._deadline_ns, link.idle_since_ns, self._wake_ns, ready_ns, room_ns
        self.ticks.record(realtime.TickStamps(*stamps, done_ns, free_ns))
        if not in_time:
            return latest_us, None
        return latest_us, self._pinger.clock.to_device_us(max(done_ns, free_ns))

    def wait_for_queue(self, due_us: int) -> None:
        """Wait until the last frame is latched; no frame but a ping renews the lease meanwhile."""
        end_ns = self._pinger.clock.to_host_ns(due_us) + _SETTLING_NS
        while (now_ns := self._link.now_ns()) + self._refresh_ns < end_ns:
            self._link.run_until(now_ns + self._refresh_ns)
            self._pinger.keep(self._refresh_ns)
        self._link.run_until(end_ns)

    def _read_status(self) -> None:
        """Adapt safety margin and lead to the least margin of stream frames in a new STATUS.

        The margin is t_apply less the time at which a frame was ready at the board. Each STATUS is
        used once.
        """
        status = self._status()
        if status is None or status is self._seen:
            return
        changed, self._seen = self._lead_changed, status
        self._lead_changed = False
        if not status.margins:
            return
        self._safety.take(status.margin_min_us, self._pinger.clock.uncertainty_us)
        if self._trim is not None and not changed:  # else its frames had two different leads
            lead_us = self._trim.add(self.lead_us - status.margin_min_us, status.margins)
            self._lead_changed = lead_us != self.lead_us
            self.lead_us = lead_us
