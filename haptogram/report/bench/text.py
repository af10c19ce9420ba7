"""One benchmark of the loop as text for a terminal."""

from __future__ import annotations

from ..formats.console import console_paragraph, console_table
from . import content


def bench_text(result: content.Result) -> str:
    """Return percentiles of every stage, late frames with their causes, and the machine.

    Parameters
    ----------
    result : mapping
        As of :func:`haptogram.campaigns.bench.result.bench_dict`.
    """
    numbers = range(1, len(content.STAGE_HEAD) - 1)
    sections = (
        [content.bench_conditions_rows(result), f"  {content.bench_frames_rows(result)}"],
        [
            *console_table(content.STAGE_HEAD, content.bench_stages_rows(result), numbers=numbers),
            *console_paragraph(content.bench_clocks_rows(result), hang=0),
        ],
        console_table(content.MISS_HEAD, content.bench_misses_rows(result), numbers=(0, 2)),
        console_paragraph(content.bench_space_rows(result), hang=0),
        [*content.bench_machine_rows(result), *(f"warning: {text}" for text in result["warnings"])],
    )
    return "\n\n".join("\n".join(section) for section in sections)
