"""When each frame of a stream is due, and the limits that line, board and timers set.

Frame i is due at t0 + floor(i * period): from the exact period, never accumulated.
"""

from __future__ import annotations

from fractions import Fraction
from typing import Final

from haptogram.driver.frames.frame import Frame
from haptogram.driver.line.budget import check_line_rate, frame_bytes_on_line, line_transmission_ns
from haptogram.driver.timing.lead import LeadTrim, default_lead_us
from haptogram.errors import ConfigurationError
from haptogram.settings.arguments import check_number, check_whole
from haptogram.settings.frozen import dataclass
from haptogram_protocol.messages import Config, HelloReply

US_PER_S: Final = 1_000_000
LEAST_RATE_HZ: Final = 0.001
_CLOCK_ERROR_US: Final = 1000  # of the estimate, and of a start that waits for the carrier


def longest_lead_us(identity: HelloReply) -> int:
    """Return the longest lead within what the board looks ahead, whatever the clocks' error."""
    return identity.max_horizon_us - _CLOCK_ERROR_US


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
    def at_rate(
        cls, rate_hz: float, lead_us: int | None, *, queue_depth: int, horizon_us: int = 2**31
    ) -> Schedule:
        """Return the schedule of *rate_hz*, taken as the simplest fraction within 1e-9 of it.

        Without a lead it gets :func:`~haptogram.driver.timing.lead.default_lead_us`.
        """
        exact_hz = Fraction(check_number("rate_hz", rate_hz, LEAST_RATE_HZ, US_PER_S))
        period_us = US_PER_S / exact_hz.limit_denominator(1_000_000)
        if lead_us is None:
            lead_us = default_lead_us(min(queue_depth * period_us, Fraction(horizon_us)))
        return cls(period_us, check_whole("lead_us", lead_us, 1, 2**31 - 1))

    @property
    def rate_hz(self) -> float:
        """Frames per second."""
        return float(US_PER_S / self.period_us)

    def offset_us(self, number: int) -> int:
        """Return when frame *number* is due after the first, in whole microseconds."""
        return number * self.period_us.numerator // self.period_us.denominator

    def check(self, frames: list[Frame], identity: HelloReply, baudrate: int) -> None:
        """Refuse a schedule that line or board cannot carry, before the first byte is sent.

        Raises
        ------
        ConfigurationError
            Naming the value and the limit.
        """
        size = frame_bytes_on_line(max(frame.payload_bytes for frame in frames))
        check_line_rate(size, baudrate=baudrate, rate_hz=self.rate_hz)
        if self.rate_hz > identity.max_frame_rate_hz:
            raise ConfigurationError(
                f"rate is {self.rate_hz:g} Hz; the board latches up to "
                f"{identity.max_frame_rate_hz} frames/s"
            )
        computing_us = max(frame.computing_us(identity) for frame in frames)
        if computing_us > self.period_us:
            raise ConfigurationError(
                f"rate is {self.rate_hz:g} Hz; the board computes these focal points in "
                f"{computing_us} µs a frame: up to {US_PER_S / computing_us:g} frames/s"
            )
        if self.lead_us > (longest_us := longest_lead_us(identity)):
            raise ConfigurationError(
                f"lead is {self.lead_us} µs; the board looks {identity.max_horizon_us} µs ahead: "
                f"lead up to {longest_us} µs"
            )
        waiting = -(-self.lead_us // self.period_us) + 1  # one, until the carrier lets it latch
        if waiting > identity.queue_depth:
            longest_us = int((identity.queue_depth - 1) * self.period_us)
            raise ConfigurationError(
                f"a lead of {self.lead_us} µs at {self.rate_hz:g} Hz keeps {waiting} frames "
                f"waiting; the board's queue holds {identity.queue_depth}: lead up to "
                f"{longest_us} µs"
            )
        line_us = -(-size * 10 * US_PER_S // baudrate)
        ready_us = max(frame.ready_after_us(identity) for frame in frames)
        if self.lead_us <= line_us + ready_us:
            board = f", and the board {ready_us} µs to make them ready" if ready_us else ""
            raise ConfigurationError(
                f"lead is {self.lead_us} µs; {size} bytes at {baudrate} baud take {line_us} µs"
                f"{board}"
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

    def lead_trim(
        self,
        frames: list[Frame],
        identity: HelloReply,
        config: Config,
        baudrate: int,
        miss_share: float,
    ) -> LeadTrim:
        """Return the trim that moves the lead of this schedule down.

        Raises
        ------
        ConfigurationError
            If the board is configured not to report its arrival margins.
        """
        if not config.status_period_ms:
            raise ConfigurationError(
                "trim needs the STATUS of the board, and status_period_ms is 0: configure it"
            )
        size = frame_bytes_on_line(max(frame.payload_bytes for frame in frames))
        ready_us = max(frame.ready_after_us(identity) for frame in frames)
        shortest_us = -(-line_transmission_ns(size, baudrate) // 1000) + ready_us + 1
        return LeadTrim(self.lead_us, shortest_us, miss_share)
