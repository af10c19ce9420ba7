"""The panels of the pictures of a run; each function draws on axes that the caller made."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from haptogram.acoustics import AcousticModel
from haptogram.acoustics.arrays import FloatArray
from haptogram.verification import FrameStatus, FrameVerdict, RunVerdict

from ..figures.plane_picture import PictureField, draw_plane_image
from ..figures.style import BLACK, BLUE, ERROR_MAP, GREY, VERMILION, draw_figure_mark
from ..figures.surroundings import draw_array_in_figure
from .fieldmap import RunFieldPicture, field_rms_kpa
from .series import (
    ErrorSeries,
    plotted_focus_mm,
    plotted_frames_of_run,
    plotted_relative_error,
    plotted_targets_mm,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

MOST_POINTS: Final = 5000  # in one panel; wrong frames always stay
LEAST_ERROR_MM: Final = 1e-5  # a smaller one is drawn as this
LEAST_RATIO: Final = 1e-3  # likewise
_AXES: Final = "xyz"


def empty_panel(axes: Any, text: str) -> None:
    """Write into an empty panel why it is empty."""
    axes.set_axis_off()
    place = axes.text2D if hasattr(axes, "text2D") else axes.text
    place(0.5, 0.5, text, transform=axes.transAxes, ha="center", va="center", color="#555555")


# --- Foci --------------------------------------------------------------------------------------


def foci_panel(figure: Figure, axes: Any, run: RunVerdict, model: AcousticModel) -> None:
    """Draw intended and measured foci over the array; *axes* has three dimensions."""
    frames = plotted_frames_of_run(run.frames, MOST_POINTS)
    elements, targets = 1e3 * model.array.positions_m, plotted_targets_mm(frames)
    axes.scatter(*elements.T, s=5, c=GREY, marker="s", linewidths=0, label="transducers")
    size = float(np.clip(4000.0 / max(len(frames), 1), 3.0, 16.0))
    if len(targets):
        style = {"facecolors": "none", "edgecolors": GREY, "linewidths": 0.5}
        axes.scatter(*targets.T, s=3.0 * size, label="intended focus", **style)
    bar = {"shrink": 0.5, "aspect": 25, "pad": 0.13}
    places = _measured_foci_panel(figure, axes, frames, size, bar)
    mark_troubled_run_frames(axes, frames)
    _equal_panel_scales(axes, np.concatenate([elements, targets, places]))
    figure.legend(loc="outside lower center", ncols=4)
    axes.view_init(elev=17.0, azim=-58.0)


def error_map_panel(figure: Figure, axes: Axes, run: RunVerdict) -> None:
    """Draw the error over its bound at every focus, seen from above."""
    frames = plotted_frames_of_run(run.frames, MOST_POINTS)
    if not frames:
        empty_panel(axes, "no frame was sent")
        return
    _measured_foci_panel(figure, axes, frames, _size_from_above(frames), {})
    mark_troubled_run_frames(axes, frames, axes_count=2)
    _show_from_above(axes)


def _measured_foci_panel(
    figure: Figure, axes: Any, frames: list[FrameVerdict], size: float, bar: dict[str, Any]
) -> FloatArray:
    """Draw the measured foci, coloured by error over bound; return their places, (M, 3)."""
    from matplotlib.colors import LogNorm

    found = [(plotted_focus_mm(f), plotted_relative_error(f)) for f in frames]
    seen = [(place, error) for place, error in found if error is not None]
    if not seen:
        return np.empty((0, 3))
    places, errors = np.array([p for p, _ in seen]), np.array([error for _, error in seen])
    is_solid = hasattr(axes, "get_zlim")
    dots = axes.scatter(
        *(places if is_solid else places[:, :2]).T,
        s=size,
        c=np.maximum(errors, LEAST_RATIO),
        norm=LogNorm(vmin=LEAST_RATIO, vmax=1.0),
        cmap=ERROR_MAP,
        linewidths=0,
        **({"depthshade": False, "label": "measured focus"} if is_solid else {}),
    )
    label = "error / bound of quantisation"
    extend = "max" if errors.max() > 1.0 else "neither"
    figure.colorbar(dots, ax=axes, label=label, format="%g", extend=extend, **bar)
    return places


def _size_from_above(frames: list[FrameVerdict]) -> float:
    return float(np.clip(8000.0 / len(frames), 4.0, 60.0))


def _show_from_above(axes: Axes) -> None:
    axes.set(xlabel="x (mm)", ylabel="y (mm)")
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.08)


def mark_troubled_run_frames(axes: Any, frames: list[FrameVerdict], axes_count: int = 3) -> None:
    """Mark the frames that are wrong or lost, each kind with a sign of its own."""
    signs = {
        FrameStatus.OFF_TARGET: "x",
        FrameStatus.WRONG_DRIVE: "*",
        FrameStatus.CORRUPT: "D",
        FrameStatus.LOST: "v",
        FrameStatus.HELD_UP: "^",
    }
    for status, marker in signs.items():
        points = plotted_targets_mm([frame for frame in frames if frame.status is status])
        if len(points):
            style = {"depthshade": False} if axes_count == 3 else {}
            places = points.T[:axes_count]
            axes.scatter(*places, s=36, c=VERMILION, marker=marker, label=str(status), **style)


def _equal_panel_scales(axes: Any, points: FloatArray) -> None:
    """Draw a millimetre equally long on every axis; no axis is so short that labels collide."""
    low, high = points.min(axis=0), points.max(axis=0)
    longest = float((high - low).max())
    is_tall = float(high[2] - low[2]) > 1.5 * float((high - low)[:2].max())
    # A slender box leaves no room for the names of its axes.
    span = np.maximum(high - low, (0.5 if is_tall else 0.25) * longest + 1.0) * 1.06
    middle = (low + high) / 2.0
    for name, centre, width in zip(_AXES, middle, span, strict=True):
        getattr(axes, f"set_{name}lim")(centre - width / 2.0, centre + width / 2.0)
        count = max(2, round(6.0 * float(width / span.max())))
        getattr(axes, f"{name}axis").get_major_locator().set_params(nbins=count)
    for name, width in zip(_AXES, span, strict=True):
        # Along the longer sides of a flat box matplotlib moves the name onto the numbers.
        pad = 8.0 + 5.0 * (float(width / span.min()) - 1.0)
        getattr(axes, f"set_{name}label")(f"{name} (mm)", labelpad=pad)
    axes.set_box_aspect(span, zoom=0.84 if is_tall else 1.08)


# --- Errors ------------------------------------------------------------------------------------


def error_panel(axes: Axes, series: ErrorSeries) -> None:
    """Draw a histogram of the errors, on a logarithmic scale that also holds their bounds."""
    axes.set_title(f"{series.name} error")
    if not len(series.errors_mm):
        empty_panel(axes, f"no {series.name} error\nwas measured")
        return
    errors = np.maximum(series.errors_mm, LEAST_ERROR_MM)
    least, most = series.bounds_mm.min(), series.bounds_mm.max()
    low = 10.0 ** np.floor(np.log10(errors.min()))
    high = 2.0 * max(float(errors.max()), float(most))
    edges = np.geomspace(low, high, 41)
    within = series.errors_mm <= series.bounds_mm * (1.0 + 1e-9)
    axes.hist(
        [errors[within], errors[~within]],
        bins=edges.tolist(),
        stacked=True,
        color=[BLUE, VERMILION],
        label=["within its bound", "beyond its bound" if (~within).any() else "_"],
    )
    axes.axvline(float(least), color="black", lw=1.0, ls="--", label="smallest bound of all frames")
    axes.axvspan(
        float(least), float(most), color="#dddddd", lw=0, zorder=0, label="bounds of quantisation"
    )
    axes.set(xscale="log", xlim=(low, high), xlabel=f"{series.name} error (mm)")
    axes.margins(y=0.35)  # room for the legend
    axes.legend(loc="upper left")


# --- Field -------------------------------------------------------------------------------------


def map_panel(
    axes: Axes, field: PictureField, shown: RunFieldPicture, model: AcousticModel, *, close: bool
) -> AxesImage:
    """Draw |p| in one plane, return the image.

    Close up with target, measured focus and peak; else with the frame of the close-up.
    """
    plane, values = field.plane, field_rms_kpa(field)
    image = draw_plane_image(
        axes, plane, values, vmin=0.0, vmax=shown.most_kpa, interpolation="bilinear"
    )
    if close:
        target, measured = shown.marks_mm
        marks = {"target": target, "fitted focus": measured, "peak": 1e3 * np.array(field.peak_m())}
        for kind, place in marks.items():
            if kind != "fitted focus" or shown.frame.measured_m is not None:
                draw_figure_mark(axes, place[plane.axes[0]], place[plane.axes[1]], kind)
        return image
    draw_array_in_figure(axes, model.array, *plane.axes)
    _mark_panel_window(axes, shown.close_upright if plane.axes[1] == 2 else shown.close_level)
    normal = plane.normal_axis
    axes.set_title(f"{_AXES[normal]} = {shown.marks_mm[0][normal]:.1f} mm")
    across_m, _ = plane.coordinates_m()
    axes.set_xlim(1e3 * across_m[0], 1e3 * across_m[-1])
    return image


def _mark_panel_window(axes: Axes, window: PictureField) -> None:
    from matplotlib.patches import Rectangle

    (left, right), (bottom, top) = window.plane.horizontal_m, window.plane.vertical_m
    corner, sides = (1e3 * left, 1e3 * bottom), (1e3 * (right - left), 1e3 * (top - bottom))
    axes.add_patch(Rectangle(corner, *sides, fill=False, ec="#fefefe", lw=0.8))


# --- Along the object --------------------------------------------------------------------------


def along_panel(axes: Axes, run: RunVerdict, measure: str, factor: float, label: str) -> None:
    """Draw one measure of every frame in the order of display."""
    pairs = [(f.number, getattr(f, measure)) for f in run.frames]
    table = np.array([pair for pair in pairs if pair[1] is not None], dtype=np.float64)
    if not len(table):
        empty_panel(axes, f"{label.partition(' (')[0]}: not measured")
        return
    numbers, values = table[:, 0], factor * table[:, 1]
    axes.plot(numbers, values, ".", color=BLUE, markersize=2.5 if len(table) > 100 else 5.0)
    axes.set_ylabel(label)
    axes.margins(x=0.02)
    if (limits := _run_panel_limits(values)) is not None:
        axes.set_ylim(*limits)
    mark_missing_run_frames(axes, run, lambda frame: frame.number)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="best")


def _run_panel_limits(values: FloatArray) -> tuple[float, float] | None:
    """Return limits for values that hardly differ, whose noise would fill an axis; None: others."""
    if np.ptp(values) >= 0.02 * abs(float(values.mean())):
        return None
    return 0.9 * float(values.min()), 1.1 * float(values.max())


def mark_missing_run_frames(
    axes: Axes, run: RunVerdict, place: Callable[[FrameVerdict], float]
) -> None:
    """Mark the frames that were lost, held up or late at the foot of the panel."""
    for kind, colour in (("lost", VERMILION), ("held up", GREY), ("late", BLACK)):
        chosen = [
            place(frame)
            for frame in run.frames
            if (frame.late if kind == "late" else frame.status == kind)
        ]
        if chosen:
            foot, transform = np.full(len(chosen), 0.03), axes.get_xaxis_transform()
            style: dict[str, Any] = {"color": colour, "markersize": 8.0, "label": kind}
            axes.plot(chosen, foot, "|", transform=transform, **style)


def pressure_map_panel(figure: Figure, axes: Axes, run: RunVerdict) -> None:
    """Draw the pressure at the focus, seen from above."""
    shown = plotted_frames_of_run(run.frames, MOST_POINTS)
    frames = [frame for frame in shown if frame.pressure_rms_pa is not None]
    if not frames:
        empty_panel(axes, "no pressure was measured")
        return
    points = plotted_targets_mm(frames)
    values = np.array([f.pressure_rms_pa for f in frames], dtype=np.float64) / 1e3
    size = _size_from_above(frames)
    dots = axes.scatter(points[:, 0], points[:, 1], s=size, c=values, linewidths=0)
    _show_from_above(axes)
    if (limits := _run_panel_limits(values)) is not None:
        dots.set_clim(*limits)
    bar = figure.colorbar(dots, ax=axes, label="pressure (kPa RMS)", shrink=0.8)
    bar.ax.ticklabel_format(useOffset=False)


# --- Time --------------------------------------------------------------------------------------


def lateness_panel(axes: Axes, run: RunVerdict, period_us: float) -> None:
    """Draw a histogram of t_latch - t_apply, with logarithmic counts."""
    values = run.values("lateness_us")
    if not len(values):
        empty_panel(axes, "no frame had a time to be latched at")
        return
    low, high = float(min(values.min(), 0.0)), float(max(values.max(), period_us))
    step = max(1.0, np.ceil((high - low) / 80.0))
    edges = np.arange(low, high + 2.0 * step, step) - 0.5  # between whole microseconds
    axes.hist(values, bins=edges.tolist(), color=BLUE)
    axes.axvline(period_us, color="black", lw=1.0, ls="--", label="one carrier period")
    axes.set(yscale="log", xlabel="latched after its time (µs)", ylabel="frames", ylim=(0.7, None))
    axes.legend(loc="upper center")
