"""Arrays whose elements are the nodes of a planar rectangular lattice, wherever it lies.

The squared distance to such an element is a sum of one term for its row and one for its column, so
that most of the geometry is computed once per row. Nodes may be empty.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics.arrays import FloatArray, read_only_array
from haptogram.acoustics.model.geometry import TransducerArray
from haptogram.acoustics.model.own_axes import (
    TOLERANCE_M,
    first_neighbour_vectors,
    grid_rows_and_columns,
    plane_axes,
)
from haptogram.settings.frozen import dataclass


@dataclass(frozen=True, eq=False, slots=True)
class Lattice:
    """A planar rectangular lattice of elements that all face along its normal.

    Attributes
    ----------
    axes : (3, 3) numpy.ndarray
        Unit vectors along the rows, along the columns, and the normal: a right-handed frame.
    x_m, y_m : (nx,), (ny,) numpy.ndarray
        Coordinates of the nodes from the array's centroid, in metres, increasing.
    elements : (nx, ny) numpy.ndarray of int64
        Number of the element at each node; -1 where there is none.
    """

    axes: FloatArray
    x_m: FloatArray
    y_m: FloatArray
    elements: NDArray[np.int64]

    def spread(self, values: FloatArray) -> FloatArray:
        """Return (..., N) values of the elements as (..., nx, ny), 0 at empty nodes."""
        return np.where(self.elements >= 0, values[..., self.elements], 0.0)


def find_lattice(array: TransducerArray) -> Lattice | None:
    """Return the lattice that the elements lie on, or None."""
    normal = array.normals[0]
    if np.abs(array.normals - normal).max() > 1e-9:
        return None
    offsets = array.positions_m - array.centre_m
    if np.abs(offsets @ normal).max() > TOLERANCE_M:
        return None
    for direction in (*np.eye(3)[:2], *first_neighbour_vectors(offsets)):
        lattice = _lattice_along(direction, normal, offsets)
        if lattice is not None:
            return lattice
    return None


def _lattice_along(
    direction: FloatArray, normal: FloatArray, offsets: FloatArray
) -> Lattice | None:
    """Return the lattice with rows along *direction*; None if elements lie beside its nodes.

    *offsets* (N, 3): elements from the array's centre; *normal*: of their plane.
    """
    axes = plane_axes(normal, direction)
    found = None if axes is None else grid_rows_and_columns(axes, offsets)
    if axes is None or found is None:
        return None
    (x_m, rows), (y_m, columns) = found
    elements = np.full((len(x_m), len(y_m)), -1, dtype=np.int64)
    elements[rows, columns] = np.arange(len(offsets))
    for values in (axes, x_m, y_m, elements):
        read_only_array(values)
    return Lattice(axes, x_m, y_m, elements)
