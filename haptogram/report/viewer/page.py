"""A page that holds the interactive view and nothing else."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from haptogram.machine.provenance import UNSTATED, Provenance

from ..formats.html import render_html_page, write_html_page
from .scene import ViewerScene

#: Colour of a page by the verdict of the run that it shows.
_TONES: Final = {"pass": "good", "fail": "bad", "inconclusive": "doubt"}


def view_page(
    scene: ViewerScene | None,
    *,
    title: str,
    lead: list[str],
    verdict: str = "",
    provenance: Provenance = UNSTATED,
) -> str:
    """Return a page that shows *scene*, or what its server tells it if there is none.

    Parameters
    ----------
    title : str
        Heading of the page.
    lead : list of str
        Sentences below the heading.
    verdict : str
        Verdict of the run that is shown; empty: there is none.
    provenance : Provenance
        Origin of the page.

    Raises
    ------
    ConfigurationError
        If the extra ``report`` is not installed.
    """
    return render_html_page("view.html", provenance, **_view_content(scene, title, lead, verdict))


def write_view(
    path: Path,
    scene: ViewerScene,
    *,
    title: str,
    lead: list[str],
    verdict: str = "",
    provenance: Provenance = UNSTATED,
) -> None:
    """Write *scene* as a page, for a browser without a server; the rest as :func:`view_page`.

    Raises
    ------
    ConfigurationError
        Also if *path* cannot be written.
    """
    write_html_page(path, "view.html", provenance, **_view_content(scene, title, lead, verdict))


def _view_content(
    scene: ViewerScene | None, title: str, lead: list[str], verdict: str
) -> dict[str, Any]:
    return {
        "title": f"Haptogram: {title}",
        "heading": f"{verdict.upper()}: {title}" if verdict else title,
        "tone": _TONES.get(verdict.lower(), "plain"),
        "lead": lead,
        "scene": scene and scene.embedded(),
    }
