"""Pictures that are part of a page."""

from __future__ import annotations

import base64
from dataclasses import dataclass
from typing import TYPE_CHECKING

from .style import PAGE_DPI, encode_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True)
class PagePicture:
    """A picture for a page.

    Attributes
    ----------
    png : bytes
        The picture.
    title : str
        What it is a picture of; read aloud in its place.
    caption : str
        What to see in it.
    """

    png: bytes
    title: str
    caption: str = ""

    @property
    def source(self) -> str:
        """The picture as the address of an image."""
        return f"data:image/png;base64,{base64.b64encode(self.png).decode('ascii')}"


def embed_picture(figure: Figure, title: str, caption: str = "") -> PagePicture:
    """Return *figure* as a picture for a page."""
    return PagePicture(encode_figure(figure, ".png", PAGE_DPI), title, caption)
