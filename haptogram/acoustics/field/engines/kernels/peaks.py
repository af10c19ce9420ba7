"""The pressure peak next to a point, across or along the beam, and what rounding does to it.

The arithmetic of :mod:`haptogram.verification.frame.peaks` for parallel pistons. Offsets, levels
and curvatures are those along one or two *axes* (2, 3); where there is one (not *both*), the second
coordinate stays 0. *metric* is (00, 01, 11).
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics.field.engines.kernels.jit import jit_checked, jit_sums
from haptogram.acoustics.field.engines.kernels.pistons import (
    arrivals_at_kernel,
    height_kernel,
    pressure_at_kernel,
)

F8 = NDArray[np.float64]

_LEAST_HEIGHT_M: Final = 2e-3  # above an element's face: further from all of them than is refused
_LEAST_CURVED: Final = 1e-9
_HALVINGS: Final = 10


@jit_checked
def _levels_kernel(
    places: F8, start: F8, axes: F8, a: float, b: float, step: float, both: bool, medium: F8,
    level: F8,
) -> bool:  # fmt: skip
    """Compute ln |p|^2 on a stencil: centre, axis neighbours and four corners."""
    for i in range(9 if both else 3):
        u = a + step * ((i == 1) - (i == 2) + (i == 5) - (i == 6) + (i == 7) - (i == 8))
        v = b + step * ((i == 3) - (i == 4) + (i == 5) - (i == 6) - (i == 7) + (i == 8))
        x = start[0] + u * axes[0, 0] + v * axes[1, 0]
        y = start[1] + u * axes[0, 1] + v * axes[1, 1]
        z = start[2] + u * axes[0, 2] + v * axes[1, 2]
        if not height_kernel(x, y, z, medium) > _LEAST_HEIGHT_M:
            return False
        re, im = pressure_at_kernel(places, x, y, z, medium)
        square = re * re + im * im
        if not square > 0.0:
            return False
        level[i] = math.log(square)
    return True


@jit_checked
def _derivatives_kernel(
    level: F8, step: float, both: bool
) -> tuple[float, float, float, float, float, bool]:
    """Return gradient and Hessian (00, 01, 11), and whether that is the Hessian of a peak."""
    scale = 1.0 / (step * step)
    g0, h00 = (level[1] - level[2]) / (2.0 * step), (level[1] - 2.0 * level[0] + level[2]) * scale
    if not both:
        return g0, 0.0, h00, 0.0, h00, h00 < 0.0
    g1, h11 = (level[3] - level[4]) / (2.0 * step), (level[3] - 2.0 * level[0] + level[4]) * scale
    h01 = (level[5] + level[6] - level[7] - level[8]) * 0.25 * scale
    middle, apart = 0.5 * (h00 + h11), math.hypot(0.5 * (h00 - h11), h01)
    is_peak = middle + apart < _LEAST_CURVED * (middle - apart) and middle + apart < 0.0
    return g0, g1, h00, h01, h11, is_peak


@jit_checked
def length_kernel(a: float, b: float, metric: F8) -> float:
    """Return the length of an offset, in radians of phase."""
    square = a * a * metric[0] + 2.0 * a * b * metric[1] + b * b * metric[2]
    return math.sqrt(max(square, 0.0))


@jit_checked
def climb_kernel(
    places: F8, start: F8, axes: F8, metric: F8, both: bool, medium: F8, settings: F8, offset: F8,
) -> bool:  # fmt: skip
    """Set *offset* (2,) to the peak next to *start*; return whether there is one.

    *settings*: half-width of the stencil, longest step in radians, the step that settles, in
    metres, and the number of steps.
    """
    step, longest, settled = settings[0], settings[1], settings[2]
    level, there = np.empty(9), np.empty(9)
    a, b = 0.0, 0.0
    if not _levels_kernel(places, start, axes, a, b, step, both, medium, level):
        return False
    for _ in range(int(settings[3])):
        g0, g1, h00, h01, h11, is_peak = _derivatives_kernel(level, step, both)
        if not is_peak:
            h00, h01, h11 = -2.0 * metric[0], -2.0 * metric[1], -2.0 * metric[2]
        determinant = h00 * h11 - h01 * h01
        da, db = (h01 * g1 - h11 * g0) / determinant, (h01 * g0 - h00 * g1) / determinant
        share = min(1.0, longest / max(length_kernel(da, db, metric), 1e-12))
        da, db = share * da, share * db
        size = math.hypot(da, db)
        if size < settled:
            offset[0], offset[1] = a + da, b + db
            return True
        share, is_higher = 1.0, False
        for _ in range(_HALVINGS):
            u, v = a + share * da, b + share * db
            if not _levels_kernel(places, start, axes, u, v, step, both, medium, there):
                return False
            is_higher = there[0] > level[0]
            if is_higher:
                break
            share *= 0.5
        if not is_higher:
            offset[0], offset[1] = a, b
            return bool(size < step)
        a, b = u, v
        level, there = there, level
    return False


@jit_sums
def _response_kernel(
    sides: F8, p: F8, h00: float, h01: float, h11: float, step: float, both: bool
) -> tuple[float, float]:
    """Return the sensitivity of the peak position to phase errors, summed over elements.

    *sides* (4, 6, N): waves next to the peak along the axes; *p* (4, 2): their sums.
    """
    determinant = h00 * h11 - h01 * h01
    scale, first, second, squares = 1.0 / step, 0.0, 0.0, np.empty(4)
    for i in range(4):
        squares[i] = p[i, 0] * p[i, 0] + p[i, 1] * p[i, 1]
    for n in range(sides.shape[2]):
        plus = (sides[0, 1, n] * p[0, 0] - sides[0, 0, n] * p[0, 1]) / squares[0]
        minus = (sides[1, 1, n] * p[1, 0] - sides[1, 0, n] * p[1, 1]) / squares[1]
        m0, m1 = (minus - plus) * scale, 0.0
        if both:
            plus = (sides[2, 1, n] * p[2, 0] - sides[2, 0, n] * p[2, 1]) / squares[2]
            minus = (sides[3, 1, n] * p[3, 0] - sides[3, 0, n] * p[3, 1]) / squares[3]
            m1 = (minus - plus) * scale
        first += abs((h11 * m0 - h01 * m1) / determinant)
        second += abs((h00 * m1 - h01 * m0) / determinant)
    return first, second


@jit_checked
def expected_peak_kernel(
    places: F8, start: F8, axes: F8, metric: F8, both: bool, medium: F8, settings: F8,
    phase_limit: float, sides: F8, place: F8, rounding: F8,
) -> bool:  # fmt: skip
    """Set *place* (3,) of the peak and how far *rounding* (2,) of the phases moves it.

    That is the first order alone; return whether there is a peak of which it tells enough.
    *settings*: those of :func:`climb_kernel`, then how far the peak may be in radians, how far in
    metres, and how far rounding may move it in radians.
    """
    offset, level, p = np.zeros(2), np.empty(9), np.ones((4, 2))
    if not climb_kernel(places, start, axes, metric, both, medium, settings, offset):
        return False
    if length_kernel(offset[0], offset[1], metric) > settings[4]:
        return False
    if math.hypot(offset[0], offset[1]) > settings[5]:
        return False
    for i in range(3):
        place[i] = start[i] + offset[0] * axes[0, i] + offset[1] * axes[1, i]
    step = settings[0]
    if not _levels_kernel(places, place, axes, 0.0, 0.0, step, both, medium, level):
        return False
    _, _, h00, h01, h11, is_peak = _derivatives_kernel(level, step, both)
    if not is_peak:
        return False
    for i in range(4 if both else 2):
        way, axis = step if i % 2 == 0 else -step, axes[i // 2]
        x, y, z = place[0] + way * axis[0], place[1] + way * axis[1], place[2] + way * axis[2]
        p[i, 0], p[i, 1], _ = arrivals_at_kernel(places, x, y, z, medium, sides[i])
    first, second = _response_kernel(sides, p, h00, h01, h11, step, both)
    rounding[0], rounding[1] = first * phase_limit, second * phase_limit
    return bool(length_kernel(rounding[0], rounding[1], metric) <= settings[6])
