"""A plane in the field, and the pressure on it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from haptogram.acoustics import AcousticModel, TransducerArray, points_in_front
from haptogram.acoustics.arrays import FloatArray, as_coordinates
from haptogram.acoustics.field import reference
from haptogram.errors import ConfigurationError
from haptogram.settings.arguments import Progress, check_choice

_ORIENTATIONS: Final = {"xy": (0, 1), "xz": (0, 2), "yz": (1, 2)}
MAX_POINTS: Final = 4_000_000
_POINTS_PER_CALL: Final = 4096
_CLEARANCE_M: Final = 2e-3  # the far-field model does not hold closer to an element


@dataclass(frozen=True, slots=True)
class PicturePlane:
    """A rectangle parallel to two of the axes of the world, whichever way an array faces.

    Attributes
    ----------
    orientation : str
        "xy", "xz" or "yz": its horizontal and vertical axis.
    through_m : (float, float, float)
        A point of it; only the coordinate along its normal counts.
    horizontal_m, vertical_m : (float, float)
        Ranges of its two axes.
    step_m : float
        Spacing of the samples.

    Raises
    ------
    ConfigurationError
        An unknown orientation, an empty range, or more than 4 million points.
    """

    orientation: str
    through_m: tuple[float, float, float]
    horizontal_m: tuple[float, float]
    vertical_m: tuple[float, float]
    step_m: float = 1e-3

    def __post_init__(self) -> None:
        check_choice("plane", self.orientation, tuple(_ORIENTATIONS))
        if not (math.isfinite(self.step_m) and self.step_m > 0.0):
            raise ConfigurationError(f"step_m is {self.step_m:g}, must be finite and above 0")
        sides = (self.horizontal_m, self.vertical_m)
        for low, high in sides:
            if not (math.isfinite(low) and math.isfinite(high) and low < high):
                raise ConfigurationError(f"range is {low:g} to {high:g} m, must ascend")
        points = math.prod((high - low) / self.step_m + 1.0 for low, high in sides)
        if points > MAX_POINTS:
            raise ConfigurationError(
                f"a plane of {points:.3g} points, must be at most {MAX_POINTS}; take a larger step"
            )

    @classmethod
    def around(
        cls,
        array: TransducerArray,
        orientation: str,
        place_m: ArrayLike,
        half_width_m: float,
        step_m: float,
    ) -> Self:
        """Return the square around a place; over a place above *array* from 5 mm above it on."""
        check_choice("plane", orientation, tuple(_ORIENTATIONS))
        x, y, z = as_coordinates("place_m", place_m).tolist()
        ranges = {
            name: (value - half_width_m, value + half_width_m)
            for name, value in zip("xyz", (x, y, z), strict=True)
        }
        floor = float(array.bounds_m[1, 2]) + 0.005
        if floor < z:
            ranges["z"] = (floor, max(ranges["z"][1], floor + 0.01))
        first, second = (ranges[name] for name in orientation)
        return cls(orientation, (x, y, z), first, second, step_m)

    @property
    def axes(self) -> tuple[int, int]:
        """Indices of the horizontal and the vertical axis."""
        return _ORIENTATIONS[self.orientation]

    @property
    def normal_axis(self) -> int:
        """Index of the axis that the plane is perpendicular to."""
        return 3 - sum(self.axes)

    def coordinates_m(self) -> tuple[FloatArray, FloatArray]:
        """Return the samples of the horizontal and of the vertical axis."""
        first, second = (
            np.linspace(low, high, round((high - low) / self.step_m) + 1)
            for low, high in (self.horizontal_m, self.vertical_m)
        )
        return first, second

    def points_m(self) -> FloatArray:
        """Return the (V * H, 3) points, the horizontal axis running fastest."""
        across, up = self.coordinates_m()
        points = np.empty((len(up), len(across), 3))
        points[...] = self.through_m
        points[..., self.axes[0]] = across
        points[..., self.axes[1]] = up[:, None]
        return points.reshape(-1, 3)


def sample_picture_points(
    model: AcousticModel,
    plane: PicturePlane,
    function: Callable[[FloatArray], NDArray[np.generic]],
    progress: Progress | None,
) -> NDArray[np.generic]:
    """Return the values of *function* at the points of a plane; NaN where there is no field."""
    points = plane.points_m()
    front = points_in_front(model, points)
    if not front.any():
        reference.check_field_points(model, points)  # says how far behind
    clear = np.flatnonzero(front & reference.points_clear_of_elements(model, points, _CLEARANCE_M))
    if not len(clear):
        raise ConfigurationError("every point of the plane is within 2 mm of an element")
    parts = []
    for start in range(0, len(clear), _POINTS_PER_CALL):
        chunk = clear[start : start + _POINTS_PER_CALL]
        parts.append(function(points[chunk]))
        if progress is not None:
            progress(min(start + _POINTS_PER_CALL, len(clear)), len(clear))
    found = np.concatenate(parts)
    values = np.full(len(points), np.nan, dtype=found.dtype)
    values[clear] = found
    across, up = plane.coordinates_m()
    return values.reshape(len(up), len(across))
