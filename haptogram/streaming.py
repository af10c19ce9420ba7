"""Frames at a steady rate: each has its device time, and leaves a fixed lead before it.

Frame i is due at t0 + floor(i * period): from the exact period, never accumulated.  What became
late on the host is sent at once while it can still be complete at the board before it is due, and
skipped otherwise.  A skipped frame has used its sequence number, and stays among what was intended.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Final

import numpy as np
from numpy.typing import NDArray

from haptogram.budget import check_rate, frame_bytes
from haptogram.clocksync import next_boundary_us
from haptogram.errors import ConfigurationError
from haptogram.frames import Frame
from haptogram.link import Link, Progress
from haptogram.pinging import Pinger
from haptogram.realtime import LoopStats, can_arrive, real_time
from haptogram.records import FrameKey, Intended
from haptogram_protocol.messages import Config, HelloReply, StatusReply

US_PER_S: Final = 1_000_000
_PROGRESS_HZ: Final = 20
_SETTLING_NS: Final = 5_000_000  # between the last latch and the question how it went
_START_NS: Final = 2_000_000  # from the last preparation to the first frame


@dataclass(frozen=True, slots=True)
class StreamReport:
    """How the host's side of a stream went.

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
    clock_uncertainty_us: float
    t0_us: int
    status: StatusReply

    @property
    def sent(self) -> int:
        """Frames that were handed to the port."""
        return self.frames - len(self.skipped)


@dataclass(frozen=True, slots=True)
class Schedule:
    """When each frame of a stream is due.

    Attributes
    ----------
    period_us : Fraction
        Exact time from one frame to the next.
    lead_us : int
        How long before its time a frame is sent.
    """

    period_us: Fraction
    lead_us: int

    @classmethod
    def at_rate(cls, rate_hz: float, lead_us: int) -> Schedule:
        """Return the schedule of *rate_hz*, taken as the simplest fraction within 1e-9 of it."""
        if not 0.0 < rate_hz <= US_PER_S:
            raise ConfigurationError(f"rate is {rate_hz:g} Hz, must be above 0, at most 1000000")
        if lead_us < 1:
            raise ConfigurationError(f"lead is {lead_us} us, must be 1 or more")
        return cls(US_PER_S / Fraction(rate_hz).limit_denominator(1_000_000), lead_us)

    @property
    def rate_hz(self) -> float:
        """Frames per second."""
        return float(US_PER_S / self.period_us)

    def offset_us(self, number: int) -> int:
        """Return when frame *number* is due after the first, in whole microseconds."""
        return number * self.period_us.numerator // self.period_us.denominator

    def check(self, frames: list[Frame], identity: HelloReply, baudrate: int) -> None:
        """Refuse, before the first byte, what line and board cannot carry.

        Raises
        ------
        ConfigurationError
            Naming what was asked and the limit.
        """
        size = frame_bytes(max(frame.payload_bytes for frame in frames))
        check_rate(size, baudrate=baudrate, rate_hz=self.rate_hz)
        if self.rate_hz > identity.max_frame_rate_hz:
            raise ConfigurationError(
                f"rate is {self.rate_hz:g} Hz; the board latches up to "
                f"{identity.max_frame_rate_hz} frames/s"
            )
        if self.lead_us > identity.max_horizon_us:
            raise ConfigurationError(
                f"lead is {self.lead_us} us; the board looks {identity.max_horizon_us} us ahead"
            )
        waiting = -(-self.lead_us // self.period_us)
        if waiting > identity.queue_depth:
            longest_us = int(identity.queue_depth * self.period_us)
            raise ConfigurationError(
                f"a lead of {self.lead_us} us at {self.rate_hz:g} Hz keeps {waiting} frames "
                f"waiting; the board's queue holds {identity.queue_depth}: lead up to "
                f"{longest_us} us"
            )
        least_us = -(-size * 10 * US_PER_S // baudrate)
        if self.lead_us <= least_us:
            raise ConfigurationError(
                f"lead is {self.lead_us} us; {size} bytes at {baudrate} baud take {least_us} us"
            )

    def check_timers(self, config: Config) -> None:
        """Refuse a rate so low that the board's timers would mute it between two frames.

        Raises
        ------
        ConfigurationError
            Naming the timers.
        """
        period_ms = float(self.period_us) / 1000
        if period_ms >= min(config.hold_ms, config.host_timeout_ms):
            raise ConfigurationError(
                f"rate is {self.rate_hz:g} Hz, a frame every {period_ms:g} ms; the board mutes "
                f"itself after hold_ms = {config.hold_ms}, host_timeout_ms = "
                f"{config.host_timeout_ms}: configure both to be longer"
            )


class Streamer:
    """Sends frames over a link, on a schedule.

    Parameters
    ----------
    link : Link
    pinger : Pinger
        Its clock has an estimate.
    identity : HelloReply
        Session and carrier of the board.
    intended : list of Intended
        Grows by every frame that was sent or skipped, at that moment.
    """

    def __init__(
        self, link: Link, pinger: Pinger, identity: HelloReply, *, intended: list[Intended]
    ) -> None:
        self._link = link
        self._pinger = pinger
        self._identity = identity
        self._intended = intended

    def send_now(self, frame: Frame) -> Intended:
        """Send one frame that is latched as soon as it is complete."""
        index, wire = self._link.connection.stream_frame(frame.message, t_apply_us=None)
        intended = self._note(frame, index, None)
        self._link.write_frame(wire)
        return intended

    def stream(
        self, frames: list[Frame], schedule: Schedule, progress: Progress | None
    ) -> tuple[LoopStats, list[int], int]:
        """Send *frames*; return the lateness of the ticks, the numbers skipped, and t0."""
        stats, skipped = LoopStats(len(frames)), []
        stride = max(1, int(schedule.rate_hz / _PROGRESS_HZ))
        with real_time():
            start_us = self._pinger.clock.to_device_us(self._link.now_ns() + _START_NS)
            t0_us = next_boundary_us(start_us + schedule.lead_us, self._identity.carrier_hz)
            for number, frame in enumerate(frames):
                due_us = t0_us + schedule.offset_us(number)
                self._wait_for_tick(due_us, schedule, stats)
                if not self._send_in_time(frame, due_us):
                    skipped.append(len(self._intended) - 1)
                if progress is not None and (number + 1) % stride == 0:
                    progress(number + 1, len(frames))
            self._link.run_until(self._pinger.clock.to_host_ns(due_us) + _SETTLING_NS)
        if progress is not None:
            progress(len(frames), len(frames))
        return stats, skipped, t0_us

    def _wait_for_tick(self, due_us: int, schedule: Schedule, stats: LoopStats) -> None:
        self._pinger.keep()
        # From the newest estimate, so that the lead stays what it is while the clocks drift.
        deadline_ns = self._pinger.clock.to_host_ns(due_us - schedule.lead_us)
        self._link.run_until(deadline_ns)
        stats.record(self._link.now_ns() - deadline_ns)

    def _send_in_time(self, frame: Frame, due_us: int) -> bool:
        index, wire = self._link.connection.stream_frame(frame.message, t_apply_us=due_us)
        self._note(frame, index, due_us)
        in_time = can_arrive(
            now_ns=self._link.now_ns(),
            line_free_ns=self._link.line.free_ns,
            transmission_ns=self._link.transmission_ns(wire),
            due_ns=self._pinger.clock.to_host_ns(due_us),
        )
        if in_time:
            self._link.write_frame(wire)
        return in_time

    def _note(self, frame: Frame, index: int, due_us: int | None) -> Intended:
        intended = Intended(
            number=len(self._intended),
            key=FrameKey.of_stream(self._identity.nonce, index),
            t_apply_us=due_us,
            foci=frame.foci,
            drive=frame.drive,
            phase_bits=frame.phase_bits,
            board_computed=frame.board_computed,
        )
        self._intended.append(intended)
        return intended
