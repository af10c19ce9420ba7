"""The reproduction as text for a terminal, at most 100 columns wide."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence
from typing import Final

from haptogram.published.paper.document import (
    DEVIATIONS_REMARK,
    FIGURE_4_REMARK,
    SCALE_REMARK,
    Paper,
    prose,
)
from haptogram.published.paper.equations import EQUATIONS
from haptogram.published.paper.table1 import TOLERANCE, Cell, Reproduction

_WIDTH: Final = 98


def render(paper: Paper) -> str:
    """Return the whole text."""
    sections = (
        _equations(paper),
        _table(paper.best),
        _readings(paper.results),
        _figure_4(paper),
    )
    return "\n\n".join("\n".join(section) for section in sections) + "\n"


def _equations(paper: Paper) -> Iterator[str]:
    yield "Equations, as printed and as corrected"
    for equation in EQUATIONS:
        yield f"  {equation.number} printed    {equation.printed}   [{equation.printed_unit}]"
        for fault in equation.faults:
            yield from textwrap.wrap(
                f"! {fault}", _WIDTH, initial_indent="      ", subsequent_indent="        "
            )
        yield f"      corrected  {equation.corrected}   [{equation.corrected_unit}]"
    yield ""
    yield f"  {'In numbers':<52} {'as printed':<20} as corrected"
    for item in paper.demonstrations:
        printed = f"{item.printed:.4g} {item.printed_unit}"
        corrected = f"{item.corrected:.4g} {item.corrected_unit}"
        yield f"  {item.what:<52} {printed:<20} {corrected}".rstrip()


def _table(result: Reproduction) -> Iterator[str]:
    yield "Table 1: force at the focus, printed and predicted (mN)"
    yield from _wrapped(f"reading: {result.reading.remark}")
    yield from _wrapped(f"scale: {result.scale_mn:.4g} mN m^2. {SCALE_REMARK}")
    yield ""
    yield "  array  step    points |  average                        |  standard deviation"
    yield "         (mm)           |  printed  ours   error          |  printed  ours   error"
    for cell in result.cells:
        yield _row(cell)
    averages = sum(cell.average_reproduced for cell in result.cells)
    deviations = sum(cell.deviation_reproduced for cell in result.cells)
    yield ""
    yield (
        f"  averages within {TOLERANCE:.0%}: {averages} of {len(result.cells)}; "
        f"standard deviations within {TOLERANCE:.0%}: {deviations} of {len(result.cells)}"
    )
    if deviations < len(result.cells):
        yield from _wrapped(f"NOT REPRODUCED: {DEVIATIONS_REMARK}")
    yield "  The text about the table:"
    for sentence in prose():
        yield from textwrap.wrap(
            sentence, _WIDTH, initial_indent="    - ", subsequent_indent="      "
        )


def _row(cell: Cell) -> str:
    columns, rows = cell.configuration
    average = "ok" if cell.average_reproduced else "NO"
    deviation = "reproduced" if cell.deviation_reproduced else "NOT reproduced"
    return (
        f"  {f'{columns}x{rows}':<6} {cell.resolution_m * 1e3:<6g} {cell.points:>6}  |"
        f"  {cell.printed_average_mn:>6.2f}  {cell.average_mn:>5.2f}  {cell.average_error:>+6.1%}  "
        f"{average:<8}|  {cell.printed_deviation_mn:>6.2f}  {cell.deviation_mn:>5.2f}  "
        f"{cell.deviation_error:>+6.0%}  {deviation}"
    )


def _readings(results: Sequence[Reproduction]) -> Iterator[str]:
    yield "Readings: RMS error of the sixteen averages and of the deviations (mN), worst average"
    for result in results:
        yield (
            f"  {result.reading.name:<24} {result.average_rms_mn:>6.3f}  "
            f"{result.deviation_rms_mn:>6.3f}  {result.worst_average_error:>6.1%}   "
            f"{sum(cell.average_reproduced for cell in result.cells):>2} of 16 within 7 %"
        )
        yield from textwrap.wrap(
            result.reading.remark, _WIDTH, initial_indent="      ", subsequent_indent="      "
        )


def _figure_4(paper: Paper) -> Iterator[str]:
    yield "Figure 4: 64 x 1 concave cylindrical section (Pa RMS)"
    for row in paper.figure_4:
        target, peak = (
            ", ".join(f"{round(value, 1) + 0.0:g}" for value in row[name])
            for name in ("target_mm", "peak_mm")
        )
        yield (
            f"  bent along {row['bend']}, target ({target}) mm: {row['target_rms_pa']:.0f}; "
            f"maximum {row['peak_rms_pa']:.0f} at ({peak}) mm, {row['peak_offset_mm']:.1f} mm away"
        )
    yield from _wrapped(FIGURE_4_REMARK)


def _wrapped(text: str) -> list[str]:
    return textwrap.wrap(text, _WIDTH, initial_indent="  ", subsequent_indent="    ")
