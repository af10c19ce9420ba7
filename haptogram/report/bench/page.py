"""One benchmark of the loop as a page with its histograms."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from haptogram.campaigns.bench.measure import BenchRun
from haptogram.campaigns.bench.result import as_dict

from ..html import embed, write_page
from . import content
from .pictures import draw_course, draw_histograms


def write_bench_page(path: Path, run: BenchRun, changes: Sequence[str] = ()) -> None:
    """Write percentiles, late frames with their causes, pictures and machine as a page.

    Parameters
    ----------
    changes : sequence of str
        Differences from an earlier run, one in each line; none without one.

    Raises
    ------
    ConfigurationError
        If the extra ``report`` is not installed, or *path* cannot be written.
    """
    result = as_dict(run)
    write_page(
        path,
        "bench.html",
        title="Haptogram: timing of the loop",
        heading="Timing of the loop",
        tone="plain",
        lead=[f"{content.conditions(result)}.", f"{content.frames(result)}."],
        stage_head=content.STAGE_HEAD,
        stages=list(content.stages(result)),
        clocks=content.clocks(result),
        miss_head=content.MISS_HEAD,
        misses=list(content.misses(result)),
        space=content.space(result),
        changes=changes,
        machine=list(content.machine(result)),
        warnings=result["warnings"],
        histograms=embed(
            draw_histograms(run.stages_us),
            "Histogram of the stages of a frame and of the control loop.",
            "Both axes are logarithmic, so that rare delays show.",
        ),
        course=embed(
            draw_course(run.stages_us, run.config.rate_hz),
            "Lateness of every frame and of the control loop in the course of the run.",
            "The control loop does nothing but wake up, in a process of its own: where it is late "
            "too, the machine was.",
        ),
    )
