"""Iso-surfaces of |p| around a focus, by marching tetrahedra."""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import ArrayLike

from haptogram.acoustics import FieldEngine
from haptogram.acoustics.arrays import FloatArray
from haptogram.errors import ConfigurationError
from haptogram.report.figures.planes import picture_field_pressure
from haptogram.report.figures.quantities import figure_quantity_and_label
from haptogram.report.figures.style import BLUE, ORANGE, VERMILION, figure_title, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_MAX_VOXELS: Final = 2_000_000
_LEVELS_DB: Final = (-3.0, -6.0, -12.0)
_COLOURS: Final = (VERMILION, ORANGE, BLUE)
_OPACITY: Final = (0.95, 0.40, 0.14)
_LEAST_SIDE: Final = 0.4  # of the longest side of a frame

# A cube along its diagonal 0-7 in six tetrahedra; corner c lies at bits (x, y, z) of c.
_TETRAHEDRA: Final = tuple(
    (0, 1 << a, (1 << a) | (1 << b), 7) for a, b in itertools.permutations(range(3), 2)
)


def isosurface_mesh(values: ArrayLike, level: float) -> FloatArray:
    """Return the triangles of the surface where a volume takes a level.

    Marching tetrahedra: each cube of eight samples in six tetrahedra, linear along their edges; the
    surface is closed inside the volume, and two tetrahedra never disagree about it.  By the right
    hand, the corners of a triangle turn around its way down.

    Parameters
    ----------
    values : (X, Y, Z) array_like
        Samples, finite.
    level : float
        Level of the surface.

    Returns
    -------
    (T, 3, 3) numpy.ndarray
        Corners of the triangles, in units of the grid.

    Raises
    ------
    ConfigurationError
        A volume that is not three-dimensional with two samples at least along each axis.
    """
    volume = np.asarray(values, dtype=np.float64)
    if volume.ndim != 3 or min(volume.shape) < 2:
        raise ConfigurationError(f"volume has shape {volume.shape}, must be (X, Y, Z), 2 at least")
    corners = np.array([[(c >> axis) & 1 for axis in range(3)] for c in range(8)])
    origin = np.stack(np.meshgrid(*(np.arange(n - 1) for n in volume.shape), indexing="ij"), -1)
    origin = origin.reshape(-1, 1, 3)
    parts = []
    for tetrahedron in _TETRAHEDRA:
        points = origin + corners[list(tetrahedron)]
        sampled = volume[points[..., 0], points[..., 1], points[..., 2]]
        crossed = (sampled > level).any(axis=1) & (sampled <= level).any(axis=1)
        parts += _isosurface_triangles(points[crossed].astype(np.float64), sampled[crossed], level)
    return np.concatenate(parts) if parts else np.empty((0, 3, 3))


def _isosurface_triangles(points: FloatArray, values: FloatArray, level: float) -> list[FloatArray]:
    """Return the triangles in tetrahedra (K, 4, 3) with values (K, 4): one or two in each."""
    # With the corners sorted by value, only how many are above the level makes a difference.
    order = np.argsort(values, axis=1, kind="stable")
    points = np.take_along_axis(points, order[..., None], axis=1)
    values = np.take_along_axis(values, order, axis=1)
    above = (values > level).sum(axis=1)
    uphill = points[:, 3] - points[:, 0]  # from the lowest corner to the highest
    parts = []
    for count, edges in (
        (1, ((0, 3), (1, 3), (2, 3))),
        (3, ((0, 1), (0, 2), (0, 3))),
        (2, ((0, 2), (0, 3), (1, 2))),
        (2, ((0, 3), (1, 3), (1, 2))),
    ):
        chosen = above == count
        if chosen.any():
            triangles = _isosurface_cut(points[chosen], values[chosen], edges, level)
            parts.append(_isosurface_face_down(triangles, uphill[chosen]))
    return parts


def _isosurface_face_down(triangles: FloatArray, uphill: FloatArray) -> FloatArray:
    """Return the triangles, turned so that their normals point to lower values."""
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    wrong = (normals * uphill).sum(axis=1) > 0.0
    triangles[wrong] = triangles[wrong][:, ::-1]
    return triangles


def _isosurface_cut(
    points: FloatArray, values: FloatArray, edges: tuple[tuple[int, int], ...], level: float
) -> FloatArray:
    """Return the points at which the level crosses three edges of each tetrahedron, (K, 3, 3)."""
    corners = []
    for low, high in edges:
        part = (level - values[:, low]) / (values[:, high] - values[:, low])
        corners.append(points[:, low] + part[:, None] * (points[:, high] - points[:, low]))
    return np.stack(corners, axis=1)


def draw_isosurfaces(
    engine: FieldEngine,
    weights: ArrayLike,
    target_m: ArrayLike,
    half_width_m: float = 0.030,
    step_m: float = 1.5e-3,
    title: str = "",
    quantity: str = "pressure",
) -> Figure:
    """Return the surfaces of -3, -6 and -12 dB below the largest |p| of a box around a target.

    Those of the radiation pressure, which is a square, are the same. The box lies along the array's
    own axes, is twice as deep as it is wide, and stays 20 mm off the array's centre.

    Raises
    ------
    ConfigurationError
        More than 2 million samples, a step or half-width that is not above 0, a quantity other than
        "pressure" and "force", or no matplotlib.
    """
    if quantity == "phase":
        raise ConfigurationError("a phase has no level, so no surfaces; choose a plane or cuts")
    if not (step_m > 0.0 and half_width_m > step_m):
        raise ConfigurationError(
            f"step_m is {step_m:g} and half_width_m {half_width_m:g}, must be above 0 and larger"
        )
    array = engine.model.array
    target = array.axes @ np.asarray(target_m, dtype=np.float64)
    floor = float(array.axes[2] @ array.centre_m) + 0.020
    low = target - half_width_m * np.array([1.0, 1.0, 2.0])
    low[2] = max(low[2], floor)
    high = target + half_width_m * np.array([1.0, 1.0, 2.0])
    counts = [round(extent / step_m) + 1 for extent in high - low]
    if math.prod(counts) > _MAX_VOXELS:
        raise ConfigurationError(
            f"{math.prod(counts)} samples, must be at most {_MAX_VOXELS}; take a larger step"
        )
    sides = [np.linspace(low[i], high[i], counts[i]) for i in range(3)]
    points = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, 3) @ array.axes
    pressure = np.nan_to_num(picture_field_pressure(engine, weights, points))
    level = np.abs(pressure).reshape(counts)
    spacing = (high - low) / (np.array(counts) - 1)
    with new_figure(5.4, 5.6) as figure:
        names = [f"{'' if array.is_upright else 'own '}{name}" for name in "xyz"]
        _plot_isosurface(figure, level, low * 1e3, spacing * 1e3, target * 1e3, names)
        what = f"|p|, relative to {level.max() / math.sqrt(2.0) * 1e-3:.3g} kPa RMS"
        if quantity == "force":
            largest = figure_quantity_and_label(engine.model.medium, pressure, quantity)[0].max()
            what = f"the radiation pressure, relative to {largest:.3g} Pa"
        figure.suptitle(figure_title(title, f"surfaces of {what}"))
    return figure


def _plot_isosurface(
    figure: Figure,
    level: FloatArray,
    low_mm: FloatArray,
    step_mm: FloatArray,
    target_mm: FloatArray,
    names: list[str],
) -> None:
    from matplotlib.colors import LightSource
    from matplotlib.patches import Patch
    from matplotlib.ticker import MaxNLocator
    from mpl_toolkits.mplot3d.art3d import (  # type: ignore[import-untyped]  # it has none
        Poly3DCollection,
    )

    figure.set_layout_engine("none")  # it clips the labels of a tall box
    axes: Any = figure.add_axes((0.07, 0.11, 0.86, 0.80), projection="3d", computed_zorder=False)
    handles: list[Any] = []
    shown_mm = [target_mm[None]]
    # The inner surface last, so that its colour is not mixed with those around it.
    for db, colour, opacity in zip(_LEVELS_DB, _COLOURS, _OPACITY, strict=True):
        triangles = isosurface_mesh(level, float(level.max()) * 10.0 ** (db / 20.0))
        corners_mm = low_mm + triangles * step_mm
        shown_mm.append(corners_mm.reshape(-1, 3))
        light = LightSource(azdeg=225, altdeg=45)
        style: dict[str, Any] = {"facecolors": colour, "alpha": opacity, "linewidths": 0}
        axes.add_collection3d(
            Poly3DCollection(corners_mm, shade=True, lightsource=light, zorder=db, **style)
        )
        handles.append(Patch(color=colour, alpha=max(opacity, 0.3), label=f"−{-db:g} dB"))
    peak_mm = low_mm + step_mm * np.array(np.unravel_index(int(np.argmax(level)), level.shape))
    for place_mm, sign, size, name in (
        (target_mm, "k+", 12.0, "target"),
        (peak_mm, "ko", 9.0, "peak"),
    ):
        mark = {"markersize": size, "fillstyle": "none", "label": name, "zorder": 1.0}
        handles += axes.plot(*place_mm[:, None], sign, **mark)
    low_mm, high_mm = _frame_isosurface(np.concatenate(shown_mm))
    for name, shown, low, high in zip("xyz", names, low_mm, high_mm, strict=True):
        getattr(axes, f"set_{name}lim")(low, high)
        getattr(axes, f"set_{name}label")(f"{shown} (mm)", labelpad=10.0 if name == "z" else 6.0)
        ticks = MaxNLocator(7 if name == "z" else 4, prune="upper" if name == "x" else None)
        getattr(axes, f"{name}axis").set_major_locator(ticks)  # that of x would meet that of y
    axes.set_box_aspect(tuple((high_mm - low_mm) / (high_mm - low_mm).max()), zoom=0.96)
    axes.view_init(elev=18, azim=-58)
    figure.legend(handles=handles, loc="upper left", bbox_to_anchor=(0.02, 0.90))


def _frame_isosurface(points_mm: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the corners of a box that the surfaces fill, no side too short for its names."""
    low, high = points_mm.min(axis=0), points_mm.max(axis=0)
    span = np.maximum(1.1 * (high - low), _LEAST_SIDE * float((high - low).max()) + 1.0)
    middle = (low + high) / 2.0
    return middle - span / 2.0, middle + span / 2.0
