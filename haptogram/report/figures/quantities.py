"""The quantities of a field that a picture can show: pressure, phase, radiation pressure."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics import Medium, radiation_pressure_pa
from haptogram.acoustics.arrays import FloatArray
from haptogram.errors import ConfigurationError

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
    if quantity not in QUANTITIES:
        raise ConfigurationError(
            f"quantity is {quantity!r}, must be one of {', '.join(QUANTITIES)}"
        )
    if quantity == "phase":
        if decibels:
            raise ConfigurationError("a phase has no level in decibels; choose pressure or force")
        if not np.iscomplexobj(values):
            raise ConfigurationError("a time average has no phase; choose pressure or force")
        angles: FloatArray = np.angle(values)
        return angles, "phase of p (rad)"
    rms = np.abs(values) / (math.sqrt(2.0) if np.iscomplexobj(values) else 1.0)
    if quantity == "force":
        force = radiation_pressure_pa(math.sqrt(2.0) * rms, medium)
        name, unit = "radiation pressure, total reflection", "Pa"
        if decibels:
            return _figure_levels_db(
                force, 10.0
            ), f"{name} (dB; 0 dB is {np.nanmax(force):.3g} {unit})"
        return force, f"{name} ({unit})"
    unit, scale = ("kPa RMS", 1e-3) if np.nanmax(rms) >= 1e3 else ("Pa RMS", 1.0)
    if decibels:
        largest = float(np.nanmax(rms)) * scale
        return _figure_levels_db(rms, 20.0), f"pressure (dB; 0 dB is {largest:.3g} {unit})"
    return rms * scale, f"pressure ({unit})"


def _figure_levels_db(values: FloatArray, per_decade: float) -> FloatArray:
    """Return levels relative to the largest of *values*, down to :data:`LEAST_DB`."""
    share = np.maximum(values / np.nanmax(values), 1e-30)
    return np.maximum(per_decade * np.log10(share), LEAST_DB)
