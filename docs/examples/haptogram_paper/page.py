"""The reproduced paper as one page, or as a folder with the page and its pictures."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from markupsafe import Markup

from haptogram.errors import ConfigurationError
from haptogram.machine.provenance import UNSTATED, Provenance
from haptogram.report.figures import encode_figure
from haptogram.report.figures.style import embed_picture
from haptogram.report.formats.html import check_html_page, render_html_page

from .document import (
    DEVIATIONS_REMARK,
    FIGURE_4_REMARK,
    SCALE_REMARK,
    PaperReproduction,
    paper_prose,
)
from .equations import EQUATIONS
from .mathml import equation_mathml
from .pictures import draw_paper_figure_4, draw_paper_hemispheres, draw_paper_table_1

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_FOLDER: Final = Path(__file__).parent
# By the axis along which the section is bent, and the plane.
_FIGURE_4_CAPTIONS: Final = {
    "x_xz": "The plane along x and z through the target, as the paper draws it.",
    "x_yz": "The plane across the section, which cannot focus there.",
    "y_xz": "The plane along x and z through the target, across the section.",
    "y_yz": "The ring is the maximum of the focus; the section's edge is louder.",
}


def paper_report_files(
    paper: PaperReproduction,
    presets: Iterable[Mapping[str, Any]],
    path: Path,
    provenance: Provenance = UNSTATED,
) -> Iterator[tuple[Path, bytes]]:
    """Yield the files of a report at *path*: a page; for a folder, every picture as well.

    Pictures in a folder (no suffix) are PNG and SVG.

    Raises
    ------
    ConfigurationError
        As :func:`check_paper_report`.
    """
    check_paper_report(path)
    figures = {
        "hemispheres": draw_paper_hemispheres(),
        "table1": draw_paper_table_1(paper.best),
        **draw_paper_figure_4(),
    }
    content = _paper_page_content(paper, presets, figures)
    page = render_html_page("paper.html", provenance, folder=_FOLDER, **content).encode()
    if path.suffix:
        yield path, page
        return
    yield path / "index.html", page
    for name, figure in figures.items():
        for suffix in (".png", ".svg"):
            yield path / f"{name}{suffix}", encode_figure(figure, suffix)


def check_paper_report(path: Path) -> None:
    """Raise, before the work begins, unless a report can be written to *path*.

    Raises
    ------
    ConfigurationError
        A suffix other than .html, a file where a folder is wanted, or no extra ``report``.
    """
    if path.suffix.lower() not in ("", ".html", ".htm"):
        raise ConfigurationError(f"html '{path}' must end in .html, or be a folder")
    if path.suffix == "" and path.exists() and not path.is_dir():
        raise ConfigurationError(f"html '{path}' is a file; name a folder, or a file in .html")
    check_html_page()


def _paper_page_content(
    paper: PaperReproduction, presets: Iterable[Mapping[str, Any]], figures: Mapping[str, Figure]
) -> dict[str, Any]:
    cells = paper.best.cells
    averages = sum(cell.average_reproduced for cell in cells)
    deviations = sum(cell.deviation_reproduced for cell in cells)
    counts = (
        f"{averages} of {len(cells)} averages of Table 1, {deviations} of {len(cells)} standard "
        "deviations"
    )
    tone, verdict = "good", "Reproduced"
    if not paper.averages_reproduced:
        tone, verdict = "bad", "Not reproduced"
    elif deviations < len(cells):
        tone, verdict = "doubt", "Reproduced in part"
    outcome = "Reproduced is what is within 7 % of the printed value."
    return {
        "title": "Haptogram: the paper of 2014, reproduced",
        "heading": f"{verdict}: {counts}",
        "tone": tone,
        "lead": ["Haptogram (2014): the paper's simulation, computed again.", outcome],
        "equations": EQUATIONS,
        "mathml": lambda text: Markup(equation_mathml(text)),
        "demonstrations": [
            (
                item.what,
                f"{item.printed:.4g} {item.printed_unit}",
                f"{item.corrected:.4g} {item.corrected_unit}",
            )
            for item in paper.demonstrations
        ],
        "hemispheres": embed_picture(
            figures["hemispheres"],
            "The hemisphere at the four resolutions.",
            "Rings at equal steps of the polar angle.",
        ),
        "reading": paper.best.reading.remark,
        "scale": SCALE_REMARK,
        "cells": cells,
        "outcome": outcome,
        "deviations_remark": DEVIATIONS_REMARK,
        "prose": paper_prose(),
        "table_1": embed_picture(
            figures["table1"],
            "Averages and standard deviations of Table 1.",
            "Full line, filled: printed. Dotted, open: predicted.",
        ),
        "readings": [
            (
                result.reading.name,
                result.reading.remark,
                f"{result.average_rms_mn:.3f}",
                f"{result.worst_average_error:.1%}",
                f"{result.deviation_rms_mn:.3f}",
            )
            for result in paper.results
        ],
        "figure_4_remark": FIGURE_4_REMARK,
        "figure_4": [
            embed_picture(figure, f"Bent along {key[0]}.", _FIGURE_4_CAPTIONS[key])
            for name, figure in figures.items()
            if name.startswith("figure4") and (key := name[-len("x_xz") :])
        ],
        "presets": [
            (
                row["preset"],
                row["quantity"],
                "" if row["published"] == "-" else row["published"],
                f"{row['ours']:.4g} {row['unit']}",
                "; ".join(filter(None, (row["source"], row["remark"]))),
            )
            for row in presets
        ],
    }
