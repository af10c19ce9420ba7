"""A plane in the field, and the pressure on it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from haptogram.acoustics import FieldEngine, points_in_front
from haptogram.acoustics.arrays import ComplexArray, FloatArray
from haptogram.acoustics.field.reference import (
    check_field_points,
    points_clear_of_elements,
    points_with_field,
)
from haptogram.acoustics.levels.average import mean_square_pressure
from haptogram.acoustics.levels.dynamics import Resonator
from haptogram.errors import ConfigurationError
from haptogram.settings.arguments import Progress

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
        if self.orientation not in _ORIENTATIONS:
            raise ConfigurationError(
                f"plane is {self.orientation!r}, must be one of {', '.join(_ORIENTATIONS)}"
            )
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


@dataclass(frozen=True, eq=False, slots=True)
class PictureField:
    """Values on a plane.

    Attributes
    ----------
    plane : PicturePlane
        The plane.
    values : (V, H) numpy.ndarray
        Complex peak pressure of one drive, or real RMS pressure of a sequence, in pascals; NaN
        within 2 mm of an element, and behind all of them if they are baffled.
    """

    plane: PicturePlane
    values: NDArray[Any]

    def peak_m(self) -> tuple[float, float, float]:
        """Return the position of the largest magnitude."""
        index = int(np.nanargmax(np.abs(self.values)))
        x, y, z = self.plane.points_m()[index].tolist()
        return x, y, z


def sample_picture_plane(
    engine: FieldEngine, weights: ArrayLike, plane: PicturePlane, progress: Progress | None = None
) -> PictureField:
    """Return the complex pressure of one drive on a plane; *progress* gets (done, total)."""
    return PictureField(
        plane,
        _sample_picture(engine, plane, lambda points: engine.pressure(weights, points), progress),
    )


def sample_picture_mean(
    engine: FieldEngine,
    weights: ArrayLike,
    plane: PicturePlane,
    frame_s: float,
    resonator: Resonator | None = None,
    progress: Progress | None = None,
) -> PictureField:
    """Return the RMS pressure of a repeated sequence of drives (F, N) on a plane."""

    def rms(points: FloatArray) -> FloatArray:
        square = mean_square_pressure(engine, weights, points, frame_s, resonator)
        root: FloatArray = np.sqrt(square)
        return root

    return PictureField(plane, _sample_picture(engine, plane, rms, progress))


def picture_field_pressure(
    engine: FieldEngine, weights: ArrayLike, points: FloatArray
) -> ComplexArray:
    """Return the pressure of one drive at (M, 3) points, NaN where the model has no field."""
    pressure = np.full(len(points), np.nan, dtype=np.complex128)
    known = points_with_field(engine.model, points)
    pressure[known] = engine.pressure(weights, points[known])
    return pressure


def _sample_picture(
    engine: FieldEngine,
    plane: PicturePlane,
    function: Callable[[FloatArray], NDArray[np.generic]],
    progress: Progress | None,
) -> NDArray[np.generic]:
    points = plane.points_m()
    front = points_in_front(engine.model, points)
    if not front.any():
        check_field_points(engine.model, points)  # says how far behind
    clear = np.flatnonzero(front & points_clear_of_elements(engine.model, points, _CLEARANCE_M))
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
