"""The axes of an array: across its face, along its rows and columns, and away from it."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics.arrays import FloatArray

TOLERANCE_M: Final = 1e-9
_ROUNDED_M: Final = 5e-6  # lines and planes of an array that was rounded to whole micrometres
_MAX_EMPTY: Final = 0.3  # largest share of empty nodes; more cost more than a lattice saves
_STEEP: Final = 0.5  # cosine: elements that look along the plane they lie in have another face
_UPRIGHT: Final = 1e-12
_CANCELLED: Final = 0.2  # mean of unit normals that look at each other, or around, on the whole
_ONE_LINE: Final = 1.5  # least ratio of the normals along one line to those across it
_UP: Final[FloatArray] = np.array([0.0, 0.0, 1.0])


def mean_array_normal(normals: FloatArray) -> FloatArray | None:
    """Return the unit vector along the mean of the normals, None if they nearly cancel out."""
    mean: FloatArray = normals.mean(axis=0)
    length = float(np.linalg.norm(mean))
    return mean / length if length > _CANCELLED else None


def array_axes(
    positions: FloatArray, normals: FloatArray, grid_shape: tuple[int, int] | None
) -> FloatArray:
    """Return the (3, 3) axes of an array, see :attr:`.geometry.TransducerArray.axes`."""
    offsets = positions - positions.mean(axis=0)
    face = _face_normal(offsets, normals)
    if np.abs(face - _UP).max() < _UPRIGHT:  # rounding does not tilt an array
        face = _UP
    if grid_shape is not None:
        axes = plane_axes(face, _row_direction(positions, face, grid_shape))
        if axes is not None:
            return axes + 0.0
    upright = _axes_turned_least(face)
    for direction in (upright[0], *first_neighbour_vectors(offsets)):
        axes = plane_axes(face, direction)
        if axes is not None and grid_rows_and_columns(axes, offsets, _ROUNDED_M) is not None:
            return _quarter_turned_axes(axes, upright)
    return upright


def plane_axes(normal: FloatArray, direction: FloatArray) -> FloatArray | None:
    """Return the right-handed frame of *normal*, its first axis along *direction* if it can be."""
    first = direction - (direction @ normal) * normal
    length = float(np.linalg.norm(first))
    if length < 1e-6 * float(np.linalg.norm(direction)) or length == 0.0:
        return None
    first = first / length
    return np.stack([first, np.cross(normal, first), normal])


def axes_about_normal(normal: FloatArray, reference: FloatArray | None = None) -> FloatArray:
    """Return a right-handed frame of a unit *normal*, whose first axis no chance decides.

    That axis is the one of *reference* (3, 3), by default of the world, that is furthest off
    *normal*, turned into the plane across it.
    """
    axes = np.eye(3) if reference is None else reference
    frame = plane_axes(normal, axes[int(np.abs(axes @ normal).argmin())])
    assert frame is not None  # no axis of a frame is further than 55 degrees off this plane
    return frame


def grid_rows_and_columns(
    axes: FloatArray, offsets: FloatArray, tolerance_m: float = TOLERANCE_M
) -> tuple[tuple[FloatArray, NDArray[np.intp]], tuple[FloatArray, NDArray[np.intp]]] | None:
    """Return, along the first two axes, the levels that *offsets* lie on, and the level of each.

    Levels further apart than *tolerance_m* are different ones.  None if they would leave too many
    nodes of a lattice empty.
    """
    along_x, along_y = (_levels_along_axis(offsets @ axis, tolerance_m) for axis in axes[:2])
    nodes = len(along_x[0]) * len(along_y[0])
    return None if nodes * (1.0 - _MAX_EMPTY) > len(offsets) else (along_x, along_y)


def _levels_along_axis(
    values: FloatArray, tolerance_m: float
) -> tuple[FloatArray, NDArray[np.intp]]:
    """Return the mean of each group of *values*, and the number of each value's group.

    Sorted values are in one group while they rise by *tolerance_m* or less from each to the next.
    The means increase; groups are numbered from 0 in their order.
    """
    order = np.argsort(values)
    steps = np.diff(values[order]) > tolerance_m
    rank = np.zeros(len(values), dtype=np.intp)
    rank[order] = np.concatenate([[0], np.cumsum(steps)])
    levels: FloatArray = np.bincount(rank, weights=values) / np.bincount(rank)
    return levels, rank


def _face_normal(offsets: FloatArray, normals: FloatArray) -> FloatArray:
    """Return the unit normal (3,) of the plane that contains the elements; else their mean normal.

    They are in a plane within 5 µm. The mean normal too where it is 60 degrees or more off the
    plane's; where all normals cancel, the axis about which they are arranged.
    """
    facing = mean_array_normal(normals)
    if facing is None:
        facing = _fallback_axis(normals)
    squares, directions = np.linalg.eigh(offsets.T @ offsets)
    across = directions[:, squares < len(offsets) * _ROUNDED_M**2]
    if np.abs(offsets @ facing).max() < _ROUNDED_M:
        return facing
    normal: FloatArray = across @ (across.T @ facing)
    length = float(np.linalg.norm(normal))
    return normal / length if length > _STEEP else facing


def _fallback_axis(normals: FloatArray) -> FloatArray:
    """Return a unit axis (3,), pointing upwards, about which normals that sum to 0 lie; else +z."""
    squares, directions = np.linalg.eigh(normals.T @ normals)
    if squares[2] > _ONE_LINE * squares[1]:
        axis = directions[:, 2]
    elif squares[1] > _ONE_LINE * squares[0]:
        axis = directions[:, 0]
    else:
        return _UP
    axis = np.where(np.abs(axis) < _UPRIGHT, 0.0, axis)
    upwards = next(part for part in axis[::-1] if part)
    signed: FloatArray = axis * np.sign(upwards)
    return signed


def _row_direction(
    positions: FloatArray, face: FloatArray, grid_shape: tuple[int, int]
) -> FloatArray:
    """Return the vector (3,) from the first element to the next one along x of a grid.

    *grid_shape*: columns and rows. With one column it is the vector to the next along y, turned by
    -90 degrees about *face*, the unit normal of the plane.
    """
    nx, ny = grid_shape
    if nx > 1:
        along: FloatArray = positions[ny] - positions[0]
        return along
    return np.cross(positions[min(1, ny - 1)] - positions[0], face)


def _axes_turned_least(face: FloatArray) -> FloatArray:
    """Return the axes (3, 3) of the world, turned by the least angle that brings z to *face*."""
    x, y, z = face.tolist()
    share = 1.0 / (1.0 + z) if z > -1.0 + _UPRIGHT else 0.0
    axes = plane_axes(face, np.array([1.0 - x * x * share, -x * y * share, -x]))
    return np.eye(3) if axes is None else axes + 0.0


def first_neighbour_vectors(offsets: FloatArray) -> list[FloatArray]:
    """Return the vector from the first element to its nearest neighbour, if any."""
    steps = offsets[1:] - offsets[0]
    return [steps[np.linalg.norm(steps, axis=1).argmin()]] if len(steps) else []


def _quarter_turned_axes(axes: FloatArray, upright: FloatArray) -> FloatArray:
    """Return *axes* (3, 3) after quarter turns around the last; the first nearest *upright*'s."""
    ways = np.array([axes[0], axes[1], -axes[0], -axes[1]])
    first = ways[int((ways @ upright[0]).argmax())]
    return np.stack([first, np.cross(axes[2], first), axes[2]]) + 0.0
