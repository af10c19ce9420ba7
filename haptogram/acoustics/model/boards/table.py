"""Every board's layout by name, and the one that a dialect's clients assume."""

from __future__ import annotations

from typing import Final

from haptogram.acoustics.model.boards.bowls import TINYLEV
from haptogram.acoustics.model.boards.grids import (
    AUTD3,
    INTERACTLAB,
    SONICSURFACE,
    SONICSURFACE_STACK,
    ULTRAINO_FLAT8,
    ULTRAINO_NANO8,
    ULTRAINO_NANO16,
    ULTRAINO_SONICSURFACE,
    ULTRAINO_STACK,
)

LAYOUTS: Final = {
    layout.name: layout
    for layout in (
        SONICSURFACE,
        SONICSURFACE_STACK,
        ULTRAINO_SONICSURFACE,
        ULTRAINO_STACK,
        ULTRAINO_FLAT8,
        TINYLEV,
        INTERACTLAB,
        AUTD3,
    )
}
#: Layout of each dialect, as its clients have it; that of Nano boards is assumed.
LAYOUT_OF_DIALECT: Final = {
    "sonicsurface": SONICSURFACE,
    "sonicsurface-tactile": SONICSURFACE,
    "ultraino-fpga": ULTRAINO_SONICSURFACE,
    "ultraino-fpga-128": TINYLEV,
    "ultraino-fpga-chained": ULTRAINO_STACK,
    "ultraino-mega64": ULTRAINO_FLAT8,
    "ultraino-nano8": ULTRAINO_NANO8,
    "ultraino-nano16": ULTRAINO_NANO16,
    "interactlab": INTERACTLAB,
    "autd3": AUTD3,
}
