"""Sound pressure levels of an array at people, in dB SPL.

What is computed: levels re 20 uPa of the linear free field, of the carrier (unweighted, as no
weighting is defined at 40 kHz).  What is not: what is heard of a modulation or of steps between
drives; reflections by walls, hand and head; and any judgement of the levels.

Limits for airborne ultrasound differ between bodies and countries: compare with the one that
applies to you.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from haptogram.acoustics.arrays import FloatArray, as_point_array
from haptogram.acoustics.field.reference import FieldEngine, points_with_field
from haptogram.acoustics.levels.average import mean_square_pressure
from haptogram.acoustics.levels.dynamics import Resonator
from haptogram.acoustics.levels.force import level_db_spl
from haptogram.acoustics.local_maximum import STEPS, climb_to_maximum
from haptogram.acoustics.model.drive import as_drive_sequence
from haptogram.acoustics.model.model import AcousticModel
from haptogram.acoustics.model.own_axes import axes_about_normal, plane_axes
from haptogram.settings.arguments import check_positive, check_whole

MAX_DIRECTIONS: Final = 1_000_000
_MOST_DIRECTIONS: Final = 100_000  # most directions, unless more are asked for
_CLIMBED: Final = 16  # directions that are refined: the loudest of a grid may be next to another
STATEMENT: Final = (
    "Unweighted levels of the linear free field, re 20 uPa; no reflections, no demodulated sound, "
    "no judgement. Compare with the limits that apply where the array is used."
)
GUIDELINE: Final = (
    "for comparison: many bodies advise at most 110 dB SPL at work in each third of an octave from "
    "25 to 50 kHz (review: C. Q. Howard, C. H. Hansen, A. C. Zander, J. Occup. Health Saf. Aust. "
    "N. Z. 21(3), 253-257, 2004); for the public less, where there is a limit at all"
)


@dataclass(frozen=True, slots=True)
class Exposure:
    """Levels at one place.

    Attributes
    ----------
    position_m : (float, float, float)
        The place.
    maximum_db_spl : float
        Largest level of any frame.
    equivalent_db_spl : float
        Level of the mean square over the sequence (Leq).

    Examples
    --------
    >>> Exposure((0.0, -0.4, 0.4), 124.1, 121.0).equivalent_db_spl
    121.0
    """

    position_m: tuple[float, float, float]
    maximum_db_spl: float
    equivalent_db_spl: float


def exposure_at(
    engine: FieldEngine,
    weights: ArrayLike,
    places_m: ArrayLike,
    frame_s: float,
    resonator: Resonator | None = None,
) -> list[Exposure]:
    """Return the levels of a repeated sequence of drives at places such as ears.

    Parameters
    ----------
    weights : (F, N) array_like of complex
        The drives, each held for *frame_s*.
    places_m : (M, 3) array_like
        Places, in metres.
    frame_s : float
        Duration of a frame.
    resonator : Resonator, optional
        Envelope of the transducers, for the equivalent level; the maximum is of settled frames.

    Raises
    ------
    ConfigurationError
        As :func:`~haptogram.acoustics.levels.average.mean_square_pressure`.

    Examples
    --------
    >>> (ear,) = exposure_at(engine, weights[None], [(0.0, -0.4, 0.4)], 1e-3)
    >>> f"{ear.maximum_db_spl:.0f} dB SPL"
    '126 dB SPL'
    """
    drives, places = (
        as_drive_sequence(weights, engine.model.array.count),
        as_point_array("places_m", places_m),
    )
    mean = mean_square_pressure(engine, drives, places, frame_s, resonator)
    settled = np.abs(engine.pressure(drives, places)).max(axis=0) / math.sqrt(2.0)
    return [
        Exposure(
            (place[0], place[1], place[2]), level_db_spl(most), level_db_spl(math.sqrt(square))
        )
        for place, most, square in zip(
            places.tolist(), settled.tolist(), mean.tolist(), strict=True
        )
    ]


def worst_exposure(
    engine: FieldEngine,
    weights: ArrayLike,
    distance_m: float,
    frame_s: float,
    directions: int | None = None,
) -> Exposure:
    """Return the loudest place (Leq) on the half sphere that the array faces, around its centre.

    Places behind the baffle and within 1 mm of an element, which have no field, are left out. The
    best of *directions* points of a Fibonacci spiral, and the loudest places next to them. As
    many as needed if not given: two to the width of the narrowest lobe.

    Raises
    ------
    ConfigurationError
        A distance not above 0, or not 10 to a million directions.

    Examples
    --------
    >>> loudest = worst_exposure(engine, weights[None], 0.5, 1e-3, directions=256)
    >>> f"{loudest.equivalent_db_spl:.0f} dB SPL"
    '139 dB SPL'
    """
    check_positive("distance_m", distance_m)
    if directions is None:
        directions = _exposure_directions(engine.model)
    check_whole("directions", directions, 10, MAX_DIRECTIONS)
    array = engine.model.array

    def places_m(directions: FloatArray) -> FloatArray:
        return array.centre_m + distance_m * _exposed_directions_ahead(directions, array.facing)

    def level(directions: FloatArray) -> FloatArray:
        places = places_m(directions)
        square = np.zeros(len(places))
        known = points_with_field(engine.model, places)
        square[known] = mean_square_pressure(engine, weights, places[known], frame_s)
        return square

    spiral = half_sphere_directions(array.facing, directions, array.axes[0])
    best = spiral[np.argsort(level(spiral))[-_CLIMBED:]]
    loudest, _ = climb_to_maximum(
        level, best, math.sqrt(2.0 * math.pi / directions), STEPS @ array.axes
    )
    return exposure_at(engine, weights, places_m(loudest[None]), frame_s)[0]


def _exposure_directions(model: AcousticModel) -> int:
    """Return how many directions cover a half-sphere at half the narrowest lobe's width.

    They are at most 100 000.
    """
    lobe_rad = model.wavelength_m / max(2.0 * model.array.aperture_radius_m, model.wavelength_m)
    return min(math.ceil(2.0 * math.pi * (2.0 / lobe_rad) ** 2), _MOST_DIRECTIONS)


def _exposed_directions_ahead(directions: FloatArray, facing: FloatArray) -> FloatArray:
    """Return unit vectors (M, 3); those that point away from *facing* go to the plane across it."""
    back = np.minimum(directions @ facing, 0.0)
    level = directions - back[:, None] * facing
    unit: FloatArray = level / np.linalg.norm(level, axis=1)[:, None]
    return unit


def half_sphere_directions(
    axis: FloatArray, count: int, side: FloatArray | None = None
) -> FloatArray:
    """Return unit vectors, of nearly equal spacing, at less than 90 degrees to a unit vector.

    The spiral starts towards *side*, by default the axis of the world that is furthest off *axis*.
    """
    index = np.arange(count) + 0.5
    height = 1.0 - index / count
    angle = np.pi * (1.0 + math.sqrt(5.0)) * index
    across = np.sqrt(1.0 - height**2)
    local = np.stack([across * np.cos(angle), across * np.sin(angle), height], axis=1)
    axes = axes_about_normal(axis) if side is None else plane_axes(axis, side)
    assert axes is not None  # *side* has a part across *axis*
    return local @ axes
