"""One benchmark of the loop as text for a terminal."""

from __future__ import annotations

from ..console import paragraph, table
from . import content


def bench_text(result: content.Result) -> str:
    """Return percentiles of every stage, late frames with their causes, and the machine.

    Parameters
    ----------
    result : mapping
        As of :func:`haptogram.campaigns.bench.result.as_dict`.
    """
    numbers = range(1, len(content.STAGE_HEAD) - 1)
    sections = (
        [content.conditions(result), f"  {content.frames(result)}"],
        [
            *table(content.STAGE_HEAD, content.stages(result), numbers=numbers),
            *paragraph(content.clocks(result), hang=0),
        ],
        table(content.MISS_HEAD, content.misses(result), numbers=(0, 2)),
        paragraph(content.space(result), hang=0),
        [*content.machine(result), *(f"warning: {text}" for text in result["warnings"])],
    )
    return "\n\n".join("\n".join(section) for section in sections)
