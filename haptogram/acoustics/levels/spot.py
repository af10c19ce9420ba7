"""The size of a focal spot, measured in the field."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from haptogram.acoustics.arrays import FloatArray, as_coordinates
from haptogram.acoustics.field.reference import FieldEngine, pressure_level_in_front
from haptogram.acoustics.model.drive import as_drive
from haptogram.errors import ConfigurationError

_HALF_POWER: Final = 10.0 ** (-3.0 / 20.0)
_HALF_PRESSURE: Final = 10.0 ** (-6.0 / 20.0)

_STEPS_PER_WAVELENGTH: Final = 32
_LATERAL_REACH: Final = 8.0  # half the length of a line across the beam, in wavelengths
_AXIAL_REACH: Final = 40.0
_AT_CENTRE_M: Final = 1e-6


@dataclass(frozen=True, slots=True)
class FocalSpot:
    """Full widths of a focus, in metres; NaN where the field does not fall that far.

    Attributes
    ----------
    width_3db_m, width_6db_m, null_to_null_m : (float, float)
        Along the array's own x and y through the target; relative to |p| at the target.
    depth_3db_m : (float, float)
        From the axial maximum toward the array and away from it, along the line from the array's
        centre through the target; of a target at the centre, along the array's own z.
    axial_peak_m : float
        Distance of the axial maximum from the target along that line; negative toward the array.

    Examples
    --------
    >>> spot = measure_spot(engine, weights, target)
    >>> [f"{1e3 * width:.1f} mm" for width in spot.width_3db_m]
    ['8.4 mm', '8.4 mm']
    """

    width_3db_m: tuple[float, float]
    width_6db_m: tuple[float, float]
    null_to_null_m: tuple[float, float]
    depth_3db_m: tuple[float, float]
    axial_peak_m: float


def measure_spot(engine: FieldEngine, weights: ArrayLike, target_m: ArrayLike) -> FocalSpot:
    """Return the size of the focus that a drive makes at a target.

    Sampled at 32 points per wavelength along three lines, with linear interpolation between them.

    Raises
    ------
    ConfigurationError
        No sound at the target, or as :func:`~haptogram.acoustics.field.reference.pressure`.

    Examples
    --------
    >>> measure_spot(engine, weights, target).axial_peak_m < target[2]
    True
    """
    drive = as_drive(weights, engine.model.array.count)
    target = as_coordinates("target_m", target_m)
    if not abs(engine.pressure(drive, target[None])[0]) > 0.0:
        raise ConfigurationError(f"no sound at {target.tolist()} m: it is no focus")
    sides = [_lateral_spot(engine, drive, target, axis) for axis in engine.model.array.axes[:2]]
    depth, peak = _axial_spot(engine, drive, target)
    (three_x, six_x, null_x), (three_y, six_y, null_y) = sides
    return FocalSpot((three_x, three_y), (six_x, six_y), (null_x, null_y), depth, peak)


def _lateral_spot(
    engine: FieldEngine, drive: ArrayLike, target: FloatArray, axis: FloatArray
) -> tuple[float, float, float]:
    """Return the -3 dB, -6 dB and null-to-null widths (m) along one axis through the target.

    A width is NaN unless the level falls that far on both sides, within 8 wavelengths.
    """
    steps, level = _spot_line(engine, drive, target, axis, _LATERAL_REACH)
    middle = len(steps) // 2
    halves = [(steps[middle:], level[middle:]), (-steps[middle::-1], level[middle::-1])]
    three = sum(_spot_crossing(s, v, _HALF_POWER * level[middle]) for s, v in halves)
    six = sum(_spot_crossing(s, v, _HALF_PRESSURE * level[middle]) for s, v in halves)
    return three, six, sum(_first_spot_minimum(s, v) for s, v in halves)


def _axial_spot(
    engine: FieldEngine, drive: ArrayLike, target: FloatArray
) -> tuple[tuple[float, float], float]:
    """Return the -3 dB depths before and behind the axial maximum; and the maximum less the target.

    In m along the ray from the array's centre through the target, outwards positive. A depth is NaN
    if the level does not fall so far within 40 wavelengths.
    """
    array = engine.model.array
    ray = target - array.centre_m
    distance = float(np.linalg.norm(ray))
    axis = ray / distance if distance > _AT_CENTRE_M else array.axes[2]
    # Between elements that face each other the centre is no element.
    nearest = float(np.linalg.norm(target - array.positions_m, axis=1).min())
    steps, level = _spot_line(
        engine, drive, target, axis, _AXIAL_REACH, nearest=-0.8 * max(distance, nearest)
    )
    # The main lobe's own maximum: uphill from the target, past nothing.
    top = int(np.argmin(np.abs(steps)))
    while 0 < top < len(level) - 1 and level[top] < max(level[top - 1], level[top + 1]):
        top += 1 if level[top + 1] > level[top - 1] else -1
    limit = _HALF_POWER * level[top]
    below = _spot_crossing(steps[top] - steps[top::-1], level[top::-1], limit)
    above = _spot_crossing(steps[top:] - steps[top], level[top:], limit)
    return (below, above), float(steps[top])


def _spot_line(
    engine: FieldEngine,
    drive: ArrayLike,
    target: FloatArray,
    axis: FloatArray,
    reach: float,
    nearest: float = -math.inf,
) -> tuple[FloatArray, FloatArray]:
    """Return the offsets (m) along a line through the target, and |p| there.

    The line has *reach* wavelengths each way, but no offset below *nearest* (m).
    """
    step = engine.model.wavelength_m / _STEPS_PER_WAVELENGTH
    count = int(reach * _STEPS_PER_WAVELENGTH)
    offsets = step * np.arange(-count, count + 1, dtype=np.float64)
    offsets = offsets[offsets >= nearest]
    return offsets, pressure_level_in_front(engine, drive, target + offsets[:, None] * axis)


def _spot_crossing(steps: FloatArray, level: FloatArray, limit: float) -> float:
    """Return the step, interpolated, at which *level* first falls to *limit*; NaN if never."""
    low = np.flatnonzero(level < limit)
    if not len(low):
        return math.nan
    i = int(low[0])
    part = (level[i - 1] - limit) / (level[i - 1] - level[i])
    return float(steps[i - 1] + part * (steps[i] - steps[i - 1]))


def _first_spot_minimum(steps: FloatArray, level: FloatArray) -> float:
    """Return where |p|^2 has its first minimum behind its peak, by a parabola; NaN if nowhere.

    *level* is |p|; the result has the unit of *steps*.
    """
    rises = np.diff(level) > 0.0
    top = int(rises.argmin())  # a focus off the axis has its peak beside the target
    rising = top + np.flatnonzero(rises[top:])
    if not len(rising) or rising[0] == 0:
        return math.nan
    i = int(rising[0])
    before, low, after = level[i - 1 : i + 2] ** 2
    part = 0.5 * (before - after) / (before - 2.0 * low + after)
    return float(steps[i] + part * (steps[1] - steps[0]))
