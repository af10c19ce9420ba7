"""The picture of a plane of the field."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import ArrayLike

from haptogram.acoustics import FieldEngine
from haptogram.report.figures.planes import PictureField, PicturePlane
from haptogram.report.figures.quantities import LEAST_DB, figure_quantity_and_label
from haptogram.report.figures.style import (
    MAGNITUDE_MAP,
    PHASE_MAP,
    draw_figure_mark,
    figure_legend,
    figure_title,
    new_figure,
)
from haptogram.report.figures.surroundings import draw_array_in_figure, draw_ear

if TYPE_CHECKING:
    from matplotlib.figure import Figure


# A picture of a plane, without its bar and its labels; the legend needs the least width.
_WIDEST_IN: Final = 5.0
_TALLEST_IN: Final = 6.0
_NARROWEST_IN: Final = 3.2
_NEAR_M: Final = 2.5e-3
_FEW_TARGETS: Final = 4
_MANY_TARGETS: Final = 200


def draw_plane_figure(
    engine: FieldEngine,
    field: PictureField,
    *,
    quantity: str = "pressure",
    targets_m: ArrayLike = (),
    title: str = "",
    peak_m: ArrayLike | None = None,
    decibels: bool = False,
    ear_m: ArrayLike | None = None,
) -> Figure:
    """Return the picture of a plane.

    Parameters
    ----------
    quantity : str
        "pressure" (RMS), "phase", or "force" (radiation pressure on a reflecting wall).
    targets_m : (T, 3) array_like
        Targets to mark: those within 2.5 mm of the plane, none if they are more than 200.
    title : str
        Title of the picture; the place of the plane is added to it.
    peak_m : (3,) array_like, optional
        Place to mark as the peak; by default that of the largest value of the plane.
    decibels : bool
        Draw levels relative to the largest value, down to -40 dB.
    ear_m : (3,) array_like, optional
        Place of an ear to mark.

    Raises
    ------
    ConfigurationError
        An unknown quantity, the phase of a time average, or no matplotlib.
    """
    values, label = figure_quantity_and_label(engine, field.values, quantity, decibels=decibels)
    colours: str = PHASE_MAP if quantity == "phase" else MAGNITUDE_MAP
    limits = (LEAST_DB, 0.0) if decibels else (0.0, None)
    if quantity == "phase":
        limits = (-math.pi, math.pi)
    with new_figure(*_plane_picture_size(field.plane)) as figure:
        figure.set_layout_engine("compressed")  # no gaps beside a picture of fixed aspect
        axes = figure.add_subplot()
        axes.grid(visible=False)
        across, up = field.plane.coordinates_m()
        half = 0.5e3 * field.plane.step_m
        image = axes.imshow(
            values,
            origin="lower",
            extent=(
                across[0] * 1e3 - half,
                across[-1] * 1e3 + half,
                up[0] * 1e3 - half,
                up[-1] * 1e3 + half,
            ),
            cmap=colours,
            vmin=limits[0],
            vmax=limits[1],
            interpolation="bicubic",
            interpolation_stage="rgba",  # between the colours: a phase turns over without a seam
            aspect="equal",
        )
        bar = figure.colorbar(image, ax=axes, label=label, shrink=0.92)
        if quantity == "phase":
            bar.set_ticks([-math.pi, -math.pi / 2, 0, math.pi / 2, math.pi])
            bar.set_ticklabels(["−π", "−π/2", "0", "π/2", "π"])
        first, second = field.plane.axes
        axes.set_xlabel(f"{'xyz'[first]} (mm)")
        axes.set_ylabel(f"{'xyz'[second]} (mm)")
        marked = _marked_plane_picture(field.plane, targets_m)
        size = 6.0 if len(marked) > _FEW_TARGETS else None
        for target in marked:
            draw_figure_mark(axes, target[first] * 1e3, target[second] * 1e3, "target", size)
        place = np.asarray(field.peak_m() if peak_m is None else peak_m, dtype=np.float64)
        draw_figure_mark(axes, place[first] * 1e3, place[second] * 1e3, "peak")
        draw_array_in_figure(axes, engine.model.array, first, second)
        if ear_m is not None:
            draw_ear(axes, 1e3 * np.asarray(ear_m, dtype=np.float64), first, second)
        figure_legend(figure, columns=2)
        axes.set_title(_plane_picture_title(title, field.plane))
    return figure


def _plane_picture_size(plane: PicturePlane) -> tuple[float, float]:
    """Return the size of a figure, in inches, that fits the shape of the plane."""
    (left, right), (low, high) = plane.horizontal_m, plane.vertical_m
    ratio = (high - low) / (right - left)
    width = min(_WIDEST_IN, _TALLEST_IN / ratio)
    height = max(width * ratio, 1.2)
    return max(width + 1.6, _NARROWEST_IN), height + 1.25


def _marked_plane_picture(plane: PicturePlane, targets_m: ArrayLike) -> list[list[float]]:
    targets = np.asarray(targets_m, dtype=np.float64).reshape(-1, 3)
    distance = np.abs(targets[:, plane.normal_axis] - plane.through_m[plane.normal_axis])
    shown: list[list[float]] = targets[distance <= _NEAR_M].tolist()
    return shown if len(shown) <= _MANY_TARGETS else []


def _plane_picture_title(title: str, plane: PicturePlane) -> str:
    axis = plane.normal_axis
    return figure_title(title, f"plane {'xyz'[axis]} = {plane.through_m[axis] * 1e3:.4g} mm")
