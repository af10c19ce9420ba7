"""The result of a sweep as a document: where it breaks, and the worst points."""

from __future__ import annotations

import textwrap
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Final

from haptogram.campaigns.sweep.campaign import SweepCampaign
from haptogram.campaigns.sweep.rows import MEASURES, VERDICTS, Measure, Row, badness

from ..figures.style import embed_picture
from ..formats.document import TONES, Block, Document, Picture, Section, Table
from .levels import SweepLevel, sweep_level, sweep_levels
from .pictures import draw_sweep_map

_SEED: Final = "seed"
_MOST_WORST: Final = 20
_MOST_REASON: Final = 60  # characters; the rows have all of it
_MOST_LEVELS: Final = 20  # most levels of one axis of a map, or of a table


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
    head = (name, "points", *reversed(VERDICTS), f"{measure.text}, median", "worst")
    return Table(head, [level.cells() for level in levels], range(1, len(head)))


def _sweep_worst_table(rows: Sequence[Row], measures: Sequence[Measure]) -> Table:
    worst = sorted(rows, key=lambda row: badness(row, measures))[:_MOST_WORST]
    head = ("point", "verdict", *(m.text for m in measures), "reason", "command that repeats it")
    cells = [
        (
            str(row["point"]),
            row["verdict"],
            *(_figure_text(row.get(measure.column)) for measure in measures),
            textwrap.shorten(row["reason"] or "", _MOST_REASON, placeholder=" ..."),
            row["command"],
        )
        for row in worst
    ]
    last = len(head) - 1
    return Table(head, cells, (0, *range(2, last - 1)), (last - 1, last))


def _figure_text(figure: float | None) -> str:
    return "" if figure is None else f"{figure:.3g}"
