"""Geometries of real boards that are more than a grid."""

from __future__ import annotations

import itertools
from typing import Final

import numpy as np

from haptogram.acoustics import TransducerArray

AUTD_PITCH_M: Final = 10.16e-3
AUTD_SIZE_M: Final = (0.192, 0.1514)
SONICSURFACE_PITCH_M: Final = 10.5e-3

# Screw holes and connectors take three places of the 18 x 14 grid, in (column, row).
_AUTD_HOLES: Final = ((1, 1), (2, 1), (16, 1))
_AUTD_GRID: Final = (18, 14)

# The wire order of SonicSurface within two rows and four columns: [row % 2][column % 4].
_SONICSURFACE_CELL: Final = ((0, 7, 1, 2), (4, 3, 6, 5))
_SONICSURFACE_SIDE: Final = 16
_SONICSURFACE_TOP_M: Final = 80.75e-3


def autd_unit() -> TransducerArray:
    """Return one AUTD3 unit: 249 elements in the order of its firmware, row by row.

    An 18 x 14 grid of 10.16 mm less three places (github.com/shinolab/autd3-rs); the origin is
    the middle of the grid instead of its first element.
    """
    return TransducerArray.from_positions(_autd_positions())


def autd_units(columns: int, rows: int) -> TransducerArray:
    """Return several units edge to edge (192 x 151.4 mm each), centred on the origin."""
    unit = _autd_positions()
    places = itertools.product(
        (np.arange(rows) - (rows - 1) / 2) * AUTD_SIZE_M[1],
        (np.arange(columns) - (columns - 1) / 2) * AUTD_SIZE_M[0],
    )
    return TransducerArray.from_positions(
        np.concatenate([unit + np.array([x, y, 0.0]) for y, x in places])
    )


def sonicsurface() -> TransducerArray:
    """Return SonicSurface: 256 elements in the order of its wire.

    Its row r lies at its z = 80.75 mm - 10.5 r mm, its column c at x = -78.75 mm + 10.5 c mm, and
    it emits along its +y (github.com/upnalab/SonicSurface).  Turned about x so that it emits along
    +z, its z becomes our -y; the centroid of its rows, 2.0 mm off its origin, is kept.
    """
    positions = np.empty((_SONICSURFACE_SIDE**2, 3))
    for row, column in itertools.product(range(_SONICSURFACE_SIDE), repeat=2):
        place = (column - (_SONICSURFACE_SIDE - 1) / 2) * SONICSURFACE_PITCH_M
        height = _SONICSURFACE_TOP_M - row * SONICSURFACE_PITCH_M
        positions[sonicsurface_wire_index(row, column)] = (place, -height, 0.0)
    return TransducerArray.from_positions(positions)


def sonicsurface_wire_index(row: int, column: int) -> int:
    """Return the index on the wire of the element in a row (from the top) and column."""
    return 64 * (column // 4) + 8 * (row // 2) + _SONICSURFACE_CELL[row % 2][column % 4]


def _autd_positions() -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    columns, rows = _AUTD_GRID
    return np.array(
        [
            ((x - (columns - 1) / 2) * AUTD_PITCH_M, (y - (rows - 1) / 2) * AUTD_PITCH_M, 0.0)
            for y, x in itertools.product(range(rows), range(columns))
            if (x, y) not in _AUTD_HOLES
        ]
    )
