"""The reproduced paper as text for a terminal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from haptogram.report.formats.console import console_paragraph, console_table

from .document import (
    DEVIATIONS_REMARK,
    FIGURE_4_REMARK,
    SCALE_REMARK,
    PaperReproduction,
    paper_prose,
)
from .equations import EQUATIONS
from .table1 import TOLERANCE, Table1Cell, Table1Reproduction


def paper_text(paper: PaperReproduction) -> str:
    """Return the equations, Table 1 cell by cell, its readings, and the foci of figure 4."""
    sections = (
        _paper_equations_text(paper),
        _paper_table_1_text(paper.best),
        _paper_readings_text(paper.results),
        _paper_figure_4_text(paper),
    )
    return "\n\n".join("\n".join(section) for section in sections) + "\n"


def _paper_equations_text(paper: PaperReproduction) -> Iterator[str]:
    yield "Equations, as printed and as corrected"
    for equation in EQUATIONS:
        yield f"  {equation.number} printed    {equation.printed}   [{equation.printed_unit}]"
        for fault in equation.faults:
            yield from console_paragraph(f"! {fault}", indent=6)
        yield f"      corrected  {equation.corrected}   [{equation.corrected_unit}]"
    yield ""
    rows = (
        (
            item.what,
            f"{item.printed:.4g} {item.printed_unit}".rstrip(),
            f"{item.corrected:.4g} {item.corrected_unit}".rstrip(),
        )
        for item in paper.demonstrations
    )
    yield from console_table(("In numbers", "as printed", "as corrected"), rows, indent=2)


def _paper_table_1_text(result: Table1Reproduction) -> Iterator[str]:
    yield "Table 1: force at the focus, printed and predicted (mN)"
    yield from console_paragraph(f"reading: {result.reading.remark}", indent=2)
    yield from console_paragraph(f"scale: {result.scale_mn:.4g} mN m^2. {SCALE_REMARK}", indent=2)
    yield ""
    yield from console_table(
        (
            "array",
            "step (mm)",
            "points",
            *_paper_force_text("average"),
            *_paper_force_text("deviation"),
        ),
        map(_paper_table_row, result.cells),
        numbers=(2, 3, 4, 5, 7, 8, 9),
        indent=2,
    )
    averages = sum(cell.average_reproduced for cell in result.cells)
    deviations = sum(cell.deviation_reproduced for cell in result.cells)
    yield ""
    yield (
        f"  averages within {TOLERANCE:.0%}: {averages} of {len(result.cells)}; "
        f"standard deviations within {TOLERANCE:.0%}: {deviations} of {len(result.cells)}"
    )
    if deviations < len(result.cells):
        yield from console_paragraph(f"NOT REPRODUCED: {DEVIATIONS_REMARK}", indent=2)
    yield "  The text about the table:"
    for sentence in paper_prose():
        yield from console_paragraph(sentence, indent=4, bullet="- ")


def _paper_force_text(name: str) -> tuple[str, ...]:
    return name, "ours", "error", ""


def _paper_table_row(cell: Table1Cell) -> tuple[str, ...]:
    columns, rows = cell.configuration
    return (
        f"{columns}x{rows}",
        f"{cell.resolution_m * 1e3:g}",
        str(cell.points),
        f"{cell.printed_average_mn:.2f}",
        f"{cell.average_mn:.2f}",
        f"{cell.average_error:+.1%}",
        "ok" if cell.average_reproduced else "NO",
        f"{cell.printed_deviation_mn:.2f}",
        f"{cell.deviation_mn:.2f}",
        f"{cell.deviation_error:+.0%}",
        "reproduced" if cell.deviation_reproduced else "NOT reproduced",
    )


def _paper_readings_text(results: Sequence[Table1Reproduction]) -> Iterator[str]:
    yield "Readings: RMS error of the sixteen averages and of the deviations (mN), worst average"
    head, *lines = console_table(
        ("reading", "averages", "deviations", "worst", "within 7 %"),
        (
            (
                result.reading.name,
                f"{result.average_rms_mn:.3f}",
                f"{result.deviation_rms_mn:.3f}",
                f"{result.worst_average_error:.1%}",
                f"{sum(cell.average_reproduced for cell in result.cells)} of {len(result.cells)}",
            )
            for result in results
        ),
        numbers=(1, 2, 3, 4),
        indent=2,
    )
    yield head
    for line, result in zip(lines, results, strict=True):
        yield line
        yield from console_paragraph(result.reading.remark, indent=6, hang=0)


def _paper_figure_4_text(paper: PaperReproduction) -> Iterator[str]:
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
    yield from console_paragraph(FIGURE_4_REMARK, indent=2)
