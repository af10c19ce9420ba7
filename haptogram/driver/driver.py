"""The driver of a board: connect, arm, focus, stream, play, read back; and mute, always.

::

    with Driver("/dev/ttyUSB0") as driver:
        driver.arm()
        driver.focus((0.0, 0.0, 0.15))
        driver.stream(points, rate_hz=1000)
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final, cast

from numpy.typing import ArrayLike

from haptogram.acoustics import AcousticModel, Calibration, Medium
from haptogram.acoustics.solvers.several import Method
from haptogram.driver.arming import ArmedSession
from haptogram.driver.frames import (
    REGISTER_BITS,
    Frame,
    FrameBuilder,
    Mode,
    Targets,
    are_frames,
    as_foci,
    check_asked,
    check_frames,
)
from haptogram.driver.line.budget import frame_bytes, transmission_ns
from haptogram.driver.line.link import NS_PER_S, Progress
from haptogram.driver.line.port import DEFAULT_BAUDRATE, Transport
from haptogram.driver.playback import MOST_PLAYED, Player, PlayReport, Timing, playback_period_us
from haptogram.driver.session import Sink
from haptogram.driver.stream import Pacing, Streamer, StreamReport, preparation_ns
from haptogram.driver.timing.lead import LeadTrim
from haptogram.driver.timing.realtime import next_deadline_ns
from haptogram.driver.timing.schedule import Schedule
from haptogram.driver.upload import SequenceData
from haptogram.errors import ConfigurationError
from haptogram.records.frame import Focus, Intended
from haptogram.records.kept import MOST_KEPT, Kept
from haptogram.settings.arguments import check_callable, check_kind, check_number, check_whole
from haptogram_protocol.messages import Feature, TraceMode

DEFAULT_PLAY_LEAD_US: Final = 100_000  # from PLAY to the first frame
_MOST_STREAMED: Final = 10_000_000  # frames in one call: each leaves 64 bytes in its report
_LONGEST_SPIN_US: Final = 1_000_000
_LONGEST_HOLD_S: Final = 1e7


class Driver(ArmedSession):
    """A session with one board.

    Parameters
    ----------
    port : str or Transport
        Any URL that pyserial takes, or a port that is open; it is closed with the driver.
    baudrate : int
        Bits per second.
    nonce : int, optional
        Session to ask for, 1 to 65535; by default one at random.
    seed : int, optional
        Seed of the nonce instead, for a board that was just started: its runs repeat exactly.
    timeout_s : float
        How long the board may take to answer, and the port to take a byte.
    phase_bits : int
        Bits per phase on the wire.
    model : AcousticModel, optional
        Array and air that the host assumes; by default the board's own array in *medium*.
    medium : Medium, optional
        Air that the host assumes over the board's own array; by default of 20 C.
    calibration : Calibration or path, optional
        How the elements really are, or the CSV file that says so: the drives compensate for their
        phases and places. The board's array is still compared with the nominal one.
    trace : TraceMode, optional
        What the board shall report of every latch; by default what it is set to.
    keep : int or None
        How many entries :attr:`intended`, :attr:`observations` and :attr:`events` keep each: the
        newest ones; None: all, which is 1 GB an hour at 1 kHz.  A verdict over frames that are not
        kept any more is no pass.
    sink : callable, optional
        Called with every :class:`Intended` and :class:`Observation` as it comes, kept or not: for
        example a :class:`~haptogram.evidence.record_file.RecordFile`.

    Attributes
    ----------
    identity : HelloReply
        What the board said of itself.
    model : AcousticModel
        May be set to another one of the same array, in other air; frames that are ready stay what
        they are.
    clock : ClockEstimate
        Of the device clock.
    intended : Kept of Intended
        What was sent or should have been, in order; ``intended.dropped`` is not kept any more.
    observations : Kept of Observation
        What the board said it latched.
    events : Kept of EventReceived
        What it reported otherwise, but for the periodic status.
    last_status : Status or None
        The newest periodic status.
    warnings : list of str
        What is odd, but does not keep the two from working together.

    Raises
    ------
    PortNotFoundError, PortBusyError, NoAnswerError, WrongProtocolError, VersionMismatchError
        Every way in which connecting can fail.
    ConfigurationError
        An argument that cannot be, before the port is opened; the model is not that of the board,
        the calibration not that of its array, or the board does not take *phase_bits*.
    """

    def __init__(
        self,
        port: str | Transport,
        *,
        baudrate: int = DEFAULT_BAUDRATE,
        nonce: int | None = None,
        seed: int | None = None,
        timeout_s: float = 2.0,
        phase_bits: int = 8,
        model: AcousticModel | None = None,
        medium: Medium | None = None,
        calibration: Calibration | str | Path | None = None,
        trace: TraceMode | None = None,
        keep: int | None = MOST_KEPT,
        sink: Sink | None = None,
    ) -> None:
        check_whole("phase_bits", phase_bits, 1, REGISTER_BITS)
        super().__init__(
            port,
            baudrate=baudrate,
            nonce=nonce,
            seed=seed,
            timeout_s=timeout_s,
            model=model,
            medium=medium,
            calibration=calibration,
            trace=trace,
            keep=keep,
            sink=sink,
        )
        self.intended = Kept[Intended](keep, sink)
        self._held: Frame | None = None
        self._phase_bits = phase_bits
        try:
            self._builder()
        except ConfigurationError:
            self._link.close()
            raise
        link, pinger, identity = self._link, self._pinger, self.identity
        self._streamer = Streamer(
            link,
            pinger,
            identity,
            intended=self.intended,
            status=lambda: self.last_status,
        )
        self._player = Player(link, pinger, identity, events=self.events)

    # --- output --------------------------------------------------------------------------------

    def focus(self, target_m: ArrayLike | Focus, *, mode: Mode = "phases") -> Intended:
        """Focus on one point, as soon as the frame is complete, and return what was sent."""
        focus = target_m if isinstance(target_m, Focus) else Focus.at(target_m)
        (frame,) = self._builder().build([(focus,)], mode)
        self._agree_on_air([frame])
        self._resume(0)
        self._held = frame
        return self._streamer.send_now(frame)

    def hold(self, seconds: float) -> None:
        """Keep the last focus for so long: neither lease nor hold timer expires meanwhile.

        After a pause in which they did, before this or in a stall of the host, it sounds again.

        Raises
        ------
        ConfigurationError
            If nothing was focused on yet, or the board is not armed.
        """
        check_number("seconds", seconds, 0.0, _LONGEST_HOLD_S)
        if self._held is None:
            raise ConfigurationError("there is no focus to hold; call focus first")
        deadline_ns = self._link.now_ns()
        end_ns = deadline_ns + int(seconds * NS_PER_S)
        while deadline_ns < end_ns:
            self._link.run_until(deadline_ns)
            self._pinger.keep()
            self._agree_on_air([self._held])
            self._resume(0)  # every time: a timer may have run out whenever the host was held up
            self._streamer.send_now(self._held)
            now_ns = self._link.now_ns()
            deadline_ns = next_deadline_ns(
                deadline_ns=deadline_ns, now_ns=now_ns, period_ns=self._refresh_ns
            )
        self._link.run_until(end_ns)

    def frames(
        self, targets: Targets, *, mode: Mode = "phases", solver: Method = "naive"
    ) -> list[Frame]:
        """Return what :meth:`stream` and :meth:`play` would send for *targets*, ready ahead.

        Many foci take a solver longer than a board waits for its host: whoever makes the frames
        first, and arms then, does not let the lease run out.  Equal targets share one frame.

        Parameters and errors as in :meth:`stream`.
        """
        return self._builder().build(as_foci(targets), mode, solver)

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
            Positions in metres, or foci; or what :meth:`frames` made of them.
        loops : int
            How often, 1 or more; 10 million frames in all at most.
        lead_us : int, optional
            How long before its time a frame is sent: a stall of the host that is shorter reaches
            nobody.  By default 100 ms, or what three quarters of the board's queue hold.
        trim : bool
            Shorten the lead to what the arrival margins that the board reports show to be enough.
        miss_share : float
            Share of the frames that may then be late, 0 to 1.
        spin_us : int
            How long before its deadline the loop stops sleeping and watches the clock; cut to a
            quarter of the period.
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
        queue_depth = self.identity.queue_depth
        schedule = Schedule.at_rate(rate_hz, lead_us, queue_depth=queue_depth)
        check_whole("loops", loops, 1, _MOST_STREAMED)
        check_whole("spin_us", spin_us, 0, _LONGEST_SPIN_US)
        check_number("miss_share", miss_share, 0.0, 1.0)
        for name, value in (("trim", trim), ("realtime", realtime)):
            check_kind(name, value, bool, "True or False")
        check_callable("progress", progress)
        once = self._made(targets, mode, solver)
        check_whole("number of frames, all loops of them", loops * len(once), 1, _MOST_STREAMED)
        schedule.check(once, self.identity, self._link.line.baudrate)
        schedule.check_timers(self._config)
        frames = once * loops
        lead_trim = self._trim(schedule, frames, miss_share) if trim else None
        pacing = Pacing(spin_us, realtime, lead_trim)
        self._agree_on_air(once)
        self._resume(schedule.lead_us + preparation_ns(len(frames)) // 1000)
        stalls = self._link.stalls
        done = self._streamer.stream(frames, schedule, pacing, progress)
        self.collect_ring()
        for text in done.not_permitted:
            self._warn(text)
        lateness_us = done.ticks.lateness_us()
        return StreamReport(
            frames=len(frames),
            skipped=tuple(done.skipped),
            lateness_us=lateness_us,
            late_ticks=int((lateness_us >= float(schedule.period_us)).sum()),
            write_stalls=self._link.stalls - stalls,
            lead_us=done.lead_us,
            lead_moves=lead_trim.moves if lead_trim else 0,
            ticks=done.ticks,
            not_permitted=done.not_permitted,
            clock_uncertainty_us=self.clock.uncertainty_us,
            t0_us=done.t0_us,
            status=self.status(),
        )

    def _trim(self, schedule: Schedule, frames: list[Frame], miss_share: float) -> LeadTrim:
        """Return what moves the lead down from that of *schedule*.

        Raises
        ------
        ConfigurationError
            If the board was told not to report its arrival margins.
        """
        if not self._config.status_period_ms:
            raise ConfigurationError(
                "trim needs the STATUS of the board, and status_period_ms is 0: configure it"
            )
        size = frame_bytes(max(frame.payload_bytes for frame in frames))
        shortest_us = -(-transmission_ns(size, self._link.line.baudrate) // 1000) + 1
        return LeadTrim(schedule.lead_us, shortest_us, miss_share)

    def play(
        self,
        targets: Targets | Sequence[Frame],
        rate_hz: float,
        *,
        loops: int = 1,
        mode: Mode | None = None,
        solver: Method | None = None,
        lead_us: int = DEFAULT_PLAY_LEAD_US,
        unattended_ms: int = 3000,
        progress: Progress | None = None,
    ) -> PlayReport:
        """Upload *targets* as a sequence, play it on the board's clock, and wait for the end.

        Parameters
        ----------
        loops : int
            How often, 1 or more; 100 million frames in all at most.
        mode : str
            ``phases`` (the default) or ``points``; frames that are ready are all of one of the two.
        unattended_ms : int
            How long the board plays on without hearing from this host.

        Others and errors as in :meth:`stream`.
        """
        check_callable("progress", progress)
        period_us = playback_period_us(rate_hz, self.identity)
        timing = Timing(period_us, loops, lead_us, unattended_ms)
        timing.check(self.identity)
        frames = self._made(targets, mode, solver)
        check_whole("number of frames, all loops of them", loops * len(frames), 1, MOST_PLAYED)
        data = SequenceData.of(frames)
        data.check(self.identity)
        self._agree_on_air(frames)
        self._resume(lead_us)
        self._player.store(data)
        self._resume(lead_us)  # an upload takes longer than a drive is held
        t0_us, end = self._player.play(frames, timing, self.intended, progress)
        self.collect_ring()
        return PlayReport(
            frames=loops * len(frames),
            latched=None if end is None else end.frames,
            t0_us=t0_us,
            clock_uncertainty_us=self.clock.uncertainty_us,
            status=self.status(),
        )

    def _builder(self) -> FrameBuilder:
        return FrameBuilder(self.model, self.identity, self._phase_bits)

    def _made(
        self, targets: Targets | Sequence[Frame], mode: Mode | None, solver: Method | None
    ) -> list[Frame]:
        if not are_frames(targets):
            mode, solver = "phases" if mode is None else mode, "naive" if solver is None else solver
            return self.frames(cast("Targets", targets), mode=mode, solver=solver)
        check_asked(targets, mode, solver)
        check_frames(targets, self.model, self.identity, self._phase_bits)
        return list(targets)

    def _agree_on_air(self, frames: Iterable[Frame]) -> None:
        """Tell a board that computes drives for which speed of sound *frames* were made."""
        if self._in_doubt:
            self.config()
        speeds = (f.sound_speed_mm_s for f in frames if f.sound_speed_mm_s is not None)
        speed_mm_s = next(speeds, None)
        if speed_mm_s is None or speed_mm_s == self._config.sound_speed_mm_s:
            return
        if not self.identity.features & Feature.CONFIG:
            raise ConfigurationError(
                f"the frames are for a speed of sound of {speed_mm_s / 1000:g} m/s; the board "
                f"assumes {self._config.sound_speed_mm_s / 1000:g} m/s and cannot be told"
            )
        self.configure(sound_speed_mm_s=speed_mm_s)
