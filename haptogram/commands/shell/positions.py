"""Positions on the command line: X,Y,Z in mm."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final, TypeAlias

from haptogram.settings.option import options_of
from haptogram.settings.parser import checked_option_type
from haptogram.settings.shape import ShapeConfig

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

Position: TypeAlias = tuple[float, float, float]


_ROW: Final = options_of(ShapeConfig)["center_mm"]
#: The type of an argument that is a position in mm.
position_argument_mm: Final[Callable[[str], Position]] = checked_option_type(
    _ROW.checked_item, _ROW.name
)


def add_position_option(
    group: argparse._ActionsContainer, word: str, help: str, **more: Any
) -> None:
    """Add an option that is a position in mm."""
    group.add_argument(word, type=position_argument_mm, metavar="X,Y,Z", help=help, **more)


def metres_of_position(position: Position) -> Position:
    """Return a position in metres that is given in mm."""
    x, y, z = position
    return x / 1e3, y / 1e3, z / 1e3


def position_text(position_m: ArrayLike, decimals: int = 1) -> str:
    """Return a position in metres as X, Y, Z in mm, without a minus zero."""
    import numpy as np  # not for --help

    rounded = np.round(np.array(position_m) * 1e3, decimals)
    return ", ".join(f"{value + 0.0:g}" for value in rounded)
