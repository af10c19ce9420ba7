"""A page that holds the interactive view and nothing else."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from haptogram.machine.provenance import UNSTATED

from ..formats.html import render_html_page, write_html_page
from .scene import Scene


def view_page(scene: Scene | None, *, title: str, lead: list[str]) -> str:
    """Return a page that shows *scene*, or what its server tells it if there is none.

    Parameters
    ----------
    title : str
        Heading of the page.
    lead : list of str
        Sentences below the heading.

    Raises
    ------
    ConfigurationError
        If the extra ``report`` is not installed.
    """
    return render_html_page("view.html", UNSTATED, **_content(scene, title, lead))


def write_view(path: Path, scene: Scene, *, title: str, lead: list[str]) -> None:
    """Write *scene* as a page, for a browser without a server; the rest as :func:`view_page`.

    Raises
    ------
    ConfigurationError
        Also if *path* cannot be written.
    """
    write_html_page(path, "view.html", UNSTATED, **_content(scene, title, lead))


def _content(scene: Scene | None, title: str, lead: list[str]) -> dict[str, Any]:
    return {
        "title": f"Haptogram: {title}",
        "heading": title,
        "tone": "plain",
        "lead": lead,
        "scene": scene and scene.embedded(),
    }
