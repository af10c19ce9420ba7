"""Histograms of a run (needs the extra ``report``)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from haptogram.campaigns.bench.attribution import MISS_LIMITS_US
from haptogram.campaigns.bench.percentiles import TimingPercentiles

from ..figures.style import BLACK, BLUE, GREEN, GREY, ORANGE, VERMILION, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_BINS: Final = np.geomspace(0.1, 1e6, 141)  # microseconds
_SHOWN: Final = (
    ("wake", "wake, from the intended time", BLUE),
    ("work", "encode and write", ORANGE),
    ("board", "complete at the board, after the line", GREEN),
    ("complete", "all of it, from the intended time", VERMILION),
    ("control", "control loop beside it", BLACK),
)


# Above the axes: the values can lie anywhere within them.
_LEGEND: Final[Any] = {"loc": "outside upper center", "ncols": 2}


def draw_bench_histograms(stages_us: Mapping[str, NDArray[np.float64]]) -> Figure:
    """Draw a histogram of the duration of each stage, both axes logarithmic to show the tail.

    Lines mark the limits from which on a frame counts as late, and the percentiles of the sum.
    """
    with new_figure(8.0, 4.8) as figure:
        axes = figure.add_subplot()
        for name, label, colour in _SHOWN:
            values = stages_us[name][~np.isnan(stages_us[name])]
            if len(values):
                width = 1.0 if name == "control" else 1.6
                axes.hist(
                    np.clip(values, _BINS[0], _BINS[-1]),
                    _BINS.tolist(),
                    histtype="step",
                    color=colour,
                    linewidth=width,
                    label=f"{label} (n = {len(values)})",
                )
        axes.set(xscale="log", yscale="log", xlabel="time (µs)", ylabel="frames")
        axes.margins(y=0.25)  # room for the names of the percentiles
        most = max(np.nanmax(stages_us[name], initial=0.0) for name, *_ in _SHOWN)
        axes.set_xlim(_BINS[0] / 1.5, min(_BINS[-1], 3.0 * max(most, *MISS_LIMITS_US)))
        _mark_bench_limits(axes.axvline)
        _mark_bench_percentiles(axes, stages_us["complete"])
        figure.legend(**_LEGEND)
    return figure


def draw_bench_course(stages_us: Mapping[str, NDArray[np.float64]], rate_hz: float) -> Figure:
    """Draw the lateness of every frame and of the control loop over time."""
    with new_figure(8.0, 3.2) as figure:
        axes = figure.add_subplot()
        for name, label, colour in (_SHOWN[4], _SHOWN[3]):
            values = stages_us[name]
            times_s = np.arange(len(values)) / rate_hz
            axes.plot(times_s, np.maximum(values, 0.1), ".", ms=1.5, color=colour, label=label)
        axes.set(yscale="log", xlabel="time (s)", ylabel="lateness (µs)")
        _mark_bench_limits(axes.axhline)
        figure.legend(**_LEGEND, markerscale=4.0)
    return figure


def _mark_bench_limits(draw_line: Callable[..., Any]) -> None:
    for limit_us in MISS_LIMITS_US:
        label = "limits of the miss counts" if limit_us == MISS_LIMITS_US[0] else None
        draw_line(limit_us, color=GREY, linewidth=1.0, linestyle="--", zorder=1.0, label=label)


def _mark_bench_percentiles(axes: Axes, values_us: NDArray[np.float64]) -> None:
    """Mark the percentiles of all of it at the top of the histogram."""
    found = TimingPercentiles.of(values_us)
    for place, (level, value) in enumerate(found.levels.items()):
        top = 0.97 - 0.04 * place  # the higher ones may lie close together
        axes.axvline(value, ymin=0.0, ymax=top - 0.01, color=VERMILION, lw=0.8, ls=":")
        axes.text(
            value,
            top,
            level,
            transform=axes.get_xaxis_transform(),
            ha="center",
            fontsize=7.0,
            color=VERMILION,
        )
