"""Playback of an uploaded sequence on the board's clock.  SPEC.md chapter 7."""

from __future__ import annotations

from typing import Final, Self

from haptogram.driver.frames.frame import Frame
from haptogram.driver.line.link import Link
from haptogram.driver.timing.clock import next_boundary_on_device_clock_us
from haptogram.driver.timing.lead import default_lead_us
from haptogram.driver.timing.pings import Pinger
from haptogram.driver.timing.schedule import LEAST_RATE_HZ, longest_lead_us
from haptogram.driver.upload import SequenceData, upload_by_driver
from haptogram.errors import ConfigurationError
from haptogram.records.frame import FrameKey, Intended
from haptogram.records.kept import KeptRecords
from haptogram.settings.arguments import Progress, check_number, check_whole
from haptogram.settings.frozen import dataclass
from haptogram_protocol import messages
from haptogram_protocol.connection import EventReceived
from haptogram_protocol.messages import HelloReply

_SEQUENCE_ID: Final = 1  # id of the one sequence that this host keeps on a board
US_PER_S: Final = 1_000_000
_TURN_NS: Final = 100_000_000
MOST_PLAYED: Final = 100_000_000  # frames in one playback: 28 hours at 1 kHz
_LEAST_UNATTENDED_MS: Final = 1000  # which every board allows: SPEC.md chapter 4
_DEFAULT_UNATTENDED_MS: Final = 3000
_NS_BETWEEN_PINGS: Final = 333_333  # for each millisecond of that time: three pings in it


def _playback_period_us(rate_hz: float, identity: HelloReply) -> int:
    """Return the period of *rate_hz* in whole microseconds, as PLAY carries it.

    Raises
    ------
    ConfigurationError
        If it is not whole, or the board does not play as fast.
    """
    rate_hz = check_number("rate_hz", rate_hz, LEAST_RATE_HZ, 1e6)
    if rate_hz > identity.max_playback_rate_hz:
        raise ConfigurationError(
            f"rate is {rate_hz:g} Hz; the board plays up to {identity.max_playback_rate_hz} "
            "frames/s"
        )
    period_us = round(US_PER_S / rate_hz)
    if abs(US_PER_S / period_us - rate_hz) > 1e-9 * rate_hz:
        raise ConfigurationError(
            f"rate is {rate_hz:g} Hz, a period of {US_PER_S / rate_hz:.6g} µs; playback takes "
            f"whole microseconds: {period_us} µs are {US_PER_S / period_us:.9g} Hz"
        )
    return period_us


def default_unattended_ms(identity: HelloReply) -> int:
    """Return the time that a sequence plays on without the host, unless the caller sets another."""
    return min(_DEFAULT_UNATTENDED_MS, identity.max_unattended_ms)


@dataclass(frozen=True, slots=True)
class PlaybackTiming:
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

    @classmethod
    def checked(
        cls,
        identity: HelloReply,
        rate_hz: float,
        loops: int,
        lead_us: int | None,
        unattended_ms: int | None,
    ) -> Self:
        """Refuse times that the board does not play, before the first byte is sent."""
        period_us = _playback_period_us(rate_hz, identity)
        loops = check_whole("loops", loops, 1, MOST_PLAYED)
        if lead_us is None:
            lead_us = default_lead_us(identity.max_horizon_us)
        lead_us = check_whole("lead_us", lead_us, 1, longest_lead_us(identity))
        if unattended_ms is None:
            unattended_ms = default_unattended_ms(identity)
        most_ms = identity.max_unattended_ms
        unattended_ms = check_whole("unattended_ms", unattended_ms, _LEAST_UNATTENDED_MS, most_ms)
        return cls(period_us, loops, lead_us, unattended_ms)

    def check_frames(self, frames: list[Frame], identity: HelloReply) -> None:
        """Refuse times in which the board cannot make *frames* ready.

        Raises
        ------
        ConfigurationError
            Naming the time that the board needs.
        """
        ready_us = max(frame.ready_after_us(identity) for frame in frames)
        if self.lead_us <= ready_us:
            raise ConfigurationError(
                f"lead is {self.lead_us} µs; the board takes {ready_us} µs to make a frame ready"
            )
        computing_us = max(frame.computing_us(identity) for frame in frames)
        if self.period_us < computing_us:
            raise ConfigurationError(
                f"period is {self.period_us} µs; the board takes {computing_us} µs to compute a "
                "frame of these focal points"
            )


@dataclass(frozen=True, slots=True)
class PlayReport:
    """Counts and times of one playback.

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
    status: messages.StatusReply


@dataclass(slots=True)
class _PlaybackScore:
    """A playback under way: the time of each frame, and the number recorded as intended."""

    frames: list[Frame]
    timing: PlaybackTiming
    t0_us: int
    session: int
    intended: KeptRecords[Intended]
    noted: int = 0

    @property
    def total(self) -> int:
        """How many frames will be due."""
        return self.timing.loops * len(self.frames)

    def due_us(self, place: int) -> int:
        """Return when frame *place* is due."""
        return self.t0_us + place * self.timing.period_us

    def note(self, due: int) -> None:
        """Note the first *due* frames, but for those that are."""
        while self.noted < due:
            loop, index = divmod(self.noted, len(self.frames))
            key = FrameKey(self.session, _SEQUENCE_ID, loop, index)
            due_us, number = self.due_us(self.noted), self.intended.total
            self.noted += 1
            self.intended.append(self.frames[index].intended(number, key, due_us))


class DriverPlayback:
    """Uploads and plays over a link.

    Parameters
    ----------
    link : Link
    pinger : Pinger
        Its clock has an estimate.
    identity : HelloReply
        The board's limits, carrier and session.
    events : KeptRecords of EventReceived
        Events of the board while the link is served, with the end of playback among them.
    """

    def __init__(
        self,
        link: Link,
        pinger: Pinger,
        identity: HelloReply,
        *,
        events: KeptRecords[EventReceived],
    ) -> None:
        self._link = link
        self._pinger = pinger
        self._identity = identity
        self._events = events
        self._news = 0  # where the events since the start of playback begin
        self._goes_on = False  # a playback for whose end nobody waited

    def stop(self) -> None:
        """End a playback that was cut short here, and goes on at the board."""
        if self._goes_on:
            self._link.request(messages.Stop(), messages.StopReply)
            self._goes_on = False

    def store(self, data: SequenceData) -> None:
        """Upload the sequence to play."""
        points = data.points_per_frame
        upload_by_driver(self._link, data.kind, _SEQUENCE_ID, data.data, points_per_frame=points)

    def play(
        self,
        frames: list[Frame],
        timing: PlaybackTiming,
        intended: KeptRecords[Intended],
        progress: Progress | None,
    ) -> tuple[int, messages.PlaybackEnded | None]:
        """Play what was stored and wait for the end; return t0 and the board's own account.

        *intended* grows by what falls due; at the end by what is left, unless the wait is cut
        short.
        """
        self._news = self._events.total
        self._goes_on = True  # also where PLAY arrived and nobody waited for its reply
        score = _PlaybackScore(frames, timing, self._start(timing), self._identity.nonce, intended)
        try:
            end = self._follow(score, progress)
        except BaseException:
            score.note(self._due(score))
            raise
        self._goes_on = False
        score.note(score.total)
        return score.t0_us, end

    def _start(self, timing: PlaybackTiming) -> int:
        """Send PLAY, due a lead from now; return its start in unwrapped device time (µs)."""
        now_us = self._pinger.clock.to_device_us(self._link.now_ns())
        t0_us = next_boundary_on_device_clock_us(now_us + timing.lead_us, self._identity.carrier_hz)
        play = messages.Play(_SEQUENCE_ID, timing.period_us, timing.loops, timing.unattended_ms)
        self._link.request(play, messages.PlayReply, t_apply_us=t0_us)
        return t0_us

    def _follow(
        self, score: _PlaybackScore, progress: Progress | None
    ) -> messages.PlaybackEnded | None:
        """Wait for the end of playback, keeping the lease; return its report, None if none came.

        The wait ends with the timeout after the last frame is due.
        """
        total, end_us = score.total, score.due_us(score.total)
        last_ns = self._pinger.clock.to_host_ns(end_us) + self._link.timeout_ns
        while (end := self._ended()) is None and (now_ns := self._link.now_ns()) < last_ns:
            due = self._due(score)
            score.note(due)
            if progress is not None:
                progress(due, total)
            self._pinger.keep(score.timing.unattended_ms * _NS_BETWEEN_PINGS)
            self._link.turn(min(now_ns + _TURN_NS, last_ns))
        if progress is not None:
            progress(total, total)
        return end

    def _ended(self) -> messages.PlaybackEnded | None:
        """Return PLAYBACK_ENDED if it has come since the start; else None."""
        news = (event.message for event in self._events.since(self._news))
        return next((m for m in news if isinstance(m, messages.PlaybackEnded)), None)

    def _due(self, score: _PlaybackScore) -> int:
        """Return the number of frames of the playback that are due by now, 0 before its start."""
        since_us = self._pinger.clock.to_device_us(self._link.now_ns()) - score.t0_us
        return min(max(0, since_us // score.timing.period_us + 1), score.total)
