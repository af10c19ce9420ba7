"""Pieces of HTML; every text that goes in is escaped here, and nowhere else."""

from __future__ import annotations

import base64
import html
from collections.abc import Iterable, Sequence


class Html(str):
    """Text that is markup already."""

    __slots__ = ()


def text(value: object) -> Html:
    """Return *value* with every character that means something to HTML escaped."""
    return value if isinstance(value, Html) else Html(html.escape(str(value)))


def element(name: str, *content: object, **attributes: str) -> Html:
    """Return an element; an attribute ``class_`` becomes ``class``."""
    given = "".join(f' {key.rstrip("_")}="{text(value)}"' for key, value in attributes.items())
    return Html(f"<{name}{given}>{''.join(map(text, content))}</{name}>")


def section(title: str, *content: object) -> Html:
    """Return a part of the page with its heading."""
    return Html(element("section", element("h2", title), *content) + "\n")


def listing(items: Iterable[object]) -> Html:
    """Return a list of items."""
    return element("ul", *(element("li", item) for item in items))


def table(head: Sequence[str], rows: Iterable[Sequence[object]], numbers: int = 0) -> Html:
    """Return a table that scrolls sideways on a narrow screen.

    Parameters
    ----------
    head : sequence of str
        Names of the columns; empty for none.
    rows : iterable of sequences
        The first cell of each is its name.
    numbers : int
        How many columns, after the first, hold numbers.
    """
    titles = element("tr", *(element("th", name, scope="col") for name in head)) if head else ""
    body = (_row(row, numbers) for row in rows)
    parts = [element("thead", titles)] if head else []
    return element("div", element("table", *parts, element("tbody", *body)), class_="scroll")


def _row(row: Sequence[object], numbers: int) -> Html:
    name, *cells = row
    rest = (
        element("td", cell, class_="number") if place < numbers else element("td", cell)
        for place, cell in enumerate(cells)
    )
    return element("tr", element("th", name, scope="row"), *rest)


def picture(png: bytes, title: str, caption: str) -> Html:
    """Return a picture that the page itself holds, with its caption."""
    source = f"data:image/png;base64,{base64.b64encode(png).decode('ascii')}"
    image = Html(f'<img src="{source}" alt="{text(title)}">')
    return Html(element("figure", image, element("figcaption", element("b", title), " ", caption)))
