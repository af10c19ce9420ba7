"""TinyLev: two bowls whose elements all look at the middle between them."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from haptogram.acoustics.model.boards.layout import Y_UP, BoardLayout
from haptogram.acoustics.model.geometry import TransducerArray

_RADIUS_M: Final = 0.060
_ELEMENT_M: Final = 10.5e-3  # distance of elements along a ring: housings of 10 mm
_RINGS: Final = (6, 12, 18)


def tinylev() -> TransducerArray:
    """Return TinyLev's two bowls of 36 elements, the lower one first, ring by ring from the axis.

    Its middle, where all elements look, is the origin.
    """
    lower = np.array([_bowl_place(count, n) for count in _RINGS for n in range(count)])
    positions = np.concatenate([lower, lower * np.array([1.0, 1.0, -1.0])])
    return TransducerArray.from_positions(positions, -positions)


def _bowl_place(count: int, n: int) -> tuple[float, float, float]:
    """Return x, y, z (m) of element *n* of *count* that touch in one ring of a bowl array."""
    ring_m = count * _ELEMENT_M / (2.0 * math.pi)
    turn = 2.0 * math.pi * n / count
    depth_m = math.sqrt(_RADIUS_M**2 - ring_m**2)
    return ring_m * math.cos(turn), ring_m * math.sin(turn), -depth_m


TINYLEV: Final = BoardLayout(
    "tinylev",
    "TinyLev, two bowls of 36 elements",
    "A. Marzo et al., Rev. Sci. Instrum. 88, 085105 (2017): two caps of 36; rings of 6, 12 and 18, "
    "radius 60 mm, order of the channels: assumed",
    tinylev,
    Y_UP,
    "the order of TinyLev's channels is assumed: its own array file, of the folder arrays of "
    "Ultraino, has another one (--array TinyLev.xml.gz)",
)
