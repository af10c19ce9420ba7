"""Levels, and the force that the sound exerts.

Radiation pressure is quadratic in the pressure; it is stated for a plane wave that falls on the
surface along its normal, so steep angles of incidence are over-estimated.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from haptogram.acoustics._validation import (
    FloatArray,
    as_complex,
    as_place,
    check_positive,
    check_range,
)
from haptogram.acoustics.field import FieldEngine, NumpyEngine
from haptogram.acoustics.medium import Medium
from haptogram.acoustics.model import AcousticModel
from haptogram.errors import ConfigurationError

REFERENCE_PRESSURE_PA: Final = 20e-6
TOTAL_REFLECTION: Final = 2.0
DISC_RADIUS_M: Final = 0.010


def level_db_spl(pressure_rms_pa: float) -> float:
    """Return the sound pressure level re 20 uPa, in dB; minus infinity for silence."""
    pressure = check_range("pressure_rms_pa", pressure_rms_pa, 0.0, 1e12)
    return 20.0 * math.log10(pressure / REFERENCE_PRESSURE_PA) if pressure > 0.0 else -math.inf


def radiation_pressure_pa(
    pressure_peak_pa: ArrayLike, medium: Medium, reflection: float = TOTAL_REFLECTION
) -> FloatArray:
    """Return the mean radiation pressure alpha_R p_rms^2 / (rho c^2), in pascals.

    Parameters
    ----------
    pressure_peak_pa : array_like of complex
        Peak pressure of the incident wave.
    reflection : float
        alpha_R: 1 for a perfect absorber, 2 for total reflection.

    Notes
    -----
    Langevin radiation pressure of a plane wave: L. E. Kinsler et al., or T. Hoshi et al., IEEE
    Trans. Haptics 3(3), 2010, eq. (1).
    """
    check_range("reflection", reflection, 1.0, 2.0)
    mean_square = 0.5 * np.abs(as_complex("pressure_peak_pa", pressure_peak_pa)) ** 2
    result: FloatArray = reflection * mean_square / (medium.impedance * medium.sound_speed_m_s)
    return result


def force_on_disc_n(
    source: AcousticModel | FieldEngine,
    weights: ArrayLike,
    centre_m: ArrayLike,
    radius_m: float = DISC_RADIUS_M,
) -> float:
    """Return the force on a totally reflecting disc whose normal is z, in newtons.

    Parameters
    ----------
    source : AcousticModel or FieldEngine
        What computes the field.
    weights : (N,) array_like of complex
        Element weights.
    centre_m : (3,) array_like
        Centre of the disc, in metres.
    radius_m : float
        Radius of the disc; at most 100 mm, which keeps the number of nodes bounded.

    Raises
    ------
    ConfigurationError
        A radius out of range, weights of several drives, or a disc that touches an element.
    """
    engine = NumpyEngine(source) if isinstance(source, AcousticModel) else source
    return ReflectingDisc(engine, radius_m).force_n(weights, centre_m)


class ReflectingDisc:
    """A totally reflecting disc whose normal is z: the force of drive after drive on it.

    Parameters
    ----------
    engine : FieldEngine
        What computes the field.
    radius_m : float
        Radius of the disc; at most 100 mm, which keeps the number of nodes bounded.

    Raises
    ------
    ConfigurationError
        A radius out of range.
    """

    def __init__(self, engine: FieldEngine, radius_m: float = DISC_RADIUS_M) -> None:
        check_range("radius_m", radius_m, 1e-6, 0.1)
        self._engine = engine
        self._offsets_m, self._areas_m2 = disc_nodes(radius_m, engine.model.wavenumber)

    def force_n(self, weights: ArrayLike, centre_m: ArrayLike) -> float:
        """Return the force, in newtons, of (N,) *weights* on the disc around (3,) *centre_m*.

        Raises
        ------
        ConfigurationError
            Weights of several drives, or a disc that touches an element.
        """
        nodes_m = as_place("centre_m", centre_m) + self._offsets_m
        pressure = self._engine.pressure(weights, nodes_m)
        if pressure.ndim != 1:
            raise ConfigurationError(f"{len(pressure)} drives, the force is that of one")
        return float(radiation_pressure_pa(pressure, self._engine.model.medium) @ self._areas_m2)


def disc_nodes(radius_m: float, wavenumber: float) -> tuple[FloatArray, FloatArray]:
    """Return nodes and weights that integrate an intensity over a disc around the origin.

    Gauss-Legendre in the squared radius, equal steps in the angle: both orders follow from the
    shortest period that |p|^2 can have, half a wavelength (6 x 18 nodes for 10 mm at 40 kHz).

    Returns
    -------
    offsets_m : (M, 3) numpy.ndarray
        Nodes, in metres.
    areas_m2 : (M,) numpy.ndarray
        Their weights, which sum to the area.
    """
    reach = check_positive("wavenumber", wavenumber) * check_positive("radius_m", radius_m)
    rings, spokes = 1 + math.ceil(reach / 1.6), 1 + math.ceil(2.3 * reach)
    nodes, weights = np.polynomial.legendre.leggauss(rings)
    radii = radius_m * np.sqrt((nodes + 1.0) / 2.0)
    angles = 2.0 * np.pi * np.arange(spokes) / spokes
    x, y = np.outer(radii, np.cos(angles)).ravel(), np.outer(radii, np.sin(angles)).ravel()
    areas = np.repeat(weights / 2.0, spokes) * (np.pi * radius_m**2 / spokes)
    return np.stack([x, y, np.zeros_like(x)], axis=1), areas
