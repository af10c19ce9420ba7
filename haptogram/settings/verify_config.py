"""Settings of a verification run: defaults, then a TOML file, then the command line."""

from __future__ import annotations

import dataclasses
import tomllib
import types
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final, get_args, get_type_hints

from ..errors import ConfigurationError
from .board import DEFAULT_ARRAY, BoardConfig
from .option import SettingError

MODES: Final = ("phases", "drives", "points", "sequence")
PHASE_BITS: Final = (8, 6, 5)
# Those of haptogram.acoustics.solvers.several, which takes numpy: --help shall not.
SOLVERS: Final = ("naive", "ibp", "gs", "wgs", "gspat", "gradient")
MODULATIONS: Final = ("am", "lm", "stm")  # those of haptogram.objects.modulation, which takes numpy
SHAPES: Final = ("hemisphere", "sphere", "circle", "line", "point")
MESH_SUFFIXES: Final = (".stl", ".obj", ".ply")
#: Units of the lengths in a mesh file, in metres: the file does not say which it has.
UNITS_M: Final = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254}
#: The largest tolerance of a miss and of the air, and uncertainty of air and elements.
MOST_MISS_MM: Final = 10.0
MOST_OFF_C: Final = 20.0
MOST_OFF_HUMIDITY_PERCENT: Final = 90.0
MOST_OFF_POSITION_MM: Final = 5.0
MOST_OFF_PHASE_RAD: Final = 3.2
#: How well a real board is known until the user says better: a room without a thermometer beside
#: the array, a hygrometer of 10 %, a printed circuit board, transducers as they are delivered.
GUESS_C: Final = 2.0
GUESS_HUMIDITY_PERCENT: Final = 10.0
GUESS_POSITION_MM: Final = 0.1
GUESS_PHASE_RAD: Final = 0.2
#: The settings that name a file to be written.
OUTPUTS: Final = ("frames", "json", "junit", "html")
_SECTION: Final = "verify"
#: Former keys, and those that replaced them.
_RENAMED: Final = {"link_baud": "baud", "report": "html"}


def _limits(low: float, high: float) -> dict[str, tuple[float, float]]:
    return {"limits": (low, high)}


@dataclasses.dataclass(frozen=True, slots=True)
class VerifyConfig:
    """What ``haptogram verify`` does.  Names, units and defaults are those of its options.

    Raises
    ------
    SettingError
        If a value is outside its limits; the text names both.
    """

    object: str = "hemisphere"
    resolution_mm: float = dataclasses.field(default=5.0, metadata=_limits(0.1, 100.0))
    radius_mm: float = dataclasses.field(default=50.0, metadata=_limits(0.1, 500.0))
    center_mm: tuple[float, float, float] = (0.0, 0.0, 100.0)
    unit: str = "mm"
    rate_hz: float = dataclasses.field(default=1000.0, metadata=_limits(1.0, 40_000.0))
    repeat: int = dataclasses.field(default=1, metadata=_limits(1, 1_000_000))
    modulation: str | None = None
    modulation_hz: float = dataclasses.field(default=200.0, metadata=_limits(0.01, 20_000.0))
    depth: float = dataclasses.field(default=1.0, metadata=_limits(0.0, 1.0))
    shift_mm: tuple[float, float, float] = (3.0, 0.0, 0.0)
    dwell_ms: float | None = dataclasses.field(default=None, metadata=_limits(0.01, 60_000.0))
    foci: int = dataclasses.field(default=1, metadata=_limits(1, 32))
    solver: str | None = None
    mode: str = "phases"
    phase_bits: int = 8
    array: str | None = None
    pitch_mm: float = dataclasses.field(default=10.0, metadata=_limits(1.0, 100.0))
    temperature_c: float = dataclasses.field(default=20.0, metadata=_limits(-20.0, 50.0))
    board_temperature_c: float | None = dataclasses.field(
        default=None, metadata=_limits(-20.0, 50.0)
    )
    calibration: Path | None = None
    compensate: bool = False
    tolerance_mm: float = dataclasses.field(default=0.0, metadata=_limits(0.0, MOST_MISS_MM))
    tolerance_c: float = dataclasses.field(default=0.0, metadata=_limits(0.0, MOST_OFF_C))
    tolerance_humidity: float = dataclasses.field(
        default=0.0, metadata=_limits(0.0, MOST_OFF_HUMIDITY_PERCENT)
    )
    uncertainty_c: float | None = dataclasses.field(default=None, metadata=_limits(0.0, MOST_OFF_C))
    uncertainty_humidity: float | None = dataclasses.field(
        default=None, metadata=_limits(0.0, MOST_OFF_HUMIDITY_PERCENT)
    )
    uncertainty_position_mm: float | None = dataclasses.field(
        default=None, metadata=_limits(0.0, MOST_OFF_POSITION_MM)
    )
    uncertainty_phase_rad: float | None = dataclasses.field(
        default=None, metadata=_limits(0.0, MOST_OFF_PHASE_RAD)
    )
    port: str | None = None
    baud: int = dataclasses.field(default=3_000_000, metadata=_limits(1200, 50_000_000))
    lead_ms: float | None = dataclasses.field(default=None, metadata=_limits(1.0, 1000.0))
    min_verified: float | None = dataclasses.field(default=None, metadata=_limits(0.0, 1.0))
    seed: int = dataclasses.field(default=0, metadata=_limits(0, 2**32 - 1))
    fault: tuple[str, ...] = ()
    fault_plan: Path | None = None
    virtual_time: bool = False
    frames: Path | None = None
    json: Path | None = None
    junit: Path | None = None
    html: Path | None = None

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            _check_limits(field, getattr(self, field.name))
        _check_choice("mode", self.mode, MODES)
        _check_choice("phase_bits", self.phase_bits, PHASE_BITS)
        _check_choice("unit", self.unit, tuple(UNITS_M))
        if self.solver is not None:
            _check_choice("solver", self.solver, SOLVERS)
        if self.object not in SHAPES and Path(self.object).suffix.lower() not in MESH_SUFFIXES:
            raise SettingError(
                "object",
                f"is {self.object!r}; known are {', '.join(SHAPES)} and a mesh file "
                f"({', '.join(MESH_SUFFIXES)})",
            )
        if self.modulation is not None:
            self._check_modulation()
        if self.frame_kind == "points" and self.solver not in (None, "naive"):
            raise SettingError(
                "solver", f"is {self.solver!r}; the board solves frames of points, by superposition"
            )
        if self.compensate:
            self._check_compensation()
        if self.port is not None:
            self._check_port(self.port)

    def _check_modulation(self) -> None:
        """Refuse what frames of this rate and mode cannot carry."""
        _check_choice("modulation", self.modulation, MODULATIONS)
        if self.modulation_hz > self.rate_hz / 2.0:
            raise SettingError(
                "modulation_hz",
                f"is {self.modulation_hz:g}; at {self.rate_hz:g} frames/s it can be "
                f"{self.rate_hz / 2.0:g} at most",
            )
        if self.modulation == "am" and self.mode == "phases":
            raise SettingError(
                "modulation",
                "is 'am', whose frames have amplitudes; the mode phases drives every transducer in "
                "full, the modes points, drives and sequence do not",
            )

    def _check_compensation(self) -> None:
        """Refuse what the host cannot compensate for."""
        if self.calibration is None:
            raise SettingError(
                "compensate", "needs to know how the elements are: name the file of a calibration"
            )
        if self.frame_kind == "points":
            raise SettingError(
                "compensate",
                f"is for drives that the host computes; in the mode {self.mode} with these "
                "settings the board does, and knows no calibration",
            )

    def _check_port(self, port: str) -> None:
        """Refuse what only the board that is started here can do."""
        if self.virtual_time:
            raise SettingError(
                "virtual_time",
                f"runs on the board inside this program; port {port!r} has a clock of its own",
            )
        if self.board_temperature_c is not None:
            raise SettingError(
                "board_temperature_c",
                "is the air over the virtual board that is started here; the judge of a board at a "
                "port takes that of the host: state it with --temperature-c",
            )
        faulty = next((name for name in ("fault", "fault_plan") if getattr(self, name)), None)
        if faulty is not None:
            raise SettingError(
                faulty,
                f"is for the virtual board that is started here; the one at port {port!r} has its "
                "own (a virtual one takes them when it is started: docs/faults.md)",
            )

    @property
    def virtual_array(self) -> str:
        """Array of the virtual board; a real one brings its own."""
        return self.array or DEFAULT_ARRAY

    @property
    def frame_kind(self) -> str:
        """What a frame holds: phases, drives or points; a sequence has no drives."""
        if self.mode == "sequence":
            return "points" if self.modulation == "am" else "phases"
        return self.mode

    @property
    def solver_of_host(self) -> str:
        """What makes the drive of several foci; a board that does it superposes them."""
        return self.solver or ("naive" if self.frame_kind == "points" else "wgs")

    @property
    def least_verified(self) -> float:
        """Share of frames that must be verified: all in virtual time, 0.9 on the wall clock."""
        if self.min_verified is not None:
            return self.min_verified
        return 1.0 if self.virtual_time else 0.9

    @property
    def air_over_board_c(self) -> float:
        """Temperature of the air that the virtual board radiates into."""
        board_c = self.board_temperature_c
        return self.temperature_c if board_c is None else board_c

    def virtual_board(self) -> BoardConfig:
        """Return the virtual board that is started here; a driver paces its line."""
        return BoardConfig.of(
            array=self.virtual_array,
            pitch_mm=self.pitch_mm,
            temperature_c=self.air_over_board_c,
            calibration=self.calibration,
            seed=self.seed,
            baud=self.baud if self.virtual_time else None,
            fault=self.fault,
            fault_plan=self.fault_plan,
        )

    def job(self) -> dict[str, Any]:
        """Return what decides the result, for the report: no output path, JSON types only."""
        values = dataclasses.asdict(self)
        return {name: _for_json(value) for name, value in values.items() if name not in OUTPUTS}


def _for_json(value: Any) -> Any:
    if isinstance(value, Path):
        return str(value)
    return list(value) if isinstance(value, tuple) else value


def _check_limits(field: dataclasses.Field[Any], value: Any) -> None:
    limits = field.metadata.get("limits")
    if limits is None or value is None:
        return
    low, high = limits
    if not low <= value <= high:  # NaN is not, either
        shown = f"{value:g}" if isinstance(value, float) else str(value)[:40]
        raise SettingError(field.name, f"is {shown}; it can be {low:.10g} to {high:.10g}")


def _check_choice(name: str, value: Any, known: tuple[Any, ...]) -> None:
    if value not in known:
        raise SettingError(name, f"is {value!r}; known are {', '.join(map(str, known))}")


def load_config(path: Path | None, overrides: Mapping[str, Any]) -> VerifyConfig:
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
    in_file = _read_table(path) if path is not None else {}
    given = {name: value for name, value in overrides.items() if value is not None}
    given = {name: tuple(v) if isinstance(v, list) else v for name, v in given.items()}
    try:
        return VerifyConfig(**(in_file | given))
    except SettingError as error:
        written = option_name(error.name) if error.name in given else f"{path}: {error.name}"
        raise ConfigurationError(f"{written} {error.message}") from error


def option_name(setting: str) -> str:
    """Return how *setting* is written on the command line."""
    return f"--{setting.replace('_', '-')}"


def _read_table(path: Path) -> dict[str, Any]:
    try:
        document = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise ConfigurationError(f"{path}: {reason}") from error
    table = document.get(_SECTION)
    if not isinstance(table, dict) or len(document) > 1:
        raise ConfigurationError(f"{path}: one table [{_SECTION}] and nothing else is expected")
    kinds = get_type_hints(VerifyConfig)
    unknown = sorted(set(table) - set(kinds))
    if unknown and (now := _RENAMED.get(unknown[0])):
        raise ConfigurationError(f"{path}: {unknown[0]!r} is now {now!r}")
    if unknown:
        raise ConfigurationError(
            f"{path}: {unknown[0]!r} is not a setting; known are {', '.join(kinds)}"
        )
    return {name: _converted(path, name, value, kinds[name]) for name, value in table.items()}


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e300


def _converted(path: Path, name: str, value: Any, kind: Any) -> Any:
    """Return a TOML value as the type of its setting."""
    wanted = tuple(k for k in (get_args(kind) if isinstance(kind, types.UnionType) else (kind,)))
    number = _is_number(value)
    if bool in wanted and isinstance(value, bool):
        return value
    if Path in wanted and isinstance(value, str):
        return Path(value)
    if str in wanted and isinstance(value, str):
        return value
    if int in wanted and isinstance(value, int) and number:
        return value
    if float in wanted and number:
        return float(value)
    if name in _LISTS and isinstance(value, list) and _LISTS[name].fits(value):
        return tuple(map(_LISTS[name].kind, value))
    names = " or ".join(k.__name__ for k in wanted if hasattr(k, "__name__"))
    told = _LISTS[name].told if name in _LISTS else names
    raise ConfigurationError(f"{path}: {name} is {value!r}; {told} is expected")


@dataclasses.dataclass(frozen=True, slots=True)
class _ListKind:
    """A setting that is a list in a file: what its items are, and how to say so."""

    kind: type
    told: str
    fits: Callable[[list[Any]], bool]


_PLACE: Final = _ListKind(
    float, "[x, y, z]", lambda items: len(items) == 3 and all(map(_is_number, items))
)
_LISTS: Final = {
    "center_mm": _PLACE,
    "shift_mm": _PLACE,
    "fault": _ListKind(
        str, "a list of texts", lambda items: all(isinstance(item, str) for item in items)
    ),
}
