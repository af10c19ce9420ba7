"""Weighted Gerchberg-Saxton."""

from __future__ import annotations

from typing import Any

import numpy as np

from haptogram.acoustics.field.engines.kernels.blocks import F4
from haptogram.acoustics.field.engines.kernels.jit import jit, jit_inline, jit_sums
from haptogram.acoustics.field.engines.kernels.waves import ONE, ZERO

# A point that cannot be served as it wants gains weight in every round: before it overflows, all
# are divided by a power of two, which changes no ratio between them.
_LARGEST_WEIGHT = np.float32(2.0**40)


@jit
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
    p, q = ZERO, ZERO
    for n in range(re.size):
        p += re[n] * drive_re[n] - im[n] * drive_im[n]
        q += re[n] * drive_im[n] + im[n] * drive_re[n]
    return p, q


@jit_inline
def _send_back_kernel(re: Any, im: Any, p: Any, q: Any, drive_re: Any, drive_im: Any) -> Any:
    """Add conj(g) (p + j q)."""
    for n in range(re.size):
        drive_re[n] = drive_re[n] + re[n] * p + im[n] * q
        drive_im[n] = drive_im[n] + re[n] * q - im[n] * p


@jit_inline
def _normalise_kernel(drive_re: Any, drive_im: Any) -> Any:
    for n in range(drive_re.size):
        square = drive_re[n] * drive_re[n] + drive_im[n] * drive_im[n] + np.float32(1e-30)
        scale = ONE / np.sqrt(square)
        drive_re[n] = drive_re[n] * scale
        drive_im[n] = drive_im[n] * scale
