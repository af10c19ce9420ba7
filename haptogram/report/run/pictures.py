"""The pictures of a run; each function returns a figure of matplotlib.

Raises ConfigurationError where matplotlib is missing (extra ``report``).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from haptogram.acoustics import AcousticModel
from haptogram.verification import RunVerdict

from ..figures.style import new_figure
from .fieldmap import FieldPicture
from .panels import (
    along_panel,
    empty_panel,
    error_panel,
    foci_panel,
    lateness_panel,
    map_panel,
    object_panel,
)
from .series import plotted_error_series

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_WIDTH_IN: Final = 8.0


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


def draw_run_field(shown: FieldPicture | None, model: AcousticModel) -> Figure:
    """Draw |p| in two planes through one focus, and below them close-ups with the marks."""
    with new_figure(_WIDTH_IN, 7.5) as figure:
        if shown is None:
            empty_panel(figure.subplots(), "no frame was sent")
            return figure
        panels = figure.subplots(2, 2)
        for axes, plane in zip(panels[0], (shown.level, shown.upright), strict=True):
            map_panel(axes, plane, shown, model, close=False)
        for axes, plane in zip(panels[1], (shown.close_level, shown.close_upright), strict=True):
            image = map_panel(axes, plane, shown, model, close=True)
        figure.colorbar(image, ax=panels, label="sound pressure, RMS (kPa)", shrink=0.6, aspect=30)
        handles, labels = axes.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=3)
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
        object_panel(figure, figure.add_subplot(grid[:, 1]), run)
    return figure


def draw_run_lateness(run: RunVerdict, model: AcousticModel) -> Figure:
    """Draw how long after its time each frame was latched."""
    with new_figure(_WIDTH_IN, 3.2) as figure:
        lateness_panel(figure.subplots(), run, max(1.0, 1e6 / model.frequency_hz))
    return figure
