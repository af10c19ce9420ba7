"""The settings of the judge: tolerances and uncertainties."""

from __future__ import annotations

from typing import Final

from haptogram.settings.frozen import dataclass

from .option import Settings, option

#: The largest tolerance of a miss and of the air, and uncertainty of air and elements.
MOST_MISS_MM: Final = 10.0
MOST_OFF_C: Final = 20.0
MOST_OFF_HUMIDITY_PERCENT: Final = 90.0
MOST_OFF_POSITION_MM: Final = 5.0
MOST_OFF_PHASE_RAD: Final = 3.2
#: Uncertainties that are assumed of a real board: a room without a thermometer beside the array, a
#: hygrometer of 10 %, a printed circuit board, transducers as they are delivered.
GUESS_C: Final = 2.0
GUESS_HUMIDITY_PERCENT: Final = 10.0
GUESS_POSITION_MM: Final = 0.1
GUESS_PHASE_RAD: Final = 0.2
_REAL: Final = "virtual board: 0; --port:"


@dataclass(frozen=True, kw_only=True)
class ToleranceConfig(Settings):
    """Misses that pass on top of those that the rounding of the phases makes."""

    tolerance_mm: float = option(
        0.0,
        unit="MM",
        high=MOST_MISS_MM,
        help="distance of a focus from its target that passes, if there is such a focus: at most "
        "half of its width",
    )
    tolerance_c: float = option(
        0.0,
        unit="C",
        high=MOST_OFF_C,
        help="difference between the air that the host assumes and that over the board",
    )
    tolerance_humidity: float = option(
        0.0,
        unit="PERCENT",
        high=MOST_OFF_HUMIDITY_PERCENT,
        help="difference between the relative humidity that the host assumes and that over the "
        "board",
    )


@dataclass(frozen=True, kw_only=True)
class UncertaintyConfig(Settings):
    """Standard uncertainties of air and elements; None: 0 for the virtual board, else a guess."""

    uncertainty_c: float | None = option(
        None,
        unit="C",
        high=MOST_OFF_C,
        help="standard uncertainty of the air temperature",
        absent=f"{_REAL} {GUESS_C:g}",
    )
    uncertainty_humidity: float | None = option(
        None,
        unit="PERCENT",
        high=MOST_OFF_HUMIDITY_PERCENT,
        help="standard uncertainty of the relative humidity",
        absent=f"{_REAL} {GUESS_HUMIDITY_PERCENT:g}",
    )
    uncertainty_position_mm: float | None = option(
        None,
        unit="MM",
        high=MOST_OFF_POSITION_MM,
        help="standard uncertainty of each coordinate of each element",
        absent=f"{_REAL} {GUESS_POSITION_MM:g}",
    )
    uncertainty_phase_rad: float | None = option(
        None,
        unit="RAD",
        high=MOST_OFF_PHASE_RAD,
        help="standard uncertainty of the phase that each element adds",
        absent=f"{_REAL} {GUESS_PHASE_RAD:g}",
    )
