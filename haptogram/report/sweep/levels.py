"""Rows of a sweep by the values of an axis: each value by itself, or ranges of many numbers."""

from __future__ import annotations

import itertools
import statistics
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

from haptogram.campaigns.sweep.rows import VERDICTS, Row

_MOST_VALUES: Final = 12
_RANGES: Final = 8


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
