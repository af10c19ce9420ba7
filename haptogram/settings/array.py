"""The settings of array, air and elements: as the host assumes them, and as they really are."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from .board import DEFAULT_ARRAY, BoardConfig, check_array_setting
from .option import Settings, option, options_of

_BOARD: Final = options_of(BoardConfig)
_LEAST_C: Final = _BOARD["temperature_c"].low
_MOST_C: Final = _BOARD["temperature_c"].high


@dataclass(frozen=True, kw_only=True)
class ArrayConfig(Settings):
    """The array and the air that the host assumes."""

    array: str | None = option(
        None,
        unit="NXxNY|FILE",
        help="grid, or a CSV file of positions in mm",
        absent=f"virtual board: {DEFAULT_ARRAY}; --port: what the board says",
    )
    pitch_mm: float = option(
        BoardConfig.pitch_mm,
        unit="MM",
        low=_BOARD["pitch_mm"].low,
        high=_BOARD["pitch_mm"].high,
        help="pitch of the grid",
    )
    temperature_c: float = option(
        BoardConfig.temperature_c,
        unit="C",
        low=_LEAST_C,
        high=_MOST_C,
        help="air temperature that the host assumes",
    )

    def __post_init__(self) -> None:
        """Check the values, and the sides of a grid."""
        super().__post_init__()
        if self.array is not None:
            check_array_setting(self.array)

    @property
    def virtual_array(self) -> str:
        """Array of the virtual board; a real one brings its own."""
        return self.array or DEFAULT_ARRAY


@dataclass(frozen=True, kw_only=True)
class ElementConfig(Settings):
    """The elements as they really are, and the air over the virtual board."""

    board_temperature_c: float | None = option(
        None,
        help="air temperature over the virtual board",
        absent="the host's",
        unit="C",
        low=_LEAST_C,
        high=_MOST_C,
    )
    calibration: Path | None = option(
        None,
        unit="FILE",
        help="CSV file with gain, phase and position of each element, as they really are: of the "
        "virtual board that is started here, and for the judge of any board; docs/calibration.md "
        "has its format",
        absent="all equal, in place",
    )
    compensate: bool = option(
        False, help="the host computes its drives for the elements of the calibration"
    )
