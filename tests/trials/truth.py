"""The truth of a trial: a field and a dense search that share nothing with the program.

p(x) = sum_n w_n g_n sqrt(2) P1 D(theta_n) e^{(jk - alpha) r_n} / r_n, a peak phasor in pascals,
time factor e^{-jwt}; w_n = A_n e^{+j phi_n}, a positive phi_n is a lag. Places are found on grids,
ever finer, by looking at values alone: no slope, no fit, no start but the target.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final

import numba
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

CARRIER_HZ: Final = 40e3
SOURCE_PA_M: Final = 3.10  # RMS on the axis times the distance, at full drive
PISTON_M: Final = 4.70e-3

#: No place nearer to an element is looked at.
_CLEARANCE_M: Final = 2e-3
#: Half the side of the first grid, in radians of phase: the main lobe of an aperture reaches 1.8.
_WINDOW_RAD: Final = 2.0
#: The same where another maximum may be near.
_NEXT_RAD: Final = 0.4
_FINEST_RAD: Final = 1e-4
_MOST_ROUNDS: Final = 400
_MOST_AGAIN: Final = 8
_AGAIN_RAD: Final = 0.02
#: The furthest that one unit of the search goes, as a share of the distance from the array.
_LONGEST_UNIT: Final = 0.25
_TURN: Final = 2.0 * math.pi


# --- air -------------------------------------------------------------------------------------


#: Rows for air, water, pressure and carbon dioxide, columns for powers of the temperature.
_CRAMER: Final = np.array(
    [
        [331.5024, 0.603055, -0.000528],
        [51.471935, 0.1495874, -0.000782],
        [-1.82e-7, 3.73e-8, -2.93e-10],
        [-85.20931, -0.228525, 5.91e-5],
    ]
)
_SQUARES: Final = np.array([0.0, -2.835149, -2.15e-13, 29.179762])


def sound_speed_m_s(temperature_c: float, humidity_percent: float = 50.0) -> float:
    """Of air at 101 325 Pa: Cramer 1993, with vapour and carbon dioxide of IEC 61094-2."""
    kelvin, pressure = temperature_c + 273.15, 101_325.0
    terms = [1.2378847e-5 * kelvin**2, -1.9121316e-2 * kelvin, 33.93711047, -6343.1645 / kelvin]
    vapour = math.exp(sum(terms)) * (1.00062 + 3.14e-8 * pressure + 5.6e-7 * temperature_c**2)
    shares = np.array([1.0, humidity_percent / 100.0 * vapour / pressure, pressure, 0.0004])
    linear = shares @ _CRAMER @ temperature_c ** np.arange(3.0)
    return float(linear + _SQUARES @ shares**2 + 0.000486 * shares[1:].prod())


def water_fraction(temperature_c: float, humidity_percent: float) -> float:
    """Molar fraction of water vapour at 101 325 Pa.  ISO 9613-1, annex B."""
    kelvin = temperature_c + 273.15
    saturated = 10.0 ** (-6.8346 * (273.16 / kelvin) ** 1.261 + 4.6151)
    return humidity_percent / 100.0 * saturated


def humid_speed_ratio(temperature_c: float, humidity_percent: float) -> float:
    """Speed of sound of air that is so much wetter than 50 %, over that of 50 %."""
    wetter = sound_speed_m_s(temperature_c, 50.0 + humidity_percent)
    return wetter / sound_speed_m_s(temperature_c)


def absorption_np_m(
    temperature_c: float, humidity_percent: float = 50.0, frequency_hz: float = CARRIER_HZ
) -> float:
    """Attenuation of the amplitude at 101 325 Pa.  ISO 9613-1, equations (3) to (5)."""
    kelvin = temperature_c + 273.15
    warmth = kelvin / 293.15
    h = 100.0 * water_fraction(temperature_c, humidity_percent)
    oxygen = 24.0 + 4.04e4 * h * (0.02 + h) / (0.391 + h)
    nitrogen = (9.0 + 280.0 * h * math.exp(-4.170 * (warmth ** (-1 / 3) - 1.0))) / warmth**0.5
    f2 = frequency_hz**2
    relaxation = 0.01275 * math.exp(-2239.1 / kelvin) / (oxygen + f2 / oxygen)
    relaxation += 0.1068 * math.exp(-3352.0 / kelvin) / (nitrogen + f2 / nitrogen)
    return f2 * (1.84e-11 * math.sqrt(warmth) + warmth**-2.5 * relaxation)


# --- field -----------------------------------------------------------------------------------


def piston(x: Floats) -> Floats:
    """2 J1(x) / x by its power series: to 1e-13 up to x = 4, which is beyond k a."""
    square = -0.25 * x * x
    total = np.full_like(square, _PISTON_SERIES[0])
    for factor in _PISTON_SERIES[1:]:
        total *= square
        total += factor
    return total


_PISTON_SERIES: Final = [
    1.0 / (math.factorial(m) * math.factorial(m + 1)) for m in range(15, -1, -1)
]


@dataclass(frozen=True)
class Scene:
    """Elements in air: (N, 3) places in metres, (N, 3) unit axes, (N,) complex sensitivities."""

    positions_m: Floats
    normals: Floats
    wavenumber: float
    absorption: float = 0.0
    sensitivity: Complexes | float = 1.0

    def distances(self, points: Floats) -> Floats:
        """(M, N) metres."""
        p = self.positions_m
        # From the differences, not from a product of matrices: that would lose nine digits.
        total = (points[:, 0, None] - p[:, 0]) ** 2
        total += (points[:, 1, None] - p[:, 1]) ** 2
        total += (points[:, 2, None] - p[:, 2]) ** 2
        return np.sqrt(total, out=total)

    def propagators(self, points: Floats) -> Complexes:
        """(M, N) peak pressures of the elements at unit weight."""
        r = self.distances(points)
        ahead = points @ self.normals.T - (self.positions_m * self.normals).sum(axis=1)
        cosine = ahead / r
        sine = np.sqrt(np.maximum(1.0 - cosine * cosine, 0.0))
        level = piston(self.wavenumber * PISTON_M * sine) * np.exp(-self.absorption * r) / r
        level *= np.where(cosine >= -1e-6, math.sqrt(2.0) * SOURCE_PA_M, 0.0)
        return level * turned(self.wavenumber * r) * self.sensitivity

    def pressure(self, weights: Complexes, points: Floats) -> Complexes:
        """(M,) pascals."""
        return self.propagators(np.atleast_2d(points)) @ weights

    def levels(self, weights: Complexes, *, shaded: bool) -> Callable[[Floats], Floats]:
        """The function from (M, 3) points to (M,) |sum of waves|, each of the size of its weight.

        *shaded*: of what arrives, in pascals; -1 next to an element.
        """
        heard = weights * self.sensitivity if shaded else weights
        drive = np.stack([heard.real, heard.imag])
        places, normals = self.positions_m.T.copy(), self.normals.T.copy()
        air = np.array([self.wavenumber / _TURN, self.absorption, self.wavenumber * PISTON_M])

        def at(points: Floats) -> Floats:
            found: Floats = _level_kernel(points, places, normals, drive, air, shaded)
            return found

        return at


def turned(phases_rad: Floats) -> Complexes:
    """e^{j phase}, of phases brought near zero first: sine and cosine are slow far from it."""
    near = phases_rad - _TURN * np.rint(phases_rad / _TURN)
    result = np.empty(near.shape, dtype=np.complex128)
    np.cos(near, out=result.real)
    np.sin(near, out=result.imag)
    return result


def weights_of(phase_codes: NDArray[np.uint8], amplitude_codes: NDArray[np.uint8]) -> Complexes:
    """What 8-bit registers make: phase code c is a lag of c / 256 of a turn."""
    lags = phase_codes.astype(np.float64) * (_TURN / 256.0)
    return amplitude_codes.astype(np.float64) / 255.0 * turned(lags)


#: Terms of each series of powers: the error of the piston's is 2e-9 and the largest one.
_TERMS: Final = 10
_POWERS: Final = range(_TERMS - 1, -1, -1)
_SINE: Final = tuple(
    (-1) ** n * math.pi ** (2 * n + 1) / math.factorial(2 * n + 1) for n in _POWERS
)
_COSINE: Final = tuple((-1) ** n * math.pi ** (2 * n) / math.factorial(2 * n) for n in _POWERS)
_DECAY: Final = tuple((-0.25) ** n / math.factorial(n) for n in _POWERS)
_PISTON: Final = tuple(_PISTON_SERIES[-_TERMS:])


@numba.njit(fastmath=True, cache=True, error_model="numpy")
def _series(factors: Any, x: float) -> float:
    total = 0.0
    for n in range(_TERMS):
        total = total * x + factors[n]
    return total


@numba.njit(fastmath=True, cache=True, error_model="numpy")
def _level_kernel(
    points: Floats, places: Floats, normals: Floats, drive: Floats, air: Floats, shaded: bool
) -> Floats:
    """|p| by series of powers, which a compiler makes a loop of several elements at once of."""
    levels = np.empty(len(points))
    for m in range(len(points)):
        re, im, near = 0.0, 0.0, 0
        for n in range(places.shape[1]):
            x, y = points[m, 0] - places[0, n], points[m, 1] - places[1, n]
            z = points[m, 2] - places[2, n]
            square = x * x + y * y + z * z
            near += square <= _CLEARANCE_M * _CLEARANCE_M
            r = math.sqrt(square)
            turns = air[0] * r
            half = turns - np.floor(turns + 0.5)
            sine, cosine = half * _series(_SINE, half * half), _series(_COSINE, half * half)
            level = 1.0
            if shaded:
                ahead = (x * normals[0, n] + y * normals[1, n] + z * normals[2, n]) / r
                flat = air[2] * air[2] * abs(1.0 - ahead * ahead)
                decay = _series(_DECAY, air[1] * r)
                decay *= decay
                level = _series(_PISTON, -0.25 * flat) * decay * decay / r
                level *= math.sqrt(2.0) * SOURCE_PA_M if ahead >= -1e-6 else 0.0
            c, s = level * (1.0 - 2.0 * sine * sine), level * 2.0 * sine * cosine
            re += drive[0, n] * c - drive[1, n] * s
            im += drive[0, n] * s + drive[1, n] * c
        levels[m] = -1.0 if near else math.sqrt(re * re + im * im)
    return levels


# --- the lie of the land around a target -----------------------------------------------------


@dataclass(frozen=True)
class Lie:
    """Axes of the focus at a target: how far one has to go for one radian of phase (RMS).

    Attributes
    ----------
    axes : (3, 3)
        Unit vectors, one per row.
    units_m : (3,)
        A radian along each; at most a quarter of the distance.
    distance_m : float
        From the centre of what is driven, or from the nearest element if that is more.
    outward : (3,)
        Unit vector from that centre to the target.
    flat : (3,) bool
        Axes along which half that distance changes the phases by less than rounding does.
    """

    axes: Floats
    units_m: Floats
    distance_m: float
    outward: Floats
    flat: NDArray[np.bool_]


def lie_of(scene: Scene, amplitudes: Floats, target: Floats, bits: int) -> Lie:
    """The axes of the focus of these amplitudes at *target*."""
    share = amplitudes / amplitudes.sum()
    rays = target - scene.positions_m
    centre = share @ scene.positions_m
    far = np.linalg.norm(rays, axis=1)
    from_centre = float(np.linalg.norm(target - centre))
    distance = max(from_centre, float(far[share > 0.0].min()))
    outward = (target - centre) / from_centre if from_centre > 1e-9 else scene.normals[0]
    unit = rays / far[:, None]
    unit = unit - share @ unit
    values, vectors = np.linalg.eigh((unit * share[:, None]).T @ unit)
    slopes = scene.wavenumber * np.sqrt(np.maximum(values, 1e-18))
    units = np.minimum(1.0 / slopes, _LONGEST_UNIT * distance)
    flat = slopes * distance / 2.0 < math.pi / 2**bits
    return Lie(vectors.T.copy(), units, distance, outward, flat)


def rounding_mm(
    scene: Scene, amplitudes: Floats, target: Floats, bits: int, axes: Floats | None = None
) -> float:
    """The largest miss that rounding of the phases makes: |sum_n |J+_in| pi/2^b|, in millimetres.

    The larger one of all driven elements alike and of elements that count as they are driven.
    *axes*: (K, 3) unit vectors that alone are looked at.
    """
    used = amplitudes > 0
    rays = target - scene.positions_m[used]
    slopes = scene.wavenumber * rays / np.linalg.norm(rays, axis=1)[:, None]
    found = []
    for share in (np.ones(used.sum()), amplitudes[used]):
        root = np.sqrt(share / share.sum())
        centred = slopes - (share / share.sum()) @ slopes
        seen = centred if axes is None else centred @ axes.T
        inverse = np.linalg.pinv(seen * root[:, None], rcond=1e-7) * root
        found.append(np.linalg.norm(np.abs(inverse).sum(axis=1)))
    return float(max(found) * math.pi / 2**bits * 1e3)


# --- search ----------------------------------------------------------------------------------


def highest(
    score: Callable[[Floats], Floats],
    start: Floats,
    lie: Lie,
    window_rad: float = _WINDOW_RAD,
    again: Callable[[Floats], Floats] | None = None,
) -> Floats:
    """The place of the highest score around *start*: the best of a grid, then ever finer grids.

    A grid that has its best place at its edge is moved before it is refined. Axes that are flat
    are not searched. *again* gives (3, 3) steps at a place that was found, to look from there.
    """
    seen = np.flatnonzero(~lie.flat)
    if not len(seen):
        return start.copy()
    steps = lie.axes[seen] * lie.units_m[seen, None]
    coarse = _cube(len(seen), 5) * (window_rad / 2.0)
    place = _best(score, start + coarse @ steps)
    place = _refined(score, place, steps, window_rad / 4.0)
    if again is None:
        return place
    for _ in range(_MOST_AGAIN):  # a ridge that is not along the axes holds a grid up: turn it
        before, steps = place, again(place)[seen]
        place = _refined(score, before, steps, _AGAIN_RAD)
        way = np.linalg.lstsq(steps.T, place - before, rcond=None)[0]
        if np.abs(way).max() < 2.0 * _FINEST_RAD:
            break
    return place


def _refined(
    score: Callable[[Floats], Floats], place: Floats, steps: Floats, size: float
) -> Floats:
    """Move and refine a grid of 3 places per side until it is as fine as can be."""
    fine = _cube(len(steps), 3)
    for _ in range(_MOST_ROUNDS):
        candidates = place + size * fine @ steps  # the first one is the place itself
        better = _best(score, candidates)
        if np.array_equal(better, candidates[0]):
            if size < _FINEST_RAD:
                break
            size *= 0.5
        place = better
    return place


@functools.cache
def _cube(dimensions: int, side: int) -> Floats:
    """Places of a cube of *side* per edge, in whole steps; its middle comes first."""
    half = side // 2
    places = sorted(
        itertools.product(range(-half, half + 1), repeat=dimensions),
        key=lambda place: sum(step * step for step in place),
    )
    return np.array(places, dtype=np.float64)


def _best(score: Callable[[Floats], Floats], points: Floats) -> Floats:
    best: Floats = points[int(score(points).argmax())]
    return best


def _in_front(
    score: Callable[[Floats], Floats], lie: Lie, target: Floats, within_m: float = math.inf
) -> Callable[[Floats], Floats]:
    """The score of what may be looked at: *within_m*, not behind the middle of the array."""

    def found(points: Floats) -> Floats:
        away = points - target
        ahead = away @ lie.outward
        near = (ahead > -0.98 * lie.distance_m) & (ahead < 4.0 * lie.distance_m)
        near &= (away**2).sum(axis=1) <= within_m**2
        return np.where(near, score(points), -np.inf)

    return found


@dataclass(frozen=True)
class Arrival:
    """Where the waves of a drive arrive in phase.

    Attributes
    ----------
    place_m : (3,)
        In metres.
    miss_m : (3,)
        From the target; 0 along what is flat.
    coherence : float
        There: 1 where all arrive in phase.
    at_target : float
        Coherence at the target itself.
    """

    place_m: Floats
    miss_m: Floats
    coherence: float
    at_target: float


def arrival(
    scene: Scene,
    phases_rad: Floats,
    amplitudes: Floats,
    target: Floats,
    lie: Lie,
    window_rad: float = _WINDOW_RAD,
    within_m: float = math.inf,
) -> Arrival:
    """Where |sum_n A_n e^{j(phi_n + k r_n(x))}| is largest around *target*, *within_m* of it."""
    used = amplitudes > 0
    near = Scene(scene.positions_m[used], scene.normals[used], scene.wavenumber)
    heard = amplitudes * scene.sensitivity
    weights = (heard * turned(phases_rad))[used] / np.abs(heard[used]).sum()

    score = near.levels(weights, shaded=False)

    def steps_at(place: Floats) -> Floats:
        there = lie_of(near, np.abs(weights), place, 8)
        return there.axes * there.units_m[:, None]

    within = _in_front(score, lie, target, within_m)
    place = highest(within, target, lie, window_rad, again=steps_at)
    both = score(np.stack([place, target]))
    return Arrival(place, place - target, float(both[0]), float(both[1]))


def nearest(
    scene: Scene, phases_rad: Floats, amplitudes: Floats, target: Floats, lie: Lie, bits: int
) -> Arrival:
    """The same; of places that suit the phases alike, which rounding hides, that at the target."""
    best = arrival(scene, phases_rad, amplitudes, target, lie)
    here = arrival(scene, phases_rad, amplitudes, target, lie, _NEXT_RAD)
    hidden = 2.0 * (1.0 - math.cos(math.pi / 2**bits))
    is_nearer = np.linalg.norm(here.miss_m) < np.linalg.norm(best.miss_m)
    return here if is_nearer and here.coherence > best.coherence - hidden else best


def explained(
    scene: Scene,
    phases_rad: Floats,
    amplitudes: Floats,
    target: Floats,
    within_m: float,
    speed_share: float,
    bits: int,
) -> tuple[Scene, Floats]:
    """The air and the place, both within what is tolerated, that suit the phases best.

    Air within *speed_share* of the speed of sound, found by halving; a place within *within_m*.
    """
    loud = np.abs(amplitudes * scene.sensitivity)

    def look(share: float) -> tuple[float, Scene, Floats]:
        air = replace(scene, wavenumber=scene.wavenumber / (1.0 + share))
        lie = lie_of(air, loud, target, bits)
        found = arrival(air, phases_rad, amplitudes, target, lie, _NEXT_RAD, within_m)
        return found.coherence, air, found.place_m

    middle, step = 0.0, speed_share
    best = look(0.0)
    while step > speed_share / 100.0:
        for share in (middle - step, middle + step):
            if abs(share) <= speed_share and (other := look(share))[0] > best[0]:
                best, middle = other, share
                break
        else:
            step /= 2.0
    return best[1], best[2]


def loudest(scene: Scene, weights: Complexes, start: Floats, lie: Lie) -> Floats:
    """The place of the largest |p| next to *start*: the one that it belongs to."""
    score = _in_front(scene.levels(weights, shaded=True), lie, start)
    return highest(score, start, lie, _NEXT_RAD)


# --- effects ---------------------------------------------------------------------------------


def shares(scene: Scene, drive: Complexes, ideal: Complexes, targets: Floats) -> Floats:
    """(F,) pressure at every target over that of the ideal drive."""
    gains = scene.propagators(targets)
    ratio: Floats = np.abs(gains @ drive) / np.abs(gains @ ideal)
    return ratio


def scattered(scene: Scene, drive: Complexes, ideal: Complexes, target: Floats) -> float:
    """What the elements that are not as they should be do to the pressure, added up, as a share.

    Each element alone, against the ideal drive, as it is or with the phase of the actual one (the
    better of the two): what one element takes away, another one cannot give back here. Rounding
    makes 1 - cos(pi/2^b) at most.
    """
    gains = scene.propagators(target[None])[0]
    wanted, actual = gains * ideal, gains * drive
    total = wanted.sum()
    turn = actual.sum() / total
    turns = (1.0, turn / abs(turn)) if abs(turn) > 1e-9 else (1.0,)
    each = [np.abs(np.abs(total + (actual / t - wanted)) - abs(total)).sum() for t in turns]
    return float(min(each) / abs(total))


def rounding_share(bits: int, ideal: Complexes, steps: float = 0.5) -> float:
    """What rounding can do to a pressure: of the phases, and of the amplitudes, *steps* each."""
    driven = np.abs(ideal[ideal != 0.0])
    level = float(driven.mean())
    return 1.0 - math.cos(_TURN * steps / 2**bits) + steps / 255.0 / max(level, 1e-6)


def rounded(weights: Complexes, bits: int, lag_rad: float = 0.0) -> Complexes:
    """*weights* after a common lag, with phases rounded to *bits* and amplitudes to 255 steps."""
    steps = _TURN / 2**bits
    phases = np.rint((np.angle(weights) + lag_rad) / steps) * steps
    return np.rint(np.minimum(np.abs(weights), 1.0) * 255.0) / 255.0 * turned(phases)


def rounding_worst(
    scene: Scene, ideal: Complexes, targets: Floats, bits: int, steps: float = 0.5
) -> Floats:
    """(F,) largest change of each pressure that phase errors of *steps* can make, signs at worst.

    |dp| <= sum_n |Im(q_n / u)| d + |q_n| d^2 / 2, u the phasor of the sum of the q_n.
    """
    parts = scene.propagators(targets) * ideal
    total = parts.sum(axis=1)
    error = _TURN * steps / 2**bits
    across = np.abs((parts * (total.conj() / np.abs(total))[:, None]).imag).sum(axis=1)
    most: Floats = across * error + np.abs(parts).sum(axis=1) * error**2 / 2.0
    return most / np.abs(total)


def rounding_reach(scene: Scene, ideal: Complexes, targets: Floats, bits: int) -> Floats:
    """(F,) largest change of each pressure that rounding makes, over 64 common lags of the drive.

    The common lag of a drive is nobody's, and each one is rounded otherwise: this is what rounding
    really reaches, not what the worst signs of all elements would.
    """
    gains = scene.propagators(targets)
    level = np.abs(gains @ ideal)
    lags = np.arange(64) * (_TURN / 2**bits / 64.0)
    drives = np.stack([rounded(ideal, bits, lag) for lag in lags])
    change: Floats = np.abs(np.abs(drives @ gains.T) / level - 1.0).max(axis=0)
    return change
