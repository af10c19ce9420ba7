"""The quantities of a field that a picture can show: pressure, phase, radiation pressure."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics import FieldEngine, radiation_pressure_pa
from haptogram.acoustics.arrays import FloatArray
from haptogram.errors import ConfigurationError

QUANTITIES: Final = ("pressure", "phase", "force")


def quantity_and_label(
    engine: FieldEngine, values: NDArray[Any], quantity: str
) -> tuple[FloatArray, str]:
    """Return a quantity of a field, and its label with the unit.

    Parameters
    ----------
    values : numpy.ndarray
        Complex: peak pressure of one drive; real: RMS pressure of a time average; in pascals.

    Raises
    ------
    ConfigurationError
        An unknown quantity, or the phase of a time average.
    """
    if quantity not in QUANTITIES:
        raise ConfigurationError(
            f"quantity is {quantity!r}, must be one of {', '.join(QUANTITIES)}"
        )
    if quantity == "phase":
        if not np.iscomplexobj(values):
            raise ConfigurationError("a time average has no phase; choose pressure or force")
        angles: FloatArray = np.angle(values)
        return angles, "phase of p (rad)"
    rms = np.abs(values) / (math.sqrt(2.0) if np.iscomplexobj(values) else 1.0)
    if quantity == "force":
        force = radiation_pressure_pa(math.sqrt(2.0) * rms, engine.model.medium)
        return force, "radiation pressure, total reflection (Pa)"
    unit, scale = ("kPa", 1e-3) if np.nanmax(rms) >= 1e3 else ("Pa", 1.0)
    return rms * scale, f"sound pressure, RMS ({unit})"
