"""One benchmark of the loop as a page with its histograms."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from haptogram.campaigns.bench.measure import BenchRun
from haptogram.campaigns.bench.result import bench_dict
from haptogram.machine.provenance import UNSTATED, Provenance

from ..figures.embedded import embed_picture
from ..formats.html import write_html_page
from . import content
from .pictures import draw_bench_course, draw_bench_histograms


def write_bench_page(
    path: Path,
    run: BenchRun,
    changes: Sequence[str] = (),
    *,
    provenance: Provenance = UNSTATED,
) -> None:
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
    result = bench_dict(run)
    tone, outcome = content.bench_outcome(result)
    write_html_page(
        path,
        "bench.html",
        provenance,
        title="Haptogram: timing of the loop",
        heading=f"Timing of the loop: {outcome}",
        tone=tone,
        lead=[f"{content.bench_conditions_rows(result)}.", f"{content.bench_frames_rows(result)}."],
        stage_head=content.STAGE_HEAD,
        stages=list(content.bench_stages_rows(result)),
        clocks=content.bench_clocks_rows(result),
        miss_head=content.MISS_HEAD,
        misses=list(content.bench_misses_rows(result)),
        space=content.bench_space_rows(result),
        changes=changes,
        machine=list(content.bench_machine_rows(result)),
        warnings=result["warnings"],
        histograms=embed_picture(
            draw_bench_histograms(run.stages_us),
            "Histogram of the stages of a frame and of the control loop.",
            "Both axes are logarithmic, so that rare delays show.",
        ),
        course=embed_picture(
            draw_bench_course(run.stages_us, run.config.rate_hz),
            "Lateness of every frame and of the control loop in the course of the run.",
            "The control loop does nothing but wake up, in a process of its own: where it is late "
            "too, the machine was.",
        ),
    )
