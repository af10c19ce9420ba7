"""Places as the command line takes them: X,Y,Z in mm."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

Place = tuple[float, float, float]


def place_mm(text: str) -> Place:
    """Return the place that *text* names, in mm: the type of an argument."""
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text}: not a place; give X,Y,Z in mm") from None
    return x, y, z


def metres(place: Place) -> Place:
    """Return a place in mm in metres."""
    x, y, z = place
    return x / 1e3, y / 1e3, z / 1e3


def text_mm(place_m: ArrayLike, decimals: int = 1) -> str:
    """Return a place in metres as X, Y, Z in mm, without a minus zero."""
    import numpy as np  # not for --help

    return ", ".join(f"{value + 0.0:g}" for value in np.round(np.array(place_m) * 1e3, decimals))
