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


def _vibration(theta, kelvin):
    """Heat capacity over R of one vibration of the characteristic temperature *theta*."""
    x = theta / kelvin
    return x * x * math.exp(x) / (math.exp(x) - 1.0) ** 2


# Share of dry air with 0.04 % of carbon dioxide, g/mol, heat capacity over R without vibrations,
# and their characteristic temperatures.
_GASES = [
    (0.78084, 28.0134, 3.5, [3393.0]),
    (0.20942, 31.9988, 3.5, [2273.0]),
    (0.00934, 39.948, 2.5, []),
    (0.0004, 44.0095, 3.5, [960.0, 960.0, 1932.0, 3380.0]),
]
_WATER = (18.01528, 4.03, [2295.0, 5255.0, 5400.0])


def _virial_m3(kelvin, water):
    """Second virial coefficient of humid air.  R. W. Hyland and A. Wexler, ASHRAE Trans., 1983."""
    t = kelvin
    air = 34.9568 - 6687.72 / t - 2.10141e6 / t**2 + 9.24746e7 / t**3
    both = 32.366097 - 14113.8 / t - 1.244535e6 / t**2 - 2.348789e9 / t**4
    vapour = 8.314462618 * t * (7.0e-3 - 1.47184e-3 * math.exp(1734.29 / t))
    dry = 1.0 - water
    return 1e-6 * (dry**2 * air + 2.0 * dry * water * both + water**2 * vapour)


def real_gas_speed_m_s(celsius, humidity_percent, pressure_pa):
    """Speed of sound of humid air from the molecules and the second virial coefficient."""
    kelvin, gas = celsius + 273.15, 8.314462618
    # Magnus' formula over water, A. L. Buck, J. Appl. Meteorol. 20, 1981.
    saturated = 611.21 * math.exp((18.678 - celsius / 234.5) * celsius / (257.14 + celsius))
    water = humidity_percent / 100.0 * 1.004 * saturated / pressure_pa
    rows = [((1.0 - water) * share, *row) for share, *row in _GASES] + [(water, *_WATER)]
    heat = gas * sum(
        share * (rigid + sum(_vibration(theta, kelvin) for theta in thetas))
        for share, _, rigid, thetas in rows
    )
    mass = 1e-3 * sum(share * molar for share, molar, _, _ in rows)
    gamma, step = heat / (heat - gas), 0.5
    below, here, above = (_virial_m3(kelvin + way * step, water) for way in (-1, 0, 1))
    first, second = (above - below) / (2.0 * step), (above - 2.0 * here + below) / step**2
    g = gamma - 1.0
    excess = here + g * kelvin * first + g * g / (2.0 * gamma) * kelvin**2 * second
    return math.sqrt(
        gamma * gas * kelvin / mass * (1.0 + 2.0 * pressure_pa / gas / kelvin * excess)
    )
