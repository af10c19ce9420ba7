"""A board's elements in the order of its channels, and the axes that its own programs use."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from haptogram.acoustics.arrays import FloatArray, as_float_array
from haptogram.acoustics.model.geometry import TransducerArray
from haptogram.settings.frozen import dataclass, field

#: Rows are our axes in those of a client: its +y is up, our +z.
Y_UP: Final = ((1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0))
#: A client whose +z is up, like ours.
Z_UP: Final = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))

Rows = tuple[tuple[float, float, float], ...]


@dataclass(frozen=True, slots=True)
class BoardLayout:
    """The elements of a board, or of several that one program drives.

    Attributes
    ----------
    name, title : str
        Short name; the board.
    source : str
        Where the geometry is from, and what of it is assumed.
    array : callable
        Returns the array, element n at channel n; every element emits towards our +z, or towards
        the other board.
    client_axes : tuple of 3 rows
        Our axes in those of the board's own programs: ours = rows @ theirs.
    assumed : str
        The assumed part of it, and how a user gives the right one; empty: nothing is assumed.

    Examples
    --------
    >>> from haptogram.acoustics.model.boards.table import LAYOUTS
    >>> layout = LAYOUTS["sonicsurface"]
    >>> layout.ours_m((0.0, 0.12, 0.0)).tolist(), layout.up
    ([0.0, 0.0, 0.12], '+y')
    >>> layout.clients_m((0.0, 0.0, 0.12)).tolist()
    [0.0, 0.12, 0.0]
    """

    name: str
    title: str
    source: str
    array: Callable[[], TransducerArray] = field(repr=False)
    client_axes: Rows = Z_UP
    assumed: str = ""

    @property
    def up(self) -> str:
        """The client's axis that is our +z."""
        return "+" + "xyz"[int(np.argmax(self.client_axes[2]))]

    def ours_m(self, client_m: ArrayLike) -> FloatArray:
        """Return (..., 3) points of a client in our axes."""
        points: FloatArray = as_float_array("client_m", client_m) @ np.array(self.client_axes).T
        return points + 0.0

    def clients_m(self, ours_m: ArrayLike) -> FloatArray:
        """Return (..., 3) points of ours in the axes of the client."""
        points: FloatArray = as_float_array("ours_m", ours_m) @ np.array(self.client_axes)
        return points + 0.0


def arrays_face_to_face(array: TransducerArray, apart_m: float) -> TransducerArray:
    """Return *array* and a second one *apart_m* above it, turned around x to look down on it.

    The channels of the second board follow those of the first.
    """
    over = array.moved(np.diag([1.0, -1.0, -1.0]), (0.0, 0.0, apart_m))
    return TransducerArray(
        np.concatenate([array.positions_m, over.positions_m]),
        np.concatenate([array.normals, over.normals]),
    )
