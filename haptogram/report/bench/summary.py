"""One benchmark of the loop for the page of a CI job."""

from __future__ import annotations

from collections.abc import Sequence

from ..formats.job_summary import Finding, JobSummary, Level, SummaryTable
from . import content


def bench_summary(result: content.Result, changes: Sequence[str] = ()) -> JobSummary:
    """Return the summary of *result*; nothing is judged, so that it has warnings only.

    Parameters
    ----------
    result : mapping
        As of :func:`haptogram.campaigns.bench.result.bench_dict`.
    changes : sequence of str
        Differences from an earlier run, one in each line.
    """
    return JobSummary(
        command="bench",
        sentence=content.bench_frames_rows(result),
        findings=[Finding(Level.WARNING, "bench", text) for text in result["warnings"]],
        facts=[
            content.bench_conditions_rows(result),
            content.bench_space_rows(result),
            *content.bench_machine_rows(result),
            *changes,
        ],
        tables=[
            SummaryTable(
                "Stages of a frame", content.STAGE_HEAD, list(content.bench_stages_rows(result))
            ),
            SummaryTable("Late frames", content.MISS_HEAD, list(content.bench_misses_rows(result))),
        ],
    )
