"""The one style of all pictures: how a figure is made, marked, encoded and put into a page.

matplotlib draws as an object: no window, no global figure, no setting of the user.
"""

from __future__ import annotations

import contextlib
import io
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from haptogram.errors import ConfigurationError
from haptogram.machine.files import is_standard_output, write_file_atomically

from ..formats.document import PagePicture
from ..formats.html import require_report_packages
from ..formats.junit import legal_xml_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


FORMATS: Final = (".png", ".svg", ".pdf")
MAGNITUDE_MAP: Final = "cividis"
PHASE_MAP: Final = "twilight"
DPI: Final = 200  # resolution of a picture in a file of its own

# Okabe and Ito's colours, distinguishable with any colour vision.
BLUE: Final = "#0072B2"
ORANGE: Final = "#E69F00"
GREEN: Final = "#009E73"
VERMILION: Final = "#D55E00"
BLACK: Final = "#000000"
GREY: Final = "#888888"

_STYLE: Final[dict[str, Any]] = {
    "axes.axisbelow": True,
    "axes.grid": True,
    "axes.labelsize": 9.0,
    "axes.linewidth": 0.8,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlelocation": "left",
    "axes.titlesize": 10.0,
    "figure.titlesize": 10.0,
    "font.size": 9.0,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.6,
    "image.cmap": MAGNITUDE_MAP,
    "legend.fontsize": 8.0,
    "legend.edgecolor": "#dddddd",
    "legend.framealpha": 0.9,
    "svg.fonttype": "none",
    "svg.hashsalt": "haptogram",  # the same picture gives the same file
    "text.parse_math": False,  # names of files and options may have any number of $
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
}

#: Sign, size and colour of a place in the field; each has a white rim, to be seen on any ground.
_MARKS: Final = {
    "target": ("+", 17.0, VERMILION),
    "peak": ("o", 11.0, BLACK),
}


@contextlib.contextmanager
def new_figure(width_in: float = 6.0, height_in: float = 4.8) -> Iterator[Figure]:
    """Give an empty figure, and the style as long as something is drawn on it.

    Raises
    ------
    ConfigurationError
        If matplotlib is not installed.
    """
    require_report_packages("pictures", "matplotlib")
    from matplotlib.figure import Figure

    with _styled():
        yield Figure(figsize=(width_in, height_in), layout="constrained")


def check_picture_format(path: Path) -> None:
    """Raise, before the work begins, unless a picture can be written in the format of *path*.

    Raises
    ------
    ConfigurationError
        A suffix that is not a format, or no matplotlib.
    """
    if path.suffix.lower() not in FORMATS:
        raise ConfigurationError(
            f"picture '{path}' ends in {path.suffix or 'nothing'!r}; possible are "
            f"{', '.join(FORMATS)}"
        )
    require_report_packages("pictures", "matplotlib")


def encode_figure(figure: Figure, suffix: str, *, transparent: bool = False) -> bytes:
    """Return *figure* in the format of *suffix*, one of `FORMATS`, without date and version.

    Parameters
    ----------
    transparent : bool
        Leave out the white ground.
    """
    left_out = {".png": ("Software",), ".svg": ("Date", "Creator"), ".pdf": ("CreationDate",)}
    metadata: Any = dict.fromkeys(left_out[suffix])
    buffer = io.BytesIO()
    with _styled(), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph")  # signs that the font has not, in a name
        figure.savefig(
            buffer, format=suffix[1:], dpi=DPI, metadata=metadata, transparent=transparent
        )
    content = buffer.getvalue()
    return legal_xml_text(content.decode()).encode() if suffix == ".svg" else content


def write_figure(path: Path, figure: Figure) -> None:
    """Write *figure* in the format of the suffix of *path*; to standard output, as PNG.

    Raises
    ------
    ConfigurationError
        A path that cannot be written.
    """
    suffix = ".png" if is_standard_output(path) else path.suffix.lower()
    write_file_atomically(path, encode_figure(figure, suffix))


def figure_title(title: str, detail: str) -> str:
    """Return the title of a picture, if there is one, and below it which part is shown."""
    return f"{title}\n{detail}" if title else detail


def figure_legend(figure: Figure, columns: int = 4) -> None:
    """Draw one legend below all panels, with each label once."""
    found = [axes.get_legend_handles_labels() for axes in figure.axes]
    entries = {
        label: handle
        for handles, labels in found
        for handle, label in zip(handles, labels, strict=True)
    }
    if entries:
        figure.legend(
            list(entries.values()),
            list(entries),
            loc="outside lower center",
            ncols=min(columns, len(entries)),
            markerscale=0.7,
        )


def draw_figure_mark(
    axes: Axes, x_mm: float, y_mm: float, kind: str, size: float | None = None
) -> None:
    """Mark the target (a cross) or the peak (a ring)."""
    marker, normal, colour = _MARKS[kind]
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


def _styled() -> contextlib.AbstractContextManager[None]:
    """Return a context in which matplotlib has the style of the project."""
    import matplotlib.style

    return matplotlib.style.context(["default", _STYLE])


#: Ink, ground, lines and remarks of a picture: in a light page, and in a dark one (style.css).
_DARK: Final = {"000000": "e4e6e8", "ffffff": "16181b", "dddddd": "3a3f45", "555555": "a8adb3"}


def embed_picture(figure: Figure, title: str, caption: str = "") -> PagePicture:
    """Return *figure* as a picture for a page, dark in a dark one."""
    svg = encode_figure(figure, ".svg", transparent=True).decode()
    for colour in _DARK:
        svg = svg.replace(f"#{colour}", f"var(--c{colour})")
    light, dark = (
        f"svg{{{';'.join(f'--c{name}:#{colour}' for name, colour in colours.items())}}}"
        for colours in ({name: name for name in _DARK}, _DARK)
    )
    # What has no colour of its own is black in SVG.
    theme = f"{light}svg{{fill:var(--c000000)}}@media screen and (prefers-color-scheme:dark)"
    svg = svg.replace("</style>", f"{theme}{{{dark}}}</style>", 1)
    return PagePicture(svg.encode(), title, caption)
