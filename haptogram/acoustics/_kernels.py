"""Compiled inner loops; plain arrays in, plain arrays out, nothing is checked here.

Only :mod:`haptogram.acoustics._compiled` imports this module, and only where numba is installed.
Lengths are in wavelengths and phases in half turns, so that r modulo the wavelength is exact.

Each block of points runs through two loops, `_rays_*` and `_add_waves`, with the intermediate
values in the first-level cache. As one loop the chain of dependent operations is longer than what
a core reorders, and it takes a third more time.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final, ParamSpec, TypeVar, cast

import numba
import numpy as np
from numpy.typing import NDArray

P = ParamSpec("P")
R = TypeVar("R")
F4 = NDArray[np.float32]
F8 = NDArray[np.float64]

BLOCK: Final = 512  # points; the buffers of a 16 x 16 array then fill about 40 kB

_GENTLE_LOSS: Final = 0.08  # nepers across a block; a quadratic is then off by at most 3e-6

# Everything of `fastmath` but the reordering of sums, which would cancel the rounding error that
# `_ray` computes on purpose.
_STRICT_SUMS: Final = {"contract", "arcp", "nnan", "ninf", "nsz", "afn"}

# sin(pi t) / t and cos(pi t) as polynomials in t^2, |t| <= 1/2, interpolated at Chebyshev nodes.
SINE: Final = (3.141590270206992, -5.167406733272327, 2.544010518503225, -0.5594624554675743)
COSINE: Final = (
    0.9999999532476083, -4.93479283061961, 4.058411352861943, -1.3318765680770057,
    0.21968961109065893,
)  # fmt: skip

_S0, _S1, _S2, _S3 = (np.float32(value) for value in SINE)
_C0, _C1, _C2, _C3, _C4 = (np.float32(value) for value in COSINE)
_ONE = np.float32(1.0)
_ZERO = np.float32(0.0)
_HALF = np.float32(0.5)


def _numba_jit(**options: Any) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Return `numba.njit` with the types of what it wraps (numba is not typed)."""
    return cast(
        "Callable[[Callable[P, R]], Callable[P, R]]",
        numba.njit(error_model="numpy", cache=True, **options),
    )


jit = _numba_jit(fastmath=_STRICT_SUMS)
jit_inline = _numba_jit(fastmath=_STRICT_SUMS, forceinline=True)
jit_checked = _numba_jit()  # keeps the meaning of NaN
jit_sums = _numba_jit(fastmath=True)  # sums may be reordered, and so vectorised


@jit_inline
def _ray(a: Any, b: Any, phase: Any, careful: Any) -> Any:
    """Return 1/r, r, the arrival phase in [-1/2, 1/2] and the half turns left out, r^2 = a + b."""
    square = a + b
    inverse = _ONE / np.sqrt(square)
    r = square * inverse
    twice = r + r
    turns = np.rint(twice + phase)
    arrival = (twice - turns) + phase
    if careful:
        missing = (a - r * r) + b  # what rounding took from r^2: r + missing / 2r is exact
        arrival += missing * inverse
    return inverse, r, arrival, turns


@jit_inline
def _flip(value: Any, half_turns: Any) -> Any:
    """Return *value* times (-1)^half_turns: the lowest bit moves into the sign."""
    bits = np.float32(value).view(np.int32)
    return np.int32(bits ^ (np.int32(half_turns) << np.int32(31))).view(np.float32)


@jit_inline
def _cos_sin(t: Any) -> Any:
    """Return cosine and sine of pi t, |t| <= 1/2; errors 5e-8 and 1.2e-6."""
    w = t * t
    sine = t * (((_S3 * w + _S2) * w + _S1) * w + _S0)
    cosine = (((_C4 * w + _C3) * w + _C2) * w + _C1) * w + _C0
    return cosine, sine


@jit_inline
def _level(inverse: Any, r: Any, q: Any, gain: Any, loss: Any, careful: Any) -> Any:
    """Return D(cos^2 = q) e^(-alpha r) / r."""
    d0, d1, d2, d3, d4, d5 = gain
    e0, e1, e2, e3 = loss
    slow = (e3 * r + e2) * r + e1 if careful else e2 * r + e1
    return (((((d5 * q + d4) * q + d3) * q + d2) * q + d1) * q + d0) * (e0 * inverse + slow)


@jit_inline
def _wave_lattice(
    a: Any, b: Any, height: Any, phase: Any, gain: Any, loss: Any, careful: Any
) -> Any:
    """Return phase and magnitude of one element of a lattice: its cosine^2 is height / r^2."""
    inverse, r, arrival, turns = _ray(a, b, phase, careful)
    level = _level(inverse, r, height * (inverse * inverse), gain, loss, careful)
    return arrival, _flip(level, turns)


@jit_inline
def _wave_free(
    x: Any, y: Any, z: Any, s: Any, phase: Any, front: Any, gain: Any, loss: Any, careful: Any
) -> Any:
    """Return phase and magnitude of an element anywhere; *s* is its normal."""
    inverse, r, arrival, turns = _ray(x * x, y * y + z * z, phase, careful)
    nx, ny, nz = s
    cosine = (x * nx + y * ny + z * nz) * inverse
    level = _level(inverse, r, cosine * cosine, gain, loss, careful)
    return arrival, _flip(level if cosine >= front else _ZERO, turns)


@jit_inline
def _rays_lattice(
    a: Any, b: Any, height: Any, amplitude: Any, phase: Any, gain: Any, loss: Any, careful: Any,
    t: Any, m: Any,
) -> Any:  # fmt: skip
    """Fill phase *t* and magnitude *m* of one element of a lattice at a block of points.

    *careful* chooses between two loops here, since inside of one the compiler would compute both.
    """
    gains, losses = _gains(gain), _losses(loss, amplitude)
    if careful:
        for p in range(a.size):
            t[p], m[p] = _wave_lattice(a[p], b[p], height[p], phase, gains, losses, True)
    else:
        for p in range(a.size):
            t[p], m[p] = _wave_lattice(a[p], b[p], height[p], phase, gains, losses, False)


@jit_inline
def _rays_free(
    hi: Any, lo: Any, s: Any, amplitude: Any, phase: Any, front: Any, gain: Any, loss: Any,
    careful: Any, t: Any, m: Any,
) -> Any:  # fmt: skip
    """Fill phase *t* and magnitude *m* of an element anywhere: *s* is its position and normal."""
    gains, losses, normal = _gains(gain), _losses(loss, amplitude), (s[3], s[4], s[5])
    sx, sy, sz = s[0], s[1], s[2]
    x, y, z, xl, yl, zl = hi[0], hi[1], hi[2], lo[0], lo[1], lo[2]
    if careful:
        for p in range(x.size):
            dx, dy, dz = (x[p] - sx) + xl[p], (y[p] - sy) + yl[p], (z[p] - sz) + zl[p]
            t[p], m[p] = _wave_free(dx, dy, dz, normal, phase, front, gains, losses, True)
    else:
        for p in range(x.size):
            dx, dy, dz = (x[p] - sx) + xl[p], (y[p] - sy) + yl[p], (z[p] - sz) + zl[p]
            t[p], m[p] = _wave_free(dx, dy, dz, normal, phase, front, gains, losses, False)


@jit_inline
def _gains(gain: Any) -> Any:
    return gain[0], gain[1], gain[2], gain[3], gain[4], gain[5]


@jit_inline
def _losses(loss: Any, amplitude: Any) -> Any:
    return loss[0] * amplitude, loss[1] * amplitude, loss[2] * amplitude, loss[3] * amplitude


@jit_inline
def _add_waves(t: Any, m: Any, re: Any, im: Any) -> Any:
    for p in range(t.size):
        cosine, sine = _cos_sin(t[p])
        re[p] = re[p] + m[p] * cosine
        im[p] = im[p] + m[p] * sine


@jit_inline
def _set_waves(t: Any, m: Any, re: Any, im: Any) -> Any:
    for p in range(t.size):
        cosine, sine = _cos_sin(t[p])
        re[p] = m[p] * cosine
        im[p] = m[p] * sine


@jit
def _loss(absorption: float, near: float, far: float, careful: bool, loss: F4) -> None:
    """Set the cubic in r that meets exp(-absorption r) at the Chebyshev nodes of [near, far].

    Not *careful*: the quadratic at three nodes.
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


@jit
def _block(points: F8, frame: F8, constants: F8, careful: bool, hi: F4, lo: F4, loss: F4) -> bool:
    """Express a block of points in the array's frame as float32 pairs; fit the loss over it.

    *frame* is (4, 3): three axes over the wavelength, and the origin. The part of the block beyond
    the last point repeats it. Returns whether care is needed: asked for, or for the loss.
    """
    near, far = 1e30, 0.0
    count = len(points)
    for p in range(count):
        u, v, w = points[p, 0] - frame[3, 0], points[p, 1] - frame[3, 1], points[p, 2] - frame[3, 2]
        square = 0.0
        for i in range(3):
            value = frame[i, 0] * u + frame[i, 1] * v + frame[i, 2] * w
            hi[i, p] = value
            lo[i, p] = value - np.float64(hi[i, p])
            square += value * value
        near, far = min(near, square), max(far, square)
    for p in range(count, hi.shape[1]):
        for i in range(3):
            hi[i, p], lo[i, p] = hi[i, count - 1], lo[i, count - 1]
    radius, absorption = constants[0], constants[1]
    near, far = max(math.sqrt(near) - radius, 0.0), math.sqrt(far) + radius
    careful = careful or absorption * (far - near) > _GENTLE_LOSS
    _loss(absorption, near, far, careful, loss)
    return careful


@jit_checked
def usable_points(
    points: F8, positions: F8, bounds: F8, reach: float, clearance: float,
    usable: NDArray[np.bool_],
) -> int:  # fmt: skip
    """Mark the points that single precision serves; return how many it does not.

    *bounds*: centre of the array (3), half-sizes of the box around it that holds every point near
    an element (3). In metres, like *reach*, the largest distance from the centre, and *clearance*,
    the smallest distance from an element. NaN is never usable.
    """
    limit, inside, served = reach * reach, 0, 0
    for p in range(len(points)):  # no branch, so that it is vectorised
        u, v, w = points[p, 0] - bounds[0], points[p, 1] - bounds[1], points[p, 2] - bounds[2]
        usable[p] = u * u + v * v + w * w <= limit
        served += usable[p]
        inside += (abs(u) < bounds[3]) & (abs(v) < bounds[4]) & (abs(w) < bounds[5])
    if inside:
        served = 0
        for p in range(len(points)):
            box = True
            for i in range(3):
                box = box and abs(points[p, i] - bounds[i]) < bounds[3 + i]
            if box and usable[p]:
                usable[p] = _nearest_square(points[p], positions) >= clearance * clearance
            served += usable[p]
    return len(points) - served


@jit_checked
def _nearest_square(point: F8, positions: F8) -> float:
    nearest = np.inf
    for n in range(len(positions)):
        square = 0.0
        for i in range(3):
            square += (point[i] - positions[n, i]) ** 2
        nearest = min(nearest, square)
    return nearest


@jit_checked
def polar_form(drive: NDArray[np.complex128], polar: F4) -> None:
    """Set the magnitudes and the phases, in half turns, of a drive."""
    for n in range(len(drive)):
        polar[0, n] = math.hypot(drive[n].real, drive[n].imag)
        polar[1, n] = math.atan2(drive[n].imag, drive[n].real) / math.pi


@jit
def _padded(count: int) -> int:
    """Return the length of the equal blocks of *count* points: whole vectors of up to 16 values."""
    blocks = max(1, (count + BLOCK - 1) // BLOCK)
    return max(16, (count + 16 * blocks - 1) // (16 * blocks) * 16)


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
    size = _padded(len(points))
    hi, lo = np.empty((3, size), np.float32), np.empty((3, size), np.float32)
    a, t, m = np.empty(size, np.float32), np.empty(size, np.float32), np.empty(size, np.float32)
    height, loss = np.empty(size, np.float32), np.empty(4, np.float32)
    rows = np.empty((gy.size, size), np.float32)
    re, im = np.empty(size, np.float32), np.empty(size, np.float32)
    for start in range(0, len(points), size):
        part = points[start : start + size]
        slow = _block(part, frame, constants, careful, hi, lo, loss)
        _lattice_rows(hi, lo, gy, rows, height)
        re[:] = _ZERO
        im[:] = _ZERO
        for i in range(gx.size):
            for p in range(size):
                dx = (hi[0, p] - gx[i]) + lo[0, p]
                a[p] = dx * dx + height[p]
            for j in range(gy.size):
                n = nodes[i, j]
                if n >= 0 and drive[0, n] != _ZERO:
                    _rays_lattice(
                        a, rows[j], height, drive[0, n], drive[1, n], gain, loss, slow, t, m
                    )
                    _add_waves(t, m, re, im)
        for p in range(len(part)):
            behind = constants[2] != 0.0 and hi[2, p] < _ZERO
            result[start + p] = 0.0 if behind else complex(re[p], im[p])


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
    size = _padded(len(points))
    hi, lo = np.empty((3, size), np.float32), np.empty((3, size), np.float32)
    a, t, m = np.empty(size, np.float32), np.empty(size, np.float32), np.empty(size, np.float32)
    height, loss = np.empty(size, np.float32), np.empty(4, np.float32)
    rows = np.empty((gy.size, size), np.float32)
    _block(points, frame, constants, True, hi, lo, loss)
    _lattice_rows(hi, lo, gy, rows, height)
    for i in range(gx.size):
        for p in range(size):
            dx = (hi[0, p] - gx[i]) + lo[0, p]
            a[p] = dx * dx + height[p]
        for j in range(gy.size):
            n = nodes[i, j]
            if n >= 0:
                _rays_lattice(a, rows[j], height, _ONE, _ZERO, gain, loss, True, t, m)
                if constants[2] != 0.0:
                    for p in range(size):
                        m[p] = m[p] if hi[2, p] >= _ZERO else _ZERO
                _set_waves(t, m, waves[0, n], waves[1, n])


@jit
def free_pressure(
    points: F8, frame: F8, constants: F8, careful: bool, gain: F4, elements: F4, drive: F4,
    result: NDArray[np.complex128],
) -> None:  # fmt: skip
    """Set the pressure of elements at any place with any normal.

    *elements* (N, 6): positions over the wavelength and normals, in the frame; *drive* (2, N).
    """
    size = _padded(len(points))
    hi, lo = np.empty((3, size), np.float32), np.empty((3, size), np.float32)
    t, m, loss = np.empty(size, np.float32), np.empty(size, np.float32), np.empty(4, np.float32)
    re, im = np.empty(size, np.float32), np.empty(size, np.float32)
    front = np.float32(0.0 if constants[2] != 0.0 else -2.0)
    for start in range(0, len(points), size):
        part = points[start : start + size]
        slow = _block(part, frame, constants, careful, hi, lo, loss)
        re[:] = _ZERO
        im[:] = _ZERO
        for n in range(len(elements)):
            if drive[0, n] != _ZERO:
                _rays_free(
                    hi, lo, elements[n], drive[0, n], drive[1, n], front, gain, loss, slow, t, m
                )
                _add_waves(t, m, re, im)
        for p in range(len(part)):
            result[start + p] = complex(re[p], im[p])


@jit
def free_waves(
    points: F8, frame: F8, constants: F8, gain: F4, elements: F4, waves: F4
) -> None:  # fmt: skip
    """Set the (2, N, B) real and imaginary parts of the propagators to at most `BLOCK` points."""
    size = _padded(len(points))
    hi, lo = np.empty((3, size), np.float32), np.empty((3, size), np.float32)
    t, m, loss = np.empty(size, np.float32), np.empty(size, np.float32), np.empty(4, np.float32)
    front = np.float32(0.0 if constants[2] != 0.0 else -2.0)
    _block(points, frame, constants, True, hi, lo, loss)
    for n in range(len(elements)):
        _rays_free(hi, lo, elements[n], _ONE, _ZERO, front, gain, loss, True, t, m)
        _set_waves(t, m, waves[0, n], waves[1, n])


@jit
def focus_codes(
    targets: F8, frame: F8, places: F4, code_steps: int, codes: NDArray[np.uint8]
) -> None:
    """Set the phase codes -r steps (mod steps) that focus on each target; *places* is (3, N).

    The rows and columns of a lattice would save three operations of twenty, and cost more than
    that in short loops.
    """
    scale, mask = np.float32(-code_steps), np.int32(code_steps - 1)
    for i in range(len(targets)):
        x, y, z = _place(targets[i], frame)
        _codes(places[0], places[1], places[2], x, y, z, scale, mask, codes[i])


@jit_inline
def _place(target: Any, frame: Any) -> Any:
    """Return the coordinates of *target* in the frame, in wavelengths."""
    u, v, w = target[0] - frame[3, 0], target[1] - frame[3, 1], target[2] - frame[3, 2]
    return (
        np.float32(frame[0, 0] * u + frame[0, 1] * v + frame[0, 2] * w),
        np.float32(frame[1, 0] * u + frame[1, 1] * v + frame[1, 2] * w),
        np.float32(frame[2, 0] * u + frame[2, 1] * v + frame[2, 2] * w),
    )


@jit_inline
def _codes(
    px: Any, py: Any, pz: Any, x: Any, y: Any, z: Any, scale: Any, mask: Any, codes: Any
) -> Any:
    for n in range(px.size):
        dx, dy, dz = x - px[n], y - py[n], z - pz[n]
        r = np.sqrt(dx * dx + dy * dy + dz * dz)
        # Through an integer: casting a negative float to uint8 is undefined.
        codes[n] = np.uint8(np.int32(np.floor(r * scale + _HALF)) & mask)


@jit_sums
def _coherent_phase(phases: Any, places: Any, x: Any, y: Any, z: Any) -> Any:
    """Return the phase, in turns, of the sum of all arrivals, magnitudes aside."""
    re, im = _ZERO, _ZERO
    px, py, pz = places[0], places[1], places[2]
    for n in range(phases.size):
        dx, dy, dz = x - px[n], y - py[n], z - pz[n]
        square = dx * dx + dy * dy + dz * dz
        twice = np.float32(2.0) * (square * (_ONE / np.sqrt(square)) + phases[n])
        turns = np.rint(twice)
        cosine, sine = _cos_sin(twice - turns)
        sign = _flip(_ONE, turns)
        re += sign * cosine
        im += sign * sine
    return np.float32(math.atan2(im, re) / (2.0 * math.pi))


@jit_sums
def _normal_equations(
    phases: Any, places: Any, x: Any, y: Any, z: Any, common: Any, sums: Any
) -> Any:
    """Sum products of the slopes u (less those at the origin) and the residuals e, in turns."""
    r0 = np.sqrt(x * x + y * y + z * z)
    cx, cy, cz = x / r0, y / r0, z / r0
    xx, xy, xz, yy, yz, zz = _ZERO, _ZERO, _ZERO, _ZERO, _ZERO, _ZERO
    sx, sy, sz, ex, ey, ez, se, ee = _ZERO, _ZERO, _ZERO, _ZERO, _ZERO, _ZERO, _ZERO, _ZERO
    px, py, pz = places[0], places[1], places[2]
    for n in range(phases.size):
        dx, dy, dz = x - px[n], y - py[n], z - pz[n]
        square = dx * dx + dy * dy + dz * dz
        inverse = _ONE / np.sqrt(square)
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


@jit
def _gauss_newton_step(sums: F8, count: int, step: F8) -> None:
    """Solve the normal equations, the common phase eliminated, for the step in wavelengths.

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


@jit
def fit_phases(
    codes: NDArray[np.uint8], order: NDArray[np.int64], places: F4, frame: F8,
    start: tuple[float, float, float], code_steps: int, count: int, max_steps: int, result: F8,
) -> None:  # fmt: skip
    """Fit a focus to the codes of the first *count* elements of *order*; *places* is (3, N) alike.

    *result*: position (m), common phase and RMS residual (rad), steps taken, 1 if converged,
    distance from the nearest of the elements (m).
    """
    phases = np.empty(count, np.float32)
    scale = np.float32(1.0) / np.float32(code_steps)
    for n in range(count):
        phases[n] = np.float32(codes[order[n]]) * scale
    sums, step = np.empty(14), np.empty(3)
    x, y, z = _place(start, frame)
    common = _coherent_phase(phases, places, x, y, z)
    taken, converged, longest = 0, False, 2.5
    while taken < max_steps and not converged:
        _normal_equations(phases, places, x, y, z, common, sums)
        _gauss_newton_step(sums, count, step)
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
    for i in range(3):
        value = frame[0, i] * x + frame[1, i] * y + frame[2, i] * z
        result[i] = frame[3, i] + value * wavelength_square
    result[3] = 2.0 * math.pi * common
    mean = sums[9] / count
    result[4] = 2.0 * math.pi * math.sqrt(max(sums[13] / count - mean * mean, 0.0))
    result[5], result[6] = taken, converged
    result[7] = math.sqrt(_least_square(places, x, y, z, count) * wavelength_square)


@jit_sums
def _least_square(places: Any, x: Any, y: Any, z: Any, count: Any) -> Any:
    least = np.float32(1e30)
    px, py, pz = places[0], places[1], places[2]
    for n in range(count):
        dx, dy, dz = x - px[n], y - py[n], z - pz[n]
        least = min(least, dx * dx + dy * dy + dz * dz)
    return least


@jit
def best_cell(score: F4, cells: F8, apart: F8) -> int:
    """Return the cell of the highest score; take it and those nearer than *apart* out."""
    best = 0
    for c in range(score.size):
        if score[c] > score[best]:
            best = c
    limit = apart[best] * apart[best]
    x, y, z = cells[0, best], cells[1, best], cells[2, best]
    for c in range(score.size):
        u, v, w = cells[0, c] - x, cells[1, c] - y, cells[2, c] - z
        score[c] = -_ONE if u * u + v * v + w * w <= limit else score[c]
    return best


@jit
def cell_scores(
    codes: NDArray[np.uint8], order: NDArray[np.int64], phasors: F4, code_steps: int
) -> F4:
    """Return |sum of e^(j (phi + k r))|^2 at each cell.

    *phasors* (2, S, C): e^(j k r) of the first S elements of *order*.
    """
    re = np.zeros(phasors.shape[2], np.float32)
    im = np.zeros(phasors.shape[2], np.float32)
    for n in range(phasors.shape[1]):
        angle = 2.0 * math.pi * codes[order[n]] / code_steps
        cosine, sine = np.float32(math.cos(angle)), np.float32(math.sin(angle))
        _turn_and_add(phasors[0, n], phasors[1, n], cosine, sine, re, im)
    return re * re + im * im


@jit_inline
def _turn_and_add(pr: Any, pi: Any, cosine: Any, sine: Any, re: Any, im: Any) -> Any:
    for c in range(re.size):
        re[c] = re[c] + pr[c] * cosine - pi[c] * sine
        im[c] = im[c] + pr[c] * sine + pi[c] * cosine


@jit
def weighted_gerchberg_saxton(
    re: F4, im: F4, wanted: F4, rounds: int, drive_re: F4, drive_im: F4
) -> None:
    """Turn the phases of a drive of unit magnitude until the points are equally well served.

    *re*, *im* (F, N): propagators; *wanted* (F,): relative amplitudes of the points. The weight of
    a point grows by mean / own of |p| / wanted in each round.
    """
    count = len(wanted)
    weight = wanted.copy()
    pressure = np.empty((2, count), np.float32)
    for _ in range(rounds):
        mean = _ZERO
        for i in range(count):
            pressure[0, i], pressure[1, i] = _received(re[i], im[i], drive_re, drive_im)
            p, q = pressure[0, i], pressure[1, i]
            mean += np.sqrt(p * p + q * q) / wanted[i]
        mean /= np.float32(count)
        drive_re[:] = _ZERO
        drive_im[:] = _ZERO
        for i in range(count):
            p, q = pressure[0, i], pressure[1, i]
            level = np.sqrt(p * p + q * q) + np.float32(1e-30)
            weight[i] *= mean * wanted[i] / level
            _send_back(
                re[i], im[i], weight[i] * p / level, weight[i] * q / level, drive_re, drive_im
            )
        _normalise(drive_re, drive_im)


@jit_sums
def _received(re: Any, im: Any, drive_re: Any, drive_im: Any) -> Any:
    p, q = _ZERO, _ZERO
    for n in range(re.size):
        p += re[n] * drive_re[n] - im[n] * drive_im[n]
        q += re[n] * drive_im[n] + im[n] * drive_re[n]
    return p, q


@jit_inline
def _send_back(re: Any, im: Any, p: Any, q: Any, drive_re: Any, drive_im: Any) -> Any:
    """Add conj(g) (p + j q)."""
    for n in range(re.size):
        drive_re[n] = drive_re[n] + re[n] * p + im[n] * q
        drive_im[n] = drive_im[n] + re[n] * q - im[n] * p


@jit_inline
def _normalise(drive_re: Any, drive_im: Any) -> Any:
    for n in range(drive_re.size):
        square = drive_re[n] * drive_re[n] + drive_im[n] * drive_im[n] + np.float32(1e-30)
        scale = _ONE / np.sqrt(square)
        drive_re[n] = drive_re[n] * scale
        drive_im[n] = drive_im[n] * scale
