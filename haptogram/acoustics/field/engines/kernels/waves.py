"""The wave of one element at many points: distance, phase, magnitude, sine and cosine.

Each block of points runs through three loops, `_lengths_kernel`, the one of `rays` and `add_waves`,
with the intermediate values in the first-level cache. As one loop the chain of dependent operations
is longer than what a core reorders, and it takes half as much time again.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from haptogram.acoustics.field.engines.kernels.jit import jit_inline

WAVES: Final = 4  # elements that are added at a time: a sum is loaded and stored once for all

# sin(pi t) / t and cos(pi t) as polynomials in t^2, |t| <= 1/2, interpolated at Chebyshev nodes.
SINE: Final = (3.141590270206992, -5.167406733272327, 2.544010518503225, -0.5594624554675743)
COSINE: Final = (
    0.9999999532476083, -4.93479283061961, 4.058411352861943, -1.3318765680770057,
    0.21968961109065893,
)  # fmt: skip

# arctan(t) / (pi t), |t| <= 1, likewise
ARCTANGENT: Final = (
    0.318309881168066, -0.10610244693118376, 0.0636380517240177, -0.04520818603088099,
    0.03385783986330279, -0.02385874385984836, 0.01355605648584259, -0.005094559438614997,
    0.0009021106846746423,
)  # fmt: skip

_S0, _S1, _S2, _S3 = (np.float32(value) for value in SINE)
_C0, _C1, _C2, _C3, _C4 = (np.float32(value) for value in COSINE)
ONE = np.float32(1.0)
ZERO = np.float32(0.0)


@jit_inline
def _lengths_kernel(a: Any, b: Any, r: Any, inverse: Any) -> Any:
    """Set r and 1/r of distances whose square is a + b."""
    for p in range(a.size):
        square = a[p] + b[p]
        inverse[p] = ONE / np.sqrt(square)
        r[p] = square * inverse[p]


@jit_inline
def flip_sign_kernel(value: Any, half_turns: Any) -> Any:
    """Return *value* times (-1)^half_turns: the lowest bit moves into the sign."""
    bits = np.float32(value).view(np.int32)
    return np.int32(bits ^ (np.int32(half_turns) << np.int32(31))).view(np.float32)


@jit_inline
def cos_sin_kernel(t: Any) -> Any:
    """Return cosine and sine of pi t, |t| <= 1/2; errors 5e-8 and 1.2e-6."""
    w = t * t
    sine = t * (((_S3 * w + _S2) * w + _S1) * w + _S0)
    cosine = (((_C4 * w + _C3) * w + _C2) * w + _C1) * w + _C0
    return cosine, sine


@jit_inline
def arctangent_kernel(t: Any) -> Any:
    """Return arctan(t) in half turns, |t| <= 1; error 5e-9. Unlike atan2 of C, it is vectorised."""
    a0, a1, a2, a3, a4, a5, a6, a7, a8 = ARCTANGENT
    w = t * t
    high = (((a8 * w + a7) * w + a6) * w + a5) * w + a4
    return t * ((((high * w + a3) * w + a2) * w + a1) * w + a0)


@jit_inline
def _gain_at_kernel(q: Any, gain: Any) -> Any:
    """Return the directivity at an angle whose squared cosine is *q*.

    It is a polynomial in q; *gain*: its six coefficients, lowest first.
    """
    d0, d1, d2, d3, d4, d5 = gain
    w = q * q  # pairs of coefficients: one operation more, and a chain half as long
    return ((d5 * q + d4) * w + (d3 * q + d2)) * w + (d1 * q + d0)


@jit_inline
def rays_kernel(
    a: Any, b: Any, a_low: Any, b_low: Any, height: Any, amplitude: Any, phase: Any, careful: Any,
    gain: Any, loss: Any, scratch: Any, t: Any, m: Any,
) -> Any:  # fmt: skip
    """Fill phase *t* and magnitude *m* of one element at a block of points.

    r^2 = *a* + *b*, cosine^2 = *height* / r^2; *scratch* is (2, B). A *careful* call, which is a
    constant where it is inlined, adds to r^2 what rounding took, *a_low* and *b_low*, and what its
    own rounding takes: the phase is then exact to 1e-6 at any distance.
    """
    r, inverse = scratch[0], scratch[1]
    _lengths_kernel(a, b, r, inverse)
    waves_kernel(height, amplitude, phase, careful, gain, loss, scratch, t, m)
    if careful:
        for p in range(r.size):
            square = a[p] + b[p]
            part = square - a[p]
            lost = (a[p] - (square - part)) + (b[p] - part)  # by that sum: Knuth's TwoSum
            length = np.float64(r[p])  # its square is exact in double precision
            rest = np.float32(np.float64(square) - length * length)
            missing = rest + (lost + (a_low[p] + b_low[p]))
            t[p] += missing * inverse[p]  # r + missing / 2r is exact


@jit_inline
def waves_kernel(
    height: Any, amplitude: Any, phase: Any, cubic: Any, gain: Any, loss: Any, scratch: Any,
    t: Any, m: Any,
) -> Any:  # fmt: skip
    """Fill phase *t* and magnitude *m* of one element; *scratch* (2, B) holds r and 1/r."""
    r, inverse, d = scratch[0], scratch[1], _gains_kernel(gain)
    e0, e1, e2, e3 = _losses_kernel(loss, amplitude)
    for p in range(r.size):
        twice = r[p] + r[p]
        turns = np.rint(twice + phase)
        t[p] = (twice - turns) + phase
        slow = (e3 * r[p] + e2) * r[p] + e1 if cubic else e2 * r[p] + e1
        level = _gain_at_kernel(height[p] * (inverse[p] * inverse[p]), d) * (e0 * inverse[p] + slow)
        m[p] = flip_sign_kernel(level, turns)


@jit_inline
def _gains_kernel(gain: Any) -> Any:
    """Return the six coefficients of the directivity as a tuple, for registers."""
    return gain[0], gain[1], gain[2], gain[3], gain[4], gain[5]


@jit_inline
def _losses_kernel(loss: Any, amplitude: Any) -> Any:
    """Return *amplitude* times the four coefficients of the absorption in r, as a tuple."""
    return loss[0] * amplitude, loss[1] * amplitude, loss[2] * amplitude, loss[3] * amplitude


@jit_inline
def add_waves_kernel(t: Any, m: Any, re: Any, im: Any) -> Any:
    """Add `WAVES` waves, of phases *t* and magnitudes *m*, to a block of sums."""
    for p in range(re.size):
        c0, s0 = cos_sin_kernel(t[0, p])
        c1, s1 = cos_sin_kernel(t[1, p])
        c2, s2 = cos_sin_kernel(t[2, p])
        c3, s3 = cos_sin_kernel(t[3, p])
        re[p] = re[p] + (m[0, p] * c0 + m[1, p] * c1) + (m[2, p] * c2 + m[3, p] * c3)
        im[p] = im[p] + (m[0, p] * s0 + m[1, p] * s1) + (m[2, p] * s2 + m[3, p] * s3)


@jit_inline
def set_waves_kernel(t: Any, m: Any, re: Any, im: Any) -> Any:
    """Set the real and imaginary parts of waves of phases *t* and magnitudes *m*."""
    for p in range(t.size):
        cosine, sine = cos_sin_kernel(t[p])
        re[p] = m[p] * cosine
        im[p] = m[p] * sine
