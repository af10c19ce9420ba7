"""Playback of an uploaded sequence on the board's clock.  SPEC.md chapter 7."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from haptogram.clocksync import next_boundary_us
from haptogram.errors import ConfigurationError
from haptogram.frames import Frame
from haptogram.link import Link, Progress
from haptogram.pinging import PING_PERIOD_NS, Pinger
from haptogram.records import FrameKey, Intended
from haptogram.upload import SequenceData, upload
from haptogram_protocol.connection import EventReceived
from haptogram_protocol.messages import (
    HelloReply,
    Play,
    PlaybackEnded,
    PlayReply,
    StatusReply,
)

SEQUENCE_ID: Final = 1  # the only one that this host keeps on a board
US_PER_S: Final = 1_000_000
_TURN_NS: Final = 100_000_000
_LEAST_UNATTENDED_MS: Final = 2 * PING_PERIOD_NS // 1_000_000


def playback_period_us(rate_hz: float, identity: HelloReply) -> int:
    """Return the period of *rate_hz* in whole microseconds, as PLAY carries it.

    Raises
    ------
    ConfigurationError
        If it is not whole, or the board does not play as fast.
    """
    if not 0.0 < rate_hz <= identity.max_playback_rate_hz:
        raise ConfigurationError(
            f"rate is {rate_hz:g} Hz; the board plays up to {identity.max_playback_rate_hz} "
            "frames/s"
        )
    period_us = round(US_PER_S / rate_hz)
    if abs(US_PER_S / period_us - rate_hz) > 1e-9 * rate_hz:
        raise ConfigurationError(
            f"rate is {rate_hz:g} Hz, a period of {US_PER_S / rate_hz:.6g} us; playback takes "
            f"whole microseconds: {period_us} us are {US_PER_S / period_us:.9g} Hz"
        )
    return period_us


@dataclass(frozen=True, slots=True)
class Timing:
    """When the frames of a sequence are due.

    Attributes
    ----------
    period_us : int
        From one frame to the next.
    loops : int
        How often the sequence is played.
    lead_us : int
        From the request to the first frame.
    unattended_ms : int
        How long the board plays on without hearing from the host.
    """

    period_us: int
    loops: int
    lead_us: int
    unattended_ms: int

    def check(self, identity: HelloReply) -> None:
        """Refuse, before the first byte, what the board does not play."""
        if self.loops < 1:
            raise ConfigurationError(f"loops is {self.loops}, must be 1 or more")
        if not 0 < self.lead_us <= identity.max_horizon_us:
            raise ConfigurationError(
                f"lead is {self.lead_us} us, must be above 0, at most {identity.max_horizon_us} us"
            )
        if not _LEAST_UNATTENDED_MS <= self.unattended_ms <= identity.max_unattended_ms:
            raise ConfigurationError(
                f"unattended_ms is {self.unattended_ms}, must be {_LEAST_UNATTENDED_MS} (two "
                f"pings of the host) to {identity.max_unattended_ms}"
            )


@dataclass(frozen=True, slots=True)
class PlayReport:
    """How a playback went.

    Attributes
    ----------
    frames : int
        Frames that were due.
    latched : int or None
        Frames that the board says it latched; None: it did not tell.
    t0_us : int
        Unwrapped device time at which the first frame was due.
    clock_uncertainty_us : float
        Stated error of the device clock at the end.
    status : StatusReply
        The board's own counts, after the last frame.
    """

    frames: int
    latched: int | None
    t0_us: int
    clock_uncertainty_us: float
    status: StatusReply


class Player:
    """Uploads and plays over a link.

    Parameters
    ----------
    link : Link
    pinger : Pinger
        Its clock has an estimate.
    identity : HelloReply
        The board's limits, carrier and session.
    events : list of EventReceived
        What the board reports while the link is served: among it the end of playback.
    """

    def __init__(
        self, link: Link, pinger: Pinger, identity: HelloReply, *, events: list[EventReceived]
    ) -> None:
        self._link = link
        self._pinger = pinger
        self._identity = identity
        self._events = events
        self._news = 0  # where the events since the start of playback begin

    def store(self, data: SequenceData) -> None:
        """Upload the sequence to play."""
        points = data.points_per_frame
        upload(self._link, data.kind, SEQUENCE_ID, data.data, points_per_frame=points)

    def play(
        self,
        frames: list[Frame],
        timing: Timing,
        intended: list[Intended],
        progress: Progress | None,
    ) -> tuple[int, PlaybackEnded | None]:
        """Play what was stored and wait for the end; return t0 and the board's own account.

        *intended* grows by what is to be latched; if the wait is cut short, by what was due then.
        """
        self._news = len(self._events)
        t0_us = self._start(timing)
        first = len(intended)
        intended += self._intended(frames, timing, t0_us, first)
        try:
            return t0_us, self._follow(timing, t0_us, len(intended) - first, progress)
        except BaseException:
            del intended[first + self._due(timing, t0_us) :]
            raise

    def _start(self, timing: Timing) -> int:
        """Start playback and return when: unwrapped device time."""
        now_us = self._pinger.clock.to_device_us(self._link.now_ns())
        t0_us = next_boundary_us(now_us + timing.lead_us, self._identity.carrier_hz)
        play = Play(SEQUENCE_ID, timing.period_us, timing.loops, timing.unattended_ms)
        self._link.request(play, PlayReply, t_apply_us=t0_us)
        return t0_us

    def _follow(
        self, timing: Timing, t0_us: int, total: int, progress: Progress | None
    ) -> PlaybackEnded | None:
        """Wait for the end of playback, and keep the lease meanwhile."""
        end_us = t0_us + total * timing.period_us
        last_ns = self._pinger.clock.to_host_ns(end_us) + self._link.timeout_ns
        while (end := self._ended()) is None and (now_ns := self._link.now_ns()) < last_ns:
            if progress is not None:
                progress(min(self._due(timing, t0_us), total), total)
            self._pinger.keep()
            self._link.turn(min(now_ns + _TURN_NS, last_ns))
        if progress is not None:
            progress(total, total)
        return end

    def _ended(self) -> PlaybackEnded | None:
        """Return what the board said of the end, among its events since the start."""
        news = (event.message for event in self._events[self._news :])
        return next((m for m in news if isinstance(m, PlaybackEnded)), None)

    def _due(self, timing: Timing, t0_us: int) -> int:
        """Return how many frames were due by now."""
        since_us = self._pinger.clock.to_device_us(self._link.now_ns()) - t0_us
        return max(0, since_us // timing.period_us + 1)

    def _intended(
        self, frames: list[Frame], timing: Timing, t0_us: int, first: int
    ) -> list[Intended]:
        count = len(frames)
        return [
            Intended(
                number=first + place,
                key=FrameKey(self._identity.nonce, SEQUENCE_ID, place // count, place % count),
                t_apply_us=t0_us + place * timing.period_us,
                foci=frames[place % count].foci,
                drive=frames[place % count].drive,
                phase_bits=frames[place % count].phase_bits,
                board_computed=frames[place % count].board_computed,
                solver=frames[place % count].solver,
            )
            for place in range(timing.loops * count)
        ]
