"""Cuts: the field along the array's own three axes through a target."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import ArrayLike

from haptogram.acoustics import FieldEngine
from haptogram.acoustics.arrays import FloatArray
from haptogram.errors import ConfigurationError
from haptogram.report.figures.planes import picture_field_pressure
from haptogram.report.figures.quantities import LEAST_DB, figure_quantity_and_label
from haptogram.report.figures.style import (
    BLACK,
    BLUE,
    GREEN,
    VERMILION,
    figure_title,
    new_figure,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_NAMES: Final = "xyz"
_LINES: Final = (BLUE, "-"), (VERMILION, "--"), (GREEN, "-")
_SAMPLES: Final = 801


def draw_cuts(
    engine: FieldEngine,
    weights: ArrayLike,
    target_m: ArrayLike,
    half_width_m: float = 0.050,
    title: str = "",
    quantity: str = "pressure",
    place: str = "target",
    decibels: bool = False,
) -> Figure:
    """Return a quantity along x and y through a target, and along z, in two panels.

    The axes are the array's own; gaps are behind it and within 1 mm of an element.

    Parameters
    ----------
    half_width_m : float
        How far the cuts reach to both sides; along z they stay 20 mm off the array's centre.
    quantity : str
        The same as of :func:`draw_plane_figure`.
    place : str
        Name of *target_m* in the picture.
    decibels : bool
        The same as of :func:`draw_plane_figure`.

    Raises
    ------
    ConfigurationError
        A half-width that is not within 1 mm to 1 m, an unknown quantity, or no matplotlib.
    """
    if not 1e-3 <= half_width_m <= 1.0:
        raise ConfigurationError(f"half_width_m is {half_width_m:g}, must be 0.001 to 1")
    target = np.asarray(target_m, dtype=np.float64)
    offsets = [_cut_offsets(engine, target, half_width_m, axis) for axis in range(3)]
    array = engine.model.array
    own, whose = array.axes @ target, "" if array.is_upright else "the array's "
    lines = [target + offsets[axis][:, None] * array.axes[axis] for axis in range(3)]
    pressure = picture_field_pressure(engine, weights, np.concatenate(lines))
    shown, label = figure_quantity_and_label(
        engine.model.medium, pressure, quantity, decibels=decibels
    )
    levels = np.split(shown, 3)
    with new_figure(7.2, 3.3) as figure:
        lateral, axial = figure.subplots(1, 2, sharey=True)
        starts_m = (0.0, 0.0, float(own[2]))
        for axis, axes in enumerate((lateral, lateral, axial)):
            places_mm = 1e3 * (starts_m[axis] + offsets[axis])
            colour, line = _LINES[axis]
            name = f"along {whose}{_NAMES[axis]}"
            axes.plot(
                places_mm, levels[axis], color=colour, linestyle=line, linewidth=1.5, label=name
            )
        if quantity != "phase":
            top = int(np.nanargmax(levels[2]))
            top_mm = (own[2] + offsets[2][top]) * 1e3
            axial.plot(top_mm, levels[2][top], "o", fillstyle="none", color=BLACK, label="peak")
            lateral.set_ylim(bottom=LEAST_DB if decibels else 0.0)
        lateral.set(xlabel=f"distance from the {place} (mm)", ylabel=label)
        axial.set_xlabel(f"{whose}z (mm)")
        for axes, start_m in ((lateral, 0.0), (axial, own[2])):
            axes.axvline(start_m * 1e3, color=BLACK, linewidth=0.8, linestyle=":", label=place)
            axes.legend(loc="upper right")
        place_text = ", ".join(f"{value * 1e3:g}" for value in target)
        figure.suptitle(figure_title(title, f"cuts through ({place_text}) mm"))
    return figure


def _cut_offsets(
    engine: FieldEngine, target: FloatArray, half_width_m: float, axis: int
) -> FloatArray:
    """Return the offsets of the samples along an own axis from the target, in metres."""
    low = -half_width_m
    if axis == 2:
        low = max(low, 0.020 - float(engine.model.array.local_m(target)[2]))
    return np.linspace(low, half_width_m, _SAMPLES)
