"""The stress on a disc in the sound of elements anywhere: single precision about its centre."""

from __future__ import annotations

import math
from typing import Any, TypeAlias

import numpy as np

from haptogram.acoustics.field.engines.kernels.blocks import F4, F8
from haptogram.acoustics.field.engines.kernels.jit import jit_checked_entry, jit_inline, jit_sums
from haptogram.acoustics.field.engines.kernels.waves import (
    ONE,
    ZERO,
    cos_sin_kernel,
    flip_sign_kernel,
)

Float: TypeAlias = Any  # of single precision
_TWO, _THREE, _FOUR, _FIVE = (np.float32(value) for value in (2.0, 3.0, 4.0, 5.0))
#: Wavelengths over radians of phase, and twice that: rho c v is the slope of p over -j k.
_PER_TURN, _PER_HALF_TURN = np.float32(0.5 / math.pi), np.float32(1.0 / math.pi)
_HALF, _SIXTH, _TWENTY_FOURTH = np.float32(0.5), np.float32(1.0 / 6.0), np.float32(1.0 / 24.0)


@jit_inline
def _distance_kernel(places: Any, n: Any, x: Any, y: Any, z: Any) -> Any:
    """Return the distance, in wavelengths, from element *n* to a point; *places*: rows x, y, z."""
    dx, dy, dz = x - places[0, n], y - places[1, n], z - places[2, n]
    return np.sqrt(dx * dx + dy * dy + dz * dz)


@jit_sums
def _lengths_to_centre_kernel(places: F8, x: float, y: float, z: float, lengths: F4) -> None:
    """Set *lengths* (N,): distances in wavelengths from the elements to the centre of the disc."""
    for n in range(lengths.size):
        lengths[n] = _distance_kernel(places, n, x, y, z)


@jit_sums
def _phases_at_centre_kernel(
    places: F8, x: float, y: float, z: float, lags: F4, phases: F4
) -> None:
    """Set *phases* (N,) of the elements' waves at the centre x, y, z of the disc, in half turns.

    They are wrapped. *lags* (N,): phases of the drive, in half turns. *places* (3, N) and the
    centre are in wavelengths.
    """
    for n in range(phases.size):
        turns = _distance_kernel(places, n, x, y, z) + 0.5 * lags[n]
        phases[n] = 2.0 * (turns - np.rint(turns))


@jit_sums
def _levels_kernel(elements: F4, drive: F4, z: Float, lengths: F4, loss: Float, at: F4) -> Float:
    """Set *at* (2, N): magnitudes after absorption, and heights of the centre over the elements.

    *drive* (2, N) begins with the magnitudes before it. *loss*: absorption per wavelength; it
    counts relative to that over the mean of *lengths* (N,), which is returned, in wavelengths. A
    height is the part that *z* has in the distance along the normal: the same all over the disc.
    """
    pz, nz, middle = elements[2], elements[5], lengths.mean()
    for n in range(lengths.size):
        u = loss * (lengths[n] - middle)
        at[0, n] = drive[0, n] * (ONE - u * (ONE - u * (_HALF - u * (_SIXTH - u * _TWENTY_FOURTH))))
        at[1, n] = (z - pz[n]) * nz[n]
    return middle


@jit_sums
def _stress_kernel(
    x: Float, y: Float, a: Float, b: Float, elements: F4, at: F4, lengths: F4, phases: F4, gain: F4,
    absorption: Float, front: Float,
) -> float:  # fmt: skip
    """Return |p|^2 - |rho c v|^2, in Pa^2, at the offset (a, b) on a disc with the centre (x, y).

    v is the velocity along the disc. *elements* (6, N): positions and normals. Of their waves at
    the centre: *at* (2, N), set by `_levels_kernel`, *lengths* (N,), and *phases* (N,) in half
    turns. *gain* (6,): coefficients of the directivity; *front*: the least cosine that has sound.
    Lengths are in wavelengths; the absorption over the mean length is left out.
    """
    px, py, nx, ny = elements[0], elements[1], elements[3], elements[4]
    levels, rises = at[0], at[1]
    g0, g1, g2, g3, g4, g5 = gain[0], gain[1], gain[2], gain[3], gain[4], gain[5]
    h1, h2, h3 = _PER_HALF_TURN * g1, _PER_HALF_TURN * _TWO * g2, _PER_HALF_TURN * _THREE * g3
    h4, h5 = _PER_HALF_TURN * _FOUR * g4, _PER_HALF_TURN * _FIVE * g5
    re, im, re_x, im_x, re_y, im_y = ZERO, ZERO, ZERO, ZERO, ZERO, ZERO
    x, y, shift, fade = x + a, y + b, a * a + b * b, absorption * _PER_TURN
    a, b = _TWO * a, _TWO * b
    for n in range(px.size):
        dx, dy, length = x - px[n], y - py[n], lengths[n]
        further = a * dx + b * dy - shift  # of the squares
        square = length * length + further
        inverse = ONE / np.sqrt(square)
        longer = further / (square * inverse + length)
        t = phases[n] + _TWO * longer
        turns = np.rint(t)
        cosine, sine = cos_sin_kernel(t - turns)
        ahead = (dx * nx[n] + dy * ny[n] + rises[n]) * inverse
        q = ahead * ahead
        w = q * q
        level = ((g5 * q + g4) * w + (g3 * q + g2)) * w + (g1 * q + g0)
        turn = ((h5 * q + h4) * w + (h3 * q + h2)) * q + h1
        u = absorption * longer
        loss = (ONE - u * (ONE - u * (_HALF - u * _SIXTH))) * levels[n] * inverse
        loss = flip_sign_kernel(loss, turns)
        loss = loss if ahead >= front else ZERO
        level, rising = loss * level, loss * turn * ahead * inverse
        fading = -level * (inverse * _PER_TURN + fade) - rising * ahead
        u, v = dx * inverse, dy * inverse
        slope_x, slope_y = fading * u + rising * nx[n], fading * v + rising * ny[n]
        re += cosine * level
        im += sine * level
        u, v = level * u, level * v
        re_x += cosine * u + sine * slope_x
        im_x += sine * u - cosine * slope_x
        re_y += cosine * v + sine * slope_y
        im_y += sine * v - cosine * slope_y
    along = re_x * re_x + im_x * im_x + re_y * re_y + im_y * im_y
    return np.float64(re * re + im * im - along)


@jit_checked_entry
def disc_stress_kernel(drive: F4, centre: F8, disc: Any, engine: Any) -> float:
    """Return the integral of |p|^2 less |rho c v|^2 along a disc, in Pa^2 m^2.

    *drive* (2, N): magnitudes, and phases in half turns. *disc*: its axes over the wavelength and
    an origin (4, 3), nodes (M, 2) in wavelengths and their areas; places (3, N) of elements, and
    places and normals (6, N) in single precision, along the axes from the origin. *engine*: gain,
    absorption per wavelength, and the least cosine that has sound.
    """
    (frame, nodes, areas, places, elements), (gain, absorption, front) = disc, engine
    place, lengths, phases = np.zeros(3), np.empty_like(drive[0]), np.empty_like(drive[0])
    for i in range(3):
        for j in range(3):
            place[i] += frame[i, j] * (centre[j] - frame[3, j])
    x, y, z = place[0], place[1], place[2]
    _lengths_to_centre_kernel(places, x, y, z, lengths)
    _phases_at_centre_kernel(places, x, y, z, drive[1], phases)
    at, loss = np.empty_like(drive), np.float32(absorption)
    middle = np.float64(_levels_kernel(elements, drive, np.float32(z), lengths, loss, at))
    force = 0.0
    for m in range(len(nodes)):
        force += areas[m] * _stress_kernel(
            np.float32(x), np.float32(y), nodes[m, 0], nodes[m, 1], elements, at, lengths, phases,
            gain, loss, np.float32(front),
        )  # fmt: skip
    return force * math.exp(-2.0 * absorption * middle)
