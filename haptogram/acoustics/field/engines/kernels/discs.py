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
    dx, dy, dz = x - places[0, n], y - places[1, n], z - places[2, n]
    return np.sqrt(dx * dx + dy * dy + dz * dz)


@jit_sums
def _lengths_to_centre_kernel(places: F8, x: float, y: float, z: float, lengths: F4) -> None:
    """Set the distances (N,) from the elements to the centre."""
    for n in range(lengths.size):
        lengths[n] = _distance_kernel(places, n, x, y, z)


@jit_sums
def _phases_at_centre_kernel(
    places: F8, x: float, y: float, z: float, lags: F4, phases: F4
) -> None:
    """Set the phases (N,) at the centre, in half turns."""
    for n in range(phases.size):
        turns = _distance_kernel(places, n, x, y, z) + 0.5 * lags[n]
        phases[n] = 2.0 * (turns - np.rint(turns))


@jit_sums
def _stress_kernel(
    x: Float, y: Float, z: Float, a: Float, b: Float, elements: F4, levels: F4, lengths: F4,
    phases: F4, gain: F4, absorption: Float, middle: Float, front: Float,
) -> float:  # fmt: skip
    """Return |p|^2 less |rho c v|^2 along the disc, at (a, b) of it, whose centre is (x, y, z).

    But for the loss over the length *middle*.
    """
    px, py, pz = elements[0], elements[1], elements[2]
    nx, ny, nz = elements[3], elements[4], elements[5]
    g0, g1, g2, g3, g4, g5 = gain[0], gain[1], gain[2], gain[3], gain[4], gain[5]
    re, im, re_x, im_x, re_y, im_y = ZERO, ZERO, ZERO, ZERO, ZERO, ZERO
    x, y = x + a, y + b
    for n in range(px.size):
        dx, dy, length = x - px[n], y - py[n], lengths[n]
        further = a * (_TWO * dx - a) + b * (_TWO * dy - b)  # of the squares
        square = length * length + further
        inverse = ONE / np.sqrt(square)
        longer = further / (square * inverse + length)
        t = phases[n] + _TWO * longer
        turns = np.rint(t)
        cosine, sine = cos_sin_kernel(t - turns)
        ahead = (dx * nx[n] + dy * ny[n] + (z - pz[n]) * nz[n]) * inverse
        q = ahead * ahead
        w = q * q
        level = ((g5 * q + g4) * w + (g3 * q + g2)) * w + (g1 * q + g0)
        turn = ((_FIVE * g5 * q + _FOUR * g4) * w + (_THREE * g3 * q + _TWO * g2)) * q + g1
        u = absorption * (length + longer - middle)
        loss = ONE - u * (ONE - u * (_HALF - u * (_SIXTH - u * _TWENTY_FOURTH)))
        loss = flip_sign_kernel(loss * levels[n] * inverse, turns)
        loss = loss if ahead >= front else ZERO
        level, rising = loss * level, loss * turn * ahead * inverse * _PER_HALF_TURN
        fading = -level * (inverse + absorption) * _PER_TURN - rising * ahead
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
    middle = np.float64(lengths.mean())
    force = 0.0
    for m in range(len(nodes)):
        force += areas[m] * _stress_kernel(
            np.float32(x), np.float32(y), np.float32(z), nodes[m, 0], nodes[m, 1], elements,
            drive[0], lengths, phases, gain, np.float32(absorption), np.float32(middle),
            np.float32(front),
        )  # fmt: skip
    return force * math.exp(-2.0 * absorption * middle)
