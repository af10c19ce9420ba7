"""Positions on the command line: X,Y,Z in mm."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

Position = tuple[float, float, float]


def position_mm(text: str) -> Position:
    """Return the position in mm that *text* names; the type of an argument."""
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text}: not a position; give X,Y,Z in mm") from None
    return x, y, z


def metres(position: Position) -> Position:
    """Return a position in metres that is given in mm."""
    x, y, z = position
    return x / 1e3, y / 1e3, z / 1e3


def place_text(position_m: ArrayLike, decimals: int = 1) -> str:
    """Return a position in metres as X, Y, Z in mm, without a minus zero."""
    import numpy as np  # not for --help

    rounded = np.round(np.array(position_m) * 1e3, decimals)
    return ", ".join(f"{value + 0.0:g}" for value in rounded)
