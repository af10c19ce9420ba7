"""Pictures in a page: as SVG, dark in a dark page."""

from __future__ import annotations

import base64
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from haptogram.report.figures import encode_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Ink, ground, lines and remarks of a picture: in a light page, and in a dark one (style.css).
_DARK: Final = {"000000": "e4e6e8", "ffffff": "16181b", "dddddd": "3a3f45", "555555": "a8adb3"}


@dataclass(frozen=True, slots=True)
class PagePicture:
    """A picture for a page.

    Attributes
    ----------
    svg : bytes
        The picture.
    title : str
        What it is a picture of; read aloud in its place.
    caption : str
        What to see in it.
    """

    svg: bytes
    title: str
    caption: str = ""

    @property
    def source(self) -> str:
        """The picture as the address of an image."""
        return f"data:image/svg+xml;base64,{base64.b64encode(self.svg).decode('ascii')}"


def embed_picture(figure: Figure, title: str, caption: str = "") -> PagePicture:
    """Return *figure* as a picture for a page, dark in a dark one."""
    svg = encode_figure(figure, ".svg").decode()
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
