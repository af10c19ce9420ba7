"""The sound that modulated ultrasound makes audible: an estimate, by Berktay's law.

Air is slightly nonlinear: along a beam of intense ultrasound, the square of its envelope becomes a
source of sound.  H. O. Berktay, J. Sound Vib. 2(4), 435-461, 1965: far out on the axis of a
collimated beam of amplitude P, envelope E(t) and cross-section S,

    p(t) = beta P^2 S / (16 pi rho c^4 alpha z) d^2 E^2 / dt^2,

which is beta / (8 pi c^3 alpha z) d^2 W / dt^2 with the power W(t) = P^2 S E^2 / (2 rho c) that the
array radiates.  The law thus needs no beam, only a power.

What it assumes makes it an estimate from above for a haptic array: the ultrasound runs freely until
air absorbs it (1 / (2 alpha), some metres), where a hand or a ceiling stops it, and the listener is
on its axis.  What it leaves out: what a hand or a wall demodulates by itself, and what a beam of
steady power makes by moving (spatio-temporal modulation).
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from haptogram.acoustics.arrays import ComplexArray, FloatArray, check_computed_number
from haptogram.acoustics.field.reference import FieldEngine
from haptogram.acoustics.levels import exposure
from haptogram.acoustics.levels.average import periodic_resonator_start
from haptogram.acoustics.levels.dynamics import Resonator
from haptogram.acoustics.levels.force import level_db_spl
from haptogram.acoustics.levels.harmonic import NONLINEARITY
from haptogram.acoustics.memory import check_array_memory
from haptogram.acoustics.model.drive import as_drive_sequence
from haptogram.settings.arguments import check_positive, check_whole

_APERTURES: Final = 4.0  # radius of the sphere over the array's: the beam's power is radial there
_DIRECTIONS: Final = 16_384  # 0.7 degrees apart: a few on the main lobe of 16 x 16 elements
_VALUES_PER_CHUNK: Final = 1 << 20


def radiated_power_w(
    engine: FieldEngine, weights: ArrayLike, directions: int = _DIRECTIONS
) -> FloatArray:
    """Return the acoustic power of each drive into the half space in front, in watts.

    The mean of |p|^2 / (2 rho c) over a half sphere of four array radii, absorption undone; within
    a few per cent.

    Parameters
    ----------
    weights : (F, N) array_like of complex
        The drives.

    directions : int
        Points of the half sphere, 10 to a million.

    Returns
    -------
    (F,) numpy.ndarray

    Raises
    ------
    ConfigurationError
        No drive; directions out of range.

    Examples
    --------
    >>> f"{radiated_power_w(engine, weights[None])[0]:.1f} W"
    '6.5 W'
    """
    drives = as_drive_sequence(weights, engine.model.array.count)
    places, per_square_pa = _demodulation_sphere(engine, directions)
    power = np.zeros(len(drives))
    for part in _demodulation_parts(places, len(drives)):
        power += (np.abs(engine.pressure(drives, part)) ** 2).sum(axis=1)
    return power * per_square_pa


def demodulated_lines(
    engine: FieldEngine,
    weights: ArrayLike,
    distance_m: float,
    frame_s: float,
    resonator: Resonator,
    directions: int = _DIRECTIONS,
) -> tuple[FloatArray, FloatArray]:
    """Return the audible lines of a repeated sequence of drives, by Berktay's law.

    Parameters
    ----------
    weights : (F, N) array_like of complex
        The drives, each held for *frame_s*.
    distance_m : float
        Of the listener from the array, on the axis of the beam.
    resonator : Resonator
        Envelope of the transducers; without its lag the steps between frames would have no end of
        overtones.

    Returns
    -------
    frequency_hz : (K,) numpy.ndarray
        Multiples of the repetition rate, 20 Hz to 20 kHz.
    pressure_rms_pa : (K,) numpy.ndarray

    Raises
    ------
    ConfigurationError
        No drive; a distance or a duration not above 0; a sequence whose lines would not fit; a
        medium that absorbs nothing; a resonator without a lag.

    Examples
    --------
    >>> modulated = np.array([[0.0], [1.0]]) * weights  # 500 Hz, if a frame lasts 1 ms
    >>> lag = Resonator.from_bandwidth(2000.0)
    >>> frequencies_hz, levels_pa = demodulated_lines(engine, modulated, 0.5, 1e-3, lag)
    >>> frequencies_hz[:2].tolist()
    [500.0, 1000.0]
    """
    drives = as_drive_sequence(weights, engine.model.array.count)
    medium = engine.model.medium
    check_positive("absorption_np_m", medium.absorption_np_m)
    check_positive("time_constant_s", resonator.time_constant_s)
    period_s = len(drives) * check_positive("frame_s", frame_s)
    highest = check_computed_number("highest line", exposure.AUDIBLE_LIMIT_HZ * period_s)
    check_array_memory("lines", (math.ceil(highest),), 64)
    orders = np.arange(
        max(1, math.ceil(exposure.LOWEST_AUDIBLE_HZ * period_s)), math.floor(highest) + 1
    )
    rate = 2.0 * np.pi * orders / period_s
    power = _demodulated_power_lines(engine, drives, frame_s, resonator, orders, directions)
    spread = 8.0 * np.pi * medium.sound_speed_m_s**3 * medium.absorption_np_m
    law = NONLINEARITY / (spread * check_positive("distance_m", distance_m))
    pressure_rms_pa = np.abs(law * rate**2 * math.sqrt(2.0) * power).astype(np.float64)
    return orders / period_s, pressure_rms_pa


def demodulated_level_db_a(
    engine: FieldEngine,
    weights: ArrayLike,
    distance_m: float,
    frame_s: float,
    resonator: Resonator,
) -> float:
    """Return the A-weighted level of :func:`demodulated_lines`, in dB re 20 uPa.

    Minus infinity for drives of steady power.

    Raises
    ------
    ConfigurationError
        As :func:`demodulated_lines`.

    Examples
    --------
    >>> modulated = np.array([[0.0], [1.0]]) * weights  # 500 Hz, if a frame lasts 1 ms
    >>> lag = Resonator.from_bandwidth(2000.0)
    >>> level = demodulated_level_db_a(engine, modulated, 0.5, 1e-3, lag)
    >>> 0.0 < level < 120.0
    True
    """
    frequency_hz, pressure_pa = demodulated_lines(engine, weights, distance_m, frame_s, resonator)
    weighting = 10.0 ** (exposure.a_weighting_db(frequency_hz) / 20.0)
    return level_db_spl(math.sqrt(float(np.sum((weighting * pressure_pa) ** 2))))


def _demodulated_power_lines(
    engine: FieldEngine,
    drives: ComplexArray,
    frame_s: float,
    resonator: Resonator,
    orders: np.ndarray[tuple[int, ...], np.dtype[np.int64]],
    directions: int,
) -> ComplexArray:
    """Return the Fourier coefficients of the radiated power, in watts.

    In a frame every field goes from where it was to where it settles, p(t) = s + g e^{-t / tau}, so
    that the power is A + 2 B e^{-t / tau} + C e^{-2 t / tau}: transformed in closed form.
    """
    sums = _demodulated_frame_sums(engine, drives, resonator.decay(frame_s), directions)
    spectra = np.fft.fft(sums, axis=1)[:, orders % len(drives)]
    period_s = len(drives) * frame_s
    lines = np.zeros(len(orders), dtype=np.complex128)
    for decays, spectrum in enumerate(spectra):
        rate = decays / resonator.time_constant_s + 2j * np.pi * orders / period_s
        lines += spectrum * -np.expm1(-rate * frame_s) / rate / period_s
    return lines


def _demodulated_frame_sums(
    engine: FieldEngine, drives: ComplexArray, left: float, directions: int
) -> FloatArray:
    """Return A, 2 B and C of each frame, (3, F)."""
    places, per_square_pa = _demodulation_sphere(engine, directions)
    sums = np.zeros((3, len(drives)))
    for part in _demodulation_parts(places, len(drives)):
        settled = engine.pressure(drives, part)
        state = periodic_resonator_start(settled, left)
        for index, field in enumerate(settled):
            gap = state - field
            sums[0, index] += np.vdot(field, field).real
            sums[1, index] += 2.0 * np.vdot(field, gap).real
            sums[2, index] += np.vdot(gap, gap).real
            state = field + left * gap
    return sums * per_square_pa


def _demodulation_sphere(engine: FieldEngine, directions: int) -> tuple[FloatArray, float]:
    """Return places on a half sphere, and the power that each of them stands for, per Pa^2."""
    check_whole("directions", directions, 10, exposure.MAX_DIRECTIONS)
    model, array = engine.model, engine.model.array
    aperture_m = float(np.linalg.norm(array.positions_m - array.centre_m, axis=1).max())
    radius_m = max(_APERTURES * aperture_m, 10.0 * model.wavelength_m)
    area_m2 = 2.0 * np.pi * radius_m**2 / directions
    undone = math.exp(2.0 * model.medium.absorption_np_m * radius_m)
    places = array.centre_m + radius_m * exposure.half_sphere_directions(
        array.facing, directions, array.axes[0]
    )
    return places, undone * area_m2 / (2.0 * model.medium.impedance)


def _demodulation_parts(places: FloatArray, drives: int) -> list[FloatArray]:
    size = max(1, _VALUES_PER_CHUNK // drives)
    return [places[start : start + size] for start in range(0, len(places), size)]
