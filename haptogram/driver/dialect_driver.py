"""The driver of boards that speak another wire: phases, foci, and streams that their line carries.

These boards have neither sessions nor clocks that a host could ask, and most never answer. They
latch a frame when it is complete. What the host knows of them is what it sent, so the observations
of this driver are read back from its own bytes: evidence of the wire, and of no board.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from haptogram.acoustics import AcousticModel, Calibration, Medium
from haptogram.acoustics.arrays import as_float_vector, check_array_magnitudes
from haptogram.acoustics.solvers.several import Method
from haptogram.driver.frames import dialect_frames
from haptogram.driver.frames.targets import Targets, as_frame_foci
from haptogram.driver.identity import check_air_of_identity
from haptogram.driver.line.budget import check_dialect_rate
from haptogram.driver.line.dialect_line import DialectLine
from haptogram.driver.line.port import Transport, check_port, open_transport
from haptogram.driver.timing import limits
from haptogram.driver.timing.realtime import PeriodicLoop
from haptogram.driver.timing.schedule import Schedule
from haptogram.machine.closing import ClosedByWith
from haptogram.machine.interrupts import without_interrupts
from haptogram.machine.process import real_time_process
from haptogram.records.frame import MAX_PHASE_RAD, Evidence, Focus, Intended, Observation
from haptogram.records.kept import MOST_KEPT, KeptRecords, check_kept_records
from haptogram.settings import arguments
from haptogram_protocol.dialects.codec import Dialect

_NS_PER_S: Final = 1_000_000_000
_START_NS: Final = 2_000_000  # time from the last preparation to the first frame
_SETTLING_NS: Final = 5_000_000  # time from the last byte on the line until a board has latched
_WITHOUT_A_LINE_BAUD: Final = 1_000_000  # rate of a port that ignores it
_PROGRESS_HZ: Final = 20
_EARLY: Final = 0.5  # silence, as a share of that after which a board loses its state


@dataclass(frozen=True, slots=True)
class DialectReport:
    """Counts and times of a stream, as the host measured them.

    Attributes
    ----------
    frames : int
        Frames that were sent.
    lateness_us : (n,) numpy.ndarray
        How late the host was at each tick, in microseconds.
    late_ticks : int
        Ticks that were late by a period or more; their frames were sent all the same.
    not_permitted : tuple of str
        Services for a real-time loop that the system refused.
    """

    skipped = ()  # no frame has a time that it could miss

    frames: int
    lateness_us: NDArray[np.float64]
    late_ticks: int
    not_permitted: tuple[str, ...]


class DialectDriver(ClosedByWith):
    """A line with boards of another maker, for phases, foci and streams.

    Opening it switches every channel off, and so does closing it.

    Parameters
    ----------
    port : str or Transport
        Any URL that pyserial takes, or an open port; the driver closes it.
    dialect : str or Dialect
        Name of a wire in docs/dialects.md, or the wire of another package.
    baudrate : int, optional
        Bits per second; by default the usual rate of the boards.
    timeout_s : float
        Longest time in seconds in which a board must answer and the port take a byte.
    model : AcousticModel, optional
        Array and air that the host assumes; by default the boards' own array in *medium*.
    medium : Medium, optional
        Air that the host assumes over the boards' own array; by default of 20 C.
    calibration : Calibration or path, optional
        Measured phases and places of the elements, for which the drives compensate.
    channels : sequence of int, optional
        Channel that drives each element; by default element n is at channel n.
    keep : int or None
        Number of the newest entries that :attr:`intended` and :attr:`observations` keep, each.
    sink : callable, optional
        Called with every :class:`Intended` and :class:`Observation`.

    Attributes
    ----------
    dialect : Dialect
        The wire.
    boards : int
        Boards on the line: as many as the channels of all elements need.
    model : AcousticModel
        Array and air of the frames to come.
    intended : KeptRecords of Intended
        Frames with foci that were sent, in order.
    observations : KeptRecords of Observation
        Drives that the bytes of these frames are, of the evidence ``wire``.
    warnings : list of str
        Oddities with which the driver could go on.

    Raises
    ------
    PortNotFoundError, PortBusyError, NoAnswerError
        Ways in which connecting can fail.
    ConfigurationError
        An argument is out of its limits, or the wire is none that this program can drive.

    Examples
    --------
    >>> from haptogram import DialectDriver
    >>> url = "haptogram://?clock=virtual&dialect=sonicsurface"
    >>> with DialectDriver(url, dialect="sonicsurface") as driver:
    ...     report = driver.stream([(0.0, 0.0, 0.15), (0.01, 0.0, 0.15)], rate_hz=40)
    >>> report.frames, str(driver.observations[0].evidence)
    (2, 'wire')
    """

    session = 0

    def __init__(
        self,
        port: str | Transport,
        *,
        dialect: str | Dialect,
        baudrate: int | None = None,
        timeout_s: float = 2.0,
        model: AcousticModel | None = None,
        medium: Medium | None = None,
        calibration: Calibration | str | Path | None = None,
        channels: Sequence[int] | None = None,
        keep: int | None = MOST_KEPT,
        sink: Callable[[Intended | Observation], object] | None = None,
    ) -> None:
        if isinstance(dialect, str):
            from haptogram_protocol.dialects.table import DIALECTS  # many modules

            arguments.check_choice("dialect", dialect, tuple(DIALECTS))
            dialect = DIALECTS[dialect]
        arguments.check_argument_kind(
            "dialect", dialect, Dialect, "the name of a wire, or a Dialect"
        )
        self.dialect = dialect
        self._baudrate = baudrate
        if baudrate is None and dialect.bauds:
            self._baudrate = dialect.bauds[0]
        port_baud = _WITHOUT_A_LINE_BAUD if self._baudrate is None else self._baudrate
        check_port(port, port_baud, timeout_s)
        check_air_of_identity(model, medium)
        keep = check_kept_records(keep)
        arguments.check_callable("sink", sink)
        self.model = (
            dialect_frames.assumed_dialect_frames_model(dialect, medium) if model is None else model
        )
        elements = None if calibration is None else Calibration.of(calibration)
        if channels is None:
            self._channels = tuple(range(self.model.array.count))
        else:
            self._channels = dialect_frames.checked_display_channels(channels)
        self.boards = math.ceil((max(self._channels) + 1) / dialect.channels)
        display = dialect_frames.dialect_display_of(dialect, self.boards)
        if model is None and display.mounting:
            self.model = dialect_frames.mounted_display_model(self.model, display)
        if elements is not None:
            self.model = self.model.calibrated(elements)
        self._display = display
        self._builder()  # refuses channels that do not fit
        self.intended = KeptRecords[Intended](keep, sink)
        self.observations = KeptRecords[Observation](keep, sink)
        self.warnings: list[str] = []
        self._closed = False
        transport = port
        if isinstance(transport, str):
            transport = open_transport(transport, baudrate=port_baud)
        self._line = DialectLine(
            transport, dialect, display, baudrate=self._baudrate, timeout_s=timeout_s
        )
        try:
            self._line.send(display.opening())
            self._shown_ns = self._line.now_ns()
            self._line.run_until(self._line.free_ns + round(display.settle_s * _NS_PER_S))
        except BaseException:
            self._line.close()
            raise

    # --- life ----------------------------------------------------------------------------------

    def close(self) -> None:
        """Switch every channel off and close the port.  Closing twice does no harm.

        An interrupt meanwhile is heard when it is done: no timer of these boards mutes them.

        Raises
        ------
        LinkError
            The port is gone: the boards go on with what they were shown last.
        """
        with without_interrupts():
            self._close()

    def _close(self) -> None:
        """Switch every channel off and close the port, unless that is done."""
        if self._closed:
            return
        self._closed = True
        try:
            self._wake()
            self._line.send([*self._display.off(), *self._display.closing()])
            self._line.run_until(self._line.free_ns + _SETTLING_NS)
        finally:
            self._line.close()

    # --- questions -----------------------------------------------------------------------------

    @property
    def url(self) -> str:
        """URL of the port."""
        return self._line.url

    @property
    def phase_steps(self) -> int:
        """Steps of a period that the boards have."""
        return self._display.steps

    # --- output --------------------------------------------------------------------------------

    def focus(self, target_m: ArrayLike | Focus, *, solver: Method = "naive") -> Intended:
        """Focus on one point and return its record; the boards hold it by themselves."""
        focus = target_m if isinstance(target_m, Focus) else Focus.at(target_m)
        (frame,) = self._builder().build([(focus,)], solver)
        return self._show(frame)

    def phases(self, phases_rad: ArrayLike) -> tuple[int | None, ...]:
        """Give each element a phase of its own, and return the codes of all channels.

        Parameters
        ----------
        phases_rad : (N,) array_like
            Lag of each element, in radians, a million at most; rounded to the steps of the boards.
        """
        phases = as_float_vector("phases_rad", phases_rad, self.model.array.count)
        check_array_magnitudes("phases_rad", phases, MAX_PHASE_RAD)
        frame = self._builder().of_phases(phases)
        self._send(frame)
        return frame.codes

    def mute(self) -> None:
        """Switch every channel off."""
        self._wake()
        self._line.send(self._display.off())
        self._shown_ns = self._line.now_ns()

    def hold(self, seconds: float) -> None:
        """Wait for *seconds*: the boards hold the last frame by themselves."""
        limits.check_hold_duration(seconds)
        self._line.run_until(self._line.now_ns() + round(seconds * _NS_PER_S))

    def frames(
        self, targets: Targets, *, solver: Method = "naive"
    ) -> list[dialect_frames.DialectFrame]:
        """Return the frames that :meth:`stream` would send for *targets*."""
        return self._builder().build(as_frame_foci(targets), solver)

    def stream(
        self,
        targets: Targets | Sequence[dialect_frames.DialectFrame],
        rate_hz: float,
        *,
        loops: int = 1,
        spin_us: int = 0,
        realtime: bool = False,
        solver: Method = "naive",
        progress: arguments.Progress | None = None,
    ) -> DialectReport:
        """Display *targets* one after the other at *rate_hz*, paced by the host.

        No frame carries a time: one that the host sends late is shown late, and none is skipped.

        Parameters
        ----------
        targets : (T, 3) array_like, sequence of Focus, or sequence of sequences of Focus
            Positions in metres, or foci; or the frames that :meth:`frames` made of them.
        loops : int
            How often, 1 or more; 10 million frames in all at most.
        spin_us, realtime, solver, progress
            As in :meth:`haptogram.driver.driver.Driver.stream`.

        Raises
        ------
        ConfigurationError
            Before the first frame: a rate that the line cannot carry, a target out of reach.
        LinkError, DeviceError
            The link broke, or a board refused; :attr:`intended` holds what was sent until then.
        """
        schedule = Schedule.at_rate(rate_hz, 1, queue_depth=1)
        check_dialect_rate(
            self.dialect, self.boards, baudrate=self._baudrate, rate_hz=schedule.rate_hz
        )
        loops, spin_us = limits.check_stream_timing(loops, spin_us, progress, realtime=realtime)
        once = self._builder().frames_of(targets, solver)
        total = limits.check_streamed_frames(loops * len(once))
        period_ns, stride = int(schedule.period_us * 1000), max(1, int(rate_hz / _PROGRESS_HZ))
        lateness_us = np.zeros(total)
        with real_time_process(strict=realtime) as refused:
            loop = PeriodicLoop(
                self._line.now_ns,
                self._line.run_until,
                period_ns=period_ns,
                spin_ns=spin_us * 1000,
            )
            start_ns = self._line.now_ns() + _START_NS
            for number in range(total):
                due_ns = start_ns + 1000 * schedule.offset_us(number)
                lateness_us[number] = (loop.wait(due_ns) - due_ns) / 1e3
                self._show(once[number % len(once)])
                if progress is not None and (number + 1) % stride == 0:
                    progress(number + 1, total)
            self._line.run_until(self._line.free_ns + _SETTLING_NS)
        if progress is not None:
            progress(total, total)
        self.warnings += [text for text in refused if text not in self.warnings]
        late = int((lateness_us >= period_ns / 1e3).sum())
        return DialectReport(total, lateness_us, late, tuple(refused))

    def _builder(self) -> dialect_frames.DialectFrameBuilder:
        """Return the maker of frames for the boards' layout and phases."""
        return dialect_frames.DialectFrameBuilder(self.model, self._display, self._channels)

    def _show(self, frame: dialect_frames.DialectFrame) -> Intended:
        """Send a frame of foci; keep and return it as intended, keep what was sent as observed.

        Observed is the drive in the bytes on the wire, if they are a whole frame.
        """
        intended = frame.intended(self.intended.total)
        self.intended.append(intended)
        seen = self._send(frame)
        if seen is not None:
            self.observations.append(
                Observation(
                    key=intended.key,
                    t_latch_us=self._line.free_ns // 1000,
                    late=False,
                    evidence=Evidence.WIRE,
                    drive=self._builder().drive_of(seen),
                )
            )
        return intended

    def _send(self, frame: dialect_frames.DialectFrame) -> list[int | None] | None:
        """Send a frame; return the phase codes that its bytes show, None for no whole frame.

        The code of a silent channel is None.
        """
        self._wake()
        seen = self._line.send(self._display.frame(frame.codes))
        self._shown_ns = self._line.now_ns()
        return seen

    def _wake(self) -> None:
        """Send silence first if the boards were idle for half the time after which they lose bytes.

        Boards that were idle for all of that time may lose the beginning of the next frame.
        """
        silent_ns = self._line.now_ns() - self._shown_ns
        if silent_ns > _EARLY * self._display.forgets_s * _NS_PER_S:
            self._line.send(self._display.off())
