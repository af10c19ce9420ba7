"""Every board's layout by name, and the one that a dialect's clients assume."""

from __future__ import annotations

from typing import Final

from haptogram.acoustics.model.boards import grids
from haptogram.acoustics.model.boards.bowls import TINYLEV

LAYOUTS: Final = {
    layout.name: layout
    for layout in (
        grids.SONICSURFACE,
        grids.SONICSURFACE_STACK,
        grids.ULTRAINO_SONICSURFACE,
        grids.ULTRAINO_STACK,
        grids.ULTRAINO_FLAT8,
        TINYLEV,
        grids.INTERACTLAB,
        grids.AUTD3,
    )
}
#: Layout of each dialect, as its clients have it; that of Nano boards is assumed.
LAYOUT_OF_DIALECT: Final = {
    "sonicsurface": grids.SONICSURFACE,
    "sonicsurface-tactile": grids.SONICSURFACE,
    "ultraino-fpga": grids.ULTRAINO_SONICSURFACE,
    "ultraino-fpga-128": TINYLEV,
    "ultraino-fpga-chained": grids.ULTRAINO_STACK,
    "ultraino-mega64": grids.ULTRAINO_FLAT8,
    "ultraino-nano8": grids.ULTRAINO_NANO8,
    "ultraino-nano16": grids.ULTRAINO_NANO16,
    "interactlab": grids.INTERACTLAB,
    "autd3": grids.AUTD3,
}
