"""The pictures of a run; each function returns a figure of matplotlib.

Raises ConfigurationError where matplotlib is missing (extra ``report``).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from haptogram.acoustics import AcousticModel
from haptogram.verification import FrameVerdict, RunVerdict

from ..figures.style import BLUE, GREY, VERMILION, figure_legend, new_figure
from .fieldmap import RunFieldPicture
from .panels import (
    LEAST_ERROR_MM,
    MOST_POINTS,
    along_panel,
    empty_panel,
    error_map_panel,
    error_panel,
    foci_panel,
    lateness_panel,
    map_panel,
    mark_missing_run_frames,
    pressure_map_panel,
)
from .series import plotted_bounds_mm, plotted_error_series, plotted_frames_of_run

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_WIDTH_IN: Final = 8.0
_HALF_WIDTH_IN: Final = 5.1  # two beside each other in a page


def draw_run_foci(run: RunVerdict, model: AcousticModel) -> Figure:
    """Draw intended and measured foci over the array, coloured by error over its bound."""
    with new_figure(_WIDTH_IN, 6.0) as figure:
        foci_panel(figure, figure.add_subplot(projection="3d"), run, model)
    return figure


def draw_run_errors(run: RunVerdict, model: AcousticModel) -> Figure:
    """Draw how the lateral and axial errors are distributed, against the bounds of rounding."""
    with new_figure(_WIDTH_IN, 3.75) as figure:
        panels = figure.subplots(1, 2, sharey=True)
        for axes, series in zip(panels, plotted_error_series(run, model), strict=True):
            error_panel(axes, series)
        panels[0].set_ylabel("frames")
    return figure


def draw_run_field(shown: RunFieldPicture, model: AcousticModel, *, close: bool) -> Figure:
    """Draw |p| in two planes through one focus; close up with the marks."""
    planes = (shown.close_level, shown.close_upright) if close else (shown.level, shown.upright)
    with new_figure(_HALF_WIDTH_IN, 2.5) as figure:
        figure.set_layout_engine("compressed")  # no gaps beside pictures of fixed aspect
        panels = figure.subplots(1, 2)
        for axes, plane in zip(panels, planes, strict=True):
            image = map_panel(axes, plane, shown, model, close=close)
        figure.colorbar(image, ax=panels, label="pressure (kPa RMS)", aspect=30)
        if close:
            figure_legend(figure)
    return figure


def draw_run_along_object(run: RunVerdict) -> Figure:
    """Draw force and pressure in the order of display, and the pressure as a map from above."""
    with new_figure(_WIDTH_IN, 4.2) as figure:
        grid = figure.add_gridspec(2, 2, width_ratios=(1.25, 1.0))
        upper = figure.add_subplot(grid[0, 0])
        lower = figure.add_subplot(grid[1, 0], sharex=upper)
        along_panel(upper, run, "pressure_rms_pa", 1e-3, "pressure (kPa RMS)")
        along_panel(lower, run, "force_n", 1e3, "force (mN)")
        upper.tick_params(labelbottom=False)
        lower.set_xlabel("frame, in the order of display")
        pressure_map_panel(figure, figure.add_subplot(grid[:, 1]), run)
    return figure


def draw_run_lateness(run: RunVerdict, model: AcousticModel) -> Figure:
    """Draw how long after its time each frame was latched."""
    with new_figure(_WIDTH_IN, 3.2) as figure:
        lateness_panel(figure.subplots(), run, max(1.0, 1e6 / model.frequency_hz))
    return figure


# --- Misses over time and over the object ---------------------------------------------------------


def draw_run_misses(run: RunVerdict, model: AcousticModel) -> Figure:
    """Draw the errors of the foci over time, each with its bound, and over the object."""
    with new_figure(_WIDTH_IN, 4.6) as figure:
        grid = figure.add_gridspec(2, 2, width_ratios=(1.35, 1.0))
        upper = figure.add_subplot(grid[0, 0])
        lower = figure.add_subplot(grid[1, 0], sharex=upper)
        frames = [f for f in plotted_frames_of_run(run.frames, MOST_POINTS) if _pictured_time_us(f)]
        for axes, axis, name in ((upper, 0, "across"), (lower, 1, "along")):
            _time_panel(axes, run, frames, model, axis, f"{name} the beam (mm)")
        upper.tick_params(labelbottom=False)
        _name_times_of_run_pictures(lower)
        error_map_panel(figure, figure.add_subplot(grid[:, 1]), run)
        figure_legend(figure)
    return figure


def _name_times_of_run_pictures(axes: Axes) -> None:
    """Name the axis of seconds; a short one in milliseconds, whose numbers have room."""
    if axes.get_xlim()[1] < 0.1:
        axes.xaxis.set_major_formatter(lambda second, _: f"{1e3 * second:g}")
        axes.set_xlabel("time (ms)")
    else:
        axes.set_xlabel("time (s)")


def _pictured_time_us(frame: FrameVerdict) -> int | None:
    return frame.t_apply_us if frame.t_latch_us is None else frame.t_latch_us


def _time_panel(
    axes: Axes,
    run: RunVerdict,
    frames: list[FrameVerdict],
    model: AcousticModel,
    axis: int,
    label: str,
) -> None:
    """Draw the error in one direction (0 across, 1 along) and its bound, over time."""
    rows = []
    for frame in frames:
        bounds = plotted_bounds_mm(model, frame)
        error = (frame.lateral_error_mm, frame.axial_error_mm)[axis]
        if bounds is not None and bounds[axis] is not None and error is not None:
            rows.append((_pictured_time_us(frame), abs(error), bounds[axis], frame.is_wrong))
    if not rows:
        empty_panel(axes, f"no error {label.partition(' (')[0]} was measured")
        return
    table = np.array(rows, dtype=np.float64)
    begin_us = min(time for time in map(_pictured_time_us, run.frames) if time is not None)
    times_s = (table[:, 0] - begin_us) / 1e6
    errors = np.maximum(table[:, 1], LEAST_ERROR_MM)
    wrong = table[:, 3] > 0.0
    size = 2.5 if len(table) > 100 else 5.0
    axes.plot(times_s, table[:, 2], "-", color=GREY, lw=1.0, label="bound of quantisation")
    axes.plot(times_s[~wrong], errors[~wrong], ".", color=BLUE, ms=size, label="error")
    if wrong.any():
        label_of_wrong = "error of a wrong frame"
        axes.plot(times_s[wrong], errors[wrong], "x", color=VERMILION, ms=5.0, label=label_of_wrong)
    mark_missing_run_frames(
        axes, run, lambda f: ((_pictured_time_us(f) or begin_us) - begin_us) / 1e6
    )
    axes.set(yscale="log", ylabel=label)
    axes.margins(x=0.02, y=0.15)
