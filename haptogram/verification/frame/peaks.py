"""Pressure peaks of a focus, and the largest shift that rounding of the phases makes.

Diffraction pulls the peak of |p| towards the array, so a peak is compared with that of the ideal
drive, whose phases are not rounded.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from haptogram.acoustics import AcousticModel, propagators
from haptogram.acoustics.arrays import ComplexArray, FloatArray
from haptogram.errors import ConfigurationError

_STENCIL_M: Final = 1e-5  # of the differences of magnitudes, whose waves are taken out
_AT_TOP_M: Final = 2e-4  # a step so short leads no higher where rounding errors are larger
_STEPS: Final = 60
_HALVINGS: Final = 10
_LONGEST_STEP_RAD: Final = 0.7  # longest step: the main lobe reaches to about 2
_SETTLED_M: Final = 2e-6
#: Error of the peak search: its last step, and rounding errors.
_SEARCH_M: Final = 5e-6
#: How far the ideal peak may be from the target of one focus: further away it is another one.
NEXT_TO_TARGET_RAD: Final = 0.5
#: The same of several foci, which pull at each other: within the main lobe, of about 2 rad.
WITHIN_LOBE_RAD: Final = 1.8
#: Share of the distance by which a focus may be off: further away it is another one, or none.
LOST: Final = 0.4
_ROUND: Final = 0.10  # rad: a peak that rounding moves further may do so out of proportion
_FLAT: Final = 1.5  # times the bound of the first order: such a peak has no place of its own
_LEAST_CURVED: Final = 1e-9  # least curvature, relative to the largest
_MARGIN: Final = 1.1  # factor for the second order of the response to rounding
#: Least metric of a focus, over k^2, along a direction in which the phases determine its place.
TURNED_RATIO: Final = 1e-6
#: All of these, in the order of the compiled loops.
PEAK_SETTINGS: Final[FloatArray] = np.array([
    _AT_TOP_M, _LONGEST_STEP_RAD, _SETTLED_M, _STEPS, NEXT_TO_TARGET_RAD, LOST, _ROUND, _MARGIN,
    _SEARCH_M, TURNED_RATIO,
])  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class FramePeakAxes:
    """Space in which a peak is searched: a line, a plane, or all directions.

    Attributes
    ----------
    axes : (D, 3) numpy.ndarray
        Orthonormal.
    metric : (D, D) numpy.ndarray
        k^2 C restricted to them; C is the covariance of the unit vectors from the elements,
        weighted by the amplitudes that arrive.  A displacement e has the length
        sqrt(e^T k^2 C e), in radians of phase.
    """

    axes: FloatArray
    metric: FloatArray

    def length_rad(self, offset_m: FloatArray) -> float:
        """Return the length of an offset (3,), in radians of phase."""
        local = self.axes @ offset_m
        return math.sqrt(max(float(local @ self.metric @ local), 0.0))


@dataclass(frozen=True, slots=True, eq=False)
class ExpectedPeak:
    """The pressure peak of the ideal drive next to a target.

    Attributes
    ----------
    direction : FramePeakAxes
        Where it was looked for.
    place_m : (3,) numpy.ndarray
        The peak.
    response : (D, N) numpy.ndarray
        Displacement of the peak per radian of phase of each element, in m/rad, to first order.
    rounding_m : (D,) numpy.ndarray
        Largest displacement that rounding of the phases can make.
    """

    direction: FramePeakAxes
    place_m: FloatArray
    response: FloatArray
    rounding_m: FloatArray

    def offset_m(self, model: AcousticModel, weights: ComplexArray) -> FloatArray | None:
        """Return (D,) the offset of the peak of *weights* from this one; None: there is none."""
        return find_frame_peak(model, weights, self.place_m, self.direction)


def expected_frame_peak(
    model: AcousticModel,
    ideal: ComplexArray,
    target_m: FloatArray,
    direction: FramePeakAxes,
    phase_limit_rad: float,
    reach_rad: float = NEXT_TO_TARGET_RAD,
) -> ExpectedPeak | None:
    """Return the peak of the *ideal* drive (N,) within *reach_rad* of a target, if it has a place.

    The largest displacement by phase errors of at most *phase_limit_rad* is that of the first
    order, sum_n |R_dn| times the limit; where that is large, the worst drives are tried.

    Returns
    -------
    ExpectedPeak or None
        None: there is no peak next to the target, or one so flat that rounding of the phases
        moves it out of all proportion.
    """
    offset_m = find_frame_peak(model, ideal, target_m, direction)
    if offset_m is None or direction.length_rad(offset_m @ direction.axes) > reach_rad:
        return None
    place_m = target_m + offset_m @ direction.axes
    distance_m = float(np.linalg.norm(target_m - model.array.centre_m))
    if float(np.linalg.norm(offset_m)) > LOST * distance_m:
        return None
    response = frame_peak_response(model, ideal, place_m, direction)
    if response is None:
        return None
    rounding_m = np.abs(response).sum(axis=1) * phase_limit_rad
    if direction.length_rad(rounding_m @ direction.axes) > _ROUND:
        worst = phase_limit_rad * np.sign(response)
        worst_m = _worst_peak_displacement_m(model, ideal, place_m, direction, worst)
        if not (worst_m <= _FLAT * rounding_m + _SEARCH_M).all():
            return None
        rounding_m = np.maximum(rounding_m, worst_m)
    if direction.length_rad(rounding_m @ direction.axes) > reach_rad:
        return None
    return ExpectedPeak(direction, place_m, response, _MARGIN * rounding_m + _SEARCH_M)


def _worst_peak_displacement_m(
    model: AcousticModel,
    ideal: ComplexArray,
    place_m: FloatArray,
    direction: FramePeakAxes,
    errors_rad: FloatArray,
) -> FloatArray:
    """Return (D,) the largest displacements of the peak by phase errors (K, N) and their negative.

    Infinite where one of them leaves no peak.
    """
    worst = np.zeros(len(direction.axes))
    for errors in (*errors_rad, *-errors_rad):
        offset = find_frame_peak(model, ideal * np.exp(1j * errors), place_m, direction)
        worst = np.maximum(worst, np.inf if offset is None else np.abs(offset))
    return worst


def find_frame_peak(
    model: AcousticModel,
    weights: ComplexArray,
    start_m: FloatArray,
    direction: FramePeakAxes,
) -> FloatArray | None:
    """Return (D,) the offset of the pressure peak next to *start_m* along the axes of *direction*.

    Newton steps on ln |p|^2; its curvature is replaced by that of an ideal focus, -2 k^2 C, where
    there is none.  A step that does not climb is halved.

    Returns
    -------
    (D,) numpy.ndarray or None
        None: the ascent leads to the elements or behind them, or does not settle.
    """
    axes = direction.axes
    offset, here = np.zeros(len(axes)), _FramePeakLevel.at(model, weights, start_m, axes)
    for _ in range(_STEPS):
        if here is None:
            return None
        curvature = here.curvature if here.is_peak else -2.0 * direction.metric
        newton = np.linalg.solve(-curvature, here.gradient)
        length_rad = direction.length_rad(newton @ axes)
        shortened = min(1.0, _LONGEST_STEP_RAD / max(length_rad, 1e-12))
        step = np.asarray(shortened * newton, dtype=np.float64)
        if float(np.linalg.norm(step)) < _SETTLED_M:
            return offset + step
        for halving in range(_HALVINGS):
            higher = offset + 0.5**halving * step
            there = _FramePeakLevel.at(model, weights, start_m + higher @ axes, axes)
            if there is not None and there.level > here.level:
                break
        else:  # at the top, as far as rounding errors can tell
            return offset if float(np.linalg.norm(step)) < _AT_TOP_M else None
        offset, here = higher, there
    return None


def frame_peak_response(
    model: AcousticModel,
    weights: ComplexArray,
    place_m: FloatArray,
    direction: FramePeakAxes,
) -> FloatArray | None:
    """Return (D, N) how far each radian of phase of an element moves a peak, in m/rad.

    At a peak of L = ln |p|^2, p = sum_n q_n, phases change by d phi and the peak moves by
    -(d2L/dx2)^-1 d2L/(dx dphi_n), with dL/dphi_n = -2 Im(q_n / p).

    Returns
    -------
    (D, N) numpy.ndarray or None
        None: *place_m* is no peak.
    """
    here = _FramePeakLevel.at(model, weights, place_m, direction.axes)
    if here is None or not here.is_peak:
        return None
    shares, slopes = here.waves / here.pressure, here.slopes / here.pressure
    mixed = -2.0 * (slopes - shares * slopes.sum(axis=1)[:, None]).imag
    response: FloatArray = np.linalg.solve(-here.curvature, mixed)
    return response


@dataclass(frozen=True, slots=True, eq=False)
class _FramePeakLevel:
    """L = ln |p|^2 and its derivatives along D axes; the waves (N,) and slopes (D, N) of p."""

    pressure: complex
    waves: ComplexArray
    slopes: ComplexArray
    gradient: FloatArray
    curvature: FloatArray

    @classmethod
    def at(
        cls, model: AcousticModel, weights: ComplexArray, place_m: FloatArray, axes: FloatArray
    ) -> _FramePeakLevel | None:
        """Return those at a place; None at an element, behind the array or without sound.

        With a wave q = m e^{jkr}, the magnitude m is differentiated numerically, and its second
        derivative is that of 1 / r.
        """
        places_m = place_m + _STENCIL_M * np.concatenate([0.0 * axes[:1], axes, -axes])
        arrivals = _frame_peak_arrivals(model, places_m)
        if arrivals is None:
            return None
        count, k, waves = len(axes), model.wavenumber, arrivals * weights
        rays_m = places_m[:, None, :] - model.array.positions_m
        distance = np.sqrt(np.einsum("mni,mni->mn", rays_m, rays_m))
        here, r = waves[0], distance[0]
        pressure = complex(here.sum())
        if not abs(pressure) > 0.0:
            return None
        still = waves[1:] * np.exp(-1j * k * (distance[1:] - r))
        fading = (still[:count] - still[count:]) / (2.0 * _STENCIL_M)
        cosines = axes @ (rays_m[0] / r[:, None]).T
        turning = 1j * k * cosines
        slopes = fading + turning * here
        both = cosines[:, None] * cosines
        apart = np.eye(count)[:, :, None]
        bends = turning[:, None] * slopes + fading[:, None] * turning
        bends += here * (1j * k / r * (apart - both) + (3.0 * both - apart) / r**2)
        first = slopes.sum(axis=1) / pressure
        second = bends.sum(axis=2) / pressure - np.outer(first, first)
        return cls(pressure, here, slopes, 2.0 * first.real, 2.0 * second.real)

    @property
    def level(self) -> float:
        """|p|, which grows with L."""
        return abs(self.pressure)

    @property
    def is_peak(self) -> bool:
        """True if the curvature is that of a peak, in every direction."""
        values = np.linalg.eigvalsh(self.curvature)
        return bool(values[-1] < _LEAST_CURVED * values[0] < 0.0)


def _frame_peak_arrivals(model: AcousticModel, points: FloatArray) -> ComplexArray | None:
    """Return the propagators (M, N); None where a point has no field."""
    try:
        return propagators(model, points)
    except ConfigurationError:  # within 1 mm of an element, or behind the array
        return None
