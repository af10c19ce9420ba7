"""Cuts: the field along the three axes through a target."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import ArrayLike

from haptogram.acoustics import FieldEngine
from haptogram.errors import ConfigurationError
from haptogram.pictures.style import BLACK, BLUE, GREEN, VERMILION, new_figure, styled, two_lines

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_NAMES: Final = "xyz"
_LINES: Final = ((BLUE, "-"), (VERMILION, "--"), (GREEN, "-"))
_SAMPLES: Final = 801


def draw_cuts(
    engine: FieldEngine,
    weights: ArrayLike,
    target_m: ArrayLike,
    half_width_m: float = 0.050,
    title: str = "",
) -> Figure:
    """Return the RMS pressure along x and y through a target, and along z, in two panels.

    Parameters
    ----------
    half_width_m : float
        How far the cuts reach to both sides; along z they stay 20 mm off the array's centre.

    Raises
    ------
    ConfigurationError
        A half-width that is not within 1 mm to 1 m, or no matplotlib.
    """
    if not 1e-3 <= half_width_m <= 1.0:
        raise ConfigurationError(f"half_width_m is {half_width_m:g}, must be 0.001 to 1")
    target = np.asarray(target_m, dtype=np.float64)
    figure = new_figure(7.2, 3.3)
    with styled():
        lateral, axial = figure.subplots(1, 2, sharey=True)
        for axis, axes in ((0, lateral), (1, lateral), (2, axial)):
            low = -half_width_m
            if axis == 2:
                low = max(low, engine.model.array.centre_m[2] + 0.020 - target[2])
            offsets = np.linspace(low, half_width_m, _SAMPLES)
            points = target + offsets[:, None] * np.eye(3)[axis]
            level = np.abs(engine.pressure(weights, points)) / math.sqrt(2.0) * 1e-3
            colour, style = _LINES[axis]
            axes.plot(
                (target[axis] + offsets) * 1e3 if axis == 2 else offsets * 1e3,
                level,
                style,
                color=colour,
                linewidth=1.5,
                label=f"along {_NAMES[axis]}",
            )
            if axis == 2:
                top = int(np.argmax(level))
                place = (target[2] + offsets[top]) * 1e3
                axes.plot(place, level[top], "o", fillstyle="none", color=BLACK, label="peak")
        lateral.set_xlabel("distance from the target (mm)")
        axial.set_xlabel("z (mm)")
        lateral.set_ylabel("sound pressure, RMS (kPa)")
        lateral.axvline(0.0, color=BLACK, linewidth=0.8, linestyle=":", label="target")
        axial.axvline(target[2] * 1e3, color=BLACK, linewidth=0.8, linestyle=":", label="target")
        for axes in (lateral, axial):
            axes.set_ylim(bottom=0.0)
            axes.grid(visible=True, linewidth=0.4, alpha=0.6)
            axes.legend(loc="upper right")
        place_text = ", ".join(f"{value * 1e3:g}" for value in target)
        figure.suptitle(two_lines(title, f"cuts through ({place_text}) mm"), fontsize=10)
    return figure
