"""Pressure peaks of a focus, and the largest shift that rounding of the phases makes.

Diffraction pulls the peak of |p| towards the array, so a peak is compared with that of the ideal
drive, whose phases are not rounded.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from haptogram.acoustics import AcousticModel
from haptogram.acoustics.arrays import ComplexArray, FloatArray
from haptogram.acoustics.levels.shift import AT_TOP_M, PressureLevel, climb_to_pressure_peak
from haptogram.settings.frozen import dataclass

_STEPS: Final = 60
_LONGEST_STEP_RAD: Final = 0.7  # longest step: the main lobe reaches to about 2
_SETTLED_M: Final = 2e-5  # the Newton step after such a one is 0.1 µm at most
#: Error of the peak search: its last step, and rounding errors.
_SEARCH_M: Final = 5e-6
#: How far the ideal peak may be from the target of one focus: further away it is another one.
NEXT_TO_TARGET_RAD: Final = 0.5
#: The same of several foci, which pull at each other: within the main lobe, of about 2 rad.
WITHIN_LOBE_RAD: Final = 1.8
#: Share of the distance by which a focus may be off: further away it is another one, or none.
LOST: Final = 0.4
_ROUND: Final = 0.10  # largest displacement by rounding, in rad, that is in proportion to it
_FLAT: Final = 1.5  # factor on the first-order bound: a peak beyond it has no place of its own
_MARGIN: Final = 1.1  # factor for the second order of the response to rounding
#: Least metric of a focus, over k^2, along a direction in which the phases determine its place.
TURNED_RATIO: Final = 1e-6
#: All of these, in the order of the compiled loops.
PEAK_SETTINGS: Final[FloatArray] = np.array([
    AT_TOP_M, _LONGEST_STEP_RAD, _SETTLED_M, _STEPS, NEXT_TO_TARGET_RAD, LOST, _ROUND, _MARGIN,
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
    """Return (D,) how far at most, in m, phase errors move the pressure peak along each axis.

    The axes are those of *direction*. Each row of *errors_rad* (K, N) is added to and subtracted
    from *ideal* (N,), the drive without errors. Infinite where a row leaves no peak near *place_m*.
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
    there is none.

    Returns
    -------
    (D,) numpy.ndarray or None
        None: the ascent leads to the elements or behind them, or does not settle.
    """

    def step_of(here: PressureLevel) -> FloatArray:
        curvature = here.curvature if here.is_peak else -2.0 * direction.metric
        newton = np.linalg.solve(-curvature, here.gradient)
        length_rad = direction.length_rad(newton @ direction.axes)
        shortened = min(1.0, _LONGEST_STEP_RAD / max(length_rad, 1e-12))
        return np.asarray(shortened * newton, dtype=np.float64)

    return climb_to_pressure_peak(
        model, weights, start_m, direction.axes, step_of, settled_m=_SETTLED_M, most_steps=_STEPS
    )


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
    here = PressureLevel.at(model, weights, place_m, direction.axes)
    if here is None or not here.is_peak:
        return None
    shares, slopes = here.waves / here.pressure, here.slopes / here.pressure
    mixed = -2.0 * (slopes - shares * slopes.sum(axis=1)[:, None]).imag
    return np.linalg.solve(-here.curvature, mixed)
