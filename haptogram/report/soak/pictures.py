"""The course of a soak as a picture (needs the extra ``report``)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from haptogram.campaigns.soak.campaign import SoakCampaign

from ..figures.style import BLACK, BLUE, GREEN, ORANGE, VERMILION, figure_legend, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COUNTED: Final = (
    ("damaged", "damaged", BLUE),
    ("lost", "lost", ORANGE),
    ("late", "late", GREEN),
)
#: Unit of the axis of time, its length in seconds, and the longest soak that it suits in seconds.
_TIME_UNITS: Final = (("s", 1.0, 300.0), ("min", 60.0, 18_000.0), ("h", 3600.0, np.inf))


def draw_soak_course(campaign: SoakCampaign) -> Figure:
    """Draw damaged, lost and late frames, the latest of them, and violations over virtual time."""
    course, interval_s = campaign.tally.course, campaign.setup.interval_s
    last = max([*course, int(np.ceil(campaign.done_s / interval_s)) - 1])
    unit, unit_s, _ = next(u for u in _TIME_UNITS if campaign.done_s <= u[2])
    edges = np.arange(last + 2) * interval_s / unit_s

    def column(name: str) -> list[float]:
        return [course[n][name] if n in course else 0 for n in range(last + 1)]

    with new_figure(8.0, 5.2) as figure:
        frames, late, wrong = figure.subplots(
            3, 1, sharex=True, height_ratios=(3.0, 2.0, 1.2), squeeze=True
        )
        for name, label, colour in _COUNTED:
            rates = np.array(column(name)) / interval_s
            frames.stairs(rates, edges, color=colour, label=label, lw=1.2)
        frames.set_yscale("symlog", linthresh=10.0)  # an outage loses hundreds, a fault one
        frames.set(ylabel="frames per second")
        late.stairs(np.array(column("latest_us")) / 1e3, edges, color=BLACK, label="latest frame")
        late.set(ylabel="after its time (ms)")
        _draw_soak_violations(wrong, np.array(column("violations")), edges)
        wrong.set(
            ylabel="violations",
            xlabel=f"virtual time ({unit})",
            xlim=(0.0, max(campaign.done_s / unit_s, edges[-2])),
        )
        for axes in (frames, late):
            axes.set_ylim(bottom=0.0)
        figure.align_ylabels()
        figure_legend(figure, columns=5)
    return figure


def _draw_soak_violations(axes: Axes, counts: np.ndarray, edges: np.ndarray) -> None:
    """Draw a bar for each interval with violations, at least as wide as can be seen."""
    if counts.any():
        middles, least = (edges[1:] + edges[:-1]) / 2.0, edges[-1] / 200.0
        found = counts > 0
        width = max(edges[1] - edges[0], least)
        axes.bar(middles[found], counts[found], width, color=VERMILION, label="violations")
        axes.set_ylim(0.0, 1.15 * counts.max())
    else:
        axes.text(0.5, 0.5, "none", ha="center", va="center", transform=axes.transAxes)
        axes.set(ylim=(0.0, 1.0), yticks=[])
