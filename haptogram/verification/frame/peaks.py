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

_STENCIL_M: Final = 2e-4
_STEPS: Final = 60
_HALVINGS: Final = 10
_LONGEST_STEP_RAD: Final = 0.7  # longest step: the main lobe reaches to about 2
_SETTLED_M: Final = 2e-6
#: Error of the peak search: its last step, and the error of the differences.
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
    _STENCIL_M, _LONGEST_STEP_RAD, _SETTLED_M, _STEPS, NEXT_TO_TARGET_RAD, LOST, _ROUND, _MARGIN,
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

    Newton steps on ln |p|^2 with derivatives from a stencil; its curvature is replaced by that of
    an ideal focus, -2 k^2 C, where the field is not convex.  A step that does not climb is halved.

    Returns
    -------
    (D,) numpy.ndarray or None
        None: the ascent leads to the elements or behind them, or does not settle.
    """
    axes = direction.axes
    stencil = _frame_peak_stencil(len(axes))
    offset, level = np.zeros(len(axes)), _frame_peak_level(model, weights, start_m + stencil @ axes)
    for _ in range(_STEPS):
        if level is None:
            return None
        gradient, curvature = _frame_peak_derivatives(level, len(axes))
        if not _is_frame_peak(curvature):
            curvature = -2.0 * direction.metric
        newton = np.linalg.solve(-curvature, gradient)
        length_rad = direction.length_rad(newton @ axes)
        shortened = min(1.0, _LONGEST_STEP_RAD / max(length_rad, 1e-12))
        step = np.asarray(shortened * newton, dtype=np.float64)
        if float(np.linalg.norm(step)) < _SETTLED_M:
            return offset + step
        for halving in range(_HALVINGS):
            higher = offset + 0.5**halving * step
            there = _frame_peak_level(model, weights, start_m + (higher + stencil) @ axes)
            if there is not None and there[0] > level[0]:
                break
        else:  # at the top, as far as differences over the stencil can tell
            return offset if float(np.linalg.norm(step)) < _STENCIL_M else None
        offset, level = higher, there
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
    axes = direction.axes
    count = len(axes)
    arrivals = _frame_peak_arrivals(model, place_m + _frame_peak_stencil(count) @ axes)
    if arrivals is None:
        return None
    parts = arrivals * weights
    pressure = parts.sum(axis=1)
    if not np.abs(pressure).min() > 0.0:
        return None
    _, curvature = _frame_peak_derivatives(2.0 * np.log(np.abs(pressure)), count)
    if not _is_frame_peak(curvature):
        return None
    slopes = -2.0 * (parts / pressure[:, None]).imag
    mixed = (slopes[1 : 1 + 2 * count : 2] - slopes[2 : 2 + 2 * count : 2]) / (2.0 * _STENCIL_M)
    response: FloatArray = np.linalg.solve(-curvature, mixed)
    return response


def _frame_peak_level(
    model: AcousticModel, weights: ComplexArray, points: FloatArray
) -> FloatArray | None:
    """Return ln |p|^2 at points (M, 3); None at an element, behind the array or without sound."""
    arrivals = _frame_peak_arrivals(model, points)
    if arrivals is None:
        return None
    pressure = np.abs(arrivals @ weights)
    return 2.0 * np.log(pressure) if pressure.min() > 0.0 else None


def _frame_peak_arrivals(model: AcousticModel, points: FloatArray) -> ComplexArray | None:
    """Return the propagators (M, N); None where a point has no field."""
    try:
        return propagators(model, points)
    except ConfigurationError:  # within 1 mm of an element, or behind the array
        return None


def _is_frame_peak(curvature: FloatArray) -> bool:
    """Return True if a Hessian (D, D) is that of a peak, in every direction."""
    values = np.linalg.eigvalsh(curvature)
    return bool(values[-1] < _LEAST_CURVED * values[0] < 0.0)


def _frame_peak_stencil(count: int) -> FloatArray:
    """Return the centre, the neighbours along each axis, and four corners for each two axes."""
    eye = np.eye(count)
    steps = [np.zeros(count)]
    for axis in eye:
        steps += [axis, -axis]
    for i in range(count):
        for j in range(i):
            steps += [eye[i] + eye[j], -eye[i] - eye[j], eye[i] - eye[j], eye[j] - eye[i]]
    return _STENCIL_M * np.array(steps)


def _frame_peak_derivatives(level: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
    """Return gradient (D,) and Hessian (D, D) from the values at the stencil."""
    plus, minus = level[1 : 1 + 2 * count : 2], level[2 : 2 + 2 * count : 2]
    gradient = (plus - minus) / (2.0 * _STENCIL_M)
    curvature = np.diag((plus - 2.0 * level[0] + minus) / _STENCIL_M**2)
    corners = iter(level[1 + 2 * count :].reshape(-1, 4))
    for i in range(count):
        for j in range(i):
            a, b, c, d = next(corners)
            curvature[i, j] = curvature[j, i] = (a + b - c - d) / (4.0 * _STENCIL_M**2)
    return gradient, curvature
