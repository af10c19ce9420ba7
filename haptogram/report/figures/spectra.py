"""The picture of a modulation: the radiation pressure at a point in time, and its spectrum."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from haptogram.acoustics.arrays import FloatArray
from haptogram.errors import ConfigurationError
from haptogram.report.figures.style import BLACK, BLUE, GREEN, VERMILION, figure_legend, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MOST_DOTS: Final = 50


def draw_spectrum(
    time_s: FloatArray,
    pressure_pa: FloatArray,
    frequency_hz: FloatArray,
    amplitude_pa: FloatArray,
    *,
    title: str = "",
    highest_hz: float = 1000.0,
    modulation_hz: float | None = None,
    rate_hz: float | None = None,
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
    modulation_hz, rate_hz : float, optional
        Frequencies to mark: that of the modulation, and half the frame rate, above which every
        line comes from the steps between frames.

    Raises
    ------
    ConfigurationError
        A *highest_hz* that is not above 0, or no matplotlib.
    """
    if not highest_hz > 0.0:
        raise ConfigurationError(f"highest_hz is {highest_hz:g}, must be above 0")
    with new_figure(7.6, 3.4) as figure:
        left, right = figure.subplots(1, 2)
        left.plot(time_s * 1e3, pressure_pa, color=BLUE, linewidth=1.3)
        left.axhline(amplitude_pa[0], color=BLACK, linewidth=0.8, linestyle="--", label="mean")
        left.set(xlabel="time (ms)", ylabel="radiation pressure, total reflection (Pa)")
        left.set_xlim(0.0, float(time_s[-1]) * 1e3)
        # Lines that are negligible beside the largest would hide the others under a row of dots.
        shown = (frequency_hz <= highest_hz) & (amplitude_pa > 1e-2 * amplitude_pa.max())
        lines, levels = frequency_hz[shown], amplitude_pa[shown]
        is_dense = len(lines) > _MOST_DOTS
        right.vlines(lines, 0.0, levels, color=VERMILION, linewidth=1.0 if is_dense else 2.0)
        if not is_dense:  # dots would run into each other
            right.plot(lines, levels, "o", color=VERMILION, markersize=3.5)
        right.set(xlabel="frequency (Hz); the line at 0 Hz is the mean", ylabel="amplitude (Pa)")
        right.set_xlim(-0.02 * highest_hz, 1.02 * highest_hz)
        half_hz = None if rate_hz is None else rate_hz / 2.0
        _mark_spectrum(right, modulation_hz, BLUE, "--", "modulation")
        _mark_spectrum(right, half_hz, GREEN, ":", "half the frame rate")
        for axes in (left, right):
            axes.set_ylim(0.0, 1.05 * axes.get_ylim()[1])
        figure_legend(figure, columns=5)
        figure.suptitle(title)
    return figure


def _mark_spectrum(axes: Axes, at_hz: float | None, colour: str, style: str, label: str) -> None:
    if at_hz is not None and at_hz <= axes.get_xlim()[1]:
        axes.axvline(at_hz, color=colour, linewidth=1.0, linestyle=style, zorder=1.0, label=label)
