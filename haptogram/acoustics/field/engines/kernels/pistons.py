"""The waves of parallel pistons at one point, in double precision.

*places* (4, N) holds positions in metres and the phases of the weights, in turns. *medium* (8,)
holds 1 / wavelength, peak pressure at 1 m, absorption, (k a / 2)^2, the common normal, and the
height of the highest element along it.

No loop over the elements stores what others read: rows of one array may overlap, as far as the
compiler can tell, and it would not vectorise the loop.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial
from numpy.typing import NDArray

from haptogram.acoustics.field.engines.kernels.jit import jit_inline, jit_sums

F8 = NDArray[np.float64]

MOST_GAIN_SQUARE: Final = 8.0  # (k a / 2)^2
MOST_LOSS: Final = 0.25  # nepers


def _power_series(terms: list[float], degree: int, high: float) -> tuple[float, ...]:
    """Return *degree* + 1 coefficients, lowest first, that fit a power series on [0, *high*].

    *terms*: the series' coefficients, lowest first; the fit is at Chebyshev nodes.
    """
    angles = math.pi * (np.arange(degree + 1) + 0.5) / (degree + 1)
    nodes = (1.0 - np.cos(angles)) * high / 2.0
    fit = Chebyshev.fit(nodes, Polynomial(terms)(nodes), degree, domain=[0.0, high])
    return tuple(fit.convert(kind=Polynomial).coef.tolist())


def _terms(count: int, base: float, first: int, step: int) -> list[float]:
    """Return *count* terms base^n / n! with alternating signs, n = first, first + step, ..."""
    powers = range(first, first + step * count, step)
    return [(-1) ** k * base**n / math.factorial(n) for k, n in enumerate(powers)]


_SINE: Final = _power_series(_terms(16, math.pi, 1, 2), 8, 0.25)
_COSINE: Final = _power_series(_terms(16, math.pi, 0, 2), 9, 0.25)
_LOSS: Final = _power_series(_terms(16, 1.0, 0, 1), 7, MOST_LOSS)


def _gain_series(order: int, degree: int) -> tuple[float, ...]:
    """Return coefficients, lowest first, of 2 J1(x) / x derived *order* times by q = x^2 / 4.

    They are those of a polynomial of this *degree* that fits it.
    """
    signs = [(-1) ** (m + order) for m in range(24)]
    terms = [s / (math.factorial(m) * math.factorial(m + order + 1)) for m, s in enumerate(signs)]
    return _power_series(terms, degree, MOST_GAIN_SQUARE)


_GAIN: Final = _gain_series(0, 12)
_GAIN_SLOPE: Final = _gain_series(1, 11)
_GAIN_BEND: Final = _gain_series(2, 10)


@jit_inline
def cos_sin_turns_kernel(turns: Any) -> Any:
    """Return cosine and sine of 2 pi *turns*; errors 1e-15."""
    s0, s1, s2, s3, s4, s5, s6, s7, s8 = _SINE
    c0, c1, c2, c3, c4, c5, c6, c7, c8, c9 = _COSINE
    twice = 2.0 * turns
    half = np.rint(twice)
    x = twice - half
    w = x * x
    sine = s0 + w * (s1 + w * (s2 + w * (s3 + w * (s4 + w * (s5 + w * (s6 + w * (s7 + w * s8)))))))
    high = c4 + w * (c5 + w * (c6 + w * (c7 + w * (c8 + w * c9))))
    cosine = c0 + w * (c1 + w * (c2 + w * (c3 + w * high)))
    sign = 1.0 - 4.0 * abs(0.5 * half - np.rint(0.5 * half))
    return sign * cosine, sign * x * sine


@jit_inline
def _ray_kernel(dx: Any, dy: Any, dz: Any, medium: Any) -> Any:
    """Return distance (m), its inverse, the cosine of the angle to the normal, and the level (Pa).

    *dx*, *dy*, *dz* (m): from an element to the point. The level is the magnitude at that distance
    straight ahead. *medium* (8,): as in the head of this module.
    """
    l0, l1, l2, l3, l4, l5, l6, l7 = _LOSS
    distance = np.sqrt(dx * dx + dy * dy + dz * dz)
    inverse = 1.0 / distance
    cosine = (dx * medium[4] + dy * medium[5] + dz * medium[6]) * inverse
    u = medium[2] * distance
    loss = l0 + u * (l1 + u * (l2 + u * (l3 + u * (l4 + u * (l5 + u * (l6 + u * l7))))))
    return distance, inverse, cosine, medium[1] * loss * inverse


@jit_inline
def wave_kernel(dx: Any, dy: Any, dz: Any, medium: Any) -> Any:
    """Return distance, its inverse, and the magnitude of a piston at unit weight."""
    d0, d1, d2, d3, d4, d5, d6, d7, d8, d9, d10, d11, d12 = _GAIN
    distance, inverse, cosine, level = _ray_kernel(dx, dy, dz, medium)
    q = medium[3] * (1.0 - cosine * cosine)
    high = d6 + q * (d7 + q * (d8 + q * (d9 + q * (d10 + q * (d11 + q * d12)))))
    gain = d0 + q * (d1 + q * (d2 + q * (d3 + q * (d4 + q * (d5 + q * high)))))
    return distance, inverse, level * gain


@jit_inline
def wave_bend_kernel(dx: Any, dy: Any, dz: Any, medium: Any) -> Any:
    """Return distance, its inverse, cosine of the angle, level, gain, its slope and its bend.

    The magnitude of a piston at unit weight is the level times the gain, whose derivatives are
    those by the cosine.
    """
    d0, d1, d2, d3, d4, d5, d6, d7, d8, d9, d10, d11 = _GAIN_SLOPE
    e0, e1, e2, e3, e4, e5, e6, e7, e8, e9, e10 = _GAIN_BEND
    distance, inverse, cosine, level = _ray_kernel(dx, dy, dz, medium)
    q = medium[3] * (1.0 - cosine * cosine)
    turn = d5 + q * (d6 + q * (d7 + q * (d8 + q * (d9 + q * (d10 + q * d11)))))
    turn = d0 + q * (d1 + q * (d2 + q * (d3 + q * (d4 + q * turn))))
    bend = e5 + q * (e6 + q * (e7 + q * (e8 + q * (e9 + q * e10))))
    bend = e0 + q * (e1 + q * (e2 + q * (e3 + q * (e4 + q * bend))))
    gain = -2.0 * turn - q * bend  # Bessel's equation
    per_cosine = -2.0 * medium[3] * cosine  # of q
    by_cosine = per_cosine * per_cosine * bend - 2.0 * medium[3] * turn
    return distance, inverse, cosine, level, gain, per_cosine * turn, by_cosine


@jit_inline
def height_kernel(x: Any, y: Any, z: Any, medium: Any) -> Any:
    """Return the height of a point above the highest element."""
    return x * medium[4] + y * medium[5] + z * medium[6] - medium[7]


@jit_sums
def arrivals_kernel(places: F8, point: F8, medium: F8) -> tuple[float, float, float]:
    """Return the common phase of the waves at a point, in turns, and the magnitude of the pressure.

    Then the sum of the magnitudes of the waves.
    """
    px, py, pz, turns = places[0], places[1], places[2], places[3]
    x, y, z, re, im, p, q, loud = point[0], point[1], point[2], 0.0, 0.0, 0.0, 0.0, 0.0
    for n in range(px.size):
        distance, _, size = wave_kernel(x - px[n], y - py[n], z - pz[n], medium)
        cosine, sine = cos_sin_turns_kernel(distance * medium[0] + turns[n])
        re += cosine
        im += sine
        p += size * cosine
        q += size * sine
        loud += abs(size)  # below 0 in a side lobe of opposite sign
    return math.atan2(im, re) / (2.0 * math.pi), math.sqrt(p * p + q * q), loud


@jit_sums
def nearest_kernel(places: F8, point: F8) -> float:
    """Return the distance from the nearest element."""
    px, py, pz, least = places[0], places[1], places[2], 1e30
    x, y, z = point[0], point[1], point[2]
    for n in range(px.size):
        dx, dy, dz = x - px[n], y - py[n], z - pz[n]
        square = dx * dx + dy * dy + dz * dz
        least = square if square < least else least
    return math.sqrt(least)


@jit_sums
def mean_outer_kernel(
    places: F8, point: F8, loud: bool, medium: F8, middle: tuple[float, float, float], matrix: F8
) -> None:
    """Set *matrix* (9,): the covariance of the unit vectors to a point (xx, xy, xz, yy, yz, zz).

    Then their mean. They count by the magnitudes that arrive where *loud*, a constant. *middle* is
    near to all of them: their squares less that of the mean would cancel.
    """
    px, py, pz, (mx, my, mz) = places[0], places[1], places[2], middle
    x, y, z, total, sx, sy, sz = point[0], point[1], point[2], 0.0, 0.0, 0.0, 0.0
    xx, xy, xz, yy, yz, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for n in range(px.size):
        dx, dy, dz = x - px[n], y - py[n], z - pz[n]
        _, inverse, size = wave_kernel(dx, dy, dz, medium)
        w = abs(size) if loud else 1.0
        dx, dy, dz = dx * inverse - mx, dy * inverse - my, dz * inverse - mz
        total += w
        sx += w * dx
        sy += w * dy
        sz += w * dz
        xx += w * dx * dx
        xy += w * dx * dy
        xz += w * dx * dz
        yy += w * dy * dy
        yz += w * dy * dz
        zz += w * dz * dz
    sx, sy, sz = sx / total, sy / total, sz / total
    matrix[0], matrix[1] = xx / total - sx * sx, xy / total - sx * sy
    matrix[2], matrix[3] = xz / total - sx * sz, yy / total - sy * sy
    matrix[4], matrix[5] = yz / total - sy * sz, zz / total - sz * sz
    matrix[6], matrix[7], matrix[8] = mx + sx, my + sy, mz + sz


@jit_sums
def inverse_symmetric_kernel(matrix: F8, inverse: F8) -> float:
    """Set the inverse of a symmetric 3 x 3 matrix (xx, xy, xz, yy, yz, zz); return its share.

    That is its determinant over the cube of its trace: at most the least over the largest
    eigenvalue.
    """
    a, b, c, d, e, f = matrix[0], matrix[1], matrix[2], matrix[3], matrix[4], matrix[5]
    m11, m12, m13 = d * f - e * e, c * e - b * f, b * e - c * d
    determinant = a * m11 + b * m12 + c * m13
    inverse[0], inverse[1], inverse[2] = m11 / determinant, m12 / determinant, m13 / determinant
    inverse[3], inverse[4] = (a * f - c * c) / determinant, (b * c - a * e) / determinant
    inverse[5] = (a * d - b * b) / determinant
    return float(determinant / (a + d + f) ** 3)


@jit_sums
def response_sums_kernel(places: F8, point: F8, mean: F8, inverse: F8, sums: F8) -> None:
    """Set the sums of the unit vectors to a point, less their *mean*, seen through *inverse*.

    *sums* (7,): of the magnitudes along x, y and z, of the squares, and of x, y and z times the
    distances.
    """
    px, py, pz = places[0], places[1], places[2]
    ax, ay, az, squares, sx, sy, sz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for n in range(px.size):
        dx, dy, dz = point[0] - px[n], point[1] - py[n], point[2] - pz[n]
        distance = np.sqrt(dx * dx + dy * dy + dz * dz)
        per = 1.0 / distance
        u, v, w = dx * per - mean[0], dy * per - mean[1], dz * per - mean[2]
        x = inverse[0] * u + inverse[1] * v + inverse[2] * w
        y = inverse[1] * u + inverse[3] * v + inverse[4] * w
        z = inverse[2] * u + inverse[4] * v + inverse[5] * w
        ax += abs(x)
        ay += abs(y)
        az += abs(z)
        squares += x * x + y * y + z * z
        sx += x * distance
        sy += y * distance
        sz += z * distance
    sums[0], sums[1], sums[2], sums[3], sums[4], sums[5], sums[6] = ax, ay, az, squares, sx, sy, sz
