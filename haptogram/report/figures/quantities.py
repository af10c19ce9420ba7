"""The quantities of a field that a picture can show: pressure, phase, radiation pressure."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics import Medium, radiation_pressure_pa
from haptogram.acoustics.arrays import FloatArray
from haptogram.errors import ConfigurationError
from haptogram.settings.arguments import check_choice

QUANTITIES: Final = ("pressure", "phase", "force")
#: Lowest level of a picture in decibels; the interactive view has the same.
LEAST_DB: Final = -40.0


def figure_quantity_and_label(
    medium: Medium, values: NDArray[Any], quantity: str, *, decibels: bool = False
) -> tuple[FloatArray, str]:
    """Return a quantity of a field, and its label with the unit.

    Parameters
    ----------
    values : numpy.ndarray
        Complex: peak pressure of one drive; real: RMS pressure of a time average; in pascals.
    decibels : bool
        Return levels relative to the largest value, down to -40 dB.

    Raises
    ------
    ConfigurationError
        An unknown quantity, the phase of a time average, or a phase in decibels.
    """
    check_choice("quantity", quantity, QUANTITIES)
    is_complex = np.iscomplexobj(values)
    if quantity == "phase":
        if decibels:
            raise ConfigurationError("a phase has no level in decibels; choose pressure or force")
        if not is_complex:
            raise ConfigurationError("a time average has no phase; choose pressure or force")
        angles: FloatArray = np.angle(values)
        return angles, "phase of p (rad)"
    shown = np.abs(values) / (math.sqrt(2.0) if is_complex else 1.0)
    name, unit = "pressure", "Pa RMS"
    if quantity == "force":
        name, unit = "radiation pressure, total reflection", "Pa"
        shown = radiation_pressure_pa(math.sqrt(2.0) * shown, medium)
    elif np.nanmax(shown) >= 1e3:
        shown, unit = 1e-3 * shown, "kPa RMS"
    if not decibels:
        return shown, f"{name} ({unit})"
    largest = float(np.nanmax(shown))
    per_decade = 10.0 if quantity == "force" else 20.0
    levels = per_decade * np.log10(np.maximum(shown / largest, 1e-30))
    return np.maximum(levels, LEAST_DB), f"{name} (dB; 0 dB is {largest:.3g} {unit})"
