"""From phase codes to foci, frame after frame, each begun at the one before: parallel pistons.

The arithmetic of :class:`haptogram.acoustics.reconstruct.reconstruction.Reconstructor` for drives
of full amplitude whose focus has not jumped.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics.field.engines.kernels.discs import disc_stress_kernel
from haptogram.acoustics.field.engines.kernels.foci import fit_phases_kernel
from haptogram.acoustics.field.engines.kernels.jit import (
    inlined,
    jit_checked,
    jit_checked_entry,
    jit_sums,
)
from haptogram.acoustics.field.engines.kernels.pistons import (
    arrivals_kernel,
    height_kernel,
    inverse_symmetric_kernel,
    mean_outer_kernel,
    nearest_kernel,
    response_sums_kernel,
)

F8 = NDArray[np.float64]

#: Numbers that :func:`focused_frames_kernel` finds of each frame.
PLACE, STD, BOUND, RESIDUAL, COHERENCE, PRESSURE, FORCE = 0, 3, 6, 9, 10, 11, 12
MEASURES: Final = 13
_FIT_STEPS: Final = 8  # steps of the fit, which starts at the result of single precision
_SETTLED_M: Final = 1e-10

_fit_phases_kernel = inlined(fit_phases_kernel)
_disc_stress_kernel = inlined(disc_stress_kernel)


@jit_sums
def _residuals_kernel(
    places: F8, point: F8, per_wavelength: float, common: float, mean: F8, products: F8
) -> None:
    """Set *products* (5,): sums over the elements that a step of the fit at *point* (m) needs.

    e is the phase in which a wave arrives less *common*, in turns. In order: e times x, y, z of the
    unit vector less the *mean* one; e; e^2. *places* (4, N): positions (m), phases (turns);
    *per_wavelength*: 1 / wavelength.
    """
    px, py, pz, turns = places[0], places[1], places[2], places[3]
    x, y, z, total, square = 0.0, 0.0, 0.0, 0.0, 0.0
    for n in range(px.size):
        dx, dy, dz = point[0] - px[n], point[1] - py[n], point[2] - pz[n]
        r = np.sqrt(dx * dx + dy * dy + dz * dz)
        inverse = 1.0 / r
        e = r * per_wavelength + turns[n] - common
        e -= np.rint(e)
        x += (dx * inverse - mean[0]) * e
        y += (dy * inverse - mean[1]) * e
        z += (dz * inverse - mean[2]) * e
        total += e
        square += e * e
    products[0], products[1], products[2], products[3], products[4] = x, y, z, total, square


@jit_checked
def _fit_kernel(
    places: F8, point: F8, medium: F8, common: float, matrix: F8, inverse: F8, least: float
) -> float:
    """Move *point* (m) to the best fit; return its RMS residual in turns, -1 if there is none.

    None: not settled after 8 steps, or the determinant of *matrix*, the slopes' products, is not
    above *least* times its trace cubed. *common*: the phase of the arrivals, in turns. *places* (4,
    N), *medium* (8,) are those of :mod:`.pistons`. *matrix* and *inverse* are those of the last
    step.
    """
    count, products = places.shape[1], np.empty(5)
    for _ in range(_FIT_STEPS):
        dx, dy, dz = point[0] - places[0, 0], point[1] - places[1, 0], point[2] - places[2, 0]
        r = math.sqrt(dx * dx + dy * dy + dz * dz)
        mean_outer_kernel(places, point, False, medium, (dx / r, dy / r, dz / r), matrix)
        if not inverse_symmetric_kernel(matrix, inverse) > least:
            return -1.0
        _residuals_kernel(places, point, medium[0], common, matrix[6:], products)
        x, y, z = products[0], products[1], products[2]
        scale = -1.0 / (count * medium[0])
        x, y, z = (
            scale * (inverse[0] * x + inverse[1] * y + inverse[2] * z),
            scale * (inverse[1] * x + inverse[3] * y + inverse[4] * z),
            scale * (inverse[2] * x + inverse[4] * y + inverse[5] * z),
        )
        point[0] += x
        point[1] += y
        point[2] += z
        if math.sqrt(x * x + y * y + z * z) < _SETTLED_M:
            return math.sqrt(max(products[4] / count - (products[3] / count) ** 2, 0.0))
    return -1.0


@jit_checked_entry
def focused_frames_kernel(
    codes: NDArray[np.uint8], code_steps: int, steps_rad: F8, limits: F8, quick_limits: F8,
    start: F8, tracker: Any, bounds: F8, places: F8, medium: F8, disc: Any, engine: Any,
    force_per_stress: float, found: F8,
) -> int:  # fmt: skip
    """Find the foci of phase *codes* (F, N), from *start* (3,) on, until one has jumped.

    *steps_rad*, *limits*, *quick_limits* (F,): the step of the phases, the largest RMS residual,
    and that of the search in single precision, whose arguments are *tracker*. *start*
    and *places* (4, N) are overwritten. *bounds* (4,): least and largest distance from an element,
    least height, least share of the eigenvalues. Sets *found* (F, MEASURES) and returns the number
    of frames that were found.
    """
    count, turn, point = places.shape[1], 1.0 / code_steps, start
    drive = np.ones((2, count), np.float32)
    matrix, inverse, sums = np.empty(9), np.empty(6), np.empty(7)
    order, single, lags, frame, most = tracker
    per_radian = 1.0 / (2.0 * math.pi * medium[0] * count)
    for f in range(len(codes)):
        last = (point[0], point[1], point[2])
        fix = _fit_phases_kernel(
            codes[f], order, single, lags, frame, last, code_steps, count, most
        )
        if not (fix[2] <= quick_limits[f] and bounds[0] <= fix[5] <= bounds[1]):
            return f
        point[0], point[1], point[2] = fix[0]
        for n in range(count):
            places[3, n] = codes[f, n] * turn
            drive[1, n] = codes[f, n] * (2.0 * turn)
        common = fix[1] / (2.0 * math.pi)
        rms = 2.0 * math.pi * _fit_kernel(places, point, medium, common, matrix, inverse, bounds[3])
        is_near = bounds[0] <= nearest_kernel(places, point) <= bounds[1]
        is_focus = 0.0 <= rms <= limits[f] and is_near
        if not (is_focus and height_kernel(point[0], point[1], point[2], medium) >= bounds[2]):
            return f
        response_sums_kernel(places, point, matrix[6:], inverse, sums)
        _, size, loud = arrivals_kernel(places, point, medium)
        for i in range(3):
            variance = inverse[i * (7 - i) // 2] * count
            found[f, PLACE + i] = point[i]
            found[f, STD + i] = math.sqrt(variance) * per_radian * steps_rad[f] / math.sqrt(12.0)
            found[f, BOUND + i] = sums[i] * per_radian * steps_rad[f] / 2.0
        found[f, RESIDUAL], found[f, COHERENCE] = rms, size / loud
        found[f, PRESSURE] = size / math.sqrt(2.0)
        found[f, FORCE] = force_per_stress * _disc_stress_kernel(drive, point, disc, engine)
    return len(codes)
