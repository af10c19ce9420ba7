"""Pictures of a run, as PNG; each function returns the bytes of one file.

Raises ImportError where matplotlib is missing (``pip install 'haptogram[report]'``).
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Final

from haptogram.acoustics import AcousticModel, Drive
from haptogram.machine.files import write_atomically
from haptogram.verification import RunVerdict

from .canvas import draw
from .fieldmap import FieldPicture, picture_field
from .panels import (
    along_panel,
    error_panel,
    foci_panel,
    lateness_panel,
    map_panel,
    nothing,
    object_panel,
)
from .series import error_series

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from .panels import Paper

_WIDTH: Final = 1200  # pixels


def foci(run: RunVerdict, model: AcousticModel) -> bytes:
    """Draw intended and measured foci over the array, coloured by error over its bound."""
    return draw(_WIDTH, 900, lambda figure: _paint_foci(figure, run, model))


def errors(run: RunVerdict, model: AcousticModel) -> bytes:
    """Draw how the lateral and axial errors are distributed, against what quantisation can do."""

    def paint(figure: Figure) -> None:
        panels = figure.subplots(1, 2, sharey=True)
        for axes, series in zip(panels, error_series(run, model), strict=True):
            error_panel(axes, series)
        panels[0].set_ylabel("frames")

    return draw(_WIDTH, 560, paint)


def field(shown: FieldPicture | None, model: AcousticModel) -> bytes:
    """Draw |p| in the plane of one focus and in the vertical plane through it."""

    def paint(figure: Figure) -> None:
        _paint_maps(figure, shown, model)

    return draw(_WIDTH, 1120, paint)


def along_object(run: RunVerdict) -> bytes:
    """Draw force and pressure in the order of display, and the pressure as a map from above."""

    def paint(figure: Figure) -> None:
        grid = figure.add_gridspec(2, 2, width_ratios=(1.25, 1.0))
        upper = figure.add_subplot(grid[0, 0])
        lower = figure.add_subplot(grid[1, 0], sharex=upper)
        along_panel(upper, run, "pressure_rms_pa", 1e-3, "pressure (kPa RMS)")
        along_panel(lower, run, "force_n", 1e3, "force (mN)")
        upper.tick_params(labelbottom=False)
        lower.set_xlabel("frame, in the order of display")
        object_panel(figure, figure.add_subplot(grid[:, 1]), run)

    return draw(_WIDTH, 620, paint)


def lateness(run: RunVerdict, model: AcousticModel) -> bytes:
    """Draw how long after its time each frame was latched."""
    period_us = 1e6 / model.frequency_hz
    return draw(
        _WIDTH, 480, lambda figure: lateness_panel(figure.subplots(), run, max(1.0, period_us))
    )


def hero(
    run: RunVerdict,
    model: AcousticModel,
    drives: Mapping[int, Drive] | None = None,
    *,
    phase_bits: int = 8,
) -> bytes:
    """Draw the foci and the field of one of them in one wide picture (1600 x 800 pixels).

    Parameters
    ----------
    drives : mapping of int to Drive, optional
        Drives that were latched, by frame number; without them the field is that of the ideal
        drive of the target, with phases of *phase_bits*.

    Raises
    ------
    ImportError
        If matplotlib is not installed.
    """
    shown = picture_field(run, model, drives, phase_bits)

    def paint(figure: Figure) -> None:
        halves = figure.subfigures(1, 2, width_ratios=(1.1, 1.0), squeeze=False)[0]
        _paint_foci(halves[0], run, model)
        _paint_maps(halves[1], shown, model)

    return draw(1600, 800, paint)


def _paint_foci(figure: Paper, run: RunVerdict, model: AcousticModel) -> None:
    foci_panel(figure, figure.add_subplot(projection="3d"), run, model)


def _paint_maps(figure: Paper, shown: FieldPicture | None, model: AcousticModel) -> None:
    """Draw both planes side by side, and below them close-ups with the marks."""
    if shown is None:
        nothing(figure.subplots(), "no frame was sent")
        return
    panels = figure.subplots(2, 2)
    for axes, plane in zip(panels[0], (shown.level, shown.upright), strict=True):
        map_panel(axes, plane, shown, model, close=False)
    for axes, plane in zip(panels[1], (shown.close_level, shown.close_upright), strict=True):
        image = map_panel(axes, plane, shown, model, close=True)
    figure.colorbar(image, ax=panels, label="|p| (kPa RMS)", shrink=0.6, aspect=30)
    legend = figure.legend(
        *axes.get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=True
    )
    legend.get_frame().set(facecolor="#3b528b", edgecolor="none", alpha=1.0)
    for text in legend.get_texts():
        text.set_color("white")


def write_picture(path: Path, png: bytes) -> None:
    """Write a picture, as a whole or not at all.

    Raises
    ------
    ConfigurationError
        If *path* cannot be written.
    """
    write_atomically(path, png)
