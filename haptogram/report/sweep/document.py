"""The result of a sweep as a document: where it breaks, and the worst points."""

from __future__ import annotations

import itertools
import statistics
import textwrap
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from haptogram.campaigns.sweep.campaign import SweepCampaign
from haptogram.campaigns.sweep.rows import MEASURES, VERDICTS, Measure, Row, badness

from ..figures.style import embed_picture, new_figure
from ..formats.document import TONES, Block, Document, Picture, Section, Table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SEED: Final = "seed"
_MOST_WORST: Final = 20
_MOST_REASON: Final = 60  # most characters of a reason; the rows have all of it
_MOST_LEVELS: Final = 20  # most levels of one axis of a map, or of a table
_MOST_VALUES: Final = 12
_RANGES: Final = 8
_INK: Final = "#111111"  # text colour on a bright cell, in a dark page too
_CHALK: Final = "#fefefe"
_BRIGHT: Final = 0.6  # share of the largest value from which on a cell is bright
_LABEL: Final = 24  # most characters of a label


def sweep_document(campaign: SweepCampaign) -> Document:
    """Return the result of *campaign*, whole or so far."""
    plan, rows = campaign.plan, campaign.rows_in_order
    measures = MEASURES[plan.config.run]
    measure = measures[0]
    counts = Counter(row["verdict"] for row in rows)
    verdict = next((name for name in VERDICTS if counts[name]), "inconclusive")
    levels = {
        axis.name: found
        for axis in plan.axes
        if len(found := sweep_levels(rows, axis.name, measure.column)) <= _MOST_LEVELS
    }
    labels = {axis.name: axis.label for axis in plan.axes if axis.name in levels}
    told = ", ".join(f"{counts[name]} {name}" for name in VERDICTS if counts[name])
    whole = "" if campaign.is_complete else f" of {len(plan)}, so far"
    names = ", ".join(axis.name for axis in plan.axes)
    return Document(
        command="sweep",
        heading=f"{verdict.upper()}: {len(rows)} points{whole}: {told}",
        title=f"sweep of {plan.config.run}, {verdict}",
        tone=TONES[verdict],
        lead=[f"{len(rows)} points of {plan.config.run}, over {names}"],
        sections=[
            Section("Where it breaks", list(_sweep_pictures(rows, labels, levels, measure))),
            *(
                Section(f"By {labels[name]}", [_sweep_level_table(name, found, measure)])
                for name, found in levels.items()
            ),
            Section("Worst points", [_sweep_worst_table(rows, measures)]),
        ],
    )


def _sweep_pictures(
    rows: Sequence[Row],
    labels: Mapping[str, str],
    levels: Mapping[str, Sequence[SweepLevel]],
    measure: Measure,
) -> Iterator[Block]:
    """Yield the map of a measure over the first two axes of the sweep, or the only one.

    The axis of the seed is left out if there are others; *labels* and *levels* are by name of the
    axis.
    """
    names = ([name for name in levels if name != _SEED] or list(levels))[:2]
    titles, shown = [labels[name] for name in names], [levels[name] for name in names]
    if len(names) == 1:
        titles, shown = ["", *titles], [[sweep_level("", rows, measure.column)], *shown]
    if names:
        yield Picture(
            lambda: embed_picture(
                draw_sweep_map(titles, shown, measure),
                f"Points over {' and '.join(filter(None, titles))}.",
                "Left: how many points did not pass, of how many. Right: the largest figure.",
            )
        )


def _sweep_level_table(name: str, levels: Sequence[SweepLevel], measure: Measure) -> Table:
    """Return a table of the *levels* of one axis: verdicts, and the measure's median and worst."""
    head = (name, "points", *reversed(VERDICTS), f"{measure.text}, median", "worst")
    return Table(head, [level.cells() for level in levels], range(1, len(head)))


def _sweep_worst_table(rows: Sequence[Row], measures: Sequence[Measure]) -> Table:
    """Return a table of the 20 worst points, with the command that repeats each."""
    worst = sorted(rows, key=lambda row: badness(row, measures))[:_MOST_WORST]
    head = ("point", "verdict", *(m.text for m in measures), "reason", "command that repeats it")
    cells = [
        (
            str(row["point"]),
            row["verdict"],
            *("" if (f := row.get(m.column)) is None else f"{f:.3g}" for m in measures),
            textwrap.shorten(row["reason"] or "", _MOST_REASON, placeholder=" ..."),
            row["command"],
        )
        for row in worst
    ]
    last = len(head) - 1
    return Table(head, cells, (0, *range(2, last - 1)), (last - 1, last))


# --- Rows by the values of an axis ---------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class SweepLevel:
    """The rows of one value, or of a range of values.

    Attributes
    ----------
    label : str
        The value or the range in words.
    rows : sequence of Row
    figures : sequence of float
        The figure of each row that has one.
    """

    label: str
    rows: Sequence[Row]
    figures: Sequence[float]

    def cells(self) -> tuple[str, ...]:
        """Return the row of a table: points, verdicts, median and largest figure."""
        counts = Counter(row["verdict"] for row in self.rows)
        told = [str(counts[verdict]) for verdict in reversed(VERDICTS)]
        if not self.figures:
            return (self.label, str(len(self.rows)), *told, "", "")
        middle, most = statistics.median(self.figures), max(self.figures)
        return (self.label, str(len(self.rows)), *told, f"{middle:.3g}", f"{most:.3g}")


def sweep_levels(rows: Sequence[Row], axis: str, column: str) -> list[SweepLevel]:
    """Return *rows* by their value on *axis*, with the figures in *column*."""
    by_value: dict[Any, list[Row]] = {}
    for row in rows:
        by_value.setdefault(row[axis], []).append(row)
    if any(isinstance(value, str) for value in by_value):
        return [sweep_level(str(value), found, column) for value, found in by_value.items()]
    values = sorted(by_value)
    if len(values) <= _MOST_VALUES:
        return [sweep_level(f"{value:.6g}", by_value[value], column) for value in values]
    edges = [len(values) * place // _RANGES for place in range(_RANGES + 1)]
    return [
        sweep_level(
            f"{values[begin]:.4g} to {values[end - 1]:.4g}",
            [row for value in values[begin:end] for row in by_value[value]],
            column,
        )
        for begin, end in itertools.pairwise(edges)
    ]


def sweep_level(label: str, rows: Sequence[Row], column: str) -> SweepLevel:
    """Return the level of *rows*, with the figures in *column*."""
    figures = [row[column] for row in rows if row.get(column) is not None]
    return SweepLevel(label, rows, figures)


# --- The map -------------------------------------------------------------------------------------


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
            axes.set_xticks(range(len(across)), [_short(one) for one in across])
            for label in axes.get_xticklabels():  # its end below its column
                label.set(rotation=45, ha="right", rotation_mode="anchor")
            axes.set(title=title, xlabel=names[1])
        left.set_ylabel(names[0])
        left.set_yticks(range(len(downward)), [_short(one) for one in downward])
    return figure


def _draw_sweep_cells(axes: Axes, values: np.ndarray, texts: np.ndarray, most: float) -> None:
    """Draw the cells of a map (rows, columns) with *texts*, dark on cells over 0.6 of *most*."""
    axes.grid(visible=False)
    axes.imshow(values, aspect="auto", origin="lower", vmin=0.0, vmax=most)
    for (y, x), text in np.ndenumerate(texts):
        colour = _INK if values[y, x] > _BRIGHT * most else _CHALK
        axes.text(x, y, text, ha="center", va="center", color=colour, fontsize=8.0)


def _short(level: SweepLevel) -> str:
    """Return the label of a level, cut to 24 characters."""
    return level.label if len(level.label) <= _LABEL else f"{level.label[:_LABEL]}…"
