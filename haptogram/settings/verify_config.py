"""Settings of a verification run: defaults, then a TOML file, then the command line."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from ..errors import ConfigurationError
from .arguments import did_you_mean
from .array import ArrayConfig, ElementConfig
from .board import BoardConfig, FaultWords
from .command_line import setting_option_name
from .line import DEFAULT_BAUD, LEAST_BAUD, MAX_BAUD
from .option import SettingError, Settings, option, option_group, options_of, unknown_setting_text
from .shape import ModulationConfig, ShapeConfig
from .text_file import read_toml
from .tolerance import ToleranceConfig, UncertaintyConfig

MODES: Final = ("phases", "drives", "points", "sequence")
PHASE_BITS: Final = (8, 6, 5)
# Those of haptogram.acoustics.solvers.several, which takes numpy: --help shall not.
SOLVERS: Final = ("naive", "ibp", "gs", "wgs", "gspat", "gradient")
_SECTION: Final = "verify"
#: Former keys, and those that replaced them.
_RENAMED: Final = {"link_baud": "baud", "report": "html"}


@dataclass(frozen=True, kw_only=True)
class PaceConfig(Settings):
    """Rate, number and lead of the frames."""

    rate_hz: float = option(1000.0, unit="HZ", low=1.0, high=40_000.0, help="points per second")
    repeat: int = option(
        1, unit="N", low=1, high=1_000_000, help="how often the object is displayed"
    )
    lead_ms: float | None = option(
        None,
        unit="MS",
        low=1.0,
        high=1000.0,
        help="how long before its time a frame is sent",
        absent="100, or 3/4 of the board's queue",
    )


@dataclass(frozen=True, kw_only=True)
class DriveConfig(Settings):
    """Number of foci in a frame, and who computes their drive."""

    foci: int = option(
        1, unit="N", low=1, high=32, help="foci in every frame, evenly apart along the object"
    )
    solver: str | None = option(
        None,
        choices=SOLVERS,
        help="how the host makes the drive of several foci: docs/performance.md compares them",
        absent="wgs; --mode points: naive, by the board",
    )
    mode: str = option(
        "phases",
        choices=MODES,
        help="phases: the host computes every drive; drives: with amplitudes; points: the board "
        "does; sequence: uploaded once, played on the board's clock",
    )
    phase_bits: int = option(8, choices=PHASE_BITS, help="bits per phase on the wire")


@dataclass(frozen=True, kw_only=True)
class LinkConfig(Settings):
    """The board's port, its line and its clock."""

    port: str | None = option(
        None,
        unit="URL",
        help="a board on any pyserial URL (/dev/ttyUSB0, /dev/pts/7, socket://...)",
        absent="a virtual board on a pty, in a process of its own",
    )
    dialect: str | None = option(
        None,
        unit="NAME",
        help="wire of other boards, such as sonicsurface: they are given phases, at the usual baud "
        "of their line and as fast as it carries, unless other rates are named (docs/dialects.md)",
        absent="Haptogram's own",
    )
    dialect_option: tuple[str, ...] = option(
        (), unit="NAME=VALUE", help="option of the dialect, such as boards=2; may be repeated"
    )
    baud: int = option(
        DEFAULT_BAUD, unit="BAUD", low=LEAST_BAUD, high=MAX_BAUD, help="rate of the line"
    )
    virtual_time: bool = option(
        False, help="no wall clock at all: the same inputs give the same result, byte for byte"
    )


@dataclass(frozen=True, kw_only=True)
class LimitConfig(Settings):
    """Seed of the run, and the limit of its verdict."""

    min_verified: float | None = option(
        None,
        unit="SHARE",
        low=0.0,
        high=1.0,
        help="share of frames that must be verified",
        absent="1 in virtual time, else 0.9",
    )
    seed: int = option(
        0, unit="N", low=0, high=2**32 - 1, help="seed of everything random, faults among it"
    )


@dataclass(frozen=True, kw_only=True)
class OutputConfig(Settings):
    """The files to be written, of every command that judges or measures, and their date."""

    record: Path | None = option(
        None,
        unit="FILE",
        help="write the bytes in both directions, the latches and what was made of them, as MCAP "
        "(docs/recordings.md)",
    )
    frames: Path | None = option(
        None,
        unit="FILE",
        help="write a line for every frame: where its focus is, what that rests on, and which miss "
        "would have shown",
    )
    json: Path | None = option(None, unit="FILE", help="write the result as JSON")
    junit: Path | None = option(None, unit="FILE", help="write the result as JUnit XML")
    html: Path | None = option(
        None, unit="FILE", help="write the result as a page of HTML that needs no other file"
    )
    summary: Path | None = option(
        None, unit="FILE", help="write a summary in Markdown, for the page of a CI job"
    )
    stamp: str | None = option(
        None,
        unit="DATE",
        help="date that --html, --junit and --summary state (ISO 8601; UTC without a zone)",
        absent="when the run began; in virtual time none, so that results repeat byte for byte",
    )


@dataclass(frozen=True, kw_only=True)
class CaptureConfig(Settings):
    """The captures of drive pins that are judged, and what they are judged by."""

    capture: tuple[Path, ...] = option(
        (),
        unit="FILE",
        help="capture of drive pins (VCD, or .sr of sigrok) of the run at --port, or of the one in "
        "--recording; may be repeated: captures of all elements are joined",
        absent="none",
    )
    channels: tuple[Path, ...] = option(
        (),
        unit="FILE",
        help="TOML map of the channels of --capture (docs/captures.md); repeated, one for each",
        absent="none",
    )
    recording: Path | None = option(
        None,
        unit="FILE",
        help="judge --capture by the frames of this recording (--record), and run nothing",
        absent="run",
    )

    def __post_init__(self) -> None:
        """Check that there is a map for every capture."""
        super().__post_init__()
        if self.recording is not None and not self.capture:
            raise SettingError("recording", "is what a capture is judged by: name the --capture")
        if self.capture and not self.channels:
            raise SettingError("channels", "is missing: a capture needs the map of its channels")
        if self.capture and len(self.channels) not in (1, len(self.capture)):
            captures = len(self.capture)
            for_them = (
                "1 capture, must be one"
                if captures == 1
                else f"{captures} captures, must be one for all or one for each"
            )
            raise SettingError("channels", f"names {len(self.channels)} maps for {for_them}")
        if self.channels and not self.capture:
            raise SettingError("channels", "is the map of a capture: name the --capture")


@dataclass(frozen=True, kw_only=True)
class VerifyConfig(Settings):
    """The settings of ``haptogram verify``: one group for each room that takes them.

    :meth:`VerifyConfig.of` takes the options of all groups by name, with the units and defaults of
    the command line.

    Raises
    ------
    SettingError
        If a value is outside its limits, or contradicts another one.
    """

    shape: ShapeConfig = option_group(ShapeConfig)
    pace: PaceConfig = option_group(PaceConfig)
    modulation: ModulationConfig = option_group(ModulationConfig)
    drive: DriveConfig = option_group(DriveConfig)
    array: ArrayConfig = option_group(ArrayConfig)
    elements: ElementConfig = option_group(ElementConfig)
    tolerance: ToleranceConfig = option_group(ToleranceConfig)
    uncertainty: UncertaintyConfig = option_group(UncertaintyConfig)
    link: LinkConfig = option_group(LinkConfig)
    limits: LimitConfig = option_group(LimitConfig)
    faults: FaultWords = option_group(FaultWords)
    captures: CaptureConfig = option_group(CaptureConfig)
    outputs: OutputConfig = option_group(OutputConfig)

    def __post_init__(self) -> None:
        """Check the settings against each other."""
        super().__post_init__()
        if self.modulation.modulation is not None:
            self._check_modulation()
        solver = self.drive.solver
        if self.frame_kind == "points" and solver not in (None, "naive"):
            raise SettingError(
                "solver", f"is {solver!r}; the board solves frames of points, by superposition"
            )
        if self.elements.compensate and self.captures.recording is None:
            self._check_compensation()
        if self.captures.capture and self.captures.recording is None and self.link.dialect:
            raise SettingError(
                "capture",
                f"is judged by frames of Haptogram's own wire, not of {self.link.dialect}: give "
                "what the pins show to haptogram capture",
            )
        if self.link.port is not None:
            self._check_port(self.link.port)
        elif self.captures.capture and self.captures.recording is None:
            raise SettingError(
                "capture",
                "is of a board at --port, or of the run in a --recording; a virtual board writes "
                "one of its own: haptogram board --capture",
            )

    def _check_modulation(self) -> None:
        """Refuse a modulation that frames of this rate and mode cannot carry."""
        kind, rate_hz = self.modulation.modulation, self.pace.rate_hz
        if self.modulation.modulation_hz > rate_hz / 2.0:
            raise SettingError(
                "modulation_hz",
                f"is {self.modulation.modulation_hz:g}; at {rate_hz:g} frames/s it can be "
                f"{rate_hz / 2.0:g} at most",
            )
        if kind == "am" and self.drive.mode == "phases":
            raise SettingError(
                "modulation",
                "is 'am', whose frames have amplitudes; the mode phases drives every transducer in "
                "full, the modes points, drives and sequence do not",
            )

    def _check_compensation(self) -> None:
        """Refuse a compensation that the host cannot compute."""
        if self.elements.calibration is None:
            raise SettingError(
                "compensate", "needs to know how the elements are: name the file of a calibration"
            )
        if self.frame_kind == "points":
            raise SettingError(
                "compensate",
                f"is for drives that the host computes; in the mode {self.drive.mode} with these "
                "settings the board does, and knows no calibration",
            )

    def _check_port(self, port: str) -> None:
        """Refuse options of the board that is started here."""
        if self.link.virtual_time:
            raise SettingError(
                "virtual_time",
                f"runs on the board inside this program; port {port!r} has a clock of its own",
            )
        if self.elements.board_temperature_c is not None:
            raise SettingError(
                "board_temperature_c",
                "is the air over the virtual board that is started here; the judge of a board at a "
                "port takes that of the host: state it with --temperature-c",
            )
        faulty = next(iter(self.faults.non_default()), None)
        if faulty is not None:
            raise SettingError(
                faulty,
                f"is for the virtual board that is started here; the one at port {port!r} has its "
                "own (a virtual one takes them when it is started: docs/faults.md)",
            )

    @property
    def frame_kind(self) -> str:
        """Content of the frames: phases, drives or points; a sequence has no drives."""
        if self.drive.mode == "sequence":
            return "points" if self.modulation.modulation == "am" else "phases"
        return self.drive.mode

    @property
    def solver_of_host(self) -> str:
        """Solver of the drive of several foci; a board that solves it superposes them."""
        return self.drive.solver or ("naive" if self.frame_kind == "points" else "wgs")

    @property
    def least_verified(self) -> float:
        """Share of frames that must be verified: all in virtual time, 0.9 on the wall clock."""
        if self.limits.min_verified is not None:
            return self.limits.min_verified
        return 1.0 if self.link.virtual_time else 0.9

    @property
    def air_over_board_c(self) -> float:
        """Temperature of the air that the virtual board radiates into."""
        board_c = self.elements.board_temperature_c
        return self.array.temperature_c if board_c is None else board_c

    def virtual_board(self) -> BoardConfig:
        """Return the virtual board that is started here; a driver paces its line."""
        own: dict[str, Any] = {
            "array": self.array.virtual_array,
            "baud": self.link.baud if self.link.virtual_time else None,
        }
        return BoardConfig.of(
            **(own if self.link.dialect is None else self.dialect_options() | {"baud": None}),
            pitch_mm=self.array.pitch_mm,
            temperature_c=self.air_over_board_c,
            calibration=self.elements.calibration,
            seed=self.limits.seed,
            fault=self.faults.fault,
            fault_plan=self.faults.fault_plan,
        )

    def dialect_options(self) -> dict[str, Any]:
        """Return the options of a virtual board that say which boards of which dialect it is."""
        given = {} if self.array.array is None else {"array": self.array.array}
        return given | {"dialect": self.link.dialect, "dialect_option": self.link.dialect_option}

    def result_options(self) -> dict[str, Any]:
        """Return the options that decide the result, for the report: JSON types, no output path."""
        outputs = options_of(OutputConfig)
        return {
            name: _setting_for_json(v) for name, v in self.values().items() if name not in outputs
        }


def _setting_for_json(value: Any) -> Any:
    if isinstance(value, Path):
        return str(value)
    return [_setting_for_json(item) for item in value] if isinstance(value, tuple) else value


def load_verify_config(path: Path | None, overrides: Mapping[str, Any]) -> VerifyConfig:
    """Return the settings: defaults, then the ``[verify]`` table of *path*, then *overrides*.

    Parameters
    ----------
    path : Path or None
        TOML file.
    overrides : mapping
        Values from the command line; those that are None were not given.

    Raises
    ------
    ConfigurationError
        If the file cannot be read, a key is not known, or a value has the wrong type or size; the
        text names the setting as it was written: the key in the file, or the option.
    """
    in_file = read_settings_table(path) if path is not None else {}
    given = {name: value for name, value in overrides.items() if value is not None}
    try:
        return VerifyConfig.of(**(in_file | given))
    except SettingError as error:
        is_in_file = error.name in in_file and error.name not in given
        written = f"{path}: {error.name}" if is_in_file else setting_option_name(error.name)
        raise ConfigurationError(f"{written} {error.message}") from error


def read_settings_table(path: Path) -> dict[str, Any]:
    """Return the ``[verify]`` table of a TOML file.

    Raises
    ------
    ConfigurationError
        If the file cannot be read, or a table or a key is not known.
    """
    document = read_toml(path, "config")
    table = document.get(_SECTION)
    for name in document:
        if name != _SECTION:
            guess = did_you_mean(name, (_SECTION,))
            raise ConfigurationError(
                f"{path}: [{name}] is not read; all settings are in one table [{_SECTION}]{guess}"
            )
    if not isinstance(table, dict):
        raise ConfigurationError(f"{path}: must have one table [{_SECTION}]")
    for name in table.keys() - options_of(VerifyConfig).keys():
        if name in _RENAMED:
            raise ConfigurationError(f"{path}: {name!r} is now {_RENAMED[name]!r}")
        known = unknown_setting_text(name, options_of(VerifyConfig))
        raise ConfigurationError(f"{path}: {name!r} is not a setting{known}")
    return table
