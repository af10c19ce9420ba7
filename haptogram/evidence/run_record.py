"""One verification run: object -> driver -> what was latched -> what to judge."""

from __future__ import annotations

import contextlib
import dataclasses
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Final, cast

from haptogram import verification
from haptogram.acoustics import AcousticModel, Calibration, TransducerArray
from haptogram.acoustics.arrays import FloatArray
from haptogram.driver.driver import Driver
from haptogram.driver.frames.frame import Frame, Mode
from haptogram.driver.line.port import open_transport
from haptogram.driver.playback import PlayReport, default_unattended_ms
from haptogram.driver.session import Sink
from haptogram.driver.stream import StreamReport
from haptogram.errors import DeviceError, LinkError
from haptogram.evidence.boards import AnyDriver, BoardUnderTest
from haptogram.evidence.dialects.latches import upload_loss_text
from haptogram.machine.terminal import printable_on_terminal
from haptogram.objects import run_frames
from haptogram.records.frame import STREAM, Intended, Observation
from haptogram.records.kept import only_kept_records
from haptogram.records.losses import BoardLosses
from haptogram.settings.arguments import Progress
from haptogram.settings.frozen import dataclass, field
from haptogram.settings.run.verify import VerifyConfig
from haptogram_protocol.dialects.codec import Dialect
from haptogram_protocol.messages import GROWING_COUNTERS, Counters, HelloReply, StateChanged

if TYPE_CHECKING:
    from haptogram.acoustics.solvers.several import Method
    from haptogram.driver.dialect_driver import DialectReport
    from haptogram.evidence.recordings.tap import RecordingTransport
    from haptogram.evidence.recordings.writer import RecordingWriter

_UNDER_WAY_US: Final = 5_000  # time until the first frame after a silence is at the board
_OWN_MUTE: Final = ("flushed",)  # counts what the host cancelled


@dataclass(slots=True)
class RunRecord:
    """Records of a run, whole or interrupted.

    Attributes
    ----------
    board : str
        The board of the run, in words.
    model : AcousticModel
        Array and air that it radiated into, as far as anybody knows.
    intended, observations
        To be joined by their keys.
    about : dict
        Identity that the board reported; of another dialect, the known facts about its boards.
    report : StreamReport, PlayReport, DialectReport or None
        The host's side; None if the run did not come to its end.
    cut : Cut or None
        How the run ended before its end.
    interrupted : bool
        Whether it was ended on purpose: then waits are as short as possible.
    unseen : str or None
        Why latches may be missing from the observations; None: none is missing.
    warnings : list of str
        Warnings about the run.
    silences : list of int
        Device times at which the output fell silent.
    losses : BoardLosses or None
        Records about frames that the board did not latch; None: on other wires.
    fault_counts : dict of str to int, or None
        How often each fault on purpose has fired; None: there was none, or the board did not tell.
    troubles : dict of str to dict of str to int
        Counts by ``board`` and ``host`` of frames that were damaged, lost or out of time, by the
        names of SPEC.md chapter 9; the counts that are not 0.
    """

    board: str
    model: AcousticModel
    about: dict[str, object]
    intended: Sequence[Intended] = ()
    observations: Sequence[Observation] = ()
    report: StreamReport | PlayReport | DialectReport | None = None
    cut: verification.Cut | None = None
    interrupted: bool = False
    unseen: str | None = None
    warnings: list[str] = field(default_factory=list)
    silences: list[int] = field(default_factory=list)
    losses: BoardLosses | None = None
    fault_counts: dict[str, int] | None = None
    troubles: dict[str, dict[str, int]] = field(default_factory=dict)

    def verdict(
        self,
        *,
        min_verified: float = 1.0,
        tolerance: verification.Tolerance | None = None,
        uncertainty: verification.Uncertainty | None = None,
        progress: Progress | None = None,
    ) -> verification.RunVerdict:
        """Return the verdict on the run; parameters and errors as of :func:`verify_run`."""
        return verification.verify_run(
            self.intended,
            self.observations,
            model=self.model,
            min_verified=min_verified,
            cut=self.cut,
            unseen=self.unseen,
            silences=self.silences,
            losses=self.losses,
            tolerance=tolerance,
            uncertainty=uncertainty,
            progress=progress,
        )


def measure_run(
    config: VerifyConfig,
    board: BoardUnderTest,
    progress: Progress | None,
    settling: Progress | None = None,
    *,
    faulty: bool = False,
    writer: RecordingWriter | None = None,
    sink: Callable[[Intended | Observation], object] | None = None,
) -> RunRecord:
    """Display the object on *board* and collect what it latched.

    An interrupt (Ctrl-C) or a link that breaks ends the run early, not in vain: what was measured
    until then is returned, and says why it is not all.

    Parameters
    ----------
    progress, settling : callable, optional
        Called with what has been done and what there is to do: of the frames, and of what the board
        has still to tell when they are over.
    faulty : bool
        Whether faults are planned: then a refusal of the board ends the run as a broken link does.
    writer : RecordingWriter, optional
        The recording that the bytes of the line go into, and the records of the back door.
    sink : callable, optional
        Called with every frame as it is sent, as the one of :class:`Driver`.
    """
    shown = run_frames.frames_of_run(config.shape, config.pace, config.modulation)
    model = run_frames.host_model_of_run_frames(config.array)
    own_array = config.link.port is not None and config.array.array is None
    elements = _calibration_of_run(config)
    tap = None if writer is None else recorded_port_of_run(board, config.link.baud, writer)
    driver = Driver(
        tap or board.port,
        baudrate=config.link.baud,
        seed=config.limits.seed if config.link.virtual_time else None,
        model=None if own_array else model,
        medium=model.medium,
        calibration=elements if config.elements.compensate else None,
        keep=run_frames.MOST_FRAMES,
        sink=sink if writer is None else beginning_sink(writer, sink),
    )
    known = board.model or driver.model
    about = _identity_of_run(driver.identity)
    found = RunRecord(board.label, known, about, driver.intended, warnings=driver.warnings)
    total = shown.count * config.pace.repeat
    growth: dict[str, int] = {}
    lease_us = math.inf
    with (
        _checked_run(found, driver, config, shown.points_m, elements),
        _cut_of_run(found, driver, board, total, faulty=faulty),
    ):
        before = driver.status().counters
        board.prepare(driver)
        with _interrupted_run(found, driver, total):
            frames = driver.frames(
                run_frames.targets_of_run(config, shown),
                mode=cast("Mode", config.frame_kind),
                solver=cast("Method", config.solver_of_host),
            )
            driver.arm()  # now: the lease would run out while a solver is at work
            found.report = _display_run(config, driver, frames, progress)
        board.finish(driver)  # after an interrupt as well: the board is there
        growth, lease_us = _counter_growth(driver, before), _effective_lease_us(driver, config)
        found.troubles = _unexpected_run_counters(
            driver, growth, _OWN_MUTE if found.interrupted else ()
        )
    found.warnings += _board_state_changes(driver, found.report)
    _observe_run(found, driver, board, settling, tap)
    if found.cut is not None:
        found.observations = _drop_after_interruption(found)
    found.silences = board.silences(driver)
    losses = board.losses(driver)
    found.losses = dataclasses.replace(
        losses,
        neglects_us=_pause_timeouts_us(driver, losses.timeouts_us, lease_us),
        counters=found.troubles.get("board", {}),
        latched=growth.get("latched"),
    )
    return found


def _identity_of_run(identity: HelloReply) -> dict[str, object]:
    """Return firmware, protocol and array of the board for the result."""
    return {
        "firmware": printable_on_terminal(identity.firmware),
        "protocol": f"{identity.major}.{identity.minor}",
        "transducers": identity.transducers,
        "carrier_hz": identity.carrier_hz,
    }


def recorded_port_of_run(
    board: BoardUnderTest, baudrate: int, writer: RecordingWriter
) -> RecordingTransport:
    """Return the open port of *board*, written down."""
    from haptogram.evidence.recordings.tap import RecordingTransport

    port = board.port
    transport = open_transport(port, baudrate=baudrate) if isinstance(port, str) else port
    if board.is_in_process:
        return RecordingTransport(transport, writer, board.records)
    return RecordingTransport(transport, writer, offset_ns=-transport.now_ns())  # from 0 on


def beginning_sink(writer: RecordingWriter, sink: Sink | None = None) -> Sink:
    """Return a sink of a driver that begins the recording with the first frame."""

    def begin(found: Intended | Observation) -> None:
        writer.begin()
        if sink is not None:
            sink(found)

    return begin


def _calibration_of_run(config: VerifyConfig) -> Calibration | None:
    """Return the calibration of the elements; None if no file is named, as all are equal."""
    file = config.elements.calibration
    return None if file is None else Calibration.from_file(file)


def _note_calibration_of_run(
    found: RunRecord, elements: Calibration, assumed: AcousticModel
) -> None:
    """Give the calibration to the judge; add a warning if the host did not compensate for it.

    Raises
    ------
    ConfigurationError
        The calibration is not of this array.
    """
    found.model = found.model.calibrated(elements)
    if assumed.calibration is None:
        found.warnings.append(
            f"{elements.name}: {elements.describe(assumed.array)}; the host does not "
            "compensate for that"
        )


@contextlib.contextmanager
def _checked_run(
    found: RunRecord,
    driver: AnyDriver,
    config: VerifyConfig,
    points_m: FloatArray,
    elements: Calibration | None,
) -> Iterator[None]:
    """Check calibration and tolerance, then run what is within; close *driver* at the end.

    A board that does not answer then is a warning. *points_m* are the foci of the run; *elements*
    None: no calibration is checked.
    """
    try:
        if elements is not None:
            _note_calibration_of_run(found, elements, driver.model)
        verification.check_frame_tolerance(
            found.model, points_m, verification.tolerance_of(config.tolerance)
        )
        run_frames.check_run_foci_in_reach(driver.model, points_m)
        yield
    finally:
        try:
            driver.close()
        except LinkError as error:
            found.warnings.append(str(error))


def _observe_run(
    found: RunRecord,
    driver: AnyDriver,
    board: BoardUnderTest,
    settling: Progress | None,
    tap: RecordingTransport | None,
) -> None:
    """Add the latches of *board* to the record, once the board has settled.

    They are recorded with *tap*, if there is one.
    """
    board.settle(driver, settling, skip_fields=found.interrupted)
    found.observations = board.observations(driver)
    found.unseen, found.fault_counts = board.unseen, board.fault_counts
    if tap is not None:
        tap.tell(board.records())


@contextlib.contextmanager
def _interrupted_run(found: RunRecord, driver: AnyDriver, total: int) -> Iterator[None]:
    """Run what is within; on Ctrl-C note after how many of *total* frames, and mute the board."""
    try:
        yield
    except KeyboardInterrupt:
        found.interrupted = True
        sent = driver.intended.total
        muted_us = _earliest_mute_us(driver) if isinstance(driver, Driver) else None
        found.cut = verification.Cut(
            f"interrupted after {sent} of {total} frames", muted_us, total - sent
        )
        driver.mute()


def _earliest_mute_us(driver: Driver) -> int:
    """Return the least device time of frames that a MUTE sent now may still cancel.

    A frame latches at the first carrier boundary at or after its time, and the clock is estimated.
    """
    period_us = 1e6 / driver.model.frequency_hz
    return driver.device_time_us() - math.ceil(period_us + driver.clock.uncertainty_us)


@contextlib.contextmanager
def _cut_of_run(
    found: RunRecord, driver: AnyDriver, board: BoardUnderTest, total: int, *, faulty: bool
) -> Iterator[None]:
    """Run what is within; on a broken link or Ctrl-C note after how many of *total* frames.

    After a broken link, frames still on the board are waited for. So they are after an error of the
    board, if it is a *faulty* one on purpose; else the error is raised.
    """
    try:
        with _interrupted_run(found, driver, total):
            yield
    except (LinkError, DeviceError) as error:
        if isinstance(error, DeviceError) and not faulty:
            raise
        if found.cut is None:
            found.cut = verification.Cut(str(error), not_sent=total - driver.intended.total)
        if isinstance(driver, Driver):
            board.wait_for_queue(driver)


def _counter_growth(driver: Driver, before: Counters) -> dict[str, int]:
    """Return by how much every counter of the board grew since *before*."""
    after = driver.status().counters
    return {
        name: (getattr(after, name) - getattr(before, name)) % (1 << 32) for name in Counters.WIRE
    }


def _effective_lease_us(driver: Driver, config: VerifyConfig) -> int:
    """Return the lease, of a sequence its unattended time, less the error of the clock.

    That is the time after which the board mutes if no frame comes.
    """
    is_played = config.drive.mode == "sequence"
    played_ms = default_unattended_ms(driver.identity)
    lease_ms = played_ms if is_played else driver.config().host_timeout_ms
    return 1000 * lease_ms - math.ceil(driver.clock.uncertainty_us)


def _pause_timeouts_us(
    driver: Driver, timeouts_us: Iterable[int], lease_us: float
) -> tuple[int, ...]:
    """Return the timeouts that fall where the host was silent for longer than the lease.

    A frame takes up to 5 ms after a silence. All times are those of the device.
    """
    silences = [(begin + lease_us, end + _UNDER_WAY_US) for begin, end in driver.silences_us()]
    return tuple(t for t in timeouts_us if any(low <= t <= high for low, high in silences))


def _unexpected_run_counters(
    driver: Driver, growth: dict[str, int], expected: Iterable[str]
) -> dict[str, dict[str, int]]:
    """Return error counters of "board" and "host" that grew and are not *expected*; {} if none."""
    fine = GROWING_COUNTERS.union(expected)
    sides = {"board": growth, "host": driver.link_counters}
    bad = {
        side: {name: count for name, count in counts.items() if count and name not in fine}
        for side, counts in sides.items()
    }
    return {side: counts for side, counts in bad.items() if counts}


def _display_run(
    config: VerifyConfig, driver: Driver, frames: list[Frame], progress: Progress | None
) -> StreamReport | PlayReport:
    """Play the frames from the board's memory, or stream them, at the configured rate."""
    lead_us = None if config.pace.lead_ms is None else round(config.pace.lead_ms * 1e3)
    display = driver.play if config.drive.mode == "sequence" else driver.stream
    return display(
        frames,
        config.pace.rate_hz,
        loops=config.pace.repeat,
        lead_us=lead_us,
        progress=progress,
    )


def _drop_after_interruption(found: RunRecord) -> Sequence[Observation]:
    """Return the latches of an interrupted run, without unintended frames of a sequence.

    The board plays a sequence to its end, whatever the host does; latches of a stream are all
    returned.
    """
    wanted = {intended.key for intended in found.intended}
    return only_kept_records(
        found.observations, lambda o: o.key.sequence == STREAM or o.key in wanted
    )


def _board_state_changes(driver: Driver, report: StreamReport | PlayReport | None) -> list[str]:
    """Return texts on state changes that the board made on its own; None for *report*: all.

    Those before the first frame are left out: while many frames are prepared the lease may expire,
    and the driver arms the board again.
    """
    return [
        f"the board went {event.message.state.name} by itself: {event.message.reason.name}"
        for event in driver.events
        if isinstance(event.message, StateChanged)
        and (report is None or driver.time_of_event_us(event) >= report.t0_us)
    ]


@dataclass(frozen=True, slots=True)
class DialectBoardsUnderTest:
    """The boards on a line, as their own programs have them.

    Attributes
    ----------
    dialect : Dialect
        Their wire.
    array : TransducerArray
        Their emitters.
    channels : tuple of int
        Channel that drives each of them.
    mounting : Calibration or None
        How they are mounted, if not all alike.
    """

    dialect: Dialect
    array: TransducerArray
    channels: tuple[int, ...]
    mounting: Calibration | None = None

    @property
    def count(self) -> int:
        """Boards that these channels need."""
        return max(self.channels) // self.dialect.channels + 1

    @property
    def frame_bytes(self) -> int:
        """Bytes of a frame for all of them."""
        return self.dialect.frame_bytes(self.count)


def measure_run_of_dialect(
    config: VerifyConfig,
    boards: DialectBoardsUnderTest,
    board: BoardUnderTest,
    progress: Progress | None,
    settling: Progress | None = None,
    *,
    writer: RecordingWriter | None = None,
) -> RunRecord:
    """Display the object on *boards* and collect what *board* latched.

    As :func:`~haptogram.evidence.run_record.measure_run` on Haptogram's own boards. At a port that
    tells nothing, the observations are what the bytes that left the host are.
    """
    shown = run_frames.frames_of_run(config.shape, config.pace, config.modulation)
    model = run_frames.host_model_of_run_frames(config.array, boards.array)
    if boards.mounting is not None:
        model = model.calibrated(boards.mounting)
    elements = _calibration_of_run(config)
    tap = None if writer is None else recorded_port_of_run(board, config.link.baud, writer)
    from haptogram.driver.dialect_driver import DialectDriver

    driver = DialectDriver(
        tap or board.port,
        dialect=boards.dialect,
        baudrate=config.link.baud if boards.dialect.bauds else None,
        model=model,
        calibration=elements if config.elements.compensate else None,
        channels=boards.channels,
        keep=run_frames.MOST_FRAMES,
        sink=None if writer is None else beginning_sink(writer),
    )
    about = {
        "dialect": boards.dialect.name,
        "boards": boards.count,
        "phase_steps": driver.phase_steps,
        "transducers": boards.array.count,
        "carrier_hz": model.frequency_hz,
    }
    known = board.model or driver.model
    found = RunRecord(board.label, known, about, driver.intended, warnings=driver.warnings)
    total = shown.count * config.pace.repeat
    with (
        _checked_run(found, driver, config, shown.points_m, elements),
        _cut_of_run(found, driver, board, total, faulty=True),
    ):
        frames = driver.frames(
            run_frames.targets_of_run(config, shown),
            solver=cast("Method", config.solver_of_host),
        )
        found.report = driver.stream(
            frames, config.pace.rate_hz, loops=config.pace.repeat, progress=progress
        )
    _observe_run(found, driver, board, settling, tap)
    if (loss := upload_loss_text(board.records())) is not None:
        found.warnings.append(loss)
    return found
