"""Pictures of a sweep (need the extra ``report``)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Final

import numpy as np

from haptogram.campaigns.sweep.rows import Measure, Row

from ..figures.style import BLACK, BLUE, GREEN, ORANGE, VERMILION, figure_legend, new_figure
from .levels import SweepLevel

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLOURS: Final = {"pass": GREEN, "fail": VERMILION, "error": BLACK, "inconclusive": ORANGE}
_PER_LINE: Final = 2  # panels beside each other
_DECADES: Final = 100.0  # from the least to the largest, from which on an axis is logarithmic
_INK: Final = "#111111"  # on a bright cell, in a dark page too
_CHALK: Final = "#fefefe"
_BRIGHT: Final = 0.6  # of the largest value, from which on a cell is bright
_LABEL: Final = 24  # characters


def draw_sweep_map(
    names: Sequence[str], levels: Sequence[Sequence[SweepLevel]], measure: Measure
) -> Figure:
    """Draw share of failures and largest figure over two axes."""
    downward, across = levels
    failed = np.full((len(downward), len(across)), np.nan)
    largest, counts = failed.copy(), np.full(failed.shape, "", object)
    columns = [{row["point"] for row in level.rows} for level in across]
    for y, level in enumerate(downward):
        for x, column in enumerate(columns):
            rows = [row for row in level.rows if row["point"] in column]
            if rows:
                wrong = sum(row["verdict"] != "pass" for row in rows)
                failed[y, x] = wrong / len(rows)
                counts[y, x] = f"{wrong}/{len(rows)}"
            figures = [row[measure.column] for row in rows if row.get(measure.column) is not None]
            largest[y, x] = max(figures, default=np.nan)
    texts = np.array([[f"{v:.2g}" if v == v else "" for v in line] for line in largest])
    with new_figure(9.0, 1.8 + 0.35 * len(downward)) as figure:
        left, right = figure.subplots(1, 2, sharey=True)
        _draw_sweep_cells(left, failed, counts, 1.0)
        _draw_sweep_cells(right, largest, texts, float(np.nanmax([1e-9, *largest.flat])))
        for axes, title in ((left, "points that did not pass"), (right, measure.text)):
            axes.set_xticks(range(len(across)), [_short(one) for one in across], rotation=45)
            axes.set(title=title, xlabel=names[1])
        left.set_ylabel(names[0])
        left.set_yticks(range(len(downward)), [_short(one) for one in downward])
    return figure


def _draw_sweep_cells(axes: Axes, values: np.ndarray, texts: np.ndarray, most: float) -> None:
    axes.grid(visible=False)
    axes.imshow(values, aspect="auto", origin="lower", vmin=0.0, vmax=most)
    for (y, x), text in np.ndenumerate(texts):
        colour = _INK if values[y, x] > _BRIGHT * most else _CHALK
        axes.text(x, y, text, ha="center", va="center", color=colour, fontsize=8.0)


def draw_sweep_axes(
    rows: Sequence[Row],
    labels: Mapping[str, str],
    levels: Mapping[str, Sequence[SweepLevel]],
    measure: Measure,
) -> Figure:
    """Draw the figure of every point over each of the axes in *labels*, and its median."""
    lines = -(-len(labels) // _PER_LINE)
    figures = [row[measure.column] for row in rows if row.get(measure.column) is not None]
    with new_figure(9.0, 0.4 + 2.6 * lines) as figure:
        panels = list(figure.subplots(lines, _PER_LINE, squeeze=False, sharey=True).flat)
        for name, axes in zip(labels, panels, strict=False):
            _draw_sweep_axis(axes, rows, name, levels[name], measure)
            axes.set_xlabel(labels[name])
        for axes in panels[len(labels) :]:
            axes.set_axis_off()
        if _spans_decades(figures):
            panels[0].set_yscale("log")
        figure_legend(figure, columns=5)
    return figure


def _draw_sweep_axis(
    axes: Axes, rows: Sequence[Row], name: str, levels: Sequence[SweepLevel], measure: Measure
) -> None:
    is_text = any(isinstance(row[name], str) for row in rows)
    places = {level.label: level.place for level in levels}
    for verdict, colour in _COLOURS.items():
        found = [
            row for row in rows if row["verdict"] == verdict and row.get(measure.column) is not None
        ]
        values = [places[str(row[name])] if is_text else row[name] for row in found]
        figures = [row[measure.column] for row in found]
        if found:
            axes.plot(values, figures, ".", color=colour, label=verdict, alpha=0.6)
    known = [level for level in levels if level.figures]
    middles = [float(np.median(level.figures)) for level in known]
    axes.plot(
        [level.place for level in known],
        middles,
        "_" if is_text else "-",  # nothing lies between two texts
        color=BLUE,
        ms=16.0,
        label="median",
    )
    axes.set_ylabel(measure.text)
    if is_text:
        axes.set_xticks(list(places.values()), [_short(level) for level in levels], rotation=30)
    elif _spans_decades([row[name] for row in rows]):
        axes.set_xscale("log")


def _spans_decades(values: Sequence[float]) -> bool:
    """Return True if the values need a logarithmic axis."""
    return bool(values) and min(values) > 0.0 and max(values) >= _DECADES * min(values)


def _short(level: SweepLevel) -> str:
    """Return the label of a level, truncated."""
    return level.label if len(level.label) <= _LABEL else f"{level.label[:_LABEL]}…"
