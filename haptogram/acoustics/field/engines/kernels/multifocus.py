"""Weighted Gerchberg-Saxton."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from haptogram.acoustics.field.engines.kernels.blocks import F4, F8
from haptogram.acoustics.field.engines.kernels.jit import (
    jit_checked_entry,
    jit_entry,
    jit_inline,
    jit_sums,
)
from haptogram.acoustics.field.engines.kernels.pistons import (
    cos_sin_turns_kernel,
    height_kernel,
    wave_kernel,
)
from haptogram.acoustics.field.engines.kernels.waves import ONE, ZERO

# A point that cannot be served as it wants gains weight in every round: before it overflows, all
# are divided by a power of two, which changes no ratio between them.
_LARGEST_WEIGHT = np.float32(2.0**40)


@jit_checked_entry
def foci_waves_kernel(
    points: F8, levels: F8, places: F8, medium: F8, re: F4, im: F4, drive_re: F4, drive_im: F4
) -> bool:
    """Set the propagators of parallel pistons over the largest, and the drive to start from.

    That is the phases of the naive superposition. *places* (4, N), all phases 0, and *medium* are
    those of :mod:`.pistons`. Returns whether every element is below each point, and heard there.
    """
    waves, exact = np.empty((3, re.shape[1])), np.empty((2, *re.shape))
    start, largest = np.zeros((2, re.shape[1])), 0.0
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        if not height_kernel(x, y, z, medium) > 0.0:
            return False
        _arrivals_kernel(places, x, y, z, medium, waves)
        for n in range(waves.shape[1]):
            size = waves[2, n]
            if size == 0.0:
                return False
            start[0, n] += levels[i] * waves[0, n] / size
            start[1, n] -= levels[i] * waves[1, n] / size
            exact[0, i, n], exact[1, i, n] = waves[0, n], waves[1, n]
            largest = max(largest, abs(size))
    for i in range(len(points)):
        for n in range(waves.shape[1]):
            re[i, n], im[i, n] = exact[0, i, n] / largest, exact[1, i, n] / largest
    for n in range(waves.shape[1]):
        size = math.sqrt(start[0, n] ** 2 + start[1, n] ** 2)
        size = size if size > 0.0 else 1.0
        drive_re[n], drive_im[n] = start[0, n] / size, start[1, n] / size
    return True


@jit_sums
def _arrivals_kernel(places: F8, x: float, y: float, z: float, medium: F8, waves: F8) -> None:
    """Set *waves* (3, N), each element's wave (Pa) at a point: real and imaginary part, magnitude.

    *places* (4, N), in m, and *medium* (8,) are those of :mod:`.pistons`; *x*, *y*, *z* are in m.
    """
    for n in range(waves.shape[1]):
        dx, dy, dz = x - places[0, n], y - places[1, n], z - places[2, n]
        distance, _, size = wave_kernel(dx, dy, dz, medium)
        cosine, sine = cos_sin_turns_kernel(distance * medium[0])
        waves[0, n], waves[1, n], waves[2, n] = size * cosine, size * sine, size


@jit_entry
def gerchberg_saxton_kernel(
    re: F4, im: F4, wanted: F4, rounds: int, drive_re: F4, drive_im: F4
) -> None:
    """Turn the phases of a drive of unit magnitude until the points are equally well served.

    *re*, *im* (F, N): propagators; *wanted* (F,): relative amplitudes of the points. The weight of
    a point grows by (mean / own of |p| / wanted)^(3/4) in each round, as in
    :mod:`haptogram.acoustics.solvers.several`: two square roots take less time than a power.
    """
    count = len(wanted)
    weight = wanted.copy()
    pressure = np.empty((2, count), np.float32)
    for _ in range(rounds):
        mean = ZERO
        for i in range(count):
            pressure[0, i], pressure[1, i] = _received_kernel(re[i], im[i], drive_re, drive_im)
            p, q = pressure[0, i], pressure[1, i]
            mean += np.sqrt(p * p + q * q) / wanted[i]
        mean /= np.float32(count)
        drive_re[:] = ZERO
        drive_im[:] = ZERO
        for i in range(count):
            p, q = pressure[0, i], pressure[1, i]
            level = np.sqrt(p * p + q * q) + np.float32(1e-30)
            root = np.sqrt(mean * wanted[i] / level)
            weight[i] *= root * np.sqrt(root)
            _send_back_kernel(
                re[i], im[i], weight[i] * p / level, weight[i] * q / level, drive_re, drive_im
            )
        _normalise_kernel(drive_re, drive_im)
        if weight.max() > _LARGEST_WEIGHT:
            weight /= _LARGEST_WEIGHT


@jit_sums
def _received_kernel(re: Any, im: Any, drive_re: Any, drive_im: Any) -> Any:
    """Return real and imaginary pressure at a focus: the drive times its propagators *re*, *im*.

    The focus's propagators (N,) and the drive (N,) are summed over the elements.
    """
    p, q = ZERO, ZERO
    for n in range(re.size):
        p += re[n] * drive_re[n] - im[n] * drive_im[n]
        q += re[n] * drive_im[n] + im[n] * drive_re[n]
    return p, q


@jit_inline
def _send_back_kernel(re: Any, im: Any, p: Any, q: Any, drive_re: Any, drive_im: Any) -> Any:
    """Add to the drive (N,) what a focus of pressure p + j q sends back to the elements.

    That is p + j q times the conjugate of its propagators *re* + j *im* (N,).
    """
    for n in range(re.size):
        drive_re[n] = drive_re[n] + re[n] * p + im[n] * q
        drive_im[n] = drive_im[n] + re[n] * q - im[n] * p


@jit_inline
def _normalise_kernel(drive_re: Any, drive_im: Any) -> Any:
    """Scale all drives to magnitude 1; those of 0 stay 0."""
    for n in range(drive_re.size):
        square = drive_re[n] * drive_re[n] + drive_im[n] * drive_im[n] + np.float32(1e-30)
        scale = ONE / np.sqrt(square)
        drive_re[n] = drive_re[n] * scale
        drive_im[n] = drive_im[n] * scale
