"""Points made ready for single precision: which ones it serves, and blocks of them."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics.field.engines.kernels.jit import jit_checked, jit_checked_entry, jit_inline

F4 = NDArray[np.float32]
F8 = NDArray[np.float64]

BLOCK: Final = 256  # points; the buffers of a 16 x 16 array then fill 30 kB, about the first cache

_GENTLE_LOSS: Final = 0.08  # nepers across a block; a quadratic is then off by at most 3e-6


@jit_checked_entry
def usable_points_kernel(
    points: F8, positions: F8, fronts: F8, bounds: F8, reach: float, clearance: float,
    usable: NDArray[np.bool_],
) -> int:  # fmt: skip
    """Mark the points that single precision serves; return how many it does not.

    *fronts* (U, 4): half-spaces n x + d >= 0, of which a point must be in one: mostly the first.
    *bounds*: centre of the array (3), half-sizes of the box around it that holds every point near
    an element (3). In metres, like *reach*, the largest distance from the centre, and *clearance*,
    the smallest distance from an element. NaN is never usable.
    """
    limit, special, served = reach * reach, 0, 0
    nx, ny, nz, offset = fronts[0, 0], fronts[0, 1], fronts[0, 2], fronts[0, 3]
    for p in range(len(points)):  # no branch, so that it is vectorised
        x, y, z = points[p, 0], points[p, 1], points[p, 2]
        u, v, w = x - bounds[0], y - bounds[1], z - bounds[2]
        usable[p] = u * u + v * v + w * w <= limit
        served += usable[p]
        special += (abs(u) < bounds[3]) & (abs(v) < bounds[4]) & (abs(w) < bounds[5])
        special += x * nx + y * ny + z * nz + offset < 0.0
    if special:
        served = 0
        for p in range(len(points)):
            usable[p] = (
                usable[p]
                and _in_front_kernel(points[p], fronts)
                and _is_clear_kernel(points[p], positions, bounds, clearance * clearance)
            )
            served += usable[p]
    return len(points) - served


@jit_checked
def _in_front_kernel(point: F8, fronts: F8) -> bool:
    """Return True if a point is in front of any of the planes *fronts* (K, 4).

    A plane a, b, c, d has the point in front if a x + b y + c z + d is 0 or more.
    """
    for front in fronts:
        if point[0] * front[0] + point[1] * front[1] + point[2] * front[2] + front[3] >= 0.0:
            return True
    return False


@jit_checked
def _is_clear_kernel(point: F8, positions: F8, bounds: F8, limit: float) -> bool:
    """Return True if the square of a point's distance from every element is at least *limit*.

    True without a look at *positions* (N, 3) outside the box *bounds*: its middle, then its
    half-lengths.
    """
    for i in range(3):
        if abs(point[i] - bounds[i]) >= bounds[3 + i]:
            return True
    return bool(_nearest_square_kernel(point, positions) >= limit)


@jit_checked
def _nearest_square_kernel(point: F8, positions: F8) -> float:
    """Return the square of the distance from a point to the nearest of *positions* (N, 3)."""
    nearest = np.inf
    for n in range(len(positions)):
        square = 0.0
        for i in range(3):
            square += (point[i] - positions[n, i]) ** 2
        nearest = min(nearest, square)
    return nearest


@jit_inline
def padded_block_length(count: int) -> int:
    """Return the length of the equal blocks of *count* points: whole vectors of up to 16 values."""
    blocks = max(1, (count + BLOCK - 1) // BLOCK)
    return max(16, (count + 16 * blocks - 1) // (16 * blocks) * 16)


@jit_inline
def block_kernel(
    points: F8, frame: F8, constants: F8, careful: bool, places: F8, loss: F4
) -> bool:  # fmt: skip
    """Express a block of points in the array's frame, in wavelengths; fit the loss over it.

    *frame* is (4, 3): three axes over the wavelength, and the origin. The part of the block beyond
    the last point repeats it. Returns whether care is needed: asked for, for the loss, or far away.
    """
    near, far = 1e30, 0.0
    count = len(points)
    for p in range(count):
        u, v, w = points[p, 0] - frame[3, 0], points[p, 1] - frame[3, 1], points[p, 2] - frame[3, 2]
        square = 0.0
        for i in range(3):
            value = frame[i, 0] * u + frame[i, 1] * v + frame[i, 2] * w
            places[i, p] = value
            square += value * value
        near, far = min(near, square), max(far, square)
    for i in range(3):
        places[i, count:] = places[i, count - 1]
    radius, absorption = constants[0], constants[1]
    near, far = max(math.sqrt(near) - radius, 0.0), math.sqrt(far) + radius
    careful = careful or absorption * (far - near) > _GENTLE_LOSS or far > constants[3]
    _loss_kernel(absorption, near, far, careful, loss)
    return careful


@jit_inline
def _loss_kernel(absorption: float, near: float, far: float, careful: bool, loss: F4) -> None:
    """Set *loss* (4,): a cubic in r, lowest order first, that fits exp(-*absorption* r).

    It fits at the Chebyshev nodes of [near, far], which is widened by 1 each way. Not *careful*:
    the quadratic at three nodes. Distances are in wavelengths.
    """
    middle, half = 0.5 * (near + far), 0.5 * (far - near) + 1.0
    top = math.exp(-absorption * middle)
    if careful:
        outer, inner = half * math.cos(math.pi / 8.0), half * math.sin(math.pi / 8.0)
        span = outer * outer - inner * inner
        c2 = (math.cosh(absorption * outer) - math.cosh(absorption * inner)) / span
        slope = -math.sinh(absorption * outer) / outer
        c3 = (math.sinh(absorption * inner) / inner + slope) / span
        c0, c1 = math.cosh(absorption * outer) - c2 * outer * outer, slope - c3 * outer * outer
    else:
        outer = half * math.sqrt(0.75)
        c0, c3 = 1.0, 0.0
        c2 = (math.cosh(absorption * outer) - 1.0) / (outer * outer)
        c1 = -math.sinh(absorption * outer) / outer
    loss[0] = top * (c0 - middle * (c1 - middle * (c2 - middle * c3)))
    loss[1] = top * (c1 - middle * (2.0 * c2 - middle * 3.0 * c3))
    loss[2] = top * (c2 - middle * 3.0 * c3)
    loss[3] = top * c3
