"""Levels, and the force that the sound exerts.

Radiation pressure is quadratic in the pressure; it is stated for a plane wave that falls on the
surface along its normal. The force on a disc is the time-averaged stress on a rigid wall.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from haptogram.acoustics.arrays import FloatArray, as_complex_array, as_coordinates
from haptogram.acoustics.field.reference import FieldEngine, NumpyEngine
from haptogram.acoustics.model.geometry import TransducerArray
from haptogram.acoustics.model.medium import Medium
from haptogram.acoustics.model.model import AcousticModel
from haptogram.acoustics.model.own_axes import axes_about_normal
from haptogram.errors import ConfigurationError
from haptogram.settings.arguments import check_number, check_positive

_REFERENCE_PRESSURE_PA: Final = 20e-6
_TOTAL_REFLECTION: Final = 2.0
_DISC_RADIUS_M: Final = 0.010
_STENCIL_RAD: Final = 0.1  # half the span of a difference, as a phase: force is off by 0.3 %
_NO_LENGTH: Final = 1e-9


def level_db_spl(pressure_rms_pa: float) -> float:
    """Return the sound pressure level re 20 uPa, in dB; minus infinity for silence.

    Examples
    --------
    >>> round(level_db_spl(20e-6), 1), round(level_db_spl(2000.0), 1)
    (0.0, 160.0)
    """
    pressure = check_number("pressure_rms_pa", pressure_rms_pa, 0.0, 1e12)
    return 20.0 * math.log10(pressure / _REFERENCE_PRESSURE_PA) if pressure > 0.0 else -math.inf


def radiation_pressure_pa(
    pressure_peak_pa: ArrayLike, medium: Medium, reflection: float = _TOTAL_REFLECTION
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

    Examples
    --------
    >>> f"{float(radiation_pressure_pa(3000.0, model.medium)):.1f} Pa"
    '63.4 Pa'
    """
    check_number("reflection", reflection, 1.0, 2.0)
    mean_square = 0.5 * np.abs(as_complex_array("pressure_peak_pa", pressure_peak_pa)) ** 2
    result: FloatArray = reflection * mean_square / (medium.impedance * medium.sound_speed_m_s)
    return result


def force_on_disc_n(
    source: AcousticModel | FieldEngine,
    weights: ArrayLike,
    centre_m: ArrayLike,
    radius_m: float = _DISC_RADIUS_M,
    normal: ArrayLike | None = None,
) -> float:
    """Return the force on a totally reflecting disc, along its normal, in newtons.

    The integral of 2 (p_rms^2 - (rho c v_t)^2) / (rho c^2) over the disc: the time-averaged stress
    on a rigid wall, which doubles the pressure p and the velocity v_t along the wall of the sound
    without it. A plane wave leaves 2 cos^2(theta) p_rms^2 / (rho c^2) at any angle theta; a focus,
    a bundle of plane waves, leaves less than one from ahead. The waves that the disc scatters at
    its rim are left out. Where the sound along the disc is louder than the pressure on it, as at a
    node of a standing wave, the force is negative.

    Parameters
    ----------
    source : AcousticModel or FieldEngine
        Engine that computes the field.
    weights : (N,) array_like of complex
        Element weights.
    centre_m : (3,) array_like
        Centre of the disc, in metres.
    radius_m : float
        Radius of the disc; at most 100 mm, which keeps the number of nodes bounded.
    normal : (3,) array_like, optional
        Which way the disc faces, of any length; that of the array's face (its own z) if not given.

    Raises
    ------
    ConfigurationError
        A radius out of range, a normal without direction, weights of several drives, or a disc that
        touches an element or reaches behind the array.

    Examples
    --------
    >>> f"{1e3 * force_on_disc_n(engine, weights, target, radius_m=0.01):.1f} mN"
    '13.4 mN'
    """
    engine = NumpyEngine(source) if isinstance(source, AcousticModel) else source
    return ReflectingDisc(engine, radius_m, normal).force_n(weights, centre_m)


class ReflectingDisc:
    """A totally reflecting disc: the force of drive after drive on it, :func:`force_on_disc_n`.

    Parameters
    ----------
    engine : FieldEngine
        Engine that computes the field.
    radius_m : float
        Radius of the disc; at most 100 mm, which keeps the number of nodes bounded.
    normal : (3,) array_like, optional
        Which way the disc faces, of any length; that of the array's face (its own z) if not given.

    Attributes
    ----------
    engine : FieldEngine
        The engine.

    Raises
    ------
    ConfigurationError
        A radius out of range, or a normal without direction.
    """

    def __init__(
        self,
        engine: FieldEngine,
        radius_m: float = _DISC_RADIUS_M,
        normal: ArrayLike | None = None,
    ) -> None:
        check_number("radius_m", radius_m, 1e-6, 0.1)
        self.engine = engine
        wavenumber, axes = engine.model.wavenumber, _force_disc_axes(engine.model.array, normal)
        nodes_m, self._areas_m2 = force_disc_nodes(radius_m, wavenumber)
        across = np.eye(3)[:2]
        stencil_m = np.concatenate([np.zeros((1, 3)), across, -across]) * _STENCIL_RAD / wavenumber
        self._nodes_m = (stencil_m[:, None] + nodes_m).reshape(-1, 3) @ axes

    @property
    def kernel_arguments(self) -> tuple[FloatArray, FloatArray, float, float]:
        """Nodes of all stencils, areas, and stress per |p|^2 and per squared difference."""
        per_pa2 = float(radiation_pressure_pa(1.0, self.engine.model.medium))
        per_slope2 = per_pa2 / (2.0 * math.sin(_STENCIL_RAD)) ** 2
        return np.ascontiguousarray(self._nodes_m), self._areas_m2, per_pa2, per_slope2

    def force_n(self, weights: ArrayLike, centre_m: ArrayLike) -> float:
        """Return the force, in newtons, of (N,) *weights* on the disc around (3,) *centre_m*.

        Raises
        ------
        ConfigurationError
            Weights of several drives, or a disc that touches an element or reaches behind the
            array.
        """
        nodes_m = as_coordinates("centre_m", centre_m) + self._nodes_m
        pressure = self.engine.pressure(weights, nodes_m)
        if pressure.ndim != 1:
            raise ConfigurationError(f"{len(pressure)} drives, the force is that of one")
        here, *around = pressure.reshape(5, -1)
        # dp/d(kx), rho c v_t but for a factor j; the sine makes it exact for a wave along the disc.
        slopes = np.subtract(around[:2], around[2:]) / (2.0 * math.sin(_STENCIL_RAD))
        along, across = radiation_pressure_pa(slopes, self.engine.model.medium)
        stress = radiation_pressure_pa(here, self.engine.model.medium) - along - across
        return float(stress @ self._areas_m2)


def _force_disc_axes(array: TransducerArray, normal: ArrayLike | None) -> FloatArray:
    """Return the (3, 3) axes of a disc, its normal last; without one, those of *array*."""
    if normal is None:
        return array.axes
    given = as_coordinates("normal", normal)
    length = float(np.linalg.norm(given))
    if length < _NO_LENGTH:
        raise ConfigurationError(f"normal is {given.tolist()}, must have a direction")
    return axes_about_normal(given / length, array.axes)


def force_disc_nodes(radius_m: float, wavenumber: float) -> tuple[FloatArray, FloatArray]:
    """Return nodes and weights that integrate an intensity over a disc around the origin, in z = 0.

    Gauss-Legendre in the squared radius, equal steps in the angle: both orders follow from the
    shortest period that |p|^2 can have, half a wavelength (5 x 14 nodes for 10 mm at 40 kHz).
    Every other ring is turned by half a step: the force of a focus is off by 1e-5 at most.

    Returns
    -------
    offsets_m : (M, 3) numpy.ndarray
        Nodes, in metres.
    areas_m2 : (M,) numpy.ndarray
        Their weights, which sum to the area.
    """
    reach = check_positive("wavenumber", wavenumber) * check_positive("radius_m", radius_m)
    rings, spokes = 1 + math.ceil(reach / 1.9), 2 + math.ceil(1.6 * reach)
    nodes, weights = np.polynomial.legendre.leggauss(rings)
    radii = radius_m * np.sqrt((nodes + 1.0) / 2.0)
    turned = np.arange(rings)[:, None] % 2 / 2.0
    angles = 2.0 * np.pi * (np.arange(spokes) + turned) / spokes
    x, y = (radii[:, None] * np.cos(angles)).ravel(), (radii[:, None] * np.sin(angles)).ravel()
    areas = np.repeat(weights / 2.0, spokes) * (np.pi * radius_m**2 / spokes)
    return np.stack([x, y, np.zeros_like(x)], axis=1), areas
