"""Pictures that are part of a page, and follow its theme."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, Any, Final

from ..formats.document import PagePicture
from .style import BLACK, GREY, PAGE_DPI, encode_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Ink, ground, lines and remarks of a picture: in a light page, and in a dark one (style.css).
_DARK: Final = {"000000": "e4e6e8", "ffffff": "16181b", "dddddd": "3a3f45", "555555": "a8adb3"}
_MOST_SHAPES: Final = 500  # of one artist; more of them become pixels


def embed_picture(figure: Figure, title: str, caption: str = "") -> PagePicture:
    """Return *figure* as a picture for a page, dark in a dark one."""
    shapes: list[Any] = figure.findobj(lambda artist: _shapes_of(artist) > _MOST_SHAPES)
    for artist in shapes:
        with warnings.catch_warnings():  # matplotlib says that it ignores this in 3D, and does it
            warnings.simplefilter("ignore")
            artist.set_rasterized(True)
        if getattr(artist, "get_color", str)() == BLACK:
            artist.set_color(GREY)  # pixels keep their colour in the dark
    svg = encode_figure(figure, ".svg", PAGE_DPI, transparent=True).decode()
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


def _shapes_of(artist: Any) -> int:
    """Return the number of points that a line or a scatter draws."""
    if hasattr(artist, "get_offsets"):
        return len(artist.get_offsets())
    return len(artist.get_xdata()) if hasattr(artist, "get_xdata") else 0
