"""The steering volume, divided into cells so small that one start in each finds any focus there."""

from __future__ import annotations

import functools
import math
from typing import Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics.arrays import FloatArray, read_only_array
from haptogram.acoustics.field.reference import points_in_front, sounding_half_spaces
from haptogram.acoustics.model.model import AcousticModel
from haptogram.acoustics.solvers.focus import (
    MIN_TARGET_DISTANCE_M,
    focus_steering_reach_m,
    focus_target_heights_m,
)
from haptogram.errors import ConfigurationError
from haptogram.settings.frozen import dataclass, field

_COARSE_CELL_M: Final = 0.040
_CELL_SPREAD_RAD: Final = 1.2  # RMS phase change to a corner: coherence exp(-0.72) there
#: Preference of the first axis among equally wide ones, whatever the rounding.
_ORDER: Final = 1.0 - 1e-9 * np.arange(3)
_CELLS_PER_CHUNK: Final = 64  # temporaries stay in the cache
_VOLUMES_KEPT: Final = 4  # 15 MB each for 16 x 16 elements; board and judge often share a model


class SearchVolume(NamedTuple):
    """The cells of some elements, and the waves between both.

    Attributes
    ----------
    cells_m : (M, 3) numpy.ndarray
        The centres of the cells, in metres; read-only.
    phasors : (M, N) numpy.ndarray of numpy.complex64
        e^{j k r} from N elements to M cells; read-only.
    """

    cells_m: FloatArray
    phasors: NDArray[np.complex64]


def search_volume(model: AcousticModel, positions: FloatArray) -> SearchVolume:
    """Return :func:`search_cells` and their :func:`cell_phasors`; the last volumes are kept.

    Parameters
    ----------
    positions : (N, 3) numpy.ndarray
        The elements that will be asked, in metres.

    Raises
    ------
    ConfigurationError
        As of :func:`search_cells`.
    """
    return _kept_search_volume(_VolumeOf.of(model, positions))


@dataclass(frozen=True, slots=True)
class _VolumeOf:
    """What a search volume depends on; equal if it gives the same volume."""

    model: AcousticModel = field(compare=False)
    positions: FloatArray = field(compare=False)
    content: tuple[object, ...]

    @classmethod
    def of(cls, model: AcousticModel, positions: FloatArray) -> Self:
        """Return the key of the volume that *positions* search."""
        array, fronts = model.array, sounding_half_spaces(model)
        parts = (positions, array.positions_m, array.normals, array.axes, fronts)
        content = (*(part.tobytes() for part in parts), array.pitch_m, model.wavenumber)
        return cls(model, positions, content)


@functools.lru_cache(_VOLUMES_KEPT)
def _kept_search_volume(of: _VolumeOf) -> SearchVolume:
    """Return the search cells and their phasors; they are cached, and read-only."""
    cells = search_cells(of.model, of.positions)
    phasors = cell_phasors(of.model, cells, of.positions)
    read_only_array(cells)
    read_only_array(phasors)
    return SearchVolume(cells, phasors)


def search_cells(model: AcousticModel, positions: FloatArray) -> FloatArray:
    """Return the centres of cells that cover everything `check_focus_target` lets through.

    From the centre of a cell to a corner, the phases at the elements change by 1.2 rad RMS at most.

    Parameters
    ----------
    positions : (N, 3) numpy.ndarray
        The elements that will be asked, in metres.

    Returns
    -------
    (M, 3) numpy.ndarray
        In metres.

    Raises
    ------
    ConfigurationError
        All of it is behind the array.
    """
    axes = model.array.axes
    centres, halves = _coarse_search_cells(model)
    places, finished = positions @ axes.T, []
    while len(centres):
        spread = model.wavenumber * _ray_spread(centres, places) * halves
        split = np.linalg.norm(spread, axis=1) > _CELL_SPREAD_RAD
        finished.append(centres[~split])
        centres, halves = _halve_search_cells(
            centres[split], halves[split], (spread[split] * _ORDER).argmax(axis=1)
        )
    cells: FloatArray = np.concatenate(finished) @ axes
    usable = _search_cell_clearance_m(cells, positions) >= 0.75 * MIN_TARGET_DISTANCE_M
    usable &= points_in_front(model, cells)
    if not usable.any():
        raise ConfigurationError(
            f"the elements face {np.round(model.array.facing, 3).tolist()} on the whole: nothing "
            f"that is {MIN_TARGET_DISTANCE_M * 1e3:g} mm or more above their centre, along "
            f"{np.round(axes[2], 3).tolist()}, is in front of them"
        )
    return cells[usable]


def leading_cells(cells: FloatArray, apart_m: FloatArray, most: int | None = None) -> list[int]:
    """Return the numbers of (M, 3) cells that are (M,) *apart_m* from all leaders before them."""
    leaders: list[int] = []
    for number, cell in enumerate(cells):
        gaps = np.linalg.norm(cells[leaders] - cell, axis=1)
        if gaps.min(initial=np.inf) > apart_m[number]:
            leaders.append(number)
            if len(leaders) == most:
                break
    return leaders


def cell_phasors(
    model: AcousticModel, cells: FloatArray, positions: FloatArray
) -> NDArray[np.complex64]:
    """Return e^{j k r} from N positions to M cells, (M, N).

    In single precision, since only the order of the cells needs it.
    """
    phasors = np.empty((len(cells), len(positions)), dtype=np.complex64)
    across = np.ascontiguousarray(cells.T)
    for n, position in enumerate(positions):
        turns = _distances_m(across, position) / model.wavelength_m
        phasors[:, n] = np.exp(2j * np.pi * (turns - np.rint(turns)))
    return phasors


def _coarse_search_cells(model: AcousticModel) -> tuple[FloatArray, FloatArray]:
    """Return centres and half-sizes (M, 3), in m, of cells that divide the steering volume.

    They are along the array's own axes; their origin is that of the world.
    """
    reach = focus_steering_reach_m(model)
    thin = model.array.half_extent_m < 1e-6
    # A line of elements cannot tell y from z (or x from z): look only straight above the line.
    lateral = [0.0 if thin[i] and not thin[1 - i] else reach[i] for i in (0, 1)]
    spans = [(-lateral[0], lateral[0]), (-lateral[1], lateral[1])]
    spans.append(focus_target_heights_m(model.array))
    axes, halves = zip(*(_search_intervals(low, high) for low, high in spans), strict=True)
    centres = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    middle = model.array.centre_m @ model.array.axes.T
    return centres + middle, np.tile(np.array(halves), (len(centres), 1))


def _search_intervals(low: float, high: float) -> tuple[FloatArray, float]:
    """Return centres (K,) of equal cells, at most 40 mm long, from *low* to *high*; half a length.

    All are in m.
    """
    # A span of whole cells stays so, whatever the rounding of a turned array says.
    count = max(1, math.ceil((high - low) / _COARSE_CELL_M - 1e-6))
    half = (high - low) / count / 2.0
    centres = low + half * np.arange(1.0, 2.0 * count, 2.0, dtype=np.float64)
    return centres, half


def _ray_spread(centres: FloatArray, positions: FloatArray) -> FloatArray:
    """Return (M, 3) the standard deviation over the elements of the unit vectors to each cell."""
    spread = np.empty_like(centres)
    for first in range(0, len(centres), _CELLS_PER_CHUNK):
        part = slice(first, first + _CELLS_PER_CHUNK)
        rays = centres[part].T[:, :, None] - positions.T[:, None, :]
        distance = np.sqrt(np.einsum("imn,imn->mn", rays, rays))
        rays /= np.maximum(distance, 1e-6)  # a cell may sit on top of an element
        squares = np.einsum("imn,imn->im", rays, rays) / len(positions)
        spread[part] = np.sqrt(np.maximum(squares - rays.mean(axis=2) ** 2, 0.0)).T
    return spread


def _halve_search_cells(
    centres: FloatArray, halves: FloatArray, axes: NDArray[np.intp]
) -> tuple[FloatArray, FloatArray]:
    """Return centres and half-sizes (2 M, 3) of both halves of M cells, cut across *axes* (M,)."""
    rows = np.arange(len(centres))
    smaller, shift = halves.copy(), np.zeros_like(halves)
    smaller[rows, axes] /= 2.0
    shift[rows, axes] = smaller[rows, axes]
    return np.concatenate([centres - shift, centres + shift]), np.concatenate([smaller, smaller])


def _search_cell_clearance_m(cells: FloatArray, positions: FloatArray) -> FloatArray:
    """Return (M,) the distance of each cell from its nearest element."""
    clearance, across = np.full(len(cells), np.inf), np.ascontiguousarray(cells.T)
    for position in positions:
        clearance = np.minimum(clearance, _distances_m(across, position))
    return clearance


def _distances_m(across: FloatArray, position: FloatArray) -> FloatArray:
    """Return (M,) distances of points, given as (3, M) coordinates, from a position."""
    x, y, z = (coordinate - at for coordinate, at in zip(across, position, strict=True))
    distances: FloatArray = np.sqrt(x * x + y * y + z * z)
    return distances
