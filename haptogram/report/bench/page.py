"""A run as one HTML page with its pictures in it."""

from __future__ import annotations

import html
from collections.abc import Sequence
from typing import Final

from haptogram.campaigns.bench.measure import BenchRun
from haptogram.campaigns.bench.result import as_dict
from haptogram.report.bench.pictures import draw_course, draw_histograms
from haptogram.report.bench.text import bench_text
from haptogram.report.figures.style import as_data_uri

_PAGE: Final = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>haptogram bench</title>
<style>
body {{ font: 15px/1.5 sans-serif; max-width: 72em; margin: 2em auto; padding: 0 1em; }}
pre {{ font-size: 13px; white-space: pre-wrap; background: #f6f6f6; padding: 1em; }}
img {{ max-width: 100%; }}
</style></head><body>
<h1>Timing of the loop</h1>
<pre>{text}</pre>
{changes}
<h2>How often, how long</h2>
<img alt="Histogram of every stage of a frame and of the control loop" src="{histograms}">
<h2>In the course of the run</h2>
<img alt="Lateness of every frame and of the control loop over time" src="{course}">
</body></html>
"""


def as_html(run: BenchRun, changes: Sequence[str] = ()) -> str:
    """Return the page.

    Raises
    ------
    ConfigurationError
        If matplotlib is not installed.
    """
    lines = html.escape("\n".join(changes))
    return _PAGE.format(
        text=html.escape(bench_text(as_dict(run))),
        changes=f"<h2>Against the run before</h2><pre>{lines}</pre>" if changes else "",
        histograms=as_data_uri(draw_histograms(run.stages_us)),
        course=as_data_uri(draw_course(run.stages_us, run.config.rate_hz)),
    )
