"""Pictures of a sweep (need the extra ``report``)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np

from haptogram.campaigns.sweep.rows import Measure

from ..figures.style import new_figure
from .levels import SweepLevel

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_INK: Final = "#111111"  # text colour on a bright cell, in a dark page too
_CHALK: Final = "#fefefe"
_BRIGHT: Final = 0.6  # share of the largest value from which on a cell is bright
_LABEL: Final = 24  # characters


def draw_sweep_map(
    names: Sequence[str], levels: Sequence[Sequence[SweepLevel]], measure: Measure
) -> Figure:
    """Draw share of failures and largest figure over two axes.

    The first may have no name, and one level of all rows.
    """
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


def _short(level: SweepLevel) -> str:
    """Return the label of a level, truncated."""
    return level.label if len(level.label) <= _LABEL else f"{level.label[:_LABEL]}…"
