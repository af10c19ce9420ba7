"""The pressure peak next to a point, across or along the beam, and what rounding does to it.

The arithmetic of :mod:`haptogram.verification.frame.peaks` for parallel pistons. Offsets, levels
and curvatures are those along one or two *axes* (2, 3); where there is one (not *both*), the second
is of zeros. *metric* is (00, 01, 11).
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics.field.engines.kernels.jit import jit_checked, jit_inline, jit_sums
from haptogram.acoustics.field.engines.kernels.pistons import (
    cos_sin_turns_kernel,
    height_kernel,
    wave_bend_kernel,
)

F8 = NDArray[np.float64]

_LEAST_HEIGHT_M: Final = 2e-3  # above an element's face: further from all of them than is refused
_LEAST_CURVED: Final = 1e-9
_HALVINGS: Final = 10

#: Sums over the elements: real and imaginary part of the pressure and of its derivatives.
SUMS: Final = 12


@jit_inline
def _wave_kernel(dx: Any, dy: Any, dz: Any, turns: Any, axes: Any, medium: Any) -> Any:
    """Return an element's wave (Pa) at a point that is *dx*, *dy*, *dz* (m) from it.

    That is: cosine and sine of its phase, 1 / r, the two parts of the unit ray along *axes*, the
    magnitude, its slopes along the axes, its second derivatives (00, 01, 11). *turns*: phase of the
    drive; *medium* (8,): as in :mod:`.pistons`.
    """
    (ax, ay, az, ah), (bx, by, bz, bh) = axes
    distance, inverse, height, level, gain, by_cosine, bend = wave_bend_kernel(dx, dy, dz, medium)
    u = (dx * ax + dy * ay + dz * az) * inverse
    v = (dx * bx + dy * by + dz * bz) * inverse
    c, s = cos_sin_turns_kernel(distance * medium[0] + turns)
    steep = -inverse - medium[2]  # of ln level, along the ray
    cu, cv = (ah - height * u) * inverse, (bh - height * v) * inverse  # slopes of that cosine
    gu, gv = by_cosine * cu, by_cosine * cv
    first, second = steep * u * gain + gu, steep * v * gain + gv
    ring = inverse * (steep * gain - inverse * height * by_cosine)
    ray = gain * (steep * steep + inverse * inverse) - ring
    mixed = by_cosine * (steep - inverse)
    m00 = ring + ray * u * u + 2.0 * mixed * u * cu + bend * cu * cu
    m01 = ray * u * v + mixed * (u * cv + v * cu) + bend * cu * cv
    m11 = ring + ray * v * v + 2.0 * mixed * v * cv + bend * cv * cv
    slopes, bends = (level * first, level * second), (level * m00, level * m01, level * m11)
    return c, s, inverse, (u, v), level * gain, slopes, bends


@jit_inline
def _with_heights_kernel(axes: Any, medium: Any) -> Any:
    """Return both *axes* as x, y, z and their component along the array's normal, from *medium*."""
    a, b = axes[0], axes[1]
    first = a[0] * medium[4] + a[1] * medium[5] + a[2] * medium[6]
    second = b[0] * medium[4] + b[1] * medium[5] + b[2] * medium[6]
    return (a[0], a[1], a[2], first), (b[0], b[1], b[2], second)


@jit_sums
def _peak_sums_kernel(
    places: F8, x: float, y: float, z: float, axes: F8, medium: F8, sums: F8
) -> None:
    """Set *sums* (12,): pressure (Pa) at x, y, z (m), its first and second derivatives on two axes.

    Real and imaginary part of each: p, then 0, 1, then 00, 01, 11. *places*, *medium*: as in
    :mod:`.pistons`.
    """
    px, py, pz, turns = places[0], places[1], places[2], places[3]
    both, k = _with_heights_kernel(axes, medium), 2.0 * math.pi * medium[0]
    s0, s1, s2, s3, s4, s5 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    s6, s7, s8, s9, s10, s11 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for n in range(px.size):
        c, s, inverse, (u, v), size, (m0, m1), (m00, m01, m11) = _wave_kernel(
            x - px[n], y - py[n], z - pz[n], turns[n], both, medium
        )
        ku, kv, bend = k * u, k * v, k * inverse * size
        r00, i00 = m00 - size * ku * ku, 2.0 * ku * m0 + bend * (1.0 - u * u)
        r01, i01 = m01 - size * ku * kv, ku * m1 + kv * m0 - bend * u * v
        r11, i11 = m11 - size * kv * kv, 2.0 * kv * m1 + bend * (1.0 - v * v)
        ku, kv = size * ku, size * kv
        s0 += c * size
        s1 += s * size
        s2 += c * m0 - s * ku
        s3 += s * m0 + c * ku
        s4 += c * m1 - s * kv
        s5 += s * m1 + c * kv
        s6 += c * r00 - s * i00
        s7 += s * r00 + c * i00
        s8 += c * r01 - s * i01
        s9 += s * r01 + c * i01
        s10 += c * r11 - s * i11
        s11 += s * r11 + c * i11
    sums[0], sums[1], sums[2], sums[3], sums[4], sums[5] = s0, s1, s2, s3, s4, s5
    sums[6], sums[7], sums[8], sums[9], sums[10], sums[11] = s6, s7, s8, s9, s10, s11


@jit_checked
def _derivatives_kernel(sums: F8, both: bool) -> tuple[float, float, float, float, float, bool]:
    """Return gradient and Hessian (00, 01, 11) of ln |p|^2, and True if that curves down all ways.

    *sums* (12,) are those of `_peak_sums_kernel`. Without *both* those of the first axis alone, and
    0 for the second.
    """
    p = complex(sums[0], sums[1])
    first, second = complex(sums[2], sums[3]) / p, complex(sums[4], sums[5]) / p
    h00 = 2.0 * (complex(sums[6], sums[7]) / p - first * first).real
    if not both:
        return 2.0 * first.real, 0.0, h00, 0.0, h00, h00 < 0.0
    h01 = 2.0 * (complex(sums[8], sums[9]) / p - first * second).real
    h11 = 2.0 * (complex(sums[10], sums[11]) / p - second * second).real
    middle, apart = 0.5 * (h00 + h11), math.hypot(0.5 * (h00 - h11), h01)
    is_peak = middle + apart < _LEAST_CURVED * (middle - apart) and middle + apart < 0.0
    return 2.0 * first.real, 2.0 * second.real, h00, h01, h11, is_peak


@jit_checked
def _level_kernel(
    places: F8, start: F8, axes: F8, a: float, b: float, medium: F8, sums: F8
) -> bool:
    """Set *sums* (12,), the pressure and its derivatives, at (a, b) on two *axes* from *start*.

    They are those of `_peak_sums_kernel`; lengths in m; *places*, *medium* as in :mod:`.pistons`.
    False if the point is not above all elements by 2 mm (*sums* are unset), or if |p| is 0 there.
    """
    x = start[0] + a * axes[0, 0] + b * axes[1, 0]
    y = start[1] + a * axes[0, 1] + b * axes[1, 1]
    z = start[2] + a * axes[0, 2] + b * axes[1, 2]
    if not height_kernel(x, y, z, medium) > _LEAST_HEIGHT_M:
        return False
    _peak_sums_kernel(places, x, y, z, axes, medium, sums)
    return _square_kernel(sums) > 0.0


@jit_checked
def _square_kernel(sums: F8) -> float:
    """Return |p|^2, in Pa^2; *sums* begins with real and imaginary part of the pressure."""
    return float(sums[0] * sums[0] + sums[1] * sums[1])


@jit_checked
def length_kernel(a: float, b: float, metric: F8) -> float:
    """Return the length of an offset, in radians of phase."""
    square = a * a * metric[0] + 2.0 * a * b * metric[1] + b * b * metric[2]
    return math.sqrt(max(square, 0.0))


@jit_checked
def climb_kernel(
    places: F8, start: F8, axes: F8, metric: F8, both: bool, medium: F8, settings: F8, offset: F8,
) -> bool:  # fmt: skip
    """Set *offset* (2,) to the peak next to *start*; return whether there is one.

    *settings*: a step at the top, longest step in radians, the step that settles, in metres, and
    the number of steps.
    """
    at_top, longest, settled, a, b = settings[0], settings[1], settings[2], 0.0, 0.0
    sums = np.empty(SUMS)
    if not _level_kernel(places, start, axes, a, b, medium, sums):
        return False
    for _ in range(int(settings[3])):
        g0, g1, h00, h01, h11, is_peak = _derivatives_kernel(sums, both)
        if not is_peak:
            h00, h01, h11 = -2.0 * metric[0], -2.0 * metric[1], -2.0 * metric[2]
        determinant = h00 * h11 - h01 * h01
        da, db = (h01 * g1 - h11 * g0) / determinant, (h01 * g0 - h00 * g1) / determinant
        share = min(1.0, longest / max(length_kernel(da, db, metric), 1e-12))
        da, db = share * da, share * db
        size = math.hypot(da, db)
        if size < settled:
            offset[0], offset[1] = a + da, b + db
            return True
        share, is_higher, level = 1.0, False, _square_kernel(sums)
        for _ in range(_HALVINGS):
            u, v = a + share * da, b + share * db
            if not _level_kernel(places, start, axes, u, v, medium, sums):
                return False
            is_higher = _square_kernel(sums) > level
            if is_higher:
                break
            share *= 0.5
        if not is_higher:
            offset[0], offset[1] = a, b
            return bool(size < at_top)
        a, b = u, v
    return False


@jit_sums
def _response_kernel(
    places: F8, place: F8, axes: F8, medium: F8, sums: F8, h00: float, h01: float, h11: float
) -> tuple[float, float]:
    """Return how far, in m, phase errors of one radian can move the peak along two axes, at most.

    Errors of every element, with the worst signs. *sums* and the Hessian of ln |p|^2 (*h00* to
    *h11*) are those at *place*; *places*, *medium*: as in :mod:`.pistons`.
    """
    px, py, pz, turns = places[0], places[1], places[2], places[3]
    x, y, z = place[0], place[1], place[2]
    both, k = _with_heights_kernel(axes, medium), 2.0 * math.pi * medium[0]
    square = sums[0] * sums[0] + sums[1] * sums[1]
    re, im = sums[0] / square, -sums[1] / square  # 1 / p, and the slopes of ln p
    ar, ai = sums[2] * re - sums[3] * im, sums[2] * im + sums[3] * re
    br, bi = sums[4] * re - sums[5] * im, sums[4] * im + sums[5] * re
    scale = 2.0 / (h00 * h11 - h01 * h01)
    h00, h01, h11 = h00 * scale, h01 * scale, h11 * scale
    one, other = 0.0, 0.0
    for n in range(px.size):
        c, s, _, (u, v), size, (first, second), _ = _wave_kernel(
            x - px[n], y - py[n], z - pz[n], turns[n], both, medium
        )
        c, s = c * re - s * im, c * im + s * re
        m0 = (first - size * ar) * s + size * (k * u - ai) * c
        m1 = (second - size * br) * s + size * (k * v - bi) * c
        one += abs(h11 * m0 - h01 * m1)
        other += abs(h00 * m1 - h01 * m0)
    return one, other


@jit_checked
def expected_peak_kernel(
    places: F8, start: F8, axes: F8, metric: F8, both: bool, medium: F8, settings: F8,
    phase_limit: float, place: F8, rounding: F8,
) -> bool:  # fmt: skip
    """Set *place* (3,) of the peak and how far *rounding* (2,) of the phases moves it.

    That is the first order alone; return whether there is a peak of which it tells enough.
    *settings*: those of :func:`climb_kernel`, then how far the peak may be in radians, how far in
    metres, and how far rounding may move it in radians.
    """
    offset, sums = np.zeros(2), np.empty(SUMS)
    if not climb_kernel(places, start, axes, metric, both, medium, settings, offset):
        return False
    if length_kernel(offset[0], offset[1], metric) > settings[4]:
        return False
    if math.hypot(offset[0], offset[1]) > settings[5]:
        return False
    for i in range(3):
        place[i] = start[i] + offset[0] * axes[0, i] + offset[1] * axes[1, i]
    if not _level_kernel(places, place, axes, 0.0, 0.0, medium, sums):
        return False
    _, _, h00, h01, h11, is_peak = _derivatives_kernel(sums, both)
    if not is_peak:
        return False
    first, second = _response_kernel(places, place, axes, medium, sums, h00, h01, h11)
    rounding[0], rounding[1] = first * phase_limit, second * phase_limit
    return bool(length_kernel(rounding[0], rounding[1], metric) <= settings[6])


@jit_checked
def peak_apart_kernel(
    latched: F8, ideal: F8, target: F8, axes: F8, metric: F8, both: bool, medium: F8,
    settings: F8, limit: float,
) -> float:  # fmt: skip
    """Return the distance of the peak of *latched* from that of *ideal*, in radians.

    Negative: -1 where either is unclear, -2 where it is more than rounding explains.
    """
    place, rounding, offset = np.empty(3), np.empty(2), np.zeros(2)
    if not expected_peak_kernel(
        ideal, target, axes, metric, both, medium, settings, limit, place, rounding
    ):
        return -1.0
    if not climb_kernel(latched, place, axes, metric, both, medium, settings, offset):
        return -1.0
    for i in range(2 if both else 1):
        if not abs(offset[i]) <= settings[7] * rounding[i] + settings[8]:
            return -2.0
    return length_kernel(offset[0], offset[1], metric)
