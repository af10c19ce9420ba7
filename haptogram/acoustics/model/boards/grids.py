"""Boards whose elements lie on a plane grid."""

from __future__ import annotations

import functools
import itertools
from typing import Final

import numpy as np

from haptogram.acoustics.arrays import FloatArray
from haptogram.acoustics.model.boards.layout import Y_UP, BoardLayout, arrays_face_to_face
from haptogram.acoustics.model.geometry import TransducerArray

AUTD_PITCH_M: Final = 10.16e-3
AUTD_SIZE_M: Final = (0.192, 0.1514)
SONICSURFACE_PITCH_M: Final = 10.5e-3
STACK_M: Final = 0.243  # ARRAY_HEIGHT of the ESP32 firmware

# Screw holes and connectors take three places of the 18 x 14 grid, in (column, row).
_AUTD_HOLES: Final = ((1, 1), (2, 1), (16, 1))
_AUTD_GRID: Final = (18, 14)

_SIDE: Final = 16
_HALF_M: Final = 78.75e-3
_SONICSURFACE_TOP_M: Final = 80.75e-3
# The wire order within two rows and four columns: [row % 2][column % 4].
_SONICSURFACE_CELL: Final = ((0, 7, 1, 2), (4, 3, 6, 5))
# The same of InteractLab, whose cells are four columns of two rows: [column % 4][row % 2].
_INTERACTLAB_CELL: Final = ((1, 5), (0, 4), (3, 6), (2, 7))

_FLAT8_SIDE: Final = 8
_FLAT8_PITCH_M: Final = 10e-3


def sonicsurface() -> TransducerArray:
    """Return SonicSurface: 256 elements in the order of its wire.

    Its row r lies at its z = 80.75 mm - 10.5 r mm, its column c at x = -78.75 mm + 10.5 c mm, and
    it emits along its +y (github.com/upnalab/SonicSurface).  Turned about x so that it emits along
    +z, its z becomes our -y; the centroid of its rows, 2.0 mm off its origin, is kept.
    """
    return _sonicsurface_from(_SONICSURFACE_TOP_M)


def ultraino_sonicsurface() -> TransducerArray:
    """Return SonicSurface as Ultraino's array file has it: centred, the first row at +78.75 mm."""
    return _sonicsurface_from(_HALF_M)


def sonicsurface_wire_index(row: int, column: int) -> int:
    """Return the index on the wire of the element in a row (from the top) and column."""
    return 64 * (column // 4) + 8 * (row // 2) + _SONICSURFACE_CELL[row % 2][column % 4]


def interactlab() -> TransducerArray:
    """Return the board of InteractLab and OpenMPD: 256 elements in the order of its pins."""
    positions = np.empty((_SIDE**2, 3))
    for column, row in itertools.product(range(_SIDE), repeat=2):
        place = (-_HALF_M + column * SONICSURFACE_PITCH_M, _HALF_M - row * SONICSURFACE_PITCH_M)
        positions[interactlab_pin(row, column)] = (*place, 0.0)
    return TransducerArray.from_positions(positions)


def interactlab_pin(row: int, column: int) -> int:
    """Return the pin of the element in a row (from +y) and column (from -x)."""
    cell = _INTERACTLAB_CELL[column % 4][row % 2]
    return 64 * (3 - column // 4) + 8 * (7 - row // 2) + cell


def ultraino_flat8() -> TransducerArray:
    """Return Ultraino's "flat 8x8": 64 elements of 10 mm pitch, row by row from its +z and -x."""
    rows = itertools.product(range(_FLAT8_SIDE), repeat=2)
    half = (_FLAT8_SIDE - 1) / 2
    return TransducerArray.from_positions(
        [((c - half) * _FLAT8_PITCH_M, (r - half) * _FLAT8_PITCH_M, 0.0) for r, c in rows]
    )


def autd_units(columns: int, rows: int) -> TransducerArray:
    """Return AUTD3 units edge to edge (192 x 151.4 mm each), centred on the origin.

    A unit is an 18 x 14 grid of 10.16 mm less three places (github.com/shinolab/autd3-rs), in the
    order of its firmware: row by row.
    """
    unit = _autd_positions()
    places = itertools.product(
        (np.arange(rows) - (rows - 1) / 2) * AUTD_SIZE_M[1],
        (np.arange(columns) - (columns - 1) / 2) * AUTD_SIZE_M[0],
    )
    return TransducerArray.from_positions(
        np.concatenate([unit + np.array([x, y, 0.0]) for y, x in places])
    )


def autd_device() -> TransducerArray:
    """Return one AUTD3 unit with its first element at the origin, as its own programs count."""
    return autd_row(1)


def autd_row(devices: int) -> TransducerArray:
    """Return AUTD3 units edge to edge along x, the first element of the first at the origin."""
    positions = _autd_positions()
    step = np.array([AUTD_SIZE_M[0], 0.0, 0.0])
    places = [positions - positions[0] + device * step for device in range(devices)]
    return TransducerArray.from_positions(np.concatenate(places))


def _sonicsurface_from(top_m: float) -> TransducerArray:
    """Return the SonicSurface array with its first row at y = -*top_m*."""
    positions = np.empty((_SIDE**2, 3))
    for row, column in itertools.product(range(_SIDE), repeat=2):
        place = (column - (_SIDE - 1) / 2) * SONICSURFACE_PITCH_M
        height = top_m - row * SONICSURFACE_PITCH_M
        positions[sonicsurface_wire_index(row, column)] = (place, -height, 0.0)
    return TransducerArray.from_positions(positions)


def _autd_positions() -> FloatArray:
    """Return (249, 3) the positions, in m, of an AUTD3 device: a grid with holes."""
    columns, rows = _AUTD_GRID
    return np.array(
        [
            ((x - (columns - 1) / 2) * AUTD_PITCH_M, (y - (rows - 1) / 2) * AUTD_PITCH_M, 0.0)
            for y, x in itertools.product(range(rows), range(columns))
            if (x, y) not in _AUTD_HOLES
        ]
    )


_MAP: Final = "element map of its repository, all 256 entries"
SONICSURFACE: Final = BoardLayout(
    "sonicsurface", "SonicSurface", f"upnalab/SonicSurface 666c2dd: {_MAP}", sonicsurface, Y_UP
)
SONICSURFACE_STACK: Final = BoardLayout(
    "sonicsurface-stack",
    "two SonicSurfaces face to face, primary below",
    "243 mm apart: ARRAY_HEIGHT of its ESP32 firmware; how the upper one is turned: assumed",
    lambda: arrays_face_to_face(sonicsurface(), STACK_M),
    Y_UP,
)
ULTRAINO_SONICSURFACE: Final = BoardLayout(
    "ultraino-sonicsurface",
    "SonicSurface as Ultraino has it",
    'asiermarzo/Ultraino 3d5a02a: "SonicSurface empty board", all 256 entries',
    ultraino_sonicsurface,
    Y_UP,
)
ULTRAINO_STACK: Final = BoardLayout(
    "ultraino-sonicsurface-stack",
    "two SonicSurfaces face to face, as a chain of Ultraino's",
    "243 mm apart, the upper one turned around x: assumed",
    lambda: arrays_face_to_face(ultraino_sonicsurface(), STACK_M),
    Y_UP,
)
ULTRAINO_FLAT8: Final = BoardLayout(
    "ultraino-flat8",
    "Ultraino's flat 8 x 8 array",
    'asiermarzo/Ultraino 3d5a02a: "flat 8x8", all 64 entries',
    ultraino_flat8,
    Y_UP,
)


def _assumed_grid(name: str, title: str, columns: int, rows: int) -> BoardLayout:
    """Return the layout of a board whose array is not published: a grid of 10 mm pitch."""
    return BoardLayout(
        name,
        f"{title}: grid of {columns} x {rows} elements of 10 mm",
        "assumed: no array is published",
        functools.partial(TransducerArray.grid, columns, rows),
        Y_UP,
        f"the emitters of {title} are assumed: --array FILE gives yours",
    )


ULTRAINO_NANO16: Final = _assumed_grid("ultraino-nano16", "Ultraino Nano16", 4, 4)
ULTRAINO_NANO8: Final = _assumed_grid("ultraino-nano8", "Ultraino Nano8", 4, 2)
INTERACTLAB: Final = BoardLayout(
    "interactlab",
    "InteractLab board of OpenMPD",
    "AcousTools 1.2.0: positions and pin map of its board file, all 256 entries; no phase offsets",
    interactlab,
)
AUTD3: Final = BoardLayout(
    "autd3",
    "AUTD3 unit, first element at the origin",
    "shinolab/autd3-rs: 18 x 14 grid less three places",
    autd_device,
)
