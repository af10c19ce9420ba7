"""The tolerance of a user, and the uncertainty of air and elements.

Both are settings of a verification: a :class:`Tolerance` decides which miss passes, an
:class:`Uncertainty` is told beside every result.  It decides nothing, but that one which is stated
of the elements says how far one of them may be off where something is tolerated.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from haptogram.acoustics import Medium
from haptogram.acoustics.arrays import FloatArray
from haptogram.acoustics.model.medium import air_speed_uncertainty
from haptogram.settings import tolerance as limits
from haptogram.settings.arguments import check_number
from haptogram.settings.frozen import dataclass, fields, replace


def _check_uncertain_air(temperature_c: float, humidity_percent: float) -> None:
    """Refuse tolerances of temperature or humidity outside their limits."""
    check_number("temperature_c", temperature_c, 0.0, limits.MOST_OFF_C)
    check_number("humidity_percent", humidity_percent, 0.0, limits.MOST_OFF_HUMIDITY_PERCENT)


@dataclass(frozen=True, slots=True)
class Tolerance:
    """Which misses pass, on top of those of rounding of the phases.  The default: none.

    Attributes
    ----------
    miss_mm : float
        Distance of the focus from its target, 0 to 10 mm.
    temperature_c : float
        Difference between the air that the host assumed and the air of the board, 0 to 20 degrees.
    humidity_percent : float
        The same of the relative humidity, 0 to 90 %.

    Raises
    ------
    ConfigurationError
        A value outside its limits.

    Examples
    --------
    >>> Tolerance(miss_mm=0.5).is_strict
    False
    """

    miss_mm: float = 0.0
    temperature_c: float = 0.0
    humidity_percent: float = 0.0

    def __post_init__(self) -> None:
        check_number("miss_mm", self.miss_mm, 0.0, limits.MOST_MISS_MM)
        _check_uncertain_air(self.temperature_c, self.humidity_percent)

    @property
    def is_strict(self) -> bool:
        """True if nothing but rounding is tolerated."""
        return not any(getattr(self, field.name) for field in fields(self))

    def left_m(self, offset_m: FloatArray | None) -> FloatArray | float:
        """Return (3,) what is left of an offset beyond the tolerated miss; 0 of one not known."""
        if offset_m is None:
            return 0.0
        length_m = max(float(np.linalg.norm(offset_m)), 1e-12)
        return np.abs(offset_m) * max(0.0, 1.0 - self.miss_mm / 1e3 / length_m)

    def speed_share(self, medium: Medium) -> float:
        """Return the relative difference of the speed of sound that is tolerated."""
        return air_speed_uncertainty(medium, self.temperature_c, self.humidity_percent)


@dataclass(frozen=True, slots=True)
class Uncertainty:
    """Standard uncertainties of air and elements.

    The default is 0: the virtual board radiates in the very air that the judge assumes.

    Attributes
    ----------
    temperature_c : float
        Of the temperature of the air, 0 to 20 degrees.
    humidity_percent : float
        Of its relative humidity, 0 to 90 %.
    position_mm : float
        Of each coordinate of each element, 0 to 5 mm.
    phase_rad : float
        Of the phase that each element adds, 0 to 3.2.
    is_guess : bool
        Whether those of the elements were not stated.

    Raises
    ------
    ConfigurationError
        A value outside its limits.

    Examples
    --------
    >>> Uncertainty(temperature_c=2.0).temperature_c
    2.0
    """

    temperature_c: float = 0.0
    humidity_percent: float = 0.0
    position_mm: float = 0.0
    phase_rad: float = 0.0
    is_guess: bool = False

    def __post_init__(self) -> None:
        _check_uncertain_air(self.temperature_c, self.humidity_percent)
        check_number("position_mm", self.position_mm, 0.0, limits.MOST_OFF_POSITION_MM)
        check_number("phase_rad", self.phase_rad, 0.0, limits.MOST_OFF_PHASE_RAD)

    def speed_share(self, medium: Medium) -> float:
        """Return the relative standard uncertainty of the speed of sound, by both together."""
        changes = (self.temperature_c, 0.0), (0.0, self.humidity_percent)
        return math.hypot(*(air_speed_uncertainty(medium, *change) for change in changes))


#: Uncertainty of a real board until the user states a better one.
REAL_BOARD: Final = Uncertainty(
    limits.GUESS_C,
    limits.GUESS_HUMIDITY_PERCENT,
    limits.GUESS_POSITION_MM,
    limits.GUESS_PHASE_RAD,
    is_guess=True,
)


def tolerance_text(tolerance: Tolerance) -> str:
    """Return a tolerance in words."""
    parts = [
        f"{tolerance.miss_mm:g} mm" if tolerance.miss_mm else "",
        f"air of ±{tolerance.temperature_c:g} °C" if tolerance.temperature_c else "",
        f"±{tolerance.humidity_percent:g} % humidity" if tolerance.humidity_percent else "",
    ]
    return ", ".join(filter(None, parts)) or "none"


def tolerance_of(config: limits.ToleranceConfig) -> Tolerance:
    """Return the tolerance of the settings."""
    return Tolerance(config.tolerance_mm, config.tolerance_c, config.tolerance_humidity)


def uncertainty_of(config: limits.UncertaintyConfig, *, at_port: bool) -> Uncertainty:
    """Return the uncertainty of air and elements that the settings state.

    An uncertainty that is not given is 0 for the virtual board that is started here, whose air and
    elements are those of the settings, and a guess (`REAL_BOARD`) for a board *at_port*.
    """
    guess = REAL_BOARD if at_port else Uncertainty()
    said = {
        "temperature_c": config.uncertainty_c,
        "humidity_percent": config.uncertainty_humidity,
        "position_mm": config.uncertainty_position_mm,
        "phase_rad": config.uncertainty_phase_rad,
    }
    stated = {name: value for name, value in said.items() if value is not None}
    is_guess = guess.is_guess and not stated.keys() & {"position_mm", "phase_rad"}
    return replace(guess, **stated, is_guess=is_guess)


class VerdictUncertainty(NamedTuple):
    """Standard uncertainty of the place of a focus, in mm, by its source.

    Attributes
    ----------
    air, positions, phases : float
        From the speed of sound, from the positions and from the phases of the elements.
    """

    air: float
    positions: float
    phases: float

    @property
    def total(self) -> float:
        """Square root of the sum of the squares."""
        return math.hypot(*self)
