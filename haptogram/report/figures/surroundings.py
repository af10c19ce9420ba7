"""The surroundings of a field in a picture of a plane: the array, and an ear."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from haptogram.acoustics import TransducerArray
from haptogram.acoustics.arrays import FloatArray

from .style import BLACK, GREY

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MM: Final = 1e3
_WIDER: Final = 0.5  # of the height of a picture: an array farther off is not drawn
_EDGE_MM: Final = 4.0
_BORDER: Final = 0.94  # of the way to the border, where an arrow ends


def draw_array_in_figure(
    axes: Axes, array: TransducerArray, horizontal: int, vertical: int
) -> None:
    """Draw the array as seen along the normal of a plane, where the picture has room for it.

    On a plane that holds the z axis the elements are drawn, and the picture grows downwards or
    upwards to hold them; on a level plane the outline of the array is drawn.
    """
    places = _MM * array.positions_m[:, [horizontal, vertical]]
    if vertical == 2:
        _draw_elements_in_figure(axes, places)
    else:
        _draw_outline_in_figure(axes, places)


def _draw_elements_in_figure(axes: Axes, places: FloatArray) -> None:
    left, right = axes.get_xlim()
    low, high = axes.get_ylim()
    room = _WIDER * (high - low)
    near = places[(places[:, 0] >= left) & (places[:, 0] <= right)]
    near = near[(near[:, 1] >= low - room) & (near[:, 1] <= high + room)]
    if not len(near):
        return
    axes.plot(*near.T, "s", color=GREY, markersize=2.5, zorder=3.0, label="transducers")
    bottom, top = near[:, 1].min() - _EDGE_MM, near[:, 1].max() + _EDGE_MM
    axes.set_xlim(left, right)
    axes.set_ylim(min(low, bottom), max(high, top))


def _draw_outline_in_figure(axes: Axes, places: FloatArray) -> None:
    limits = axes.get_xlim(), axes.get_ylim()
    if not _reaches_into_figure(_array_outline_in_figure(places), *limits):
        return
    for tint, width, label in (("white", 2.5, None), (GREY, 1.0, "outline of the array")):
        line = _array_outline_in_figure(places)
        axes.plot(*line.T, "--", color=tint, lw=width, zorder=2.5, label=label)
    axes.set(xlim=limits[0], ylim=limits[1])


def _reaches_into_figure(line: FloatArray, *limits: tuple[float, float]) -> bool:
    """Return True if any part of a (N, 2) line is within the limits of both axes."""
    shares = np.linspace(0.0, 1.0, 101)[:, None, None]
    points = line[:-1] + shares * (line[1:] - line[:-1])
    low, high = np.array(limits, dtype=np.float64).T
    return bool(((points > low) & (points < high)).all(axis=-1).any())


def _array_outline_in_figure(places: FloatArray) -> FloatArray:
    """Return the closed convex outline of (N, 2) places; elements in a line are a line."""
    spread = places - places.mean(axis=0)
    if np.linalg.matrix_rank(spread, tol=1e-6 * max(1.0, float(np.abs(spread).max()))) < 2:
        ends = spread @ np.linalg.svd(spread)[2][0]
        return places[[int(ends.argmin()), int(ends.argmax())]]
    from scipy.spatial import ConvexHull

    corners = ConvexHull(places).vertices
    outline: FloatArray = places[[*corners, corners[0]]]
    return outline


def draw_ear(axes: Axes, ear_mm: FloatArray, horizontal: int, vertical: int) -> None:
    """Mark an ear; one beyond the picture by an arrow at the border, with its distance.

    Parameters
    ----------
    ear_mm : (3,) numpy.ndarray
        Place of the ear.
    """
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    place = np.array([ear_mm[horizontal], ear_mm[vertical]], dtype=np.float64)
    middle = np.array([(left + right) / 2.0, (low + high) / 2.0])
    half = np.array([(right - left) / 2.0, (high - low) / 2.0])
    away = place - middle
    share = float(np.max(np.abs(away) / half))
    if share <= 1.0:
        axes.plot(*place, "^", color=BLACK, mec="white", markersize=9.0, zorder=5.0, label="ear")
        return
    tip, tail = middle + away / share * _BORDER, middle + away / share * (_BORDER - 0.2)
    distance_mm = math.dist(place, middle + away / share)
    side = float(np.sign(away[0]) * (abs(away[0]) > 0.5 * half[0]))
    axes.annotate(
        f"ear, {distance_mm:.0f} mm beyond",
        xy=(float(tip[0]), float(tip[1])),
        xytext=(float(tail[0]), float(tail[1])),
        ha={-1.0: "left", 0.0: "center", 1.0: "right"}[side],
        va="center",
        fontsize=8.0,
        color=BLACK,
        zorder=5.0,
        bbox={"boxstyle": "round,pad=0.2", "fc": "white", "ec": "none", "alpha": 0.85},
        arrowprops={"arrowstyle": "-|>", "color": "white", "lw": 1.5, "shrinkA": 0.0},
    )
