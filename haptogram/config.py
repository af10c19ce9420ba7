"""Settings of a verification run: defaults, then a TOML file, then the command line."""

from __future__ import annotations

import dataclasses
import tomllib
import types
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, get_args, get_type_hints

from .errors import ConfigurationError

MODES: Final = ("phases", "points", "sequence")
PHASE_BITS: Final = (8, 6, 5)
SHAPES: Final = ("hemisphere", "sphere", "circle", "line", "point")
MESH_SUFFIXES: Final = (".stl", ".obj", ".ply")
DEFAULT_ARRAY: Final = "16x16"
_SECTION: Final = "verify"


def _limits(low: float, high: float) -> dict[str, tuple[float, float]]:
    return {"limits": (low, high)}


@dataclasses.dataclass(frozen=True, slots=True)
class VerifyConfig:
    """What ``haptogram verify`` does.  Names, units and defaults are those of its options.

    Raises
    ------
    ConfigurationError
        If a value is outside its limits; the text names both.
    """

    object: str = "hemisphere"
    resolution_mm: float = dataclasses.field(default=5.0, metadata=_limits(0.1, 100.0))
    radius_mm: float = dataclasses.field(default=50.0, metadata=_limits(0.1, 500.0))
    center_mm: tuple[float, float, float] = (0.0, 0.0, 100.0)
    rate_hz: float = dataclasses.field(default=1000.0, metadata=_limits(1.0, 40_000.0))
    repeat: int = dataclasses.field(default=1, metadata=_limits(1, 1_000_000))
    mode: str = "phases"
    phase_bits: int = 8
    array: str | None = None
    pitch_mm: float = dataclasses.field(default=10.0, metadata=_limits(1.0, 100.0))
    temperature_c: float = dataclasses.field(default=20.0, metadata=_limits(-20.0, 50.0))
    board_temperature_c: float | None = dataclasses.field(
        default=None, metadata=_limits(-20.0, 50.0)
    )
    port: str | None = None
    link_baud: int = dataclasses.field(default=3_000_000, metadata=_limits(1200, 50_000_000))
    lead_ms: float | None = dataclasses.field(default=None, metadata=_limits(1.0, 1000.0))
    min_verified: float | None = dataclasses.field(default=None, metadata=_limits(0.0, 1.0))
    seed: int = dataclasses.field(default=0, metadata=_limits(0, 2**32 - 1))
    virtual_time: bool = False
    json: Path | None = None
    junit: Path | None = None
    report: Path | None = None

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            _check_limits(field, getattr(self, field.name))
        _check_choice("mode", self.mode, MODES)
        _check_choice("phase_bits", self.phase_bits, PHASE_BITS)
        if self.object not in SHAPES and Path(self.object).suffix.lower() not in MESH_SUFFIXES:
            raise ConfigurationError(
                f"object is {self.object!r}; known are {', '.join(SHAPES)} and a mesh file "
                f"({', '.join(MESH_SUFFIXES)})"
            )
        if self.virtual_time and self.port is not None:
            raise ConfigurationError(
                f"virtual_time runs on the board inside this program; port {self.port!r} has a "
                "clock of its own"
            )

    @property
    def virtual_array(self) -> str:
        """Array of the virtual board; a real one brings its own."""
        return self.array or DEFAULT_ARRAY

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

    def job(self) -> dict[str, Any]:
        """Return what decides the result, for the report: no output path, JSON types only."""
        outputs = {"json", "junit", "report"}
        values = dataclasses.asdict(self)
        return {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in values.items()
            if name not in outputs
        }


def _check_limits(field: dataclasses.Field[Any], value: Any) -> None:
    limits = field.metadata.get("limits")
    if limits is None or value is None:
        return
    low, high = limits
    if not low <= value <= high:  # NaN is not, either
        shown = f"{value:g}" if isinstance(value, float) else str(value)[:40]
        raise ConfigurationError(f"{field.name} is {shown}; it can be {low:g} to {high:g}")


def _check_choice(name: str, value: Any, known: tuple[Any, ...]) -> None:
    if value not in known:
        raise ConfigurationError(f"{name} is {value!r}; known are {', '.join(map(str, known))}")


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
        If the file cannot be read, a key is not known, or a value has the wrong type or size.
    """
    values = _read_table(path) if path is not None else {}
    values |= {name: value for name, value in overrides.items() if value is not None}
    return VerifyConfig(**values)


def _read_table(path: Path) -> dict[str, Any]:
    try:
        document = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise ConfigurationError(f"{path}: {error}") from error
    table = document.get(_SECTION)
    if not isinstance(table, dict) or len(document) > 1:
        raise ConfigurationError(f"{path}: one table [{_SECTION}] and nothing else is expected")
    kinds = get_type_hints(VerifyConfig)
    unknown = sorted(set(table) - set(kinds))
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
    triple = isinstance(value, list) and len(value) == 3 and all(map(_is_number, value))
    if name == "center_mm" and triple:
        return tuple(float(v) for v in value)
    names = " or ".join(k.__name__ for k in wanted if hasattr(k, "__name__"))
    raise ConfigurationError(f"{path}: {name} is {value!r}; {names} is expected")
