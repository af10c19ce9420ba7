"""What all pictures share: how a figure is made, how it looks, how it is written."""

from __future__ import annotations

import base64
import io
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from haptogram.errors import ConfigurationError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FORMATS: Final = (".png", ".svg", ".pdf")
MAGNITUDE_MAP: Final = "cividis"
PHASE_MAP: Final = "twilight"
DPI: Final = 200

# Okabe and Ito's colours, told apart with any colour vision.
BLUE: Final = "#0072B2"
ORANGE: Final = "#E69F00"
GREEN: Final = "#009E73"
VERMILION: Final = "#D55E00"
SKY: Final = "#56B4E9"
BLACK: Final = "#000000"

_SETTINGS: Final[Any] = {
    "font.size": 9.0,
    "axes.titlesize": 10.0,
    "axes.linewidth": 0.8,
    "axes.grid": False,
    "legend.fontsize": 8.0,
    "legend.frameon": True,
    "legend.framealpha": 0.9,
    "svg.hashsalt": "haptogram",  # the same picture gives the same file
    "svg.fonttype": "none",
}


def new_figure(width_in: float = 6.0, height_in: float = 4.8) -> Figure:
    """Return an empty figure, apart from any window or global state.

    Raises
    ------
    ConfigurationError
        If matplotlib is not installed.
    """
    try:
        import matplotlib as mpl  # here, because only pictures need it, and it is an extra
        from matplotlib.figure import Figure
    except ImportError as error:
        raise ConfigurationError(
            "pictures need matplotlib: pip install 'haptogram[report]'"
        ) from error
    with mpl.rc_context(_SETTINGS):
        return Figure(figsize=(width_in, height_in), layout="constrained")


def styled() -> Any:
    """Return a context in which matplotlib draws in the style of these pictures."""
    import matplotlib as mpl

    return mpl.rc_context(_SETTINGS)


def check_format(path: Path) -> None:
    """Raise unless the suffix of *path* names a format that can be written.

    Raises
    ------
    ConfigurationError
        Names the suffix and what is possible.
    """
    if path.suffix.lower() not in FORMATS:
        raise ConfigurationError(
            f"picture '{path}' ends in {path.suffix or 'nothing'!r}; possible are "
            f"{', '.join(FORMATS)}"
        )


def render(figure: Figure, path: Path) -> bytes:
    """Return *figure* in the format of the suffix of *path*, without a date.

    Raises
    ------
    ConfigurationError
        A suffix that is not a format.
    """
    check_format(path)
    suffix = path.suffix.lower()
    buffer = io.BytesIO()
    with styled():
        figure.savefig(buffer, format=suffix[1:], dpi=DPI, metadata=_undated(suffix))
    return buffer.getvalue()


def two_lines(title: str, detail: str) -> str:
    """Return what a picture is of, if that is said, and below it what it shows of that."""
    return f"{title}\n{detail}" if title else detail


def as_data_uri(figure: Figure) -> str:
    """Return *figure* as a PNG in a data URI, for an HTML page that needs no other file."""
    buffer = io.BytesIO()
    with styled():
        figure.savefig(buffer, format="png", dpi=DPI * 0.75)
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")


def mark(axes: Axes, x_mm: float, y_mm: float, kind: str, size: float | None = None) -> None:
    """Mark the target (a cross) or the peak (a ring), readable on light and on dark."""
    marker, normal, colour = ("+", 17.0, VERMILION) if kind == "target" else ("o", 9.0, BLACK)
    for tint, width, label in (("white", 3.0, None), (colour, 1.4, kind)):
        axes.plot(
            x_mm,
            y_mm,
            marker,
            fillstyle="none",
            color=tint,
            markersize=size or normal,
            markeredgewidth=width,
            label=label,
            zorder=3.0 if kind == "peak" else 4.0,
        )


def _undated(suffix: str) -> dict[str, Any]:
    return {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}.get(suffix, {})
