"""From phase codes to foci, frame after frame, each begun at the one before: parallel pistons.

The arithmetic of :class:`haptogram.acoustics.reconstruct.reconstruction.Reconstructor` for drives
of full amplitude whose focus has not jumped.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics.field.engines.kernels.fields import (
    lattice_pressure_kernel,
    polar_form_kernel,
)
from haptogram.acoustics.field.engines.kernels.foci import fit_phases_kernel
from haptogram.acoustics.field.engines.kernels.jit import jit_checked, jit_checked_entry, jit_sums
from haptogram.acoustics.field.engines.kernels.pistons import (
    arrivals_at_kernel,
    cos_sin_turns_kernel,
    height_kernel,
    inverse_symmetric_kernel,
    mean_outer_kernel,
    response_sums_kernel,
)

F8 = NDArray[np.float64]

#: Numbers that :func:`focused_frames_kernel` finds of each frame.
PLACE, STD, BOUND, RESIDUAL, COHERENCE, PRESSURE, FORCE = 0, 3, 6, 9, 10, 11, 12
MEASURES: Final = 13
_FIT_STEPS: Final = 8  # steps of the fit, which starts at the result of single precision
_SETTLED_M: Final = 1e-10


@jit_sums
def _residuals_kernel(
    places: F8, point: F8, per_wavelength: float, rays: F8
) -> tuple[float, float]:
    """Set *rays* (5, N): unit vectors, distances, residuals in turns; return the sums of the last.

    They are that of the residuals and that of their squares; the common phase is taken out.
    """
    px, py, pz, turns = places[0], places[1], places[2], places[3]
    ux, uy, uz, distance, error = rays[0], rays[1], rays[2], rays[3], rays[4]
    re, im = 0.0, 0.0
    for n in range(px.size):
        dx, dy, dz = point[0] - px[n], point[1] - py[n], point[2] - pz[n]
        r = np.sqrt(dx * dx + dy * dy + dz * dz)
        inverse = 1.0 / r
        ux[n], uy[n], uz[n], distance[n] = dx * inverse, dy * inverse, dz * inverse, r
        error[n] = r * per_wavelength + turns[n]
        cosine, sine = cos_sin_turns_kernel(error[n])
        re += cosine
        im += sine
    common = math.atan2(im, re) / (2.0 * math.pi)
    total, square = 0.0, 0.0
    for n in range(px.size):
        e = error[n] - common
        e -= np.rint(e)
        error[n] = e
        total += e
        square += e * e
    return total, square


@jit_sums
def _products_kernel(rays: F8, mean: F8, products: F8) -> None:
    """Compute *products* (3,), J^T r: the centred slopes times the residuals."""
    x, y, z = 0.0, 0.0, 0.0
    for n in range(rays.shape[1]):
        e = rays[4, n]
        x += (rays[0, n] - mean[0]) * e
        y += (rays[1, n] - mean[1]) * e
        z += (rays[2, n] - mean[2]) * e
    products[0], products[1], products[2] = x, y, z


@jit_checked
def _fit_kernel(
    places: F8, point: F8, per_wavelength: float, rays: F8, matrix: F8, inverse: F8, least: float
) -> float:
    """Move *point* to the best fit; return its RMS residual in turns, -1 if it diverged.

    Afterwards *matrix* and *inverse* are those of the slopes there.
    """
    count, products, equal, length = rays.shape[1], np.empty(3), np.ones(rays.shape[1]), 1.0
    for _ in range(_FIT_STEPS):
        total, square = _residuals_kernel(places, point, per_wavelength, rays)
        middle = (rays[0, 0], rays[1, 0], rays[2, 0])
        mean_outer_kernel(rays[0], rays[1], rays[2], equal, middle, matrix)
        if not inverse_symmetric_kernel(matrix, inverse) > least:
            return -1.0
        if length < _SETTLED_M:
            return math.sqrt(max(square / count - (total / count) ** 2, 0.0))
        _products_kernel(rays, matrix[6:], products)
        x, y, z = products[0], products[1], products[2]
        scale = -1.0 / (count * per_wavelength)
        x, y, z = (
            scale * (inverse[0] * x + inverse[1] * y + inverse[2] * z),
            scale * (inverse[1] * x + inverse[3] * y + inverse[4] * z),
            scale * (inverse[2] * x + inverse[4] * y + inverse[5] * z),
        )
        length = math.sqrt(x * x + y * y + z * z)
        point[0] += x
        point[1] += y
        point[2] += z
    return -1.0


@jit_sums
def _least_kernel(values: F8) -> float:
    """Return the least value."""
    least = 1e30
    for n in range(values.size):
        least = values[n] if values[n] < least else least
    return least


@jit_checked
def _force_kernel(
    phasors: NDArray[np.complex128], codes: NDArray[np.uint8], point: F8, disc: Any, engine: Any
) -> float:
    """Return the force on a disc around *point*, as :class:`.levels.force.ReflectingDisc` does.

    *disc*: nodes (5 M, 3), areas (M,), factors of |p|^2 and of squared differences; *engine*: what
    the kernels of single precision take.
    """
    nodes, areas, here, across = disc
    frame, constants, careful, gain, gx, gy, lattice = engine
    drive, polar = np.empty(codes.size, np.complex128), np.empty((2, codes.size), np.float32)
    for n in range(codes.size):
        drive[n] = phasors[codes[n]]
    polar_form_kernel(drive, polar)
    points, p = np.empty(nodes.shape), np.empty(len(nodes), np.complex128)
    for m in range(len(nodes)):
        for i in range(3):
            points[m, i] = nodes[m, i] + point[i]
    lattice_pressure_kernel(points, frame, constants, careful, gain, gx, gy, lattice, polar, p)
    force, count = 0.0, areas.size
    for m in range(count):
        first, second = p[count + m] - p[3 * count + m], p[2 * count + m] - p[4 * count + m]
        stress = here * (p[m].real ** 2 + p[m].imag ** 2)
        stress -= across * (first.real**2 + first.imag**2 + second.real**2 + second.imag**2)
        force += stress * areas[m]
    return force


@jit_checked_entry
def focused_frames_kernel(
    codes: NDArray[np.uint8], phasors: NDArray[np.complex128], steps_rad: F8, limits: F8,
    quick_limits: F8, start: F8, tracker: Any, bounds: F8, places: F8, medium: F8, disc: Any,
    engine: Any, found: F8,
) -> int:  # fmt: skip
    """Find the foci of phase *codes* (F, N), from *start* (3,) on, until one has jumped.

    *steps_rad*, *limits*, *quick_limits* (F,): the step of the phases, the largest RMS residual,
    and that of the search in single precision, whose arguments are *tracker*. *start*
    and *places* (4, N) are overwritten. *bounds* (4,): least and largest distance from an element,
    least height, least share of the eigenvalues. Sets *found* (F, MEASURES) and returns the number
    of frames that were found.
    """
    count = places.shape[1]
    rays, waves, point = np.empty((5, count)), np.empty((6, count)), start
    matrix, inverse, sums = np.empty(9), np.empty(6), np.empty(7)
    order, single, lags, frame, most = tracker
    turn, per_wavelength = 1.0 / phasors.size, medium[0]
    per_radian = 1.0 / (2.0 * math.pi * per_wavelength * count)
    for f in range(len(codes)):
        last = (point[0], point[1], point[2])
        fix = fit_phases_kernel(
            codes[f], order, single, lags, frame, last, phasors.size, count, most
        )
        if not (fix[2] <= quick_limits[f] and bounds[0] <= fix[5] <= bounds[1]):
            return f
        point[0], point[1], point[2] = fix[0]
        for n in range(count):
            places[3, n] = codes[f, n] * turn
        rms = 2.0 * math.pi * _fit_kernel(
            places, point, per_wavelength, rays, matrix, inverse, bounds[3]
        )  # fmt: skip
        x, y, z, distance = point[0], point[1], point[2], rays[3]
        is_focus = 0.0 <= rms <= limits[f] and bounds[0] <= _least_kernel(distance) <= bounds[1]
        if not (is_focus and height_kernel(x, y, z, medium) >= bounds[2]):
            return f
        response_sums_kernel(rays[0], rays[1], rays[2], distance, matrix[6:], inverse, sums)
        re, im, loud = arrivals_at_kernel(places, x, y, z, medium, waves)
        size = math.sqrt(re * re + im * im)
        for i in range(3):
            variance = inverse[i * (7 - i) // 2] * count
            found[f, PLACE + i] = point[i]
            found[f, STD + i] = math.sqrt(variance) * per_radian * steps_rad[f] / math.sqrt(12.0)
            found[f, BOUND + i] = sums[i] * per_radian * steps_rad[f] / 2.0
        found[f, RESIDUAL], found[f, COHERENCE] = rms, size / loud
        found[f, PRESSURE] = size / math.sqrt(2.0)
        found[f, FORCE] = _force_kernel(phasors, codes[f], point, disc, engine)
    return len(codes)
