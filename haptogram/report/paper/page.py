"""The reproduction as one HTML page that needs no other file, or as a folder of pictures."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from haptogram.errors import ConfigurationError
from haptogram.published.paper.document import (
    DEVIATIONS_REMARK,
    FIGURE_4_REMARK,
    SCALE_REMARK,
    Paper,
    prose,
)
from haptogram.published.paper.equations import EQUATIONS
from haptogram.report.figures import as_data_uri, render

from .pictures import draw_figure_4, draw_hemispheres, draw_table_1

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_STYLE: Final = """
body { font: 15px/1.45 system-ui, sans-serif; max-width: 68rem; margin: 2rem auto; padding: 0 1rem;
       color: #1a1a1a; background: #fff }
table { border-collapse: collapse; margin: 1rem 0; font-variant-numeric: tabular-nums }
th, td { border-bottom: 1px solid #ccc; padding: .25rem .7rem; text-align: left;
         vertical-align: top }
td.n { text-align: right }
td.n, td.verdict { white-space: nowrap }
td.no { color: #8a3a00; font-weight: 600 }
.pairs { display: grid; grid-template-columns: 1fr 1fr; gap: 0 1rem; align-items: end }
code { font-size: .92em } figure { margin: 1.2rem 0 } img { max-width: 100% }
.faults { color: #8a3a00 } p.note { max-width: 50rem }
"""

# By how the section is bent, and the plane.
_FIGURE_4_CAPTIONS: Final = {
    "x_xz": "Bent along x: the plane along x and z through the target, as the paper draws it.",
    "x_yz": "Bent along x: across the section, which cannot focus there.",
    "y_xz": "Bent along y: the plane along x and z through the target, across the section.",
    "y_yz": "Bent along y: the ring is the maximum of the focus; the section's edge is louder.",
}


def report_files(
    paper: Paper, presets: Iterable[dict[str, Any]], path: Path
) -> Iterator[tuple[Path, bytes]]:
    """Yield what to write for a report at *path*: a page; to a folder, every picture as well.

    Pictures in a folder (no suffix) are PNG and SVG.

    Raises
    ------
    ConfigurationError
        A suffix other than .html, or no matplotlib.
    """
    check_report(path)
    figures = {
        "hemispheres": draw_hemispheres(),
        "table1": draw_table_1(paper.best),
        **draw_figure_4(),
    }
    page = _page(paper, list(presets), figures).encode()
    if path.suffix:
        yield path, page
        return
    yield path / "index.html", page
    for name, figure in figures.items():
        for kind in (".png", ".svg"):
            picture = path / f"{name}{kind}"
            yield picture, render(figure, picture)


def check_report(path: Path) -> None:
    """Raise, before the work starts, unless *path* ends in .html or can be a folder.

    Raises
    ------
    ConfigurationError
        Another suffix, or a file where a folder is wanted.
    """
    if path.suffix.lower() not in ("", ".html", ".htm"):
        raise ConfigurationError(f"report '{path}' must end in .html, or be a folder")
    if path.suffix == "" and path.exists() and not path.is_dir():
        raise ConfigurationError(f"report '{path}' is a file; a folder, or a name in .html")


def _page(paper: Paper, presets: Sequence[dict[str, Any]], figures: dict[str, Figure]) -> str:
    best = paper.best
    deviations = sum(cell.deviation_reproduced for cell in best.cells)
    parts = [
        "<h1>Haptogram (2014): the paper's simulation, reproduced</h1>",
        "<h2>Equations</h2>",
        _equations(),
        _demonstrations(paper),
        "<h2>The tactile hemisphere</h2>",
        _figure(figures["hemispheres"], "Rings at equal steps of the polar angle."),
        "<h2>Table 1</h2>",
        _note(f"Reading: {best.reading.remark}. {SCALE_REMARK}"),
        _table_1(paper),
        _note(
            f"{sum(cell.average_reproduced for cell in best.cells)} of 16 averages and "
            f"{deviations} of 16 standard deviations are within 7 % of the printed value. "
            + DEVIATIONS_REMARK
        ),
        "<ul>" + "".join(f"<li>{escape(sentence)}</li>" for sentence in prose()) + "</ul>",
        _figure(figures["table1"], "Full line, filled: printed. Dotted, open: predicted."),
        "<h3>Other readings</h3>",
        _readings(paper),
        "<h2>Figure 4</h2>",
        _note(FIGURE_4_REMARK),
        '<div class="pairs">',
        *(
            _figure(figures[name], _FIGURE_4_CAPTIONS[name[-len("x_xz") :]])
            for name in figures
            if name.startswith("figure4")
        ),
        "</div>",
        "<h2>Systems behind the paper, and open boards</h2>",
        _presets(presets),
    ]
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width">'
        f"<title>Haptogram paper</title><style>{_STYLE}</style></head>\n<body>"
        + "\n".join(parts)
        + "</body></html>\n"
    )


def _equations() -> str:
    rows = []
    for equation in EQUATIONS:
        faults = "<br>".join(escape(fault) for fault in equation.faults)
        rows.append(
            f"<tr><td>{equation.number}</td>"
            f"<td><code>{escape(equation.printed)}</code><br>[{escape(equation.printed_unit)}]</td>"
            f'<td class="faults">{faults}</td>'
            f"<td><code>{escape(equation.corrected)}</code><br>"
            f"[{escape(equation.corrected_unit)}]</td></tr>"
        )
    return _table(("", "as printed", "faults", "as corrected"), rows)


def _demonstrations(paper: Paper) -> str:
    rows = [
        f"<tr><td>{escape(item.what)}</td><td>{item.printed:.4g} {item.printed_unit}</td>"
        f"<td>{item.corrected:.4g} {item.corrected_unit}</td></tr>"
        for item in paper.demonstrations
    ]
    return _table(("in numbers", "as printed", "as corrected"), rows)


def _table_1(paper: Paper) -> str:
    rows = []
    for cell in paper.best.cells:
        columns, lines = cell.configuration
        rows.append(
            f"<tr><td class=n>{columns} × {lines}</td><td class=n>{cell.resolution_m * 1e3:g}</td>"
            f"<td class=n>{cell.points}</td>"
            f"<td class=n>{cell.printed_average_mn:.2f}</td><td class=n>{cell.average_mn:.2f}</td>"
            + _verdict(cell.average_error, cell.average_reproduced)
            + f"<td class=n>{cell.printed_deviation_mn:.2f}</td>"
            f"<td class=n>{cell.deviation_mn:.2f}</td>"
            + _verdict(cell.deviation_error, cell.deviation_reproduced)
            + "</tr>"
        )
    heads = ("array", "step (mm)", "points", "average, printed", "ours (mN)", "")
    return _table((*heads, "deviation, printed", "ours (mN)", ""), rows)


def _verdict(error: float, reproduced: bool) -> str:
    if reproduced:
        return f'<td class="verdict">{error:+.1%}, reproduced</td>'
    return f'<td class="verdict no">{error:+.0%}, not reproduced</td>'


def _readings(paper: Paper) -> str:
    rows = [
        f"<tr><td>{escape(result.reading.name)}</td><td>{escape(result.reading.remark)}</td>"
        f"<td class=n>{result.average_rms_mn:.3f}</td>"
        f"<td class=n>{result.worst_average_error:.1%}</td>"
        f"<td class=n>{result.deviation_rms_mn:.3f}</td></tr>"
        for result in paper.results
    ]
    heads = ("reading", "", "averages, RMS (mN)", "worst average", "deviations, RMS (mN)")
    return _table(heads, rows)


def _presets(presets: Sequence[dict[str, Any]]) -> str:
    rows = []
    for row in presets:
        note = "; ".join(part for part in (row["source"], row["remark"]) if part)
        ours = f"{row['ours']:.4g} {row['unit']}"
        cells = (row["preset"], row["quantity"], row["published"], ours, note)
        rows.append("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in cells) + "</tr>")
    return _table(("preset", "quantity", "published", "ours", "source, remark"), rows)


def _table(heads: Sequence[str], rows: Sequence[str]) -> str:
    head = "".join(f"<th>{escape(text)}</th>" for text in heads)
    return f"<table><tr>{head}</tr>\n" + "\n".join(rows) + "</table>"


def _note(text: str) -> str:
    return f'<p class="note">{escape(text)}</p>'


def _figure(figure: Figure, caption: str) -> str:
    text = f"<figcaption>{escape(caption)}</figcaption>" if caption else ""
    return f'<figure><img alt="{escape(caption)}" src="{as_data_uri(figure)}">{text}</figure>'
