"""The driver of a board: connect, arm, focus, stream, play, read back; and mute, always."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from haptogram.acoustics import AcousticModel, Calibration, Medium, TransducerArray
from haptogram.acoustics.solvers.several import Method
from haptogram.driver.frames.builder import FrameBuilder
from haptogram.driver.frames.frame import Frame, Mode
from haptogram.driver.frames.targets import Targets, as_frame_foci
from haptogram.driver.identity import check_air_of_identity, read_geometry
from haptogram.driver.line.link import NS_PER_S, Link
from haptogram.driver.line.port import DEFAULT_BAUDRATE, Transport, check_port, open_transport
from haptogram.driver.playback import (
    MOST_PLAYED,
    DriverPlayback,
    PlaybackTiming,
    PlayReport,
)
from haptogram.driver.session import DriverSession, Sink, choose_session_nonce
from haptogram.driver.stream import Streamer, StreamPacing, StreamReport, stream_preparation_ns
from haptogram.driver.timing import limits
from haptogram.driver.timing.realtime import next_deadline_ns
from haptogram.driver.timing.schedule import Schedule
from haptogram.driver.upload import SequenceData, upload_correction
from haptogram.errors import ConfigurationError
from haptogram.machine.closing import ClosedByWith
from haptogram.records.frame import Focus, Intended, Observation
from haptogram.records.kept import MOST_KEPT, KeptRecords, check_kept_records
from haptogram.settings.arguments import (
    Progress,
    check_argument_kind,
    check_callable,
    check_number,
    check_whole,
)
from haptogram_protocol import HostConnection, messages
from haptogram_protocol.cobs import fastest_cobs
from haptogram_protocol.connection import EventReceived
from haptogram_protocol.state import OutputState


class Driver(ClosedByWith):
    """A session with one board, of one thread at a time.

    Parameters
    ----------
    port : str or Transport
        Any URL that pyserial takes, or an open port; the driver closes it.
    baudrate : int
        Bits per second.
    nonce : int, optional
        Number of the session, 1 to 65535; by default drawn at random.
    seed : int, optional
        Seed that draws the nonce: runs with a board that was just started repeat exactly.
    timeout_s : float
        Longest time in seconds in which the board must answer and the port take a byte.
    model : AcousticModel, optional
        Array and air that the host assumes; by default the board's own array in *medium*.
    medium : Medium, optional
        Air that the host assumes over the board's own array; by default of 20 C.
    calibration : Calibration or path, optional
        Measured phases and places of the elements, or a CSV file of them: the drives compensate
        for both.  The board's array is still compared with the nominal one.
    trace : TraceMode, optional
        Report that the board sends of every latch; by default as the board is configured.
    keep : int or None
        Number of the newest entries that :attr:`intended`, :attr:`observations` and
        :attr:`events` keep, each.  None keeps all, which is 1 GB an hour at 1 kHz.  A verdict over
        frames that were dropped is no pass.
    sink : callable, optional
        Called with every :class:`Intended` and :class:`Observation`, kept or not; it may mute.

    Attributes
    ----------
    session : int
        Nonce of the session.
    identity : HelloReply
        The board's answer to HELLO.
    model : AcousticModel
        Array and air of the frames to come.  May be set to another model of the same array; frames
        that are ready keep theirs.
    clock : ClockEstimate
        Estimate of the device clock.
    intended : KeptRecords of Intended
        Frames that were sent or due, in order; ``intended.dropped`` counts those not kept.
    observations : KeptRecords of Observation
        Latches that the board reported; ``observations.dropped`` counts those not kept, here or in
        its trace ring.
    events : KeptRecords of EventReceived
        Other events of the board, without the periodic status.
    warnings : list of str
        Oddities with which host and board can still work together.

    Raises
    ------
    PortNotFoundError, PortBusyError, NoAnswerError, WrongProtocolError, VersionMismatchError
        Every way in which connecting can fail.
    ConfigurationError
        An argument is out of its limits (before the port is opened), the model is not that of the
        board, or the calibration not that of its array.

    Examples
    --------
    >>> with Driver(url, seed=1) as driver:
    ...     state = driver.arm()
    ...     intended = driver.focus((0.0, 0.0, 0.15))
    ...     report = driver.stream([(0.0, 0.0, 0.15), (0.01, 0.0, 0.15)], rate_hz=500)
    >>> intended.key.index, report.status.counters.latched
    (65520, 3)
    """

    def __init__(
        self,
        port: str | Transport,
        *,
        baudrate: int = DEFAULT_BAUDRATE,
        nonce: int | None = None,
        seed: int | None = None,
        timeout_s: float = 2.0,
        model: AcousticModel | None = None,
        medium: Medium | None = None,
        calibration: Calibration | str | Path | None = None,
        trace: messages.TraceMode | None = None,
        keep: int | None = MOST_KEPT,
        sink: Sink | None = None,
    ) -> None:
        check_port(port, baudrate, timeout_s)
        check_air_of_identity(model, medium)
        if trace is not None:
            check_argument_kind("trace", trace, messages.TraceMode, "a TraceMode, or None")
        keep = check_kept_records(keep)
        check_callable("sink", sink)
        elements = None if calibration is None else Calibration.of(calibration)
        self.session = choose_session_nonce(nonce, seed)
        connection = HostConnection(nonce=self.session, cobs=fastest_cobs())
        transport = open_transport(port, baudrate=baudrate) if isinstance(port, str) else port
        self._link = Link(transport, connection, baudrate=baudrate, timeout_s=timeout_s, keep=keep)
        self._session = DriverSession(self._link, keep, sink)
        self.identity, self.clock = self._session.identity, self._session.clock
        self.observations, self.events = self._session.observations, self._session.events
        self.warnings = self._session.warnings
        self.intended = KeptRecords[Intended](keep, sink)
        self._closed = False
        try:
            self.model = self._session.start(model, medium, elements)
            if trace is not None:
                self.configure(trace_mode=trace)
            self._builder()  # refuses a model of another array
        except BaseException:
            self._session.abandon()
            raise
        session = self._session
        self._streamer = Streamer(
            self._link,
            session.pinger,
            self.identity,
            intended=self.intended,
            status=lambda: session.last_status,
        )
        self._player = DriverPlayback(self._link, session.pinger, self.identity, events=self.events)
        self._held: Frame | None = None

    # --- life ----------------------------------------------------------------------------------

    def close(self) -> None:
        """Mute the board and close the port, in bounded time.  Closing twice does no harm.

        Raises
        ------
        LinkError
            If the board did not confirm that it is mute; its own timers will mute it.
        """
        if not self._closed:
            self._closed = True
            self._session.close()

    def arm(self) -> OutputState:
        """Allow output; it stays silent until the first frame is latched.

        A board mutes itself if it hears no frame for a while.  The next call that sends frames
        arms the board again after such a pause, until :meth:`mute` or :meth:`disarm`.
        """
        return self._session.control.arm()

    def mute(self) -> OutputState:
        """Switch the output off, ahead of everything that waits."""
        return self._session.control.mute()

    def disarm(self) -> OutputState:
        """Switch the output off and forbid it."""
        return self._session.control.disarm()

    # --- questions -----------------------------------------------------------------------------

    @property
    def url(self) -> str:
        """URL of the port."""
        return self._link.url

    @property
    def link_counters(self) -> dict[str, int]:
        """Counts of good and damaged frames from the board, by name."""
        return dict(self._link.connection.counters)

    @property
    def last_status(self) -> messages.Status | None:
        """The newest periodic status of the board; None before the first."""
        return self._session.last_status

    def device_time_us(self) -> int:
        """Return the present time on the board's clock, unwrapped, as the host estimates it."""
        return self.clock.to_device_us(self._link.now_ns())

    def time_of_event_us(self, event: EventReceived) -> int:
        """Return the device time of *event*, unwrapped."""
        check_argument_kind("event", event, EventReceived, "an event, as in Driver.events")
        return self._session.time_of_event_us(event)

    def status(self) -> messages.StatusReply:
        """Return the board's counters and arrival margin; the margin is then reset."""
        return self._link.request(messages.GetStatus(), messages.StatusReply)

    def ping(self) -> float:
        """Measure the device clock again and return the remaining error, in microseconds."""
        self._session.pinger.synchronise()
        return self.clock.uncertainty_us

    def silences_us(self) -> list[tuple[int, int]]:
        """Return begin and end of each time in which this host sent nothing for 20 ms or longer.

        Unwrapped device times in microseconds.
        """
        to_device_us = self.clock.to_device_us
        return [(to_device_us(t0), to_device_us(t1)) for t0, t1 in self._link.silences_ns]

    def config(self) -> messages.Config:
        """Return the board's configuration."""
        return self._session.control.read()

    def configure(self, **changes: Any) -> messages.Config:
        """Change fields of the board's configuration and return the one then in force.

        Parameters
        ----------
        **changes
            Fields of :class:`~haptogram_protocol.messages.Config`.

        Raises
        ------
        ConfigurationError
            If there is no such field, or a value does not fit its field.
        DeviceError
            If the board refuses a value.
        """
        return self._session.control.change(**changes)

    def correct_phases(self, codes: bytes) -> None:
        """Set the phase correction of every transducer, in 1/256 turns."""
        upload_correction(self._link, self.identity, codes)

    def geometry(self) -> TransducerArray:
        """Return the board's array, read element by element."""
        return read_geometry(self._link, self.identity)

    def read_drive(self, kind: messages.DriveKind = messages.DriveKind.LATCHED) -> Observation:
        """Return the present drive at the transducers, latched or radiated."""
        return self._session.read_drive(kind)

    def collect_ring(self) -> None:
        """Add the latches in the board's trace ring, if it keeps one, to the observations."""
        self._session.collect_ring()

    # --- output --------------------------------------------------------------------------------

    def focus(self, target_m: ArrayLike | Focus, *, mode: Mode = "phases") -> Intended:
        """Focus on one point, as soon as the frame is complete, and return its record."""
        focus = target_m if isinstance(target_m, Focus) else Focus.at(target_m)
        (frame,) = self._builder().build([(focus,)], mode)
        self._make_ready([frame], 0)
        self._held = frame
        return self._streamer.send_now(frame)

    def hold(self, seconds: float) -> None:
        """Keep the last focus for *seconds*: neither lease nor hold timer expires meanwhile.

        After a pause in which they did, before this or in a stall of the host, it sounds again.

        Raises
        ------
        ConfigurationError
            If nothing was focused on yet, or the board is not armed.
        """
        limits.check_hold_duration(seconds)
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
                deadline_ns=deadline_ns,
                now_ns=now_ns,
                period_ns=self._session.control.refresh_ns,
            )
        self._link.run_until(end_ns)

    def frames(
        self, targets: Targets, *, mode: Mode = "phases", solver: Method = "naive"
    ) -> list[Frame]:
        """Return the frames that :meth:`stream` and :meth:`play` would send for *targets*.

        Many foci take a solver longer than a board waits for its host: whoever makes the frames
        first, and arms then, does not let the lease run out.  Equal targets share one frame.

        Parameters and errors as in :meth:`stream`.
        """
        return self._builder().build(as_frame_foci(targets), mode, solver)

    def stream(
        self,
        targets: Targets | Sequence[Frame],
        rate_hz: float,
        *,
        loops: int = 1,
        lead_us: int | None = None,
        trim: bool = False,
        miss_share: float = 1e-3,
        spin_us: int = 0,
        realtime: bool = False,
        mode: Mode | None = None,
        solver: Method | None = None,
        progress: Progress | None = None,
    ) -> StreamReport:
        """Display *targets* one after the other at *rate_hz*, each at its time.

        Parameters
        ----------
        targets : (T, 3) array_like, sequence of Focus, or sequence of sequences of Focus
            Positions in metres, or foci; or the frames that :meth:`frames` made of them.
        loops : int
            How often, 1 or more; 10 million frames in all at most.
        lead_us : int, optional
            How long before its time a frame is sent: a stall of the host that is shorter reaches
            nobody.  By default 100 ms, or what three quarters of the board's queue hold, or three
            quarters of what it looks ahead.
        trim : bool
            Shorten the lead as far as the arrival margins that the board reports permit.
        miss_share : float
            Share of the frames that may then be late, 0 to 1.
        spin_us : int
            How long before its deadline the loop stops sleeping and watches the clock; a quarter of
            the period at most.
        realtime : bool
            Ask for fixed priority, locked memory and a frozen collector; what is not permitted is
            in the report and in :attr:`warnings`.
        mode : str
            ``phases`` (the default) and ``drives``: the host computes the drive; ``points``: the
            board does.  Frames that are ready have their mode and their solver.
        solver : str
            How the host makes the drive of a frame with several foci: one of
            :data:`haptogram.acoustics.solvers.several.METHODS`, by default ``naive``.
        progress : callable, optional
            Called with the number done and the total, about 20 times a second.

        Raises
        ------
        ConfigurationError
            Before the first frame: a rate that the line cannot carry, a lead that the board's queue
            cannot hold, a target out of reach, a mode that the board does not have, frames that
            were made for another board, or otherwise than *mode* and *solver* say; a board that is
            not armed.
        LinkError
            The link broke, or the board's clock jumped; :attr:`intended` holds what was sent until
            then.
        """
        limit = self.identity
        schedule = Schedule.at_rate(
            rate_hz, lead_us, queue_depth=limit.queue_depth, horizon_us=limit.max_horizon_us
        )
        loops, spin_us = limits.check_stream_timing(loops, spin_us, progress, realtime=realtime)
        check_number("miss_share", miss_share, 0.0, 1.0)
        check_argument_kind("trim", trim, bool, "True or False")
        once = self._builder().frames_of(targets, mode, solver)
        limits.check_streamed_frames(loops * len(once))
        known, baudrate = self._session.control.known, self._link.line.baudrate
        schedule.check(once, self.identity, baudrate)
        schedule.check_timers(known)
        pacing = StreamPacing(
            spin_us,
            realtime,
            schedule.lead_trim(once, self.identity, known, baudrate, miss_share) if trim else None,
            self._session.control.refresh_ns,
        )
        every = once * loops
        self._session.pinger.refresh()
        self._make_ready(once, schedule.lead_us + stream_preparation_ns(len(every)) // 1000)
        report = self._streamer.stream(every, schedule, pacing, progress, self._final_status)
        for text in report.not_permitted:
            self._session.warn(text)
        return report

    def play(
        self,
        targets: Targets | Sequence[Frame],
        rate_hz: float,
        *,
        loops: int = 1,
        mode: Mode | None = None,
        solver: Method | None = None,
        lead_us: int | None = None,
        unattended_ms: int | None = None,
        progress: Progress | None = None,
    ) -> PlayReport:
        """Upload *targets* as a sequence, play it on the board's clock, and wait for the end.

        Parameters that are not listed here, and errors, are those of :meth:`stream`.

        Parameters
        ----------
        loops : int
            How often, 1 or more; 100 million frames in all at most.
        mode : str
            ``phases`` (the default) or ``points``; frames that are ready are all of one of the two.
        unattended_ms : int, optional
            How long the board plays on without hearing from this host, 1000 or more; by default
            3000, or what the board allows if that is less.
        """
        check_callable("progress", progress)
        timing = PlaybackTiming.checked(self.identity, rate_hz, loops, lead_us, unattended_ms)
        frames = self._builder().frames_of(targets, mode, solver)
        total = timing.loops * len(frames)
        check_whole("number of frames, all loops of them", total, 1, MOST_PLAYED)
        data = SequenceData.of(frames)
        data.check(self.identity)
        timing.check_frames(frames, self.identity)
        self._make_ready(frames, timing.lead_us)
        self._player.store(data)
        self._session.pinger.refresh()
        self._session.control.rearm_if_timed_out(timing.lead_us)  # an upload outlasts a hold
        t0_us, end = self._player.play(frames, timing, self.intended, progress)
        status = self._final_status()
        return PlayReport(
            frames=total,
            latched=None if end is None else end.frames,
            t0_us=t0_us,
            clock_uncertainty_us=self.clock.uncertainty_us,
            status=status,
        )

    def _make_ready(self, frames: list[Frame], first_us: int) -> None:
        """Stop a playback, set the sound speed of *frames*; rearm a board that a timer mutes.

        It is muted by one already, or will be in the *first_us* µs until the first latch.
        """
        self._player.stop()
        self._session.control.agree_on_sound_speed(frames)
        self._session.control.rearm_if_timed_out(first_us)

    def _final_status(self) -> messages.StatusReply:
        """Read the latches that the board's trace still holds, then return the board's status."""
        self._session.collect_ring()
        return self.status()

    def _builder(self) -> FrameBuilder:
        """Return the maker of frames for this model and board."""
        return FrameBuilder(self.model, self.identity)
