"""The settings of array, air and elements: as the host assumes them, and as they really are."""

from __future__ import annotations

from pathlib import Path

from haptogram.settings.frozen import dataclass

from .board import DEFAULT_ARRAY, BoardConfig, check_array_setting
from .option import Settings, option, option_of


@dataclass(frozen=True, kw_only=True)
class ArrayConfig(Settings):
    """The array and the air that the host assumes."""

    array: str | None = option(
        None,
        unit="NXxNY|FILE",
        help="grid, or a CSV file of positions in mm",
        absent=f"virtual board: {DEFAULT_ARRAY}; --port: what the board says",
    )
    pitch_mm: float = option_of(BoardConfig, "pitch_mm", help="pitch of the grid")
    temperature_c: float = option_of(
        BoardConfig, "temperature_c", help="air temperature that the host assumes"
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

    board_temperature_c: float | None = option_of(
        BoardConfig,
        "temperature_c",
        default=None,
        help="air temperature over the virtual board",
        absent="the host's",
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
