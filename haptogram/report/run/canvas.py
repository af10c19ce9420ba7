"""Draws with matplotlib as an object: no window, no global figure, no setting of the user.

matplotlib is imported when something is drawn; :class:`ImportError` says that it is not there.
"""

from __future__ import annotations

import io
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_DPI: Final = 160
_STYLE: Final[dict[str, Any]] = {
    "axes.axisbelow": True,
    "axes.grid": True,
    "axes.labelsize": 9.0,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlelocation": "left",
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "font.size": 9.0,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.6,
    "image.cmap": "viridis",
    "legend.fontsize": 8.0,
    "legend.frameon": False,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
}


def draw(width_px: int, height_px: int, paint: Callable[[Figure], None]) -> bytes:
    """Return a PNG of what *paint* puts on a figure.

    Parameters
    ----------
    width_px, height_px : int
        Size of the picture.

    Raises
    ------
    ImportError
        If matplotlib is not installed.
    """
    import matplotlib.style
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with matplotlib.style.context(["default", _STYLE]):
        figure = Figure(
            figsize=(width_px / _DPI, height_px / _DPI),
            dpi=_DPI,
            layout="constrained",
        )
        FigureCanvasAgg(figure)
        paint(figure)
        buffer = io.BytesIO()
        # Without the version of matplotlib, which would change the bytes and not the picture.
        figure.savefig(buffer, format="png", metadata={"Software": None})
    return buffer.getvalue()
