"""Fields and propagators of lattices and of elements anywhere."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics._kernels._blocks import F4, F8, block, padded
from haptogram.acoustics._kernels._jit import jit, jit_checked, jit_inline
from haptogram.acoustics._kernels._waves import (
    ONE,
    WAVES,
    ZERO,
    add_waves,
    rays_free,
    rays_lattice,
    set_waves,
)


@jit_checked
def polar_form(drive: NDArray[np.complex128], polar: F4) -> None:
    """Set the magnitudes and the phases, in half turns, of a drive."""
    for n in range(len(drive)):
        polar[0, n] = math.hypot(drive[n].real, drive[n].imag)
        polar[1, n] = math.atan2(drive[n].imag, drive[n].real) / math.pi


@jit
def lattice_pressure(
    points: F8, frame: F8, constants: F8, careful: bool, gain: F4, gx: F4, gy: F4,
    nodes: NDArray[np.int64], drive: F4, result: NDArray[np.complex128],
) -> None:  # fmt: skip
    """Set the pressure of a planar lattice of parallel elements.

    *constants*: aperture radius and absorption (per wavelength), 1 if the elements are baffled.
    *careful*: rounding errors do not average out. *nodes* (nx, ny): the element at each node, -1
    for none. *drive* (2, N): magnitudes, and phases in half turns. r^2 = (x - gx)^2 + z^2 +
    (y - gy)^2 is the sum of one of nx and one of ny rows that are computed once a block.
    """
    size = padded(len(points))
    hi, lo = np.empty((3, size), np.float32), np.empty((3, size), np.float32)
    a, height = np.empty(size, np.float32), np.empty(size, np.float32)
    t, m = np.zeros((WAVES, size), np.float32), np.empty((WAVES, size), np.float32)
    rows, loss = np.empty((gy.size, size), np.float32), np.empty(4, np.float32)
    re, im = np.empty(size, np.float32), np.empty(size, np.float32)
    for start in range(0, len(points), size):
        part = points[start : start + size]
        slow = block(part, frame, constants, careful, hi, lo, loss)
        _lattice_rows(hi, lo, gy, rows, height)
        re[:] = ZERO
        im[:] = ZERO
        held = 0
        for i in range(gx.size):
            for p in range(size):
                dx = (hi[0, p] - gx[i]) + lo[0, p]
                a[p] = dx * dx + height[p]
            for j in range(gy.size):
                n = nodes[i, j]
                if n >= 0 and drive[0, n] != ZERO:
                    rays_lattice(
                        a,
                        rows[j],
                        height,
                        drive[0, n],
                        drive[1, n],
                        gain,
                        loss,
                        slow,
                        t[held],
                        m[held],
                    )
                    held = _held(held, t, m, re, im)
        if held:
            m[held:] = ZERO
            add_waves(t, m, re, im)
        for p in range(len(part)):
            behind = constants[2] != 0.0 and hi[2, p] < ZERO
            result[start + p] = 0.0 if behind else complex(re[p], im[p])


@jit_inline
def _held(held: Any, t: Any, m: Any, re: Any, im: Any) -> Any:
    """Return how many waves are held after one more: all are added as soon as they are enough."""
    if held + 1 < WAVES:
        return held + 1
    add_waves(t, m, re, im)
    return 0


@jit
def _lattice_rows(hi: F4, lo: F4, gy: F4, rows: F4, height: F4) -> None:
    """Set the squares of y - gy, and of z."""
    for j in range(gy.size):
        for p in range(height.size):
            dy = (hi[1, p] - gy[j]) + lo[1, p]
            rows[j, p] = dy * dy
    for p in range(height.size):
        z = np.float64(hi[2, p]) + np.float64(lo[2, p])
        height[p] = z * z


@jit
def lattice_waves(
    points: F8, frame: F8, constants: F8, gain: F4, gx: F4, gy: F4, nodes: NDArray[np.int64],
    waves: F4,
) -> None:  # fmt: skip
    """Set the (2, N, B) real and imaginary parts of the propagators to at most `BLOCK` points.

    *nodes* (nx, ny): the element at each node, -1 for none.
    """
    size = padded(len(points))
    hi, lo = np.empty((3, size), np.float32), np.empty((3, size), np.float32)
    a, t, m = np.empty(size, np.float32), np.empty(size, np.float32), np.empty(size, np.float32)
    height, loss = np.empty(size, np.float32), np.empty(4, np.float32)
    rows = np.empty((gy.size, size), np.float32)
    block(points, frame, constants, True, hi, lo, loss)
    _lattice_rows(hi, lo, gy, rows, height)
    for i in range(gx.size):
        for p in range(size):
            dx = (hi[0, p] - gx[i]) + lo[0, p]
            a[p] = dx * dx + height[p]
        for j in range(gy.size):
            n = nodes[i, j]
            if n >= 0:
                rays_lattice(a, rows[j], height, ONE, ZERO, gain, loss, True, t, m)
                if constants[2] != 0.0:
                    for p in range(size):
                        m[p] = m[p] if hi[2, p] >= ZERO else ZERO
                set_waves(t, m, waves[0, n], waves[1, n])


@jit
def free_pressure(
    points: F8, frame: F8, constants: F8, careful: bool, gain: F4, elements: F4, drive: F4,
    result: NDArray[np.complex128],
) -> None:  # fmt: skip
    """Set the pressure of elements at any place with any normal.

    *elements* (N, 6): positions over the wavelength and normals, in the frame; *drive* (2, N).
    """
    size = padded(len(points))
    hi, lo = np.empty((3, size), np.float32), np.empty((3, size), np.float32)
    t, m = np.zeros((WAVES, size), np.float32), np.empty((WAVES, size), np.float32)
    loss = np.empty(4, np.float32)
    re, im = np.empty(size, np.float32), np.empty(size, np.float32)
    front = np.float32(0.0 if constants[2] != 0.0 else -2.0)
    for start in range(0, len(points), size):
        part = points[start : start + size]
        slow = block(part, frame, constants, careful, hi, lo, loss)
        re[:] = ZERO
        im[:] = ZERO
        held = 0
        for n in range(len(elements)):
            if drive[0, n] != ZERO:
                rays_free(
                    hi,
                    lo,
                    elements[n],
                    drive[0, n],
                    drive[1, n],
                    front,
                    gain,
                    loss,
                    slow,
                    t[held],
                    m[held],
                )
                held = _held(held, t, m, re, im)
        if held:
            m[held:] = ZERO
            add_waves(t, m, re, im)
        for p in range(len(part)):
            result[start + p] = complex(re[p], im[p])


@jit
def free_waves(
    points: F8, frame: F8, constants: F8, gain: F4, elements: F4, waves: F4
) -> None:  # fmt: skip
    """Set the (2, N, B) real and imaginary parts of the propagators to at most `BLOCK` points."""
    size = padded(len(points))
    hi, lo = np.empty((3, size), np.float32), np.empty((3, size), np.float32)
    t, m, loss = np.empty(size, np.float32), np.empty(size, np.float32), np.empty(4, np.float32)
    front = np.float32(0.0 if constants[2] != 0.0 else -2.0)
    block(points, frame, constants, True, hi, lo, loss)
    for n in range(len(elements)):
        rays_free(hi, lo, elements[n], ONE, ZERO, front, gain, loss, True, t, m)
        set_waves(t, m, waves[0, n], waves[1, n])
