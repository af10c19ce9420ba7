"""Levels, and the force that the sound exerts.

Radiation pressure is quadratic in the pressure; it is stated for a plane wave that falls on the
surface along its normal. The force on a disc is the time-averaged stress on a rigid wall.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from haptogram.acoustics.arrays import ComplexArray, FloatArray, as_complex_array, as_coordinates
from haptogram.acoustics.field.engines.numba_engine import NumbaEngine
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
_STENCIL_RAD: Final = 1e-3  # half the span of a difference, as a phase
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
    return reflection * mean_square / (medium.impedance * medium.sound_speed_m_s)


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
        self._axes = _force_disc_axes(engine.model.array, normal)
        nodes_m, self._areas_m2 = force_disc_nodes(radius_m, engine.model.wavenumber)
        across = np.eye(3)[:2]
        stencil_m = np.concatenate([np.zeros((1, 3)), across, -across])
        stencil_m *= _STENCIL_RAD / engine.model.wavenumber
        self._stencils_m = (stencil_m[:, None] + nodes_m).reshape(-1, 3) @ self._axes
        self._nodes_m = self._stencils_m[: len(nodes_m)]
        if isinstance(engine, NumbaEngine):
            #: Of the compiled loop, besides drive and centre.
            self.kernel_arguments = engine.disc_arguments(self._axes, nodes_m, self._areas_m2)

    @property
    def force_per_stress(self) -> float:
        """Newtons per Pa^2 m^2 of |p|^2 less |rho c v|^2."""
        return float(radiation_pressure_pa(1.0, self.engine.model.medium))

    def force_n(self, weights: ArrayLike, centre_m: ArrayLike) -> float:
        """Return the force, in newtons, of (N,) *weights* on the disc around (3,) *centre_m*.

        Raises
        ------
        ConfigurationError
            Weights of several drives, or a disc that touches an element or reaches behind the
            array.
        """
        centre, engine = as_coordinates("centre_m", centre_m), self.engine
        stress = None
        if isinstance(engine, NumbaEngine):
            points_m = centre + self._nodes_m
            stress = engine.disc_stress(weights, centre, points_m, self.kernel_arguments)
        if stress is None:
            stress = self._stress(engine.pressure(weights, centre + self._stencils_m))
        return self.force_per_stress * stress

    def _stress(self, pressure: ComplexArray) -> float:
        """Return the integral of |p|^2 less |rho c v|^2 along the disc, in Pa^2 m^2.

        *pressure* (5 K,): at the K points of the disc, then at their neighbours on four sides.
        Several drives are refused.
        """
        if pressure.ndim != 1:
            raise ConfigurationError(f"{len(pressure)} drives, the force is that of one")
        here, *around = pressure.reshape(5, -1)
        # dp/d(kx), rho c v but for a factor j; the sine makes it exact for a wave along the disc.
        slopes = np.subtract(around[:2], around[2:]) / (2.0 * math.sin(_STENCIL_RAD))
        squares = np.abs(here) ** 2 - (np.abs(slopes) ** 2).sum(axis=0)
        return float(squares @ self._areas_m2)


def _force_disc_axes(array: TransducerArray, normal: ArrayLike | None) -> FloatArray:
    """Return the (3, 3) axes of a disc, its normal last; the array's own axes without a normal."""
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
    # G. H. Golub and J. H. Welsch, Math. Comput. 23, 1969; numpy.polynomial takes 10 ms to import.
    degrees = np.arange(1, rings)
    nodes, vectors = np.linalg.eigh(np.diag(degrees / np.sqrt(4.0 * degrees**2 - 1.0), -1))
    radii = radius_m * np.sqrt((nodes + 1.0) / 2.0)
    turned = np.arange(rings)[:, None] % 2 / 2.0
    angles = 2.0 * np.pi * (np.arange(spokes) + turned) / spokes
    x, y = (radii[:, None] * np.cos(angles)).ravel(), (radii[:, None] * np.sin(angles)).ravel()
    areas = np.repeat(vectors[0] ** 2, spokes) * (np.pi * radius_m**2 / spokes)
    return np.stack([x, y, np.zeros_like(x)], axis=1), areas
