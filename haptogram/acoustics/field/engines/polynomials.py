"""Directivities as polynomials, for single precision."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from haptogram.acoustics.arrays import FloatArray
from haptogram.acoustics.model.model import AcousticModel
from haptogram.acoustics.model.transducer import CircularPiston, PointSource

_GAIN_DEGREE: Final = 5
_GAIN_ERROR: Final = 6e-6  # relative to the smallest gain in front of the element
_SAMPLES: Final = 400


def fit_gain_polynomial(
    function: Callable[[FloatArray], FloatArray], degree: int, low: float, high: float
) -> tuple[FloatArray, float]:
    """Return power-basis coefficients on [low, high], near-minimax, and their largest error."""
    angles = np.pi * (np.arange(_SAMPLES) + 0.5) / _SAMPLES
    nodes = 0.5 * (low + high) + 0.5 * (high - low) * np.cos(angles)
    powers = np.vander(nodes, degree + 1, increasing=True)  # numpy.polynomial takes 10 ms to import
    coefficients = np.asarray(np.linalg.lstsq(powers, function(nodes), rcond=None)[0], np.float64)
    grid = np.linspace(low, high, 10 * _SAMPLES)
    return coefficients, float(np.abs(np.polyval(coefficients[::-1], grid) - function(grid)).max())


def gain_polynomial(model: AcousticModel) -> FloatArray | None:
    """Return the gain in front as a polynomial in cos^2, or None if none is accurate enough.

    A piston so large that its gain passes through zero has none, since single precision cannot
    keep the relative accuracy there; nor has a directivity that this module does not know.
    """
    directivity, wavenumber = model.transducer.directivity, model.wavenumber
    if not isinstance(directivity, CircularPiston | PointSource):
        return None

    def gain(cosine_squared: FloatArray) -> FloatArray:
        return directivity.gain(np.sqrt(np.maximum(cosine_squared, 0.0)), wavenumber)

    coefficients, error = fit_gain_polynomial(gain, _GAIN_DEGREE, 0.0, 1.0)
    smallest = float(np.abs(gain(np.linspace(0.0, 1.0, _SAMPLES))).min())
    return coefficients if error <= _GAIN_ERROR * smallest else None
