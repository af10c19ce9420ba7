"""Fields and propagators of lattices and of elements anywhere."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics._kernels._blocks import F4, F8, block, padded
from haptogram.acoustics._kernels._jit import jit, jit_inline
from haptogram.acoustics._kernels._waves import (
    ONE,
    WAVES,
    ZERO,
    add_waves,
    arctangent,
    rays,
    set_waves,
)

_GRAZING = np.float32(-1e-5)  # wavelengths: what rounding may leave of 0, at 30 of them


@jit
def polar_form(drive: NDArray[np.complex128], polar: F4) -> None:
    """Set the magnitudes and the phases, in half turns, of a drive."""
    for n in range(drive.size):
        x, y = drive[n].real, drive[n].imag
        large, small = max(abs(x), abs(y)), min(abs(x), abs(y))
        eighth = arctangent(small / max(large, 1e-300))
        quarter = 0.5 - eighth if abs(y) > abs(x) else eighth
        half = 1.0 - quarter if x < 0.0 else quarter
        polar[0, n] = math.sqrt(x * x + y * y)
        polar[1, n] = -half if y < 0.0 else half


@jit
def lattice_pressure(
    points: F8, frame: F8, constants: F8, careful: bool, gain: F4, gx: F4, gy: F4,
    nodes: NDArray[np.int64], drive: F4, result: NDArray[np.complex128],
) -> None:  # fmt: skip
    """Set the pressure of a planar lattice of parallel elements, at points in front of it.

    *constants*: aperture radius and absorption (per wavelength), 1 if the elements are baffled.
    *careful*: rounding errors do not average out. *nodes* (nx, ny): the element at each node, -1
    for none. *drive* (2, N): magnitudes, and phases in half turns. r^2 = (x - gx)^2 + z^2 +
    (y - gy)^2 is the sum of one of nx and one of ny rows that are computed once a block.
    """
    size = padded(len(points))
    hi, lo = np.empty((3, size), np.float32), np.empty((3, size), np.float32)
    a, height = np.empty(size, np.float32), np.empty(size, np.float32)
    rows, scratch = np.empty((gy.size, size), np.float32), np.empty((2, size), np.float32)
    t, m = np.zeros((WAVES, size), np.float32), np.empty((WAVES, size), np.float32)
    re, im, loss = np.empty(size, np.float32), np.empty(size, np.float32), np.empty(4, np.float32)
    for start in range(0, len(points), size):
        part = points[start : start + size]
        slow = block(part, frame, constants, careful, hi, lo, loss)
        _lattice_rows(hi, lo, gy, rows, height)
        re[:], im[:] = ZERO, ZERO
        held = 0
        for i in range(gx.size):
            _lattice_column(hi, lo, gx[i], height, a)
            for j in range(gy.size):
                n = nodes[i, j]
                if n >= 0 and drive[0, n] != ZERO:
                    rays(
                        a, rows[j], height, drive[0, n], drive[1, n], gain, loss, slow, scratch,
                        t[held], m[held],
                    )  # fmt: skip
                    held = _held(held, t, m, re, im)
        _add_held(held, t, m, re, im)
        for p in range(len(part)):
            result[start + p] = complex(re[p], im[p])


@jit_inline
def _held(held: Any, t: Any, m: Any, re: Any, im: Any) -> Any:
    """Return how many waves are held after one more: all are added as soon as they are enough."""
    if held + 1 < WAVES:
        return held + 1
    add_waves(t, m, re, im)
    return 0


@jit_inline
def _add_held(held: Any, t: Any, m: Any, re: Any, im: Any) -> Any:
    if held:
        m[held:] = ZERO
        add_waves(t, m, re, im)


@jit_inline
def _hide(ahead: Any, values: Any) -> Any:
    """Set to zero what is behind the element."""
    for p in range(values.size):
        values[p] = values[p] if ahead[p] >= _GRAZING else ZERO


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


@jit_inline
def _lattice_column(hi: Any, lo: Any, gx: Any, height: Any, a: Any) -> Any:
    """Set the sum of the squares of x - gx and of z."""
    for p in range(a.size):
        dx = (hi[0, p] - gx) + lo[0, p]
        a[p] = dx * dx + height[p]


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
    rows, scratch = np.empty((gy.size, size), np.float32), np.empty((2, size), np.float32)
    block(points, frame, constants, True, hi, lo, loss)
    _lattice_rows(hi, lo, gy, rows, height)
    for i in range(gx.size):
        _lattice_column(hi, lo, gx[i], height, a)
        for j in range(gy.size):
            n = nodes[i, j]
            if n >= 0:
                rays(a, rows[j], height, ONE, ZERO, gain, loss, True, scratch, t, m)
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
    offset, scratch = np.empty((4, size), np.float32), np.empty((2, size), np.float32)
    t, m = np.zeros((WAVES, size), np.float32), np.empty((WAVES, size), np.float32)
    re, im, loss = np.empty(size, np.float32), np.empty(size, np.float32), np.empty(4, np.float32)
    for start in range(0, len(points), size):
        part = points[start : start + size]
        slow = block(part, frame, constants, careful, hi, lo, loss)
        re[:], im[:] = ZERO, ZERO
        held = 0
        for n in range(len(elements)):
            if drive[0, n] != ZERO:
                _free_wave(
                    hi, lo, elements[n], drive[0, n], drive[1, n], constants, gain, loss, slow,
                    offset, scratch, t[held], m[held],
                )  # fmt: skip
                held = _held(held, t, m, re, im)
        _add_held(held, t, m, re, im)
        for p in range(len(part)):
            result[start + p] = complex(re[p], im[p])


@jit_inline
def _free_wave(
    hi: Any, lo: Any, s: Any, amplitude: Any, phase: Any, constants: Any, gain: Any, loss: Any,
    careful: Any, offset: Any, scratch: Any, t: Any, m: Any,
) -> Any:  # fmt: skip
    """Fill phase *t* and magnitude *m* of the element with position and normal *s*."""
    _offsets(hi, lo, s, offset)
    rays(
        offset[0], offset[1], offset[2], amplitude, phase, gain, loss, careful, scratch, t, m
    )  # fmt: skip
    if constants[2] != 0.0:
        _hide(offset[3], m)


@jit_inline
def _offsets(hi: Any, lo: Any, s: Any, offset: Any) -> Any:
    """Set the square of x, that of y and z, that along the normal, and the offset along it."""
    x, y, z, xl, yl, zl = hi[0], hi[1], hi[2], lo[0], lo[1], lo[2]
    a, b, height, ahead = offset[0], offset[1], offset[2], offset[3]
    sx, sy, sz, nx, ny, nz = s[0], s[1], s[2], s[3], s[4], s[5]
    for p in range(a.size):
        dx, dy, dz = (x[p] - sx) + xl[p], (y[p] - sy) + yl[p], (z[p] - sz) + zl[p]
        a[p] = dx * dx
        b[p] = dy * dy + dz * dz
        ahead[p] = dx * nx + dy * ny + dz * nz
        height[p] = ahead[p] * ahead[p]


@jit
def free_waves(
    points: F8, frame: F8, constants: F8, gain: F4, elements: F4, waves: F4
) -> None:  # fmt: skip
    """Set the (2, N, B) real and imaginary parts of the propagators to at most `BLOCK` points."""
    size = padded(len(points))
    hi, lo = np.empty((3, size), np.float32), np.empty((3, size), np.float32)
    offset, scratch = np.empty((4, size), np.float32), np.empty((2, size), np.float32)
    t, m, loss = np.empty(size, np.float32), np.empty(size, np.float32), np.empty(4, np.float32)
    block(points, frame, constants, True, hi, lo, loss)
    for n in range(len(elements)):
        _free_wave(
            hi, lo, elements[n], ONE, ZERO, constants, gain, loss, True, offset, scratch, t, m
        )  # fmt: skip
        set_waves(t, m, waves[0, n], waves[1, n])
