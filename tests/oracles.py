"""Slow, independent answers that the package is judged by.

Written from the equations with the standard library alone: no numpy, and nothing of the package
under test, so that an error shared by both would have to be made twice.
"""

import cmath
import json
import math
from pathlib import Path

_BESSEL_NODES = 48


def reference_fields():
    """Fields and scalars that another program computed with 50 digits."""
    path = Path(__file__).parent / "data" / "reference_fields.json"
    return json.loads(path.read_text(encoding="utf-8"))


def bessel_j1(x):
    """J1 as the mean of cos(t - x sin t) over a period; the rule converges exponentially."""
    terms = (
        math.cos(t - x * math.sin(t))
        for t in (2.0 * math.pi * i / _BESSEL_NODES for i in range(_BESSEL_NODES))
    )
    return sum(terms) / _BESSEL_NODES


def piston_gain(ka_sine):
    """Return 2 J1(x) / x; near 0 by its series, where the integral divided by x loses digits."""
    if ka_sine < 0.01:
        return 1.0 - ka_sine**2 / 8.0 + ka_sine**4 / 192.0
    return 2.0 * bessel_j1(ka_sine) / ka_sine


def omnidirectional(direction, normal):  # noqa: ARG001  (a gain)
    """Return 1: a point source."""
    return 1.0


def circular_piston(ka):
    """Return the gain of a baffled circular piston of radius a."""

    def gain(direction, normal):
        cosine = _dot(direction, normal)
        return piston_gain(ka * math.sqrt(max(0.0, 1.0 - cosine**2))) if cosine >= 0.0 else 0.0

    return gain


def rectangular_piston(half_kw, half_kh, width_axis):
    """Return the gain of a baffled rectangle, k w / 2 along an axis and k h / 2 across it."""

    def gain(direction, normal):
        if _dot(direction, normal) < 0.0:
            return 0.0
        along = _dot(width_axis, normal)
        width = [a - along * n for a, n in zip(width_axis, normal, strict=True)]
        length = math.sqrt(_dot(width, width))
        (a, b, c), (d, e, f) = normal, width
        height = (b * f - c * e, c * d - a * f, a * e - b * d)
        return math.prod(
            _sinc(half * _dot(direction, axis) / length)
            for half, axis in ((half_kw, width), (half_kh, height))
        )

    return gain


def falling_to_the_rear(direction, normal):
    """Return 1 on the axis, falling in proportion to the angle to 0 behind."""
    return 1.0 - math.acos(max(-1.0, min(1.0, _dot(direction, normal)))) / math.pi


def field(
    points, positions, normals, weights, *, wavenumber, absorption, peak_strength,
    gain=omnidirectional,
):  # fmt: skip
    """Complex peak pressure and sum of magnitudes at each point, one element after the other.

    *gain* takes the direction to the point and the element's normal, unit vectors both.
    """
    result = []
    for point in points:
        total, magnitude = 0j, 0.0
        for position, normal, weight in zip(positions, normals, weights, strict=True):
            offset = [float(point[i]) - float(position[i]) for i in range(3)]
            distance = math.sqrt(_dot(offset, offset))
            direction = [component / distance for component in offset]
            term = (
                complex(weight)
                * (peak_strength * gain(direction, [float(n) for n in normal]) / distance)
                * cmath.exp((1j * wavenumber - absorption) * distance)
            )
            total += term
            magnitude += abs(term)
        result.append((total, magnitude))
    return result


def _dot(first, second):
    return math.fsum(a * b for a, b in zip(first, second, strict=True))


def _sinc(x):
    return math.sin(x) / x if x else 1.0


def delayed_sum(point, positions, phase_codes, phase_bits, *, frequency, sound_speed, time):
    """Sound at a point and an instant, from sources that are switched *later* by their phase code.

    Sum of cos(w (t - delay_n) - k r_n) / r_n with delay_n = code / 2^bits of a period: a source
    that starts late by delay_n is heard late by delay_n, and again late by r_n / c.
    """
    total = 0.0
    for position, code in zip(positions, phase_codes, strict=True):
        delay = int(code) / 2**phase_bits / frequency
        distance = math.dist(point, position)
        total += (
            math.cos(2.0 * math.pi * frequency * (time - delay - distance / sound_speed)) / distance
        )
    return total


def delayed_peak(point, positions, phase_codes, phase_bits, *, frequency, sound_speed, samples=48):
    """Largest of `delayed_sum` over one period."""
    return max(
        delayed_sum(
            point,
            positions,
            phase_codes,
            phase_bits,
            frequency=frequency,
            sound_speed=sound_speed,
            time=i / samples / frequency,
        )
        for i in range(samples)
    )
