"""From phase codes back to the focus."""

from __future__ import annotations

import math
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics.field.engines.kernels.blocks import F4, F8
from haptogram.acoustics.field.engines.kernels.jit import jit_entry, jit_inline, jit_sums
from haptogram.acoustics.field.engines.kernels.waves import (
    ONE,
    ZERO,
    cos_sin_kernel,
    flip_sign_kernel,
)

_BESIDE: Final = np.float32(1e-3)  # wavelengths

Fitted: TypeAlias = tuple[tuple[float, float, float], float, float, int, bool, float]


@jit_inline
def _place_kernel(target: Any, frame: Any) -> Any:
    """Return x, y, z of *target* (m) in wavelengths; *frame* (4, 3): axes, then origin (m)."""
    u, v, w = target[0] - frame[3, 0], target[1] - frame[3, 1], target[2] - frame[3, 2]
    return (
        np.float32(frame[0, 0] * u + frame[0, 1] * v + frame[0, 2] * w),
        np.float32(frame[1, 0] * u + frame[1, 1] * v + frame[1, 2] * w),
        np.float32(frame[2, 0] * u + frame[2, 1] * v + frame[2, 2] * w),
    )


@jit_entry
def fit_phases_kernel(
    codes: NDArray[np.uint8], order: NDArray[np.int64], places: F4, lags: F4, frame: F8,
    start: tuple[float, float, float], code_steps: int, count: int, max_steps: int,
) -> Fitted:  # fmt: skip
    """Fit a focus to the codes of the first *count* elements of *order*.

    Positions *places* (3, N) and *lags* (N,), in turns, are in that order.

    Return position (m), common phase and RMS residual (rad), steps taken, whether converged,
    distance from the nearest of the elements (m): a tuple costs a third of an array filled here and
    read there.
    """
    phases = np.empty(count, np.float32)
    scale = np.float32(1.0) / np.float32(code_steps)
    for n in range(count):
        phases[n] = np.float32(codes[order[n]]) * scale + lags[n]
    sums, step = np.empty(14), np.empty(3)
    x, y, z = _place_kernel(start, frame)
    if min(x * x + y * y + z * z, _least_square_kernel(places, x, y, z, count)) == ZERO:
        z += _BESIDE  # at the origin and on an element there is no direction
    common = _coherent_phase_kernel(phases, places, x, y, z)
    taken, converged, longest = 0, False, 2.5
    while taken < max_steps and not converged:
        _normal_equations_kernel(phases, places, x, y, z, common, sums)
        _gauss_newton_kernel(sums, count, step)
        length = math.sqrt(step[0] * step[0] + step[1] * step[1] + step[2] * step[2])
        shrink = min(1.0, longest / max(length, longest))
        r0 = math.sqrt(x * x + y * y + z * z)
        along = (step[0] * x + step[1] * y + step[2] * z) / r0
        slopes = step[0] * sums[6] + step[1] * sums[7] + step[2] * sums[8]
        common += np.float32(sums[9] / count + shrink * (along + slopes / count))
        x += np.float32(shrink * step[0])
        y += np.float32(shrink * step[1])
        z += np.float32(shrink * step[2])
        taken += 1
        converged = length < 1e-4  # quadratic: the next one would be below a micrometre
    wavelength_square = 1.0 / (frame[0, 0] ** 2 + frame[0, 1] ** 2 + frame[0, 2] ** 2)
    position = (
        frame[3, 0] + (frame[0, 0] * x + frame[1, 0] * y + frame[2, 0] * z) * wavelength_square,
        frame[3, 1] + (frame[0, 1] * x + frame[1, 1] * y + frame[2, 1] * z) * wavelength_square,
        frame[3, 2] + (frame[0, 2] * x + frame[1, 2] * y + frame[2, 2] * z) * wavelength_square,
    )
    mean = sums[9] / count
    residual = 2.0 * math.pi * math.sqrt(max(sums[13] / count - mean * mean, 0.0))
    nearest = math.sqrt(_least_square_kernel(places, x, y, z, count) * wavelength_square)
    return position, 2.0 * math.pi * float(common), residual, taken, converged, nearest


@jit_sums
def _coherent_phase_kernel(phases: Any, places: Any, x: Any, y: Any, z: Any) -> Any:
    """Return the phase, in turns, of the sum of all arrivals at a point, each of magnitude 1.

    *phases* (N,): of the drive, in turns; *places* (3, N) and the point are in wavelengths.
    """
    re, im = ZERO, ZERO
    px, py, pz = places[0], places[1], places[2]
    for n in range(phases.size):
        dx, dy, dz = x - px[n], y - py[n], z - pz[n]
        square = dx * dx + dy * dy + dz * dz
        twice = np.float32(2.0) * (square * (ONE / np.sqrt(square)) + phases[n])
        turns = np.rint(twice)
        cosine, sine = cos_sin_kernel(twice - turns)
        sign = flip_sign_kernel(ONE, turns)
        re += sign * cosine
        im += sign * sine
    return np.float32(math.atan2(im, re) / (2.0 * math.pi))


@jit_sums
def _normal_equations_kernel(
    phases: Any, places: Any, x: Any, y: Any, z: Any, common: Any, sums: Any
) -> Any:
    """Set *sums* (14,): sums over the elements from which a step of the fit at x, y, z follows.

    Slopes are unit vectors to the point, less that from the origin; e is the phase in which a wave
    arrives less *common*, in turns. In order: six products of slopes, three slopes, e, three
    products of slope and e, e^2.
    """
    r0 = np.sqrt(x * x + y * y + z * z)
    cx, cy, cz = x / r0, y / r0, z / r0
    xx, xy, xz, yy, yz, zz = ZERO, ZERO, ZERO, ZERO, ZERO, ZERO
    sx, sy, sz, ex, ey, ez, se, ee = ZERO, ZERO, ZERO, ZERO, ZERO, ZERO, ZERO, ZERO
    px, py, pz = places[0], places[1], places[2]
    for n in range(phases.size):
        dx, dy, dz = x - px[n], y - py[n], z - pz[n]
        square = dx * dx + dy * dy + dz * dz
        inverse = ONE / np.sqrt(square)
        e = (square * inverse + phases[n]) - common
        e = e - np.rint(e)
        ux, uy, uz = dx * inverse - cx, dy * inverse - cy, dz * inverse - cz
        xx += ux * ux
        xy += ux * uy
        xz += ux * uz
        yy += uy * uy
        yz += uy * uz
        zz += uz * uz
        sx += ux
        sy += uy
        sz += uz
        ex += ux * e
        ey += uy * e
        ez += uz * e
        se += e
        ee += e * e
    sums[0], sums[1], sums[2], sums[3], sums[4], sums[5] = xx, xy, xz, yy, yz, zz
    sums[6], sums[7], sums[8], sums[9] = sx, sy, sz, se
    sums[10], sums[11], sums[12], sums[13] = ex, ey, ez, ee


@jit_inline
def _gauss_newton_kernel(sums: F8, count: int, step: F8) -> None:
    """Set *step* (3,), in wavelengths, that solves the normal equations *sums* of *count* elements.

    A direction that the phases do not show has no slope: the small damping leaves it where it is.
    """
    n = float(count)
    sx, sy, sz, se = sums[6], sums[7], sums[8], sums[9]
    a, b, c = sums[0] - sx * sx / n, sums[1] - sx * sy / n, sums[2] - sx * sz / n
    d, e, f = sums[3] - sy * sy / n, sums[4] - sy * sz / n, sums[5] - sz * sz / n
    damping = 1e-6 * (a + d + f) + 1e-12
    a, d, f = a + damping, d + damping, f + damping
    u, v, w = sums[10] - sx * se / n, sums[11] - sy * se / n, sums[12] - sz * se / n
    m11, m12, m13 = d * f - e * e, c * e - b * f, b * e - c * d
    m22, m23, m33 = a * f - c * c, b * c - a * e, a * d - b * b
    determinant = a * m11 + b * m12 + c * m13
    step[0] = -(m11 * u + m12 * v + m13 * w) / determinant
    step[1] = -(m12 * u + m22 * v + m23 * w) / determinant
    step[2] = -(m13 * u + m23 * v + m33 * w) / determinant


@jit_sums
def _least_square_kernel(places: Any, x: Any, y: Any, z: Any, count: Any) -> Any:
    """Return the square of the distance from a point to the nearest of *count* elements."""
    least = np.float32(1e30)
    px, py, pz = places[0], places[1], places[2]
    for n in range(count):
        dx, dy, dz = x - px[n], y - py[n], z - pz[n]
        least = min(least, dx * dx + dy * dy + dz * dz)
    return least
