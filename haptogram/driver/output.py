"""The way of finished frames to the transducers: checked, the board made ready, sent, reported.

Which frames these are is decided by the caller, :class:`haptogram.driver.driver.Driver`.
"""

from __future__ import annotations

from dataclasses import replace

from haptogram.driver.frames.frame import Frame
from haptogram.driver.line.link import NS_PER_S
from haptogram.driver.playback import DriverPlayback, PlaybackTiming, PlayReport
from haptogram.driver.session import DriverSession
from haptogram.driver.stream import Streamer, StreamPacing, StreamReport, stream_preparation_ns
from haptogram.driver.timing.realtime import next_deadline_ns
from haptogram.driver.timing.schedule import Schedule
from haptogram.driver.upload import SequenceData
from haptogram.errors import ConfigurationError
from haptogram.records.frame import Intended
from haptogram.records.kept import KeptRecords
from haptogram.settings.arguments import Progress
from haptogram_protocol.messages import GetStatus, StatusReply


class HostOutput:
    """Sends frames in one session, and arms the board again where a timer muted it.

    Parameters
    ----------
    session : DriverSession
        Started.
    intended : KeptRecords of Intended
        Grows by every frame that is sent or due.
    """

    def __init__(self, session: DriverSession, intended: KeptRecords[Intended]) -> None:
        link, pinger, identity = session.link, session.pinger, session.identity
        self._session = session
        self._link = link
        self._arming = session.arming
        self._configuration = session.configuration
        self._intended = intended
        self._streamer = Streamer(
            link, pinger, identity, intended=intended, status=lambda: session.last_status
        )
        self._player = DriverPlayback(link, pinger, identity, events=session.events)
        self._held: Frame | None = None

    def focus(self, frame: Frame) -> Intended:
        """Send *frame*, to be latched as soon as it is complete."""
        self._make_ready([frame], 0)
        self._held = frame
        return self._streamer.send_now(frame)

    def hold(self, seconds: float) -> None:
        """Repeat the last frame of :meth:`focus` for *seconds*, so that no timer runs out.

        Raises
        ------
        ConfigurationError
            If there was no such frame, or the board is not armed.
        """
        if self._held is None:
            raise ConfigurationError("there is no focus to hold; call focus first")
        deadline_ns = self._link.now_ns()
        end_ns = deadline_ns + int(seconds * NS_PER_S)
        while deadline_ns < end_ns:
            self._link.run_until(deadline_ns)
            self._session.pinger.keep()
            # Every time: a timer may have run out whenever the host was held up.
            self._make_ready([self._held], 0)
            self._streamer.send_now(self._held)
            now_ns = self._link.now_ns()
            deadline_ns = next_deadline_ns(
                deadline_ns=deadline_ns, now_ns=now_ns, period_ns=self._arming.refresh_ns
            )
        self._link.run_until(end_ns)

    def stream(
        self,
        frames: list[Frame],
        loops: int,
        schedule: Schedule,
        pacing: StreamPacing,
        *,
        trim_to: float | None,
        progress: Progress | None,
    ) -> StreamReport:
        """Send *frames*, *loops* times over; *trim_to* is the share that a trim lets be late."""
        known, baudrate = self._configuration.known, self._link.line.baudrate
        schedule.check(frames, self._session.identity, baudrate)
        schedule.check_timers(known)
        if trim_to is not None:
            trim = schedule.lead_trim(frames, self._session.identity, known, baudrate, trim_to)
            pacing = replace(pacing, trim=trim)
        pacing = replace(pacing, refresh_ns=self._arming.refresh_ns)
        every = frames * loops
        self._make_ready(frames, schedule.lead_us + stream_preparation_ns(len(every)) // 1000)
        report = self._streamer.stream(every, schedule, pacing, progress, self._ended)
        for text in report.not_permitted:
            self._session.warn(text)
        return report

    def play(
        self, frames: list[Frame], timing: PlaybackTiming, progress: Progress | None
    ) -> PlayReport:
        """Upload *frames*, play them on the board's clock, and wait for the end."""
        data = SequenceData.of(frames)
        data.check(self._session.identity)
        timing.check_frames(frames, self._session.identity)
        self._make_ready(frames, timing.lead_us)
        self._player.store(data)
        self._arming.rearm_if_timed_out(timing.lead_us)  # an upload takes longer than a hold
        t0_us, end = self._player.play(frames, timing, self._intended, progress)
        status = self._ended()
        return PlayReport(
            frames=timing.loops * len(frames),
            latched=None if end is None else end.frames,
            t0_us=t0_us,
            clock_uncertainty_us=self._session.clock.uncertainty_us,
            status=status,
        )

    def _make_ready(self, frames: list[Frame], first_us: int) -> None:
        """Stop a running playback, set the sound speed of *frames*, rearm if needed."""
        self._player.stop()
        self._configuration.agree_on_sound_speed(frames)
        self._arming.rearm_if_timed_out(first_us)

    def _ended(self) -> StatusReply:
        """Take the latches of the trace ring, and ask the board how it went."""
        self._session.collect_ring()
        return self._link.request(GetStatus(), StatusReply)
