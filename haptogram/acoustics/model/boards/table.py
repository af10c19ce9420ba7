"""Every board's layout by name."""

from __future__ import annotations

from typing import Final

from haptogram.acoustics.model.boards import bowls, grids
from haptogram.acoustics.model.boards.layout import BoardLayout

LAYOUTS: Final = {
    layout.name: layout
    for module in (grids, bowls)
    for layout in vars(module).values()
    if isinstance(layout, BoardLayout)
}
