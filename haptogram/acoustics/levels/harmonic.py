"""Finite amplitude: how far the air turns a strong wave into harmonics before its focus.

A plane wave of peak pressure P becomes a shock after the distance rho c^2 / (beta k P).  A focus is
sigma = beta k / (rho c^2) int |p| ds of these shock lengths from the array, along the line from the
middle of what sounds.  Well below sigma = 1 the second harmonic is sigma / 2 of the first; behind
it the wave tends to a sawtooth, whose second harmonic is half of the first (M. F. Hamilton and D.
T. Blackstock, Nonlinear Acoustics, 1998, chapter 4: the solutions of Fubini and Fay).  Against the
integral of the source p^2 over the volume, which knows diffraction, sigma / 2 is within a fifth.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from haptogram.acoustics.arrays import as_coordinates
from haptogram.acoustics.field.reference import FieldEngine, points_with_field
from haptogram.acoustics.model.drive import as_drive

NONLINEARITY: Final = 1.2  # beta of air: (gamma + 1) / 2
#: Amplitude at which the second harmonic is a tenth of the pressure: -20 dB.
TOLD_FROM: Final = 0.2
_SAMPLES_PER_WAVELENGTH: Final = 8
_MOST_SAMPLES: Final = 2000


def shock_lengths(engine: FieldEngine, weights: ArrayLike, focus_m: ArrayLike) -> float | None:
    """Return the distance of a focus from the array, in shock lengths.

    Parameters
    ----------
    weights : (N,) array_like of complex
        The drive.
    focus_m : (3,) array_like
        Its focus, in metres.

    Returns
    -------
    float or None
        sigma; about twice the second harmonic over the first, where it is below 1.  None: of
        elements that face each other, whose waves meet and do not add up.

    Raises
    ------
    ConfigurationError
        Weights that are not one per element.

    Examples
    --------
    >>> sigma = shock_lengths(engine, weights, target)
    >>> f"a shock {'before' if sigma > 1.0 else 'behind'} the focus, {sigma:.1f} lengths away"
    'a shock before the focus, 1.4 lengths away'
    """
    model = engine.model
    drive, focus = as_drive(weights, model.array.count), as_coordinates("focus_m", focus_m)
    shares = np.abs(model.radiated(drive))
    if not shares.any():
        return 0.0
    normals = model.array.normals[shares > 0.0]
    if (normals @ normals.T).min() < 0.0:
        return None
    start = shares @ model.array.positions_m / shares.sum()
    length_m = float(np.linalg.norm(focus - start))
    samples = math.ceil(_SAMPLES_PER_WAVELENGTH * length_m / model.wavelength_m)
    count = min(max(samples, 1), _MOST_SAMPLES)
    points = start + (focus - start) * ((np.arange(count) + 0.5) / count)[:, None]
    points = points[points_with_field(model, points)]
    total = float(np.abs(engine.pressure(drive, points)).sum()) if len(points) else 0.0
    stiffness = model.medium.impedance * model.medium.sound_speed_m_s
    return NONLINEARITY * model.wavenumber / stiffness * total * length_m / count


def finite_amplitude_text(
    engine: FieldEngine, weights: ArrayLike, focus_m: ArrayLike
) -> str | None:
    """Return a sentence on what the linear field leaves out; None below :data:`TOLD_FROM`."""
    sigma = shock_lengths(engine, weights, focus_m)
    if sigma is None or sigma < TOLD_FROM:
        return None
    where = f"finite amplitude: the focus is {sigma:.2f} shock lengths from the array"
    if sigma >= 1.0:
        return (
            f"{where}; the wave is steep before it, and the linear pressure and force are more "
            "than the air carries"
        )
    return (
        f"{where}; the second harmonic is about {sigma / 2.0:.0%} of the pressure "
        f"({20.0 * math.log10(sigma / 2.0):.0f} dB), which the linear field leaves out"
    )
