"""A virtual board: in this program, in virtual time, or in a process of its own, on a terminal.

::

    with VirtualBoard() as board, Driver(board.url) as driver:
        driver.arm()
        driver.stream(points, rate_hz=1000)
        print(board.verify(driver.intended))
"""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Final, Self

from haptogram.acoustics import AcousticModel, Calibration, Medium, Transducer, TransducerArray
from haptogram.errors import ConfigurationError
from haptogram.evidence import backdoor
from haptogram.evidence.backdoor import BackdoorReader
from haptogram.evidence.board_process import ENDS_WITHIN_S, BoardInProgram, BoardProcess
from haptogram.evidence.dialects.latches import (
    are_records_of_another_dialect,
    dialect_run_observations,
    has_dialect_latched_all,
)
from haptogram.machine.closing import ClosedByWith
from haptogram.machine.working_folder import WorkingFolder
from haptogram.records.frame import FrameKey, Intended, Observation, check_intended
from haptogram.records.losses import BoardLosses
from haptogram.settings import arguments
from haptogram.settings.board import BOARD_OPTIONS, DEFAULT_ARRAY, BoardConfig
from haptogram.settings.command_line import written_options
from haptogram.settings.faults.plan import parse_faults
from haptogram.settings.line import MAX_BAUD, LineSettings

if TYPE_CHECKING:
    from haptogram.verification import RunVerdict, Tolerance, Uncertainty

_VIRTUAL_BAUD: Final = 3_000_000  # without a rate, frames would come at one moment
_MOST_LATCHES: Final = 10**9
_LONGEST_WAIT_S: Final = 1e7
_POLL_S: Final = 0.01
_QUIET_S: Final = 15.0  # time without a record after which the one that is waited for will not come
_LAST_WORDS_S: Final = 3.0  # the same for a board that has ended: nothing holds its writer up


class VirtualBoard(ClosedByWith):
    """A virtual board that judges what it was sent, and cleans up after itself.

    In virtual time it is in this program, and time passes while a host waits for bytes: the same
    calls give the same result, however busy the machine is.  On the wall clock it is
    ``python -m sim_device``, for any program that opens a pseudo-terminal.

    Parameters
    ----------
    array : str, optional
        Grid such as ``16x16``, or a CSV file of positions in mm; by default ``16x16``, of a
        *dialect* its own.
    pitch_mm : float
        Pitch of a grid.
    temperature_c : float
        Temperature of the air over the board.
    calibration : Calibration or path, optional
        Gain, phase and position of its elements as they really are, or the CSV file of them.
        Neither its firmware nor its host knows them.
    seed : int
        Seed of everything random.
    baudrate : int or None
        Rate at which its line carries bytes; None: 3 Mbaud in virtual time, and on the wall clock
        as fast as they come.  A driver keeps to its
        own rate in any case.  With a rate here, bytes that pile up while the board's process waits
        for a processor are slow to catch up, as they would not be in a real board.
    reconstruct : bool
        Whether it rebuilds the field of every latch.
    faults : sequence of str
        Faults on purpose of line, clock and transducers, such as ``"line.flip ber=1e-5"``;
        docs/faults.md lists them.
    fault_plan : path, optional
        TOML file with faults, which come before those of *faults*.
    dialect : str, optional
        Wire of another board, such as ``"sonicsurface"``; docs/dialects.md lists them. Its clients
        open :attr:`url`; the rate of its line is its own unless it is given here.
    dialect_options : sequence of str
        Options of the dialect, such as ``"boards=2"``.
    clock : str, optional
        ``virtual`` or ``wall``; by default ``wall`` for the wire of another board, whose programs
        open a terminal, else ``virtual``.

    Attributes
    ----------
    url : str
        Port for a host: in virtual time a URL of pyserial for this program, on the wall clock the
        path of a terminal.
    is_virtual : bool
        Whether time is virtual.
    backdoor : Path
        File that it writes its records to, as long as it runs.
    model : AcousticModel
        Array and air of the board, its calibration included.

    Raises
    ------
    ConfigurationError
        An argument that cannot be, before a process is started; or the board does not come up,
        because of a fault that is not known for example: the text holds what it said.

    Examples
    --------
    >>> VirtualBoard("16x16", pitch_mm=-1.0)
    Traceback (most recent call last):
        ...
    haptogram.settings.option.SettingError: pitch_mm is -1, must be 1 to 100 mm
    """

    def __init__(
        self,
        array: str | None = BoardConfig.array,
        *,
        pitch_mm: float = BoardConfig.pitch_mm,
        temperature_c: float = BoardConfig.temperature_c,
        calibration: Calibration | str | Path | None = None,
        seed: int = BoardConfig.seed,
        baudrate: int | None = LineSettings.baud,
        reconstruct: bool = True,
        faults: Sequence[str] = (),
        fault_plan: Path | None = None,
        dialect: str | None = BoardConfig.dialect,
        dialect_options: Sequence[str] = (),
        clock: str | None = None,
    ) -> None:
        if clock is not None:
            arguments.check_choice("clock", clock, ("virtual", "wall"))
        self.is_virtual = clock == "virtual" or (clock is None and dialect is None)
        if baudrate is not None:
            arguments.check_whole("baudrate", baudrate, 1, MAX_BAUD)
        arguments.check_argument_kind("reconstruct", reconstruct, bool, "True or False")
        arguments.check_texts("dialect_options", dialect_options, "boards=2")
        elements = None if calibration is None else Calibration.of(calibration)
        config = BoardConfig.of(
            array=array,
            pitch_mm=pitch_mm,
            temperature_c=temperature_c,
            seed=seed,
            baud=_VIRTUAL_BAUD if self.is_virtual and baudrate is None else baudrate,
            fault_plan=fault_plan,
            dialect=dialect,
            dialect_option=tuple(dialect_options),
        )
        added = dataclasses.replace(config, faults=config.faults + parse_faults(faults))
        self._power_up(added, elements, reconstruct=reconstruct)

    @classmethod
    def of(cls, config: BoardConfig) -> Self:
        """Start the board that *config* describes, on the wall clock."""
        board = cls.__new__(cls)
        board.is_virtual = False
        file = config.calibration
        elements = None if file is None else Calibration.from_file(file)
        # The field of another dialect's boards is rebuilt by whoever knows the frames.
        board._power_up(config, elements, reconstruct=config.dialect is None)  # noqa: SLF001  its own class
        return board

    def _power_up(
        self, config: BoardConfig, elements: Calibration | None, *, reconstruct: bool = True
    ) -> None:
        """Start the board, in this program or in a process, with a fresh back door.

        *elements* (None: all are equal) is its calibration; *reconstruct*: it reports foci too.
        """
        if config.dialect is None:  # before a process is started, so that it can be refused
            self.model = _board_model(config, elements)
        self._has_faults = bool(config.plan.faults)
        self._folder = WorkingFolder("haptogram-board-")
        self.backdoor = self._folder.path / "backdoor.jsonl"
        if elements is not None:
            copy = self._folder.path / "calibration.csv"
            elements.to_file(copy)
            config = dataclasses.replace(config, calibration=copy)
        with contextlib.ExitStack() as undo:
            undo.callback(self._folder.remove)
            self._process = self._started(config, reconstruct=reconstruct)
            undo.callback(self._process.kill)
            undo.callback(self._process.close_pipe)
            self._records = BoardRecords(self.backdoor, self._process)
            undo.callback(self._records.close)
            if isinstance(self._process, BoardProcess):
                self._process.wait_until_ready()
            if config.dialect is not None:
                self.model = backdoor.board_model_of_evidence(self._records.read()[0])
            undo.pop_all()

    def _started(self, config: BoardConfig, *, reconstruct: bool) -> BoardInProgram | BoardProcess:
        """Return the started board: in this program if virtual, else a process at a link.

        *reconstruct*: its back door also tells the field of each drive.
        """
        if self.is_virtual:
            board = BoardInProgram(config, self.backdoor, reconstruct=reconstruct)
            self.url = board.url
            return board
        self.url = str(self._folder.path / "board")
        port = [f"--link={self.url}", f"--backdoor={self.backdoor}"]
        if not reconstruct:
            port.append("--no-reconstruct")
        # Without a seed the process takes a random one.
        values = {"seed": config.seed} | config.non_default()
        arguments = [*port, *written_options(values, BOARD_OPTIONS)]
        return BoardProcess(arguments, self._folder.path / "log")

    def sleep(self, seconds: float) -> None:
        """Let time pass on the clock of the board."""
        arguments.check_number("seconds", seconds, 0.0, _LONGEST_WAIT_S)
        self._process.sleep(seconds)

    # --- evidence ------------------------------------------------------------------------------

    def records(self) -> list[dict[str, Any]]:
        """Return everything that has come out of the back door; see docs/backdoor.md."""
        return list(self._records.read())

    def wait_for(self, latches: int, timeout_s: float = 60.0) -> bool:
        """Wait until the back door has shown *latches* latches; return whether it has."""
        arguments.check_whole("latches", latches, 0, _MOST_LATCHES)
        arguments.check_number("timeout_s", timeout_s, 0.0, _LONGEST_WAIT_S)
        return self._records.wait_for_latches(latches, timeout_s)

    def observations(self, session: int | None = None) -> list[Observation]:
        """Return the latches of one session or of all of them."""
        if session is not None:
            arguments.check_whole("session", session, 0, 0xFFFF)
        return backdoor.observations_of_backdoor(self.records(), session)

    @property
    def fault_counts(self) -> dict[str, int] | None:
        """Counts of the faults that fired; None before the board has ended, or without faults."""
        return backdoor.observed_fault_counts(self._records.read())

    def wait_idle(self, intended: Sequence[Intended]) -> str | None:
        """Wait until the back door shows the last of *intended*, is closed, or falls silent.

        The board latches first and rebuilds the field later: its records lag behind, and go on
        for a while after a board that was killed.

        Returns
        -------
        str or None
            Why a frame may have been latched that it does not show; None: it shows all.
        """
        _check_one_session(intended)
        if not intended:
            return None
        if are_records_of_another_dialect(self._records.read()):
            why = self._records.wait_for_all(intended)
        else:
            why = self._records.wait_for_latch(intended[-1].key)
        return None if self.is_virtual else why  # in virtual time nothing lags behind

    def finish(
        self, progress: Callable[[int], None] | None = None, *, skip_fields: bool = False
    ) -> None:
        """End the board in order, if it runs, and read its back door to the end.

        Parameters
        ----------
        progress : callable, optional
            Called with the number of records so far: the board may take a while to rebuild what it
            still owes.
        skip_fields : bool
            True: the last records come at once, without their fields.
        """
        arguments.check_callable("progress", progress)
        arguments.check_argument_kind("skip_fields", skip_fields, bool, "True or False")
        if skip_fields:
            self._process.close_pipe()
        else:
            self._process.terminate()
        # Its process of fields may get no processor for long: only its end says that no more comes.
        self._records.read_until(lambda: False, progress, ENDS_WITHIN_S)

    def verify(
        self,
        intended: Sequence[Intended],
        *,
        model: AcousticModel | None = None,
        min_verified: float | None = None,
        tolerance: Tolerance | None = None,
        uncertainty: Uncertainty | None = None,
    ) -> RunVerdict:
        """Join what was intended with what was latched, and judge every frame.

        The verdict is true for a pass only: ``assert board.verify(driver.intended)``.

        Parameters
        ----------
        model : AcousticModel, optional
            Array and air that the host assumes; by default those of the board.
        min_verified : float, optional
            Share of the frames that must be verified for the run to pass; by default all of them in
            virtual time, else 0.9.
        tolerance : Tolerance, optional
            Which misses pass on top of what rounding of the phases makes; by default none.
        uncertainty : Uncertainty, optional
            How well the model is known, which the result tells in mm; by default exactly.

        Returns
        -------
        RunVerdict
            Of the frames in *intended*.  A :class:`~haptogram.records.kept.KeptRecords` that
            dropped some can fail, but not pass, and ``counts["not_kept"]`` says how many.

        Raises
        ------
        ConfigurationError
            An argument that cannot be.
        """
        _check_one_session(intended)
        # Late, because it is much: whoever only wants a board does not pay for it.
        from haptogram.verification import check_run_judgement, verify_run

        assumed = self.model if model is None else model
        share = (1.0 if self.is_virtual else 0.9) if min_verified is None else min_verified
        check_run_judgement(assumed, share, tolerance, uncertainty)
        unseen = self.wait_idle(intended)
        session = intended[0].key.session if intended else None
        return verify_run(
            intended,
            dialect_run_observations(intended, self.records(), session),
            model=assumed,
            min_verified=share,
            tolerance=tolerance,
            uncertainty=uncertainty,
            unseen=unseen,
            silences=backdoor.observed_silences_on_clock_of(intended, self.records()),
            losses=self.losses(intended),
        )

    def losses(self, intended: Sequence[Intended]) -> BoardLosses:
        """Return the reasons, in the back door, for frames of *intended* that were not latched.

        Where faults on purpose delay the line, late arrival is theirs and not the machine's.
        """
        return backdoor.observed_losses_on_clock_of(
            intended,
            self.records(),
            is_machine_in_between=not (self.is_virtual or self._has_faults),
        )

    # --- process -------------------------------------------------------------------------------

    @property
    def pid(self) -> int:
        """Number of the board's process; in virtual time that of this program."""
        return self._process.pid

    def how_it_ended(self, patience_s: float = 0.0) -> str | None:
        """Return in one line how the board's process ended; None: it runs after *patience_s*."""
        return self._process.how_it_ended(patience_s)

    def log(self) -> str:
        """Return the output of the board so far."""
        return self._process.log()

    def kill(self) -> None:
        """End the board at once, as a power cut would."""
        self._process.kill()

    def stop(self) -> int:
        """End the board in order, so that its last records are written; return its status.

        Raises
        ------
        LinkLostError
            The board did not end in time, and was killed.
        """
        return self._process.stop()

    def close(self) -> None:
        """End the board and remove everything that it left behind."""
        try:
            if self._process.is_running():
                self.stop()
        finally:
            self._process.close_pipe()
            self._records.close()
            self._folder.remove()

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if kind is not None:
            self._process.close_pipe()  # nobody will ask for fields
        super().__exit__(kind, error, traceback)


def _check_one_session(intended: Sequence[Intended]) -> None:
    """Refuse an empty list of frames, or frames of several sessions."""
    check_intended(intended)
    sessions = sorted({entry.key.session for entry in intended})
    if len(sessions) > 1:
        raise ConfigurationError(
            f"intended holds frames of the sessions {sessions[0]} and {sessions[1]}; verify one "
            "session at a time"
        )


def _board_model(config: BoardConfig, elements: Calibration | None) -> AcousticModel:
    """Return the true acoustic model of a virtual board, calibrated with *elements* if not None."""
    model = AcousticModel(
        TransducerArray.parse(config.array or DEFAULT_ARRAY, pitch_m=config.pitch_mm / 1000),
        Medium.air(config.temperature_c),
        Transducer(),
    )
    return model if elements is None else model.calibrated(elements)


class BoardRecords:
    """Reads the back door of a board, and waits for its records.

    Parameters
    ----------
    path : Path
        File that the board appends to.
    board : BoardProcess or BoardInProgram
        The board, on whose clock it is waited for.

    Attributes
    ----------
    records : list of dict
        Those that were read.
    """

    def __init__(self, path: Path, board: BoardProcess | BoardInProgram) -> None:
        path.touch()
        self.records: list[dict[str, Any]] = []
        self._stream = BackdoorReader(str(path))
        self._board = board

    def read(self) -> list[dict[str, Any]]:
        """Return all records so far."""
        while self._stream.is_open and (found := self._stream.read()):
            self.records += found
        return self.records

    def close(self) -> None:
        """Read what there is, and close the back door."""
        self.read()
        self._stream.close()

    def wait_for_latches(self, count: int, timeout_s: float) -> bool:
        """Wait for *count* latches; return whether they came before the end and *timeout_s*."""
        end_s = self._board.now_s() + timeout_s
        while sum(record["kind"] in backdoor.LATCHES for record in self.read()) < count:
            if self._board.now_s() > end_s or self._is_closed:
                return False
            self._board.sleep(_POLL_S)
        return True

    def wait_for_latch(self, key: FrameKey) -> str | None:
        """Wait for the latch with this *key*, for the end, or until the board falls silent.

        Returns
        -------
        str or None
            Why latches of its session may be missing; None: none is.
        """
        looked_at = 0

        def is_there() -> bool:
            nonlocal looked_at
            new = self.records[looked_at:]
            looked_at += len(new)
            return any(backdoor.is_observed_latch_of(record, key) for record in new)

        self.read_until(is_there)
        return backdoor.why_observations_incomplete(self.records, key.session, key)

    def wait_for_all(self, intended: Sequence[Intended]) -> str | None:
        """Wait for a latch of each frame of *intended* on a board that numbers none.

        Returns
        -------
        str or None
            As :meth:`wait_for_latch`.
        """
        self.read_until(lambda: has_dialect_latched_all(intended, self.records))
        if has_dialect_latched_all(intended, self.records):
            return None
        return backdoor.why_observations_incomplete(self.records)

    def read_until(
        self,
        enough: Callable[[], bool],
        progress: Callable[[int], None] | None = None,
        quiet_s: float = _QUIET_S,
    ) -> None:
        """Read until *enough* returns True, or until no more records are expected.

        *progress* is called with the number of records so far.  A board that runs may be silent
        for *quiet_s*.
        """
        quiet_since_s = self._board.now_s()
        while True:
            count = len(self.records)
            if len(self.read()) > count:
                quiet_since_s = self._board.now_s()
                if progress is not None:
                    progress(len(self.records))
            if enough() or self._is_closed:
                return
            patience_s = quiet_s if self._board.is_running() else _LAST_WORDS_S
            if self._board.now_s() - quiet_since_s > patience_s:
                return
            self._board.sleep(_POLL_S)

    @property
    def _is_closed(self) -> bool:
        """Return True once the record has come that says that the board has ended."""
        records = self.records
        return bool(records) and records[-1]["kind"] == "end"
