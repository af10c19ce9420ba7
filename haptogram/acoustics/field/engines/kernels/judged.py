"""The criteria of frames that shall focus on one point, and whose arrays are parallel pistons.

The arithmetic of :mod:`haptogram.verification.frame` for drives of full amplitude, frame by frame.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics.field.engines.kernels.jit import jit_checked, jit_checked_entry, jit_sums
from haptogram.acoustics.field.engines.kernels.peaks import peak_apart_kernel
from haptogram.acoustics.field.engines.kernels.pistons import (
    arrivals_kernel,
    inverse_symmetric_kernel,
    mean_outer_kernel,
    nearest_kernel,
    response_sums_kernel,
)

F8 = NDArray[np.float64]

#: Numbers that :func:`judged_frames_kernel` finds of each frame.
BOUND, SCATTER, DRIFT, PHASE, COHERENCE, LOUDNESS, PEAK, ACROSS, ALONG = 0, 3, 4, 5, 6, 7, 8, 9, 10
MEASURES: Final = 11
#: Answers: all criteria hold, or what the caller has to find out.
HOLD, UNOBSERVED, PEAKLESS, FAILED = 0, 1, 2, 3


@jit_sums
def _turns_to_target_kernel(
    places: F8, target: F8, per_wavelength: float, common: float, turns: F8
) -> float:
    """Set *turns* (N,), ideal phases for a focus at *target*; return half the errors' range (rad).

    An error is a phase in the fourth row of *places*, in turns, less the ideal one and *common*,
    the phase of the arrivals. *per_wavelength*: 1 / wavelength, in 1/m.
    """
    px, py, pz, codes = places[0], places[1], places[2], places[3]
    for n in range(px.size):
        dx, dy, dz = target[0] - px[n], target[1] - py[n], target[2] - pz[n]
        turns[n] = -per_wavelength * np.sqrt(dx * dx + dy * dy + dz * dz)
    low, high = 1.0, -1.0
    for n in range(px.size):
        error = codes[n] - turns[n] - common
        error -= np.rint(error)
        low, high = error if error < low else low, error if error > high else high
    return math.pi * (high - low)


@jit_checked
def _metric_kernel(covariance: F8, wavenumber: float, first: F8, second: F8, metric: F8) -> None:
    """Set *metric* (00, 01, 11): variance of phase (rad^2) per moves squared (m^2) along two axes.

    It is k^2 A C A^T: C the *covariance* (6,) of unit vectors from the elements, as xx, xy, xz, yy,
    yz, zz; A the axes *first* and *second*.
    """
    a, b, c = covariance[0], covariance[1], covariance[2]
    d, e, f = covariance[3], covariance[4], covariance[5]
    for i in range(3):
        one, other = second if i == 2 else first, second if i > 0 else first
        x = a * one[0] + b * one[1] + c * one[2]
        y = b * one[0] + d * one[1] + e * one[2]
        z = c * one[0] + e * one[1] + f * one[2]
        metric[i] = wavenumber**2 * (x * other[0] + y * other[1] + z * other[2])


@jit_checked
def _bound_kernel(
    places: F8, target: F8, matrix: F8, wavenumber: float, limit: float, distance_m: float,
    observed: F8, found: F8,
) -> bool:  # fmt: skip
    """Set in *found* a focus's bounds, scatter and drift (m); return False if it is not observable.

    Bounds are for phase errors up to *limit* (rad). *observed* (4,): what the share of *matrix*
    must exceed; the share of *distance_m* from which on a bound is multiplied by the third number;
    the share of it that no bound may reach.
    """
    inverse, sums = np.empty(6), np.empty(7)
    if not inverse_symmetric_kernel(matrix, inverse) > observed[0]:
        return False
    per_radian = 1.0 / (wavenumber * places.shape[1])
    response_sums_kernel(places, target, matrix[6:], inverse, sums)
    for i in range(3):
        bound = sums[i] * per_radian * limit
        bound *= observed[2] if bound > observed[1] * distance_m else 1.0
        if not bound < observed[3] * distance_m:
            return False
        found[BOUND + i] = bound
    found[SCATTER] = math.sqrt(sums[3]) * per_radian
    found[DRIFT] = math.sqrt(sums[4] ** 2 + sums[5] ** 2 + sums[6] ** 2) * per_radian
    return True


@jit_checked
def _is_in_place_kernel(offset: F8, axis: F8, found: F8) -> bool:
    """Set in *found* the miss (m) across and along *axis*, the beam; return True if within bounds.

    *offset* (3,): the focus less its target as x, y, z, each compared with its bound in *found*.
    """
    along = offset[0] * axis[0] + offset[1] * axis[1] + offset[2] * axis[2]
    square, inside = 0.0, True
    for i in range(3):
        square += (offset[i] - along * axis[i]) ** 2
        inside = inside and abs(offset[i]) <= found[BOUND + i]
    found[ACROSS], found[ALONG] = math.sqrt(square), along
    return inside


@jit_checked_entry
def judged_frames_kernel(
    codes: NDArray[np.uint8], turn: float, targets: F8, axes: F8, distances: F8, offsets: F8,
    limits: F8, coherences: F8, latched: F8, medium: F8, observed: F8, settings: F8, found: F8,
    answers: NDArray[np.int64],
) -> None:  # fmt: skip
    """Judge frames of phase *codes* (F, N), of a *turn* each, whose foci somebody found.

    *axes* (F, 4, 3): two directions across the beam, that along it, and zeros; *distances* (F,) of
    the targets from the centre, *offsets* (F, 3) of the foci from them; *limits*, *coherences*
    (F,): the largest phase error and the least coherence. *latched* (4, N) and *settings* are
    overwritten. Sets *found* (F, MEASURES) and *answers* (F,).
    """
    count, ideal = latched.shape[1], latched.copy()
    matrix, metrics = np.empty(9), np.empty((2, 3))
    wavenumber, lost_share = 2.0 * math.pi * medium[0], settings[5]
    for f in range(len(codes)):
        target, measures, limit = targets[f], found[f], limits[f]
        for n in range(count):
            latched[3, n] = codes[f, n] * turn
        common, size, loud = arrivals_kernel(latched, target, medium)
        measures[PHASE] = _turns_to_target_kernel(latched, target, medium[0], common, ideal[3])
        measures[COHERENCE], measures[LOUDNESS] = size / loud, loud
        middle = (axes[f, 2, 0], axes[f, 2, 1], axes[f, 2, 2])
        mean_outer_kernel(latched, target, False, medium, middle, matrix)
        distance_m = max(distances[f], nearest_kernel(latched, target))
        answers[f] = UNOBSERVED
        if not _bound_kernel(
            latched, target, matrix, wavenumber, limit, distance_m, observed, measures
        ):
            continue
        mean_outer_kernel(latched, target, True, medium, middle, matrix)
        _metric_kernel(matrix, wavenumber, axes[f, 0], axes[f, 1], metrics[0])
        _metric_kernel(matrix, wavenumber, axes[f, 2], axes[f, 3], metrics[1])
        metrics[1, 2] = metrics[1, 0]  # that nothing is divided by 0
        m00, m01, m11 = metrics[0, 0], metrics[0, 1], metrics[0, 2]
        least = 0.5 * (m00 + m11) - math.hypot(0.5 * (m00 - m11), m01)
        answers[f] = PEAKLESS
        if not min(least, metrics[1, 0]) > settings[9] * wavenumber**2:
            continue
        settings[5] = lost_share * distances[f]
        across, along = 0.0, 0.0
        for i in range(2):
            across, along = along, peak_apart_kernel(
                latched, ideal, target, axes[f, 2 * i :], metrics[i], i == 0, medium, settings,
                limit,
            )  # fmt: skip
        measures[PEAK] = max(across, along)
        if min(across, along) == -1.0:
            continue
        holds = measures[PHASE] <= limit and measures[COHERENCE] >= coherences[f]
        holds = _is_in_place_kernel(offsets[f], axes[f, 2], measures) and holds
        answers[f] = HOLD if holds and min(across, along) >= 0.0 else FAILED
