"""A session through the real chain: driver, bytes, virtual board, back door, verification.

Virtual time throughout. What is wrong is put in where it would be in life: in the host's model, in
the bytes of a frame, in the board.
"""

from __future__ import annotations

import base64
import contextlib
import dataclasses
import inspect
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final
from urllib.parse import urlencode

import numpy as np
import serial

import sim_device
from haptogram.acoustics import (
    AcousticModel,
    Calibration,
    Drive,
    Medium,
    Transducer,
    TransducerArray,
)
from haptogram.acoustics.solvers.several import weights_for_foci
from haptogram.driver.driver import Driver
from haptogram.driver.frames.frame import Frame
from haptogram.driver.line.port import PyserialTransport
from haptogram.errors import ConfigurationError, HaptogramError, LinkError
from haptogram.evidence.boards import InProcessBoardUnderTest
from haptogram.records import frame as records
from haptogram.verification import Cut, RunVerdict, Tolerance, Uncertainty, verify_run
from haptogram.verification.frame.verdict import FrameVerdict
from haptogram_protocol.messages import Drives, Phases

from . import truth, wrongs
from .cases import Session, Wanted, superposed
from .layouts import Random
from .truth import Complexes
from .wrongs import Registers, Slip, Wrong

BAUD: Final = 3_000_000
_RATE_HZ: Final = 200.0


@dataclass
class Seen:
    """One frame after it went through everything.

    Attributes
    ----------
    wanted : Wanted
        With its foci as the wire has them, where the board makes the drive.
    verdict : FrameVerdict or str
        The error that the judge raised, in place of its verdict.
    radiated : list of Registers
        Of every latch, in the order in which they were.
    wrong : Wrong or None
        What was made wrong on purpose in this frame.
    """

    wanted: Wanted
    verdict: FrameVerdict | str
    radiated: list[Registers]
    wrong: Wrong | None = None


@dataclass
class Ran:
    """A session after it ran.

    Attributes
    ----------
    frames : list of Seen
    run : RunVerdict or None
    intended : list of Intended
        What the host said that it wanted.
    error : str or None
        What it failed with: an error of the program that is in order where something was broken on
        purpose (*expected*), or one that is not.
    tags : dict
        What was wrong with the whole session.
    """

    session: Session
    frames: list[Seen] = field(default_factory=list)
    run: RunVerdict | None = None
    intended: list[records.Intended] = field(default_factory=list)
    error: str | None = None
    expected: bool = False
    tags: dict[str, Any] = field(default_factory=dict)


class Program:
    """The program's own objects for a session: what its host and its judge are told."""

    def __init__(self, session: Session, folder: Path) -> None:
        self.session = session
        self.array_text = session.layout.write(folder)
        self.array = TransducerArray.parse(self.array_text, pitch_m=session.layout.pitch_m)
        self.calibration: str | None = None
        if session.elements is not None:
            self.calibration = session.elements.write(folder / "calibration.csv")
            self._elements = Calibration.from_file(self.calibration)
        self.told_to_host = self.host_calibration(folder)

    def known(self, model: AcousticModel) -> AcousticModel:
        """*model* with the elements as they really are: what a judge is told."""
        return model if self.calibration is None else model.calibrated(self._elements)

    def model(self, speed_ratio: float = 1.0, temperature_c: float | None = None) -> AcousticModel:
        air = Medium.air(
            self.session.temperature_c if temperature_c is None else temperature_c,
            self.session.humidity_percent,
        )
        speed = air.sound_speed_m_s * speed_ratio
        return AcousticModel(
            self.array, dataclasses.replace(air, sound_speed_m_s=speed), Transducer()
        )

    def host(self) -> AcousticModel:
        """What a correct host takes the world for: within what is tolerated."""
        host, model = self.session.host, self.model(self.session.host.speed_ratio)
        if host.knows_places or self.session.mode == "points":
            return model
        places = host.positions_m(self.session.layout.positions_m)
        array = TransducerArray.from_positions(places, self.session.layout.normals)
        return dataclasses.replace(model, array=array)

    def host_calibration(self, folder: Path) -> str | None:
        """The calibration file of that host."""
        own, host = self.session.elements, self.session.host
        if own is None or host.knows_places:
            return self.calibration
        places = host.positions_m(own.positions_m)
        return dataclasses.replace(own, positions_m=places).write(folder / "host.csv")

    def weights(self, wanted: Wanted, speed_ratio: float = 1.0, pitch: float = 1.0) -> Complexes:
        """The unrounded drive for *wanted*, in air and with a pitch that are off by factors.

        Of several foci it is the host's own where a solver made it: which drive is best is not
        judged here, but whether it is the one that arrives.
        """
        session, layout = self.session, self.session.layout
        true = session.scene
        places = layout.centre_m + (true.positions_m - layout.centre_m) * pitch
        scene = dataclasses.replace(
            true, positions_m=places, wavenumber=true.wavenumber / speed_ratio
        )
        if len(wanted.foci) == 1 or wanted.solver == "naive":
            weights = superposed(scene, wanted.foci)
        else:
            weights = self._solved(wanted, speed_ratio, pitch, places)
        if wanted.amplitudes is not None:
            return wanted.amplitudes / 255.0 * np.exp(1j * np.angle(weights))
        if session.mode in ("phases", "sequence"):
            return np.exp(1j * np.angle(weights))
        return weights

    def _solved(
        self, wanted: Wanted, speed_ratio: float, pitch: float, places: truth.Floats
    ) -> Complexes:
        model = self.known(self.model(speed_ratio))
        if pitch != 1.0:
            array = TransducerArray.from_positions(places, self.session.layout.normals)
            model = dataclasses.replace(model, array=array)
        levels = [focus.amplitude for focus in wanted.foci]
        lags = [focus.lag_rad for focus in wanted.foci]
        made = weights_for_foci(model, wanted.targets_m, levels, lags, method=wanted.solver)
        if not np.isfinite(made).all():
            raise ConfigurationError(f"{wanted.solver} found no drive for {wanted.foci}")
        return made


def run_session(session: Session) -> tuple[Ran, Program]:
    """Run it, and join every frame with what was seen of it."""
    ran = Ran(session, tags=dict(session.tags))
    random = np.random.default_rng([3, session.seed])
    with tempfile.TemporaryDirectory(prefix="haptogram-trials-") as folder:
        program = Program(session, Path(folder))
        try:
            _run(ran, program, random)
        except HaptogramError as error:
            ran.error = f"{type(error).__name__}: {error}"
            ran.expected = "fault" in ran.tags
        except Exception as error:
            ran.error = f"{type(error).__name__}: {error} [{_where(error)}]"
    return ran, program


def _where(error: BaseException) -> str:
    """The innermost place of the program in the traceback."""
    place, step = "?", error.__traceback__
    while step is not None:
        file = step.tb_frame.f_code.co_filename
        if "haptogram" in file or "sim_device" in file:
            place = f"{Path(file).parent.name}/{Path(file).name}:{step.tb_lineno}"
        step = step.tb_next
    return place


def _run(ran: Ran, program: Program, random: Random) -> None:
    session = ran.session
    faults, host = _broken(ran, program, random)
    with _board(session, program, faults) as board:
        driver = Driver(
            board.port,
            baudrate=BAUD,
            seed=session.seed,
            model=host,
            **_compensating(ran, program),
        )
        sent: list[tuple[Frame, Wrong | None]] = []
        cut = None
        try:
            right = [_right(driver, session, wanted) for wanted in session.frames]
            sent = _sent(ran, program, driver, right, random)
            driver.arm()
            _show(driver, session, [frame for frame, _ in sent])
        except LinkError as error:
            if not faults:
                raise
            cut = Cut(str(error), not_sent=len(sent) - len(driver.intended))
            board.wait_for_queue(driver)
        finally:
            with contextlib.suppress(LinkError):
                driver.close()
        board.settle(driver)
        seen = board.observations(driver)
        told = {
            "model": program.known(program.model()),
            "silences": board.silences(driver),
            "cut": cut,
            **_tolerating(session),
        }
        verdicts = _verdicts(ran, list(driver.intended), seen, told)
        latched = _latched(board.port_records)
        ran.intended = list(driver.intended)
    for place, (intended, verdict) in enumerate(zip(ran.intended, verdicts, strict=True)):
        key = intended.key
        wanted = _as_sent(session.frames[place], intended)
        came = latched.get((key.session, key.sequence, key.loop, key.index), [])
        ran.frames.append(Seen(wanted, verdict, came, sent[place][1]))


def _verdicts(
    ran: Ran,
    intended: list[records.Intended],
    seen: list[records.Observation],
    told: dict[str, Any],
) -> list[FrameVerdict | str]:
    """The verdict of every frame; if the judge fails over them, of each one by itself."""
    with contextlib.suppress(Exception):
        ran.run = verify_run(intended, seen, **told)
        return list(ran.run.frames)
    verdicts: list[FrameVerdict | str] = []
    for frame in intended:
        try:
            verdicts += verify_run([frame], seen, **told).frames
        except Exception as error:
            verdicts.append(f"{type(error).__name__}: {error} [{_where(error)}]")
    return verdicts


def _compensating(ran: Ran, program: Program) -> dict[str, Any]:
    """What the host is told of its elements: nothing, if that is what is wrong."""
    told = program.told_to_host is not None and "uncompensated" not in ran.tags
    return {"calibration": program.told_to_host} if told else {}


def _tolerating(session: Session) -> dict[str, Any]:
    if session.allowance is None:
        return {}
    allowed = {k: v for k, v in dataclasses.asdict(session.allowance).items() if v}
    scatter_mm = allowed.pop("position_mm", 0.0)
    uncertainty = Uncertainty(position_mm=scatter_mm)
    return {"tolerance": Tolerance(**allowed), "uncertainty": uncertainty}


# --- board and host --------------------------------------------------------------------------


def _broken(ran: Ran, program: Program, random: Random) -> tuple[list[str], AcousticModel]:
    """Return the faults of the board and the host's model: what is wrong for a whole session."""
    session = ran.session
    if session.group == "honest":
        return [], program.host()
    how = str(random.choice(["frames", "air", "pitch", "fault"], p=[0.62, 0.1, 0.03, 0.25]))
    if session.elements is not None and random.random() < 0.3:
        how = "uncompensated"
        ran.tags[how] = True
    ran.tags["how"] = how
    if how == "fault":
        ran.tags["fault"] = wrongs.fault_of(session.layout, random)
        return [ran.tags["fault"]], program.host()
    if how == "air":
        delta = random.choice([-1, 1]) * 10 ** random.uniform(-2.0, 1.85)
        host_c = float(np.clip(session.temperature_c + delta, -20.0, 50.0))
        ran.tags["host air"] = host_c - session.temperature_c
        return [], program.model(temperature_c=host_c)
    if how == "pitch":
        size = float(random.choice([-1, 1]) * 10 ** random.uniform(-4.0, -1.0))
        ran.tags["host pitch"] = size
        layout, model = session.layout, program.model()
        places = layout.centre_m + (layout.positions_m - layout.centre_m) * (1.0 + size)
        array = TransducerArray.from_positions(places, layout.normals)
        return [], dataclasses.replace(model, array=array)
    return [], program.host()


class _Board(InProcessBoardUnderTest):
    """As the program makes it for ``verify --virtual-time``, with its records at hand."""

    port_records: list[dict[str, Any]]


@contextlib.contextmanager
def _board(session: Session, program: Program, faults: list[str]) -> Iterator[_Board]:
    sim_device.register_url_handler()
    options: dict[str, Any] = {
        "clock": "virtual",
        "array": program.array_text,
        "pitch_mm": repr(session.layout.pitch_m * 1e3),
        "temperature_c": repr(session.temperature_c),
        "baud": BAUD,
        "seed": session.seed,
        # Nobody asks for the one focus of several foci: some sessions look for it all the same.
        "reconstruct": int(len(session.frames[0].foci) == 1 or session.seed % 4 == 0),
        "fault": faults,
    }
    if program.calibration is not None:
        options["calibration"] = program.calibration
    url = f"haptogram://?{urlencode(options, doseq=True)}"
    virtual: Any = serial.serial_for_url(url, timeout=0)
    with contextlib.closing(virtual) as port:
        board = _Board(
            PyserialTransport(port, "virtual board"),
            lambda: port.records,
            port.wait_until_ns,
            port.simulation.dialect.board.settings.model,
        )
        board.port_records = port.records
        yield board


def _latched(found: list[dict[str, Any]]) -> dict[tuple[int, int, int, int], list[Registers]]:
    """What left the transducers at every latch, by its key."""
    latched: dict[tuple[int, int, int, int], list[Registers]] = {}
    for record in found:
        if record["kind"] != "latch":
            continue
        key = (record["session"], record["sequence"], record["loop"], record["index"])
        drive = record["radiated"] or record
        phases, amplitudes = (
            np.frombuffer(base64.b64decode(drive[name]), dtype=np.uint8)
            for name in ("phase_codes", "amplitude_codes")
        )
        latched.setdefault(key, []).append((phases, amplitudes))
    return latched


# --- frames ----------------------------------------------------------------------------------


def _foci(wanted: Wanted) -> list[records.Focus]:
    return [records.Focus.at(f.place_m, f.amplitude, f.lag_rad) for f in wanted.foci]


def _mode(session: Session) -> Any:
    return "phases" if session.mode == "sequence" else session.mode


def _made(driver: Driver, session: Session, wanted: Wanted) -> Frame:
    (frame,) = driver.frames([_foci(wanted)], mode=_mode(session), solver=wanted.solver)  # type: ignore[arg-type]
    return frame


def _right(driver: Driver, session: Session, wanted: Wanted) -> Frame:
    """The frame as a correct host makes it; apertures that no call offers are put in by hand."""
    frame = _made(driver, session, wanted)
    if session.mode == "points" and session.host.away_m.any():
        other = _made(driver, session, wrongs.moved(wanted, session.host.away_m))
        return dataclasses.replace(other, foci=frame.foci)
    if wanted.amplitudes is None:
        return frame
    return _holding(session, frame, (frame.drive.phase_codes, wanted.amplitudes), of_host=True)


def _holding(session: Session, frame: Frame, registers: Registers, *, of_host: bool) -> Frame:
    """*frame* with these registers in its message; if the host believes in them, in its drive."""
    phases, amplitudes = registers
    message: Drives | Phases
    if session.mode == "drives":
        message = Drives(phases.tobytes() + amplitudes.tobytes())
    else:
        message = Phases(phases.tobytes())
    drive = Drive(phases, amplitudes) if of_host else frame.drive
    return dataclasses.replace(frame, message=message, drive=drive)


def _sent(
    ran: Ran, program: Program, driver: Driver, right: list[Frame], random: Random
) -> list[tuple[Frame, Wrong | None]]:
    """What goes out: the right frames, or in sessions of wrong frames something else."""
    session = ran.session
    if ran.tags.get("how") != "frames":
        return [(frame, None) for frame in right]
    sent = []
    for place, (frame, wanted) in enumerate(zip(right, session.frames, strict=True)):
        if session.mode == "points":
            sent.append(_other_points(driver, session, frame, wanted, random))
            continue
        slip = Slip(
            session, wanted, _registers(frame), _registers(right[place - 1]), program.weights
        )
        try:
            wrong = wrongs.wrong_with(slip, random)
        except ConfigurationError:  # a solver refuses foci out of reach: this frame stays right
            wrong = None
        if wrong is not None:
            frame = _holding(session, frame, wrong.registers, of_host=wrong.of_host)
        sent.append((frame, wrong))
    return sent


def _registers(frame: Frame) -> Registers:
    return frame.drive.phase_codes, frame.drive.amplitude_codes


def _other_points(
    driver: Driver, session: Session, frame: Frame, wanted: Wanted, random: Random
) -> tuple[Frame, Wrong | None]:
    """The same frame, as far as the host knows, with other points in its message."""
    kind, other, size = wrongs.other_foci(wanted, random)
    try:
        made = _made(driver, session, other)
    except ConfigurationError:
        return frame, None
    wrong = Wrong(kind, _registers(made), size, of_host=False)
    return dataclasses.replace(frame, message=made.message), wrong


def _as_sent(wanted: Wanted, intended: records.Intended) -> Wanted:
    """*wanted* with its foci as the wire rounds them; they are within half a micrometre."""
    foci = tuple(
        dataclasses.replace(
            focus, place_m=sent.position_m, amplitude=sent.amplitude, lag_rad=sent.phase_rad
        )
        for focus, sent in zip(wanted.foci, intended.foci, strict=True)
    )
    rounded = dataclasses.replace(wanted, foci=foci)
    if np.abs(rounded.targets_m - wanted.targets_m).max() > 1e-6:
        raise AssertionError(f"the host intends {intended.foci}, {wanted.foci} were asked for")
    return rounded


def _show(driver: Driver, session: Session, frames: list[Frame]) -> None:
    show = driver.play if session.mode == "sequence" else driver.stream
    mode = {"mode": _mode(session)} if "mode" in inspect.signature(show).parameters else {}
    show(frames, _RATE_HZ, **mode)
