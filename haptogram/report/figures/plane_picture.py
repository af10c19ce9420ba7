"""The field on a plane, and its picture."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from haptogram.acoustics import AcousticModel, Drive, FieldEngine, choose_engine
from haptogram.acoustics.arrays import FloatArray
from haptogram.acoustics.levels.average import mean_square_pressure
from haptogram.acoustics.levels.dynamics import Resonator
from haptogram.report.figures import style
from haptogram.report.figures.planes import PicturePlane, sample_picture_points
from haptogram.report.figures.quantities import LEAST_DB, figure_quantity_and_label
from haptogram.settings.arguments import Progress

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage


# A picture of a plane, without its bar and its labels; the legend needs the least width.
_WIDEST_IN: Final = 5.0
_TALLEST_IN: Final = 6.0
_NARROWEST_IN: Final = 3.2
_NEAR_M: Final = 2.5e-3
_FEW_TARGETS: Final = 4
_MANY_TARGETS: Final = 200
_WIDER: Final = 0.5  # largest distance of a drawn array, in heights of the picture
_EDGE_MM: Final = 4.0


@dataclass(frozen=True, eq=False, slots=True)
class PictureField:
    """Values on a plane.

    Attributes
    ----------
    plane : PicturePlane
        The plane.
    values : (V, H) numpy.ndarray
        Complex peak pressure of one drive, or real RMS pressure of a sequence, in pascals; NaN
        within 2 mm of an element, and behind all of them if they are baffled.
    model : AcousticModel
        Array and air.

    Examples
    --------
    >>> from haptogram.acoustics import AcousticModel
    >>> model = AcousticModel.default(nx=8, ny=8)
    >>> field = field_on_plane(model, [1j] * 64, (0.0, 0.0, 0.08), step_m=0.005)
    >>> across_m, up_m = field.plane.coordinates_m()
    >>> field.values.shape == (len(up_m), len(across_m))
    True
    """

    plane: PicturePlane
    values: NDArray[Any] = field(repr=False)
    model: AcousticModel = field(repr=False)

    def peak_m(self) -> tuple[float, float, float]:
        """Return the position of the largest magnitude."""
        index = int(np.nanargmax(np.abs(self.values)))
        x, y, z = self.plane.points_m()[index].tolist()
        return x, y, z

    def save(
        self,
        path: str | Path,
        *,
        quantity: str = "pressure",
        decibels: bool = False,
        targets_m: ArrayLike = (),
        title: str = "",
    ) -> None:
        """Write the picture of :func:`draw_plane_figure` as .png, .svg or .pdf.

        Raises
        ------
        ConfigurationError
            Another suffix, a path that cannot be written, an unknown quantity, or no matplotlib.
        """
        file = Path(path)
        style.check_picture_format(file)
        figure = draw_plane_figure(
            self, quantity=quantity, decibels=decibels, targets_m=targets_m, title=title
        )
        style.write_figure(file, figure)


def sample_picture_plane(
    engine: FieldEngine, weights: ArrayLike, plane: PicturePlane, progress: Progress | None = None
) -> PictureField:
    """Return the complex pressure of one drive on a plane; *progress* gets (done, total)."""
    values = sample_picture_points(
        engine.model, plane, lambda points: engine.pressure(weights, points), progress
    )
    return PictureField(plane, values, engine.model)


def sample_picture_mean(
    engine: FieldEngine,
    weights: ArrayLike,
    plane: PicturePlane,
    frame_s: float,
    resonator: Resonator | None = None,
    progress: Progress | None = None,
) -> PictureField:
    """Return the RMS pressure of a repeated sequence of drives (F, N) on a plane."""

    def rms(points: FloatArray) -> FloatArray:
        square = mean_square_pressure(engine, weights, points, frame_s, resonator)
        return np.sqrt(square)

    values = sample_picture_points(engine.model, plane, rms, progress)
    return PictureField(plane, values, engine.model)


def field_on_plane(
    model: AcousticModel,
    drive: Drive | ArrayLike,
    place_m: ArrayLike,
    *,
    plane: str = "xz",
    half_width_m: float = 0.06,
    step_m: float = 0.75e-3,
) -> PictureField:
    """Return the field of one drive on a plane, which can be saved as a picture.

    Parameters
    ----------
    model : AcousticModel
        Array and air.
    drive : Drive, or (N,) array_like of complex
        Phases and amplitudes of the elements.
    place_m : (3,) array_like
        Middle of the plane, in metres.
    plane : str
        "xy", "xz" or "yz", axes of the world.
    half_width_m : float
        Reach of the plane around that place, in metres; one that stands over an array of which all
        is below the place begins 5 mm above it.
    step_m : float
        Spacing of the samples, in metres.

    Raises
    ------
    ConfigurationError
        A drive of another number of elements; more than 4 million samples; a plane that is all
        behind the array or within 2 mm of an element.

    Examples
    --------
    >>> import numpy as np
    >>> from haptogram.acoustics import AcousticModel, Drive, focus_phases
    >>> model, target = AcousticModel.default(nx=8, ny=8), (0.0, 0.01, 0.08)
    >>> drive = Drive.from_weights(np.exp(1j * focus_phases(model, target)))
    >>> field = field_on_plane(model, drive, target, plane="xy", step_m=0.002)
    >>> [round(1e3 * value) for value in field.peak_m()]
    [0, 10, 80]
    """
    weights = drive.weights() if isinstance(drive, Drive) else drive
    around = PicturePlane.around(model.array, plane, place_m, half_width_m, step_m)
    return sample_picture_plane(choose_engine(model), weights, around)


def draw_plane_figure(
    field: PictureField,
    *,
    quantity: str = "pressure",
    targets_m: ArrayLike = (),
    title: str = "",
    peak_m: ArrayLike | None = None,
    decibels: bool = False,
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

    Raises
    ------
    ConfigurationError
        An unknown quantity, the phase of a time average, or no matplotlib.
    """
    values, label = figure_quantity_and_label(
        field.model.medium, field.values, quantity, decibels=decibels
    )
    first, second = field.plane.axes
    with style.new_figure(*_plane_picture_size(field.plane)) as figure:
        figure.set_layout_engine("compressed")  # no gaps beside a picture of fixed aspect
        axes = figure.add_subplot()
        image = _draw_plane_image(axes, field.plane, values)
        bar = figure.colorbar(image, ax=axes, label=label, shrink=0.92)
        image.set_clim(LEAST_DB if decibels else 0.0, 0.0 if decibels else None)
        if quantity == "phase":
            image.set(cmap=style.PHASE_MAP, clim=(-math.pi, math.pi))
            bar.set_ticks([-math.pi, -math.pi / 2, 0, math.pi / 2, math.pi])
            bar.set_ticklabels(["−π", "−π/2", "0", "π/2", "π"])
        marked = _marked_plane_picture(field.plane, targets_m)
        size = 6.0 if len(marked) > _FEW_TARGETS else None
        for target in marked:
            style.draw_figure_mark(axes, target[first] * 1e3, target[second] * 1e3, "target", size)
        place = np.asarray(field.peak_m() if peak_m is None else peak_m, dtype=np.float64)
        style.draw_figure_mark(axes, place[first] * 1e3, place[second] * 1e3, "peak")
        if second == 2:
            _draw_elements(axes, 1e3 * field.model.array.positions_m[:, [first, second]])
        style.figure_legend(figure, columns=2)
        axes.set_title(_plane_picture_title(title, field.plane))
    return figure


def _draw_plane_image(axes: Axes, plane: PicturePlane, values: NDArray[Any]) -> AxesImage:
    """Draw values (V, H), rows upwards, on a plane in mm; return the image."""
    across, up = (1e3 * samples for samples in plane.coordinates_m())
    half = 0.5e3 * plane.step_m
    axes.grid(visible=False)
    first, second = plane.axes
    axes.set(xlabel=f"{'xyz'[first]} (mm)", ylabel=f"{'xyz'[second]} (mm)")
    extent = (across[0] - half, across[-1] + half, up[0] - half, up[-1] + half)
    return axes.imshow(
        values,
        origin="lower",
        extent=extent,
        aspect="equal",
        interpolation="bicubic",
        interpolation_stage="rgba",  # between the colours: a phase turns over without a seam
    )


def _draw_elements(axes: Axes, places: FloatArray) -> None:
    """Draw the elements at *places* (N, 2), across and up in mm, and extend the picture to them.

    Left out are elements beside the picture, or over half its height above or below it.
    """
    left, right = axes.get_xlim()
    low, high = axes.get_ylim()
    room = _WIDER * (high - low)
    near = places[(places[:, 0] >= left) & (places[:, 0] <= right)]
    near = near[(near[:, 1] >= low - room) & (near[:, 1] <= high + room)]
    if not len(near):
        return
    axes.plot(*near.T, "s", color=style.GREY, markersize=2.5, zorder=3.0, label="transducers")
    bottom, top = near[:, 1].min() - _EDGE_MM, near[:, 1].max() + _EDGE_MM
    axes.set_xlim(left, right)
    axes.set_ylim(min(low, bottom), max(high, top))


def _plane_picture_size(plane: PicturePlane) -> tuple[float, float]:
    """Return width and height in inches of a figure that fits the shape of the plane."""
    (left, right), (low, high) = plane.horizontal_m, plane.vertical_m
    ratio = (high - low) / (right - left)
    width = min(_WIDEST_IN, _TALLEST_IN / ratio)
    height = max(width * ratio, 1.2)
    return max(width + 1.6, _NARROWEST_IN), height + 1.25


def _marked_plane_picture(plane: PicturePlane, targets_m: ArrayLike) -> list[list[float]]:
    """Return the targets (x, y, z in m) within 2.5 mm of the plane; [] if those are over 200."""
    targets = np.asarray(targets_m, dtype=np.float64).reshape(-1, 3)
    distance = np.abs(targets[:, plane.normal_axis] - plane.through_m[plane.normal_axis])
    shown: list[list[float]] = targets[distance <= _NEAR_M].tolist()
    return shown if len(shown) <= _MANY_TARGETS else []


def _plane_picture_title(title: str, plane: PicturePlane) -> str:
    """Return *title* with the coordinate of the plane in mm."""
    axis = plane.normal_axis
    return style.figure_title(title, f"plane {'xyz'[axis]} = {plane.through_m[axis] * 1e3:.4g} mm")
