"""The picture of a modulation: the radiation pressure at a point in time, and its spectrum."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from haptogram.pictures.style import BLUE, VERMILION, new_figure, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FloatArray: TypeAlias = NDArray[np.float64]


def draw_spectrum(
    time_s: FloatArray,
    pressure_pa: FloatArray,
    frequency_hz: FloatArray,
    amplitude_pa: FloatArray,
    *,
    title: str = "",
    highest_hz: float = 1000.0,
) -> Figure:
    """Return a picture of a signal and its one-sided amplitude spectrum.

    Parameters
    ----------
    time_s, pressure_pa : (T,) numpy.ndarray
        Radiation pressure at a point.
    frequency_hz, amplitude_pa : (K,) numpy.ndarray
        Its spectrum; the value at 0 Hz is the mean.
    highest_hz : float
        Where the spectrum is cut; skin feels up to about 1 kHz.
    """
    figure = new_figure(7.2, 3.2)
    with styled():
        left, right = figure.subplots(1, 2)
        left.plot(time_s * 1e3, pressure_pa, color=BLUE, linewidth=1.3)
        left.set_xlabel("time (ms)")
        left.set_ylabel("radiation pressure (Pa)")
        left.set_ylim(bottom=0.0)
        # What is nothing beside the largest line would hide the others under a row of dots.
        shown = (frequency_hz <= highest_hz) & (amplitude_pa > 1e-3 * amplitude_pa.max())
        lines, levels = frequency_hz[shown], amplitude_pa[shown]
        right.vlines(lines, 0.0, levels, color=VERMILION, linewidth=2.0)
        right.plot(lines, levels, "o", color=VERMILION, markersize=3.5)
        right.set_xlabel("frequency (Hz)")
        right.set_ylabel("amplitude (Pa)")
        right.set_ylim(bottom=0.0)
        for axes in (left, right):
            axes.grid(visible=True, linewidth=0.4, alpha=0.6)
        figure.suptitle(title, fontsize=10)
    return figure
