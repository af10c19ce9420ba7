"""The wave of one element at many points: distance, phase, magnitude, sine and cosine.

Each block of points runs through two loops, `rays_*` and `add_waves`, with the intermediate values
in the first-level cache. As one loop the chain of dependent operations is longer than what a core
reorders, and it takes a third more time.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from haptogram.acoustics._kernels._jit import jit_inline

WAVES: Final = 4  # elements that are added at a time: a sum is loaded and stored once for all

# sin(pi t) / t and cos(pi t) as polynomials in t^2, |t| <= 1/2, interpolated at Chebyshev nodes.
SINE: Final = (3.141590270206992, -5.167406733272327, 2.544010518503225, -0.5594624554675743)
COSINE: Final = (
    0.9999999532476083, -4.93479283061961, 4.058411352861943, -1.3318765680770057,
    0.21968961109065893,
)  # fmt: skip

_S0, _S1, _S2, _S3 = (np.float32(value) for value in SINE)
_C0, _C1, _C2, _C3, _C4 = (np.float32(value) for value in COSINE)
ONE = np.float32(1.0)
ZERO = np.float32(0.0)
HALF = np.float32(0.5)


@jit_inline
def _ray(a: Any, b: Any, phase: Any, careful: Any) -> Any:
    """Return 1/r, r, the arrival phase in [-1/2, 1/2] and the half turns left out, r^2 = a + b."""
    square = a + b
    inverse = ONE / np.sqrt(square)
    r = square * inverse
    twice = r + r
    turns = np.rint(twice + phase)
    arrival = (twice - turns) + phase
    if careful:
        missing = (a - r * r) + b  # what rounding took from r^2: r + missing / 2r is exact
        arrival += missing * inverse
    return inverse, r, arrival, turns


@jit_inline
def flip(value: Any, half_turns: Any) -> Any:
    """Return *value* times (-1)^half_turns: the lowest bit moves into the sign."""
    bits = np.float32(value).view(np.int32)
    return np.int32(bits ^ (np.int32(half_turns) << np.int32(31))).view(np.float32)


@jit_inline
def cos_sin(t: Any) -> Any:
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
    w = q * q  # pairs of coefficients: one operation more, and a chain half as long
    return (((d5 * q + d4) * w + (d3 * q + d2)) * w + (d1 * q + d0)) * (e0 * inverse + slow)


@jit_inline
def _wave_lattice(
    a: Any, b: Any, height: Any, phase: Any, gain: Any, loss: Any, careful: Any
) -> Any:
    """Return phase and magnitude of one element of a lattice: its cosine^2 is height / r^2."""
    inverse, r, arrival, turns = _ray(a, b, phase, careful)
    level = _level(inverse, r, height * (inverse * inverse), gain, loss, careful)
    return arrival, flip(level, turns)


@jit_inline
def _wave_free(
    x: Any, y: Any, z: Any, s: Any, phase: Any, front: Any, gain: Any, loss: Any, careful: Any
) -> Any:
    """Return phase and magnitude of an element anywhere; *s* is its normal."""
    inverse, r, arrival, turns = _ray(x * x, y * y + z * z, phase, careful)
    nx, ny, nz = s
    cosine = (x * nx + y * ny + z * nz) * inverse
    level = _level(inverse, r, cosine * cosine, gain, loss, careful)
    return arrival, flip(level if cosine >= front else ZERO, turns)


@jit_inline
def rays_lattice(
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
def rays_free(
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
def add_waves(t: Any, m: Any, re: Any, im: Any) -> Any:
    """Add `WAVES` waves, of phases *t* and magnitudes *m*, to a block of sums."""
    for p in range(re.size):
        c0, s0 = cos_sin(t[0, p])
        c1, s1 = cos_sin(t[1, p])
        c2, s2 = cos_sin(t[2, p])
        c3, s3 = cos_sin(t[3, p])
        re[p] = re[p] + (m[0, p] * c0 + m[1, p] * c1) + (m[2, p] * c2 + m[3, p] * c3)
        im[p] = im[p] + (m[0, p] * s0 + m[1, p] * s1) + (m[2, p] * s2 + m[3, p] * s3)


@jit_inline
def set_waves(t: Any, m: Any, re: Any, im: Any) -> Any:
    for p in range(t.size):
        cosine, sine = cos_sin(t[p])
        re[p] = m[p] * cosine
        im[p] = m[p] * sine
