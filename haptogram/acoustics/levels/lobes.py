"""Secondary lobes: where an array coarser than half a wavelength radiates besides its target."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from haptogram.acoustics.arrays import FloatArray, as_coordinates
from haptogram.acoustics.field.reference import (
    FieldEngine,
    pressure_level_in_front,
)
from haptogram.acoustics.local_maximum import STEPS, climb_to_maximum
from haptogram.acoustics.memory import check_array_memory
from haptogram.acoustics.model.drive import as_drive
from haptogram.errors import ConfigurationError
from haptogram.settings.arguments import check_number

_POINTS_PER_WAVELENGTH: Final = 3
_NUMBERS_PER_POINT: Final = 12  # that the search holds at once
_CLIMBED: Final = 8  # maxima of the grid that are refined
_MAX_HALF_WIDTH_M: Final = 0.5


@dataclass(frozen=True, slots=True)
class SecondaryLobe:
    """The largest maximum besides the focus, in the target's plane parallel to the array's face.

    Attributes
    ----------
    position_m : (float, float, float)
        Where.
    level_db : float
        |p| there over |p| at the target.

    Examples
    --------
    >>> lobe = largest_secondary_lobe(engine, weights, target, half_width_m=0.05)
    >>> -20.0 < lobe.level_db < 0.0
    True
    """

    position_m: tuple[float, float, float]
    level_db: float


def largest_secondary_lobe(
    engine: FieldEngine, weights: ArrayLike, target_m: ArrayLike, half_width_m: float = 0.150
) -> SecondaryLobe | None:
    """Return the largest maximum of |p| besides the focus, parallel to the array's face.

    Looked for in the plane through the target, on a grid of three points per wavelength, up to
    *half_width_m* from above the array's centre along its own x and y, and from there between its
    points; the maximum next to the target is the focus.  Steered off axis, a 10 mm pitch leaves
    lobes of only -8 dB.

    Raises
    ------
    ConfigurationError
        A half-width outside 10 to 500 mm, no sound at the target, or as
        :func:`~haptogram.acoustics.pressure`.

    Examples
    --------
    >>> lobe = largest_secondary_lobe(engine, weights, target, half_width_m=0.05)
    >>> lobe.position_m[2] == target[2]
    True
    """
    check_number("half_width_m", half_width_m, 0.010, _MAX_HALF_WIDTH_M)
    target = as_coordinates("target_m", target_m)
    count = math.ceil(2.0 * half_width_m * _POINTS_PER_WAVELENGTH / engine.model.wavelength_m)
    check_array_memory("the grid of a search", (count + 1, count + 1, _NUMBERS_PER_POINT), 8)
    side = np.linspace(-half_width_m, half_width_m, count + 1)
    x, y = np.meshgrid(side, side, indexing="ij")
    array = engine.model.array
    height_m = array.local_m(target)[2]
    points = array.world_m(np.stack([x.ravel(), y.ravel(), np.full(x.size, height_m)], axis=1))
    drive = as_drive(weights, engine.model.array.count)
    focus = abs(complex(engine.pressure(drive, target[None])[0]))
    if not focus > 0.0:
        raise ConfigurationError(f"no sound at {target.tolist()} m: it is no focus")
    level = pressure_level_in_front(engine, drive, points).reshape(x.shape)
    tops = np.flatnonzero(_lobe_maxima(level))
    if len(tops) < 2:
        return None
    main = np.argmin(np.linalg.norm(points[tops] - target, axis=1))
    others = np.delete(tops, main)
    loudest = others[np.argsort(level.ravel()[others])[-_CLIMBED:]]
    top_m, found = climb_to_maximum(
        lambda places: pressure_level_in_front(engine, drive, places),
        points[loudest],
        float(side[1] - side[0]),
        STEPS[STEPS[:, 2] == 0.0] @ array.axes,
    )
    x_m, y_m, z_m = top_m.tolist()
    return SecondaryLobe((x_m, y_m, z_m), 20.0 * math.log10(found / focus))


def _lobe_maxima(level: FloatArray) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Return a mask, shaped as *level*, of the values above all eight neighbours.

    Never on the border. Of equal neighbours, as a symmetric field has them, the last is above the
    others.
    """
    result = np.zeros(level.shape, dtype=np.bool_)
    core = level[1:-1, 1:-1]
    inner = np.ones(core.shape, dtype=np.bool_)
    rows, columns = level.shape
    for i, j in itertools.product((0, 1, 2), (0, 1, 2)):
        neighbour = level[i : rows - 2 + i, j : columns - 2 + j]
        if (i, j) != (1, 1):
            inner &= core >= neighbour if (i, j) < (1, 1) else core > neighbour
    result[1:-1, 1:-1] = inner
    return result
