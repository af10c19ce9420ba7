"""A page that holds the interactive view and nothing else."""

from __future__ import annotations

from pathlib import Path

from ..html import write_html_page
from .scene import Scene


def write_view(path: Path, scene: Scene, *, title: str, lead: list[str]) -> None:
    """Write *scene* as a page of its own, for a browser without a server.

    Parameters
    ----------
    title : str
        Heading of the page.
    lead : list of str
        Sentences below the heading.

    Raises
    ------
    ConfigurationError
        If the extra ``report`` is not installed, or *path* cannot be written.
    """
    write_html_page(
        path,
        "view.html",
        title=f"Haptogram: {title}",
        heading=title,
        tone="plain",
        lead=lead,
        scene=scene.embedded(),
    )
