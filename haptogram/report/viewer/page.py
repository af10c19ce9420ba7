"""The interactive view and nothing else, as a document."""

from __future__ import annotations

from typing import Final

from ..formats.document import Document
from .scene import ViewerScene

#: Colour of a page by the verdict of the run that it shows.
_TONES: Final = {"pass": "good", "fail": "bad", "inconclusive": "doubt"}


def view_document(
    scene: ViewerScene | None, *, title: str, lead: list[str], verdict: str = ""
) -> Document:
    """Return a document that shows *scene*, or what the server of its page tells it if it is None.

    Parameters
    ----------
    title : str
        Heading of the page.
    lead : list of str
        Sentences below the heading.
    verdict : str
        Verdict of the run that is shown; empty: there is none.
    """
    return Document(
        command="view",
        heading=f"{verdict.upper()}: {title}" if verdict else title,
        title=title,
        tone=_TONES.get(verdict.lower(), "plain"),
        lead=[sentence.removesuffix(".") for sentence in lead],
        template="view.html",
        content=lambda: {"scene": scene and scene.embedded()},
    )
