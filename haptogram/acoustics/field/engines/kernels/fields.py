"""Fields and propagators of lattices and of elements anywhere."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics.field.engines.kernels.blocks import (
    F4,
    F8,
    block_kernel,
    padded_block_length,
)
from haptogram.acoustics.field.engines.kernels.jit import jit_entry, jit_inline
from haptogram.acoustics.field.engines.kernels.waves import (
    ONE,
    WAVES,
    ZERO,
    add_waves_kernel,
    arctangent_kernel,
    rays_kernel,
    set_waves_kernel,
    waves_kernel,
)

# Wavelengths by which rounding may put a point behind an element in whose plane it is.
_ROUNDING = np.float32(1e-5)


@jit_entry
def polar_form_kernel(drive: NDArray[np.complex128], polar: F4) -> None:
    """Set the magnitudes and the phases, in half turns, of a drive."""
    for n in range(drive.size):
        x, y = drive[n].real, drive[n].imag
        large, small = max(abs(x), abs(y)), min(abs(x), abs(y))
        eighth = arctangent_kernel(small / max(large, 1e-300))
        quarter = 0.5 - eighth if abs(y) > abs(x) else eighth
        half = 1.0 - quarter if x < 0.0 else quarter
        polar[0, n] = math.sqrt(x * x + y * y)
        polar[1, n] = -half if y < 0.0 else half


@jit_entry
def lattice_pressure_kernel(
    points: F8, frame: F8, constants: F8, careful: bool, gain: F4, gx: F8, gy: F8,
    nodes: NDArray[np.int64], drive: F4, result: NDArray[np.complex128],
) -> None:  # fmt: skip
    """Set the pressure of a planar lattice of parallel elements, at points in front of it.

    *constants*: aperture radius and absorption (per wavelength), least cosine that has sound.
    *careful*: rounding errors do not average out. *nodes* (nx, ny): the element at each node, -1
    for none. *drive* (2, N): magnitudes, and phases in half turns. r^2 = (x - gx)^2 + z^2 +
    (y - gy)^2 is the sum of one of nx and one of ny rows that are computed once a block.
    """
    size = padded_block_length(len(points))
    places, depth, height = np.empty((3, size)), np.empty(size), np.empty(size, np.float32)
    rows, a = np.empty((2, gy.size, size), np.float32), np.empty((2, size), np.float32)
    scratch, sums = np.empty((2, size), np.float32), np.empty((2, size), np.float32)
    t, m = np.zeros((WAVES, size), np.float32), np.empty((WAVES, size), np.float32)
    loss = np.empty(4, np.float32)
    for start in range(0, len(points), size):
        part = points[start : start + size]
        # A choice inside the loops would slow both of its sides down.
        if block_kernel(part, frame, constants, careful, places, loss):
            _lattice_block_kernel(
                places, True, gain, loss, gx, gy, nodes, drive, depth, height, rows, a, scratch, t,
                m, sums,
            )  # fmt: skip
        else:
            _lattice_block_kernel(
                places, False, gain, loss, gx, gy, nodes, drive, depth, height, rows, a, scratch,
                t, m, sums,
            )  # fmt: skip
        for p in range(len(part)):
            result[start + p] = complex(sums[0, p], sums[1, p])


@jit_inline
def _lattice_block_kernel(
    places: Any, careful: Any, gain: Any, loss: Any, gx: Any, gy: Any, nodes: Any, drive: Any,
    depth: Any, height: Any, rows: Any, a: Any, scratch: Any, t: Any, m: Any, sums: Any,
) -> Any:  # fmt: skip
    """Set *sums* (2, B), real and imaginary pressure (Pa) of a lattice at *places* (3, B).

    Lengths are in wavelengths. *nodes* (nx, ny): the element in the column *gx*, row *gy*; -1 for
    none. *drive* (2, N): magnitudes, phases in half turns. *gain* (6,), *loss* (4,): coefficients
    of directivity, in Pa, and absorption. *careful*: r^2 is corrected by its rounding error. The
    arguments from *depth* to *m* are scratch.
    """
    re, im = sums[0], sums[1]
    re[:], im[:] = ZERO, ZERO
    _lattice_rows_kernel(places, gy, careful, rows, depth, height)
    held = 0
    for i in range(gx.size):
        _squares_kernel(places[0], gx[i], depth, careful, a[0], a[1])
        for j in range(gy.size):
            n = nodes[i, j]
            if n >= 0 and drive[0, n] != ZERO:
                rays_kernel(
                    a[0], rows[0, j], a[1], rows[1, j], height, drive[0, n], drive[1, n], careful,
                    gain, loss, scratch, t[held], m[held],
                )  # fmt: skip
                held = _held_kernel(held, t, m, re, im)
    _add_held_kernel(held, t, m, re, im)


@jit_inline
def _held_kernel(held: Any, t: Any, m: Any, re: Any, im: Any) -> Any:
    """Return how many waves the buffer *t* (phases), *m* (magnitudes) holds after one more.

    *held* are those before it. A buffer that is full is added to the sums *re*, *im*, and 0
    returned.
    """
    if held + 1 < WAVES:
        return held + 1
    add_waves_kernel(t, m, re, im)
    return 0


@jit_inline
def _add_held_kernel(held: Any, t: Any, m: Any, re: Any, im: Any) -> Any:
    """Add the first *held* waves of the buffer *t* (phases), *m* (magnitudes) to *re*, *im*."""
    if held:
        m[held:] = ZERO
        add_waves_kernel(t, m, re, im)


@jit_inline
def _lattice_rows_kernel(
    places: F8, gy: F8, careful: bool, rows: F4, depth: F8, height: F4
) -> None:  # fmt: skip
    """Set *rows* (2, ny, B) to (y - gy)^2 of each point from each row of the lattice.

    The second part of *rows* is the rounding error of the first, set where *careful*. *depth* (B,)
    gets z^2 of the points, *height* (B,) the same in single precision.
    """
    depth[:] = 0.0
    for j in range(gy.size):
        _squares_kernel(places[1], gy[j], depth, careful, rows[0, j], rows[1, j])
    for p in range(height.size):
        depth[p] = places[2, p] * places[2, p]
        height[p] = depth[p]


@jit_inline
def _squares_kernel(x: Any, s: Any, rest: Any, careful: Any, high: Any, low: Any) -> Any:
    """Set *high* to (x - s)^2 + *rest*; if *careful*, set *low* to what its rounding took."""
    for p in range(x.size):
        high[p] = (x[p] - s) * (x[p] - s) + rest[p]
    if careful:
        for p in range(x.size):
            low[p] = (x[p] - s) * (x[p] - s) + rest[p] - np.float64(high[p])


@jit_entry
def lattice_waves_kernel(
    points: F8, frame: F8, constants: F8, gain: F4, gx: F8, gy: F8, nodes: NDArray[np.int64],
    waves: F4,
) -> None:  # fmt: skip
    """Set the (2, N, B) real and imaginary parts of the propagators to at most `BLOCK` points.

    *nodes* (nx, ny): the element at each node, -1 for none.
    """
    size = padded_block_length(len(points))
    places, depth, height = np.empty((3, size)), np.empty(size), np.empty(size, np.float32)
    rows, a = np.empty((2, gy.size, size), np.float32), np.empty((2, size), np.float32)
    scratch = np.empty((2, size), np.float32)
    t, m, loss = np.empty(size, np.float32), np.empty(size, np.float32), np.empty(4, np.float32)
    block_kernel(points, frame, constants, True, places, loss)
    _lattice_rows_kernel(places, gy, True, rows, depth, height)
    for i in range(gx.size):
        _squares_kernel(places[0], gx[i], depth, True, a[0], a[1])
        for j in range(gy.size):
            n = nodes[i, j]
            if n >= 0:
                rays_kernel(
                    a[0], rows[0, j], a[1], rows[1, j], height, ONE, ZERO, True, gain, loss,
                    scratch, t, m,
                )  # fmt: skip
                set_waves_kernel(t, m, waves[0, n], waves[1, n])


@jit_entry
def free_pressure_kernel(
    points: F8, frame: F8, constants: F8, careful: bool, gain: F4, elements: F8, flat: bool,
    drive: F4, result: NDArray[np.complex128],
) -> None:  # fmt: skip
    """Set the pressure of elements at any place with any normal.

    *elements* (N, 6): positions over the wavelength and normals, in the frame; *flat*: all lie in
    its plane and look along its z, and every point is in front of them. *drive* (2, N).
    """
    size = padded_block_length(len(points))
    places, pairs = np.empty((3, size)), np.empty((6, size), np.float32)
    offset, scratch = np.zeros((5, size), np.float32), np.empty((2, size), np.float32)
    t, m = np.zeros((WAVES, size), np.float32), np.empty((WAVES, size), np.float32)
    sums, loss = np.empty((2, size), np.float32), np.empty(4, np.float32)
    for start in range(0, len(points), size):
        part = points[start : start + size]
        slow = block_kernel(part, frame, constants, careful, places, loss)
        _split_kernel(places, pairs)
        if slow:
            _free_block_kernel(
                places, pairs, True, False, constants, gain, loss, elements, drive, offset,
                scratch, t, m, sums,
            )  # fmt: skip
        elif flat:
            for p in range(size):
                offset[2, p] = places[2, p] * places[2, p]
            _free_block_kernel(
                places, pairs, False, True, constants, gain, loss, elements, drive, offset,
                scratch, t, m, sums,
            )  # fmt: skip
        else:
            _free_block_kernel(
                places, pairs, False, False, constants, gain, loss, elements, drive, offset,
                scratch, t, m, sums,
            )  # fmt: skip
        for p in range(len(part)):
            result[start + p] = complex(sums[0, p], sums[1, p])


@jit_inline
def _free_block_kernel(
    places: Any, pairs: Any, careful: Any, flat: Any, constants: Any, gain: Any, loss: Any,
    elements: Any, drive: Any, offset: Any, scratch: Any, t: Any, m: Any, sums: Any,
) -> Any:  # fmt: skip
    """Set *sums* (2, B): real and imaginary pressure (Pa) of elements anywhere at *places* (3, B).

    Lengths are in wavelengths; *pairs* (6, B): *places* split. *constants*: aperture radius,
    absorption, least cosine that has sound; *gain* (6,), *loss* (4,): coefficients of directivity
    (Pa) and absorption. *elements* (N, 6): position, normal. *drive* (2, N): magnitudes, phases in
    half turns. *offset* to *m*: scratch. *careful*: double precision; *flat*: all in one plane.
    """
    re, im = sums[0], sums[1]
    re[:], im[:] = ZERO, ZERO
    held = 0
    for n in range(len(elements)):
        if drive[0, n] != ZERO:
            _free_wave_kernel(
                places, pairs, elements[n], drive[0, n], drive[1, n], careful, flat, constants,
                gain, loss, offset, scratch, t[held], m[held],
            )  # fmt: skip
            held = _held_kernel(held, t, m, re, im)
    _add_held_kernel(held, t, m, re, im)


@jit_inline
def _split_kernel(places: F8, pairs: F4) -> None:
    """Split *places* (3, B) into float32 *pairs* (6, B): three high parts, then three low parts."""
    for i in range(3):
        for p in range(places.shape[1]):
            pairs[i, p] = places[i, p]
            pairs[3 + i, p] = places[i, p] - np.float64(pairs[i, p])


@jit_inline
def _free_wave_kernel(
    places: Any, pairs: Any, s: Any, amplitude: Any, phase: Any, careful: Any, flat: Any,
    constants: Any, gain: Any, loss: Any, offset: Any, scratch: Any, t: Any, m: Any,
) -> Any:  # fmt: skip
    """Set phase *t* (half turns) and magnitude *m*, (B,) each, of the wave of an element at *s*.

    *s* (6,): position and normal; the other arguments, and units, are those of
    `_free_block_kernel`. *careful* (double precision) and *flat* (one plane for all elements) are
    constants where it is inlined; where *flat*, z^2 of the points is in *offset*.
    """
    square, low, height, ahead, none = offset[0], offset[1], offset[2], offset[3], offset[4]
    if flat:
        _flat_lengths_kernel(pairs, s, height, scratch[0], scratch[1])
        waves_kernel(height, amplitude, phase, False, gain, loss, scratch, t, m)
        return
    if careful:
        _exact_offsets_kernel(places, s, square, low, height, ahead)
    else:
        _offsets_kernel(pairs, s, square, height, ahead)
    rays_kernel(
        square, none, low, none, height, amplitude, phase, careful, gain, loss, scratch, t, m
    )  # fmt: skip
    front, rounding, r = np.float32(constants[2]), ZERO if careful else _ROUNDING, scratch[0]
    for p in range(r.size):
        m[p] = m[p] if ahead[p] >= front * r[p] - rounding else ZERO


@jit_inline
def _flat_lengths_kernel(pairs: Any, s: Any, height: Any, r: Any, inverse: Any) -> Any:
    """Set distances *r* and 1/r (B,) of points from an element of a flat array, in wavelengths.

    *pairs* (6, B): the points; *s* (6,): position and normal of the element; *height* (B,): z^2.
    """
    x, y, x_low, y_low = pairs[0], pairs[1], pairs[3], pairs[4]
    sx, sy = np.float32(s[0]), np.float32(s[1])
    for p in range(r.size):
        dx, dy = (x[p] - sx) + x_low[p], (y[p] - sy) + y_low[p]
        square = dx * dx + (dy * dy + height[p])
        inverse[p] = ONE / np.sqrt(square)
        r[p] = square * inverse[p]


@jit_inline
def _offsets_kernel(pairs: Any, s: Any, square: Any, height: Any, ahead: Any) -> Any:
    """Set *square* (r^2), *ahead* (along the normal) and *height* (its square) of points.

    *pairs* (6, B): the points; *s* (6,): position and normal of the element; all in wavelengths.
    """
    x, y, z, x_low, y_low, z_low = pairs[0], pairs[1], pairs[2], pairs[3], pairs[4], pairs[5]
    sx, sy, sz = np.float32(s[0]), np.float32(s[1]), np.float32(s[2])
    nx, ny, nz = np.float32(s[3]), np.float32(s[4]), np.float32(s[5])
    for p in range(x.size):
        dx, dy, dz = (x[p] - sx) + x_low[p], (y[p] - sy) + y_low[p], (z[p] - sz) + z_low[p]
        square[p] = dx * dx + dy * dy + dz * dz
        ahead[p] = dx * nx + dy * ny + dz * nz
        height[p] = ahead[p] * ahead[p]


@jit_inline
def _exact_offsets_kernel(
    places: Any, s: Any, square: Any, low: Any, height: Any, ahead: Any
) -> Any:  # fmt: skip
    """Set *square* (r^2), *ahead* (along the normal) and *height*, its square, in double precision.

    *places* (3, B): the points; *s* (6,): position and normal of the element; all in wavelengths.
    *low* gets what rounding to single precision takes from r^2.
    """
    x, y, z = places[0], places[1], places[2]
    for p in range(x.size):
        dx, dy, dz = x[p] - s[0], y[p] - s[1], z[p] - s[2]
        exact = dx * dx + dy * dy + dz * dz
        square[p] = exact
        low[p] = exact - np.float64(square[p])
        ahead[p] = dx * s[3] + dy * s[4] + dz * s[5]
        height[p] = ahead[p] * ahead[p]


@jit_entry
def free_waves_kernel(
    points: F8, frame: F8, constants: F8, gain: F4, elements: F8, waves: F4
) -> None:  # fmt: skip
    """Set the (2, N, B) real and imaginary parts of the propagators to at most `BLOCK` points."""
    size = padded_block_length(len(points))
    places, pairs = np.empty((3, size)), np.empty((6, size), np.float32)
    offset, scratch = np.zeros((5, size), np.float32), np.empty((2, size), np.float32)
    t, m, loss = np.empty(size, np.float32), np.empty(size, np.float32), np.empty(4, np.float32)
    block_kernel(points, frame, constants, True, places, loss)
    _split_kernel(places, pairs)
    for n in range(len(elements)):
        _free_wave_kernel(
            places, pairs, elements[n], ONE, ZERO, True, False, constants, gain, loss, offset,
            scratch, t, m,
        )  # fmt: skip
        set_waves_kernel(t, m, waves[0, n], waves[1, n])
