"""Starting points of a pattern: the phases turn a whole number of times around them.

Seen from the right point, the phases of a focus are all alike, those of a vortex turn with the
azimuth, and those of a twin trap jump by half a turn, which is a turn one way and the other added.
So one product finds them all: the waves that arrive at each of many points, less the turns of the
azimuth.
"""

from __future__ import annotations

from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics.arrays import BoolArray, ComplexArray, FloatArray
from haptogram.acoustics.field.reference import points_in_front
from haptogram.acoustics.model.geometry import TransducerArray
from haptogram.acoustics.model.model import AcousticModel
from haptogram.acoustics.reconstruct.cells import cell_phasors, leading_cells, search_volume

MAX_CHARGE: Final = 4
CHARGES: Final = tuple(range(-MAX_CHARGE, MAX_CHARGE + 1))
_SUBARRAY: Final = 100  # elements whose phases the search compares
_STARTS: Final = 6  # start positions for each charge
_LOOKED_AT: Final = 48  # best cells of each charge
_APART: Final = 0.25  # least distance of starts, relative to the array's: lobes are farther
_LEAST_SCORE: Final = 0.3  # chance reaches 0.35 with 100 elements, a corner of the right cell 0.5
_TWIN_SCORE: Final = 1.1  # a twin trap reaches 0.9 where others reach 1
_AT_A_TIME: Final = 256  # points: temporaries stay in the cache
_AXES: Final = "xyz"
_LEAST_BEND: Final = 0.1  # least singular value of the normals of a bowl: less is a line or a plane
_BOWL: Final = 0.4  # half-width of the search around a bowl's middle, in radii of the bowl
_BOWL_STARTS: Final = 6
_BOWL_CELLS: Final = 400  # best cells among which the starts of a bowl are chosen
_MOST_BOWL_STEPS: Final = 12  # each way: 7 000 points
_CLEARANCE_M: Final = 0.010  # least distance of a point from the elements of the other board


class Start(NamedTuple):
    """A point to start a fit from.

    Attributes
    ----------
    position_m : (3,) numpy.ndarray
        In the world.
    charge : int or None
        Turns of the phase around its axis; None for a twin trap.
    below : bool
        Whether the axis goes through the point, and not through the middle of the array.
    score : float
        How well the phases agree there, 0 to 1.
    turn_rad : float
        Direction across the plane that splits a twin trap.
    """

    position_m: FloatArray
    charge: int | None
    below: bool
    score: float
    turn_rad: float


class PatternSearch:
    """The search volume of elements that look the same way.

    Parameters
    ----------
    model : AcousticModel
        The whole array.
    side : (N,) numpy.ndarray of bool
        The elements that look the same way.
    """

    def __init__(self, model: AcousticModel, side: BoolArray) -> None:
        array = model.array
        self.side = side
        self._axes, self._centre = array.axes, array.centre_m
        own = TransducerArray.from_positions(array.positions_m[side], array.normals[side])
        one_side = AcousticModel(own, model.medium, model.transducer)
        distance = np.linalg.norm(own.positions_m - own.centre_m, axis=1)
        nearest = np.sort(np.argsort(distance, kind="stable")[:_SUBARRAY])
        self.elements: NDArray[np.intp] = np.flatnonzero(side)[nearest]
        positions = array.positions_m[self.elements]
        cells, phasors = search_volume(one_side, positions)
        between = _pattern_cells_between(model, cells, side)
        self._cells, self._phasors = cells[between], phasors[between]
        self._local = (positions - self._centre) @ self._axes.T
        self._feet = ((self._cells - self._centre) @ self._axes.T)[:, :2]
        middle = self._local[:, :2].mean(axis=0)
        self._turns = _pattern_phasor(self._local[:, :2] - middle)
        self.middle_m = middle
        self._reach = np.linalg.norm(self._cells - own.centre_m, axis=1)
        self._bowl_cells = _cells_of_bowl(model)
        self._bowl_apart_m = np.full(_BOWL_CELLS, model.wavelength_m / 2.0)
        self._bowl_phasors = cell_phasors(model, self._bowl_cells, array.positions_m)

    def starts(self, arrivals: ComplexArray, *, below: bool) -> list[Start]:
        """Return points to start from, the likeliest first.

        Parameters
        ----------
        arrivals : (N,) numpy.ndarray
            e^{j phi} of every element, 0 where it is silent.
        below : bool
            Whether axes go through the points, and not through the middle of the array.
        """
        heard = arrivals[self.elements].astype(np.complex64)
        if not heard.any():
            return []
        sums = self._sums_below(heard) if below else self._sums_around_the_middle(heard)
        sums /= np.abs(heard).sum()
        twist = np.angle(sums[:, MAX_CHARGE - 1] * sums[:, MAX_CHARGE + 1].conj()) / 2.0
        level = np.abs(sums)
        both = np.hypot(level[:, MAX_CHARGE - 1], level[:, MAX_CHARGE + 1])
        # Of a twin trap the two turns have 0.64 each: together 0.9, and each more than half.
        twin = np.where(
            2.0 * level[:, MAX_CHARGE - 1 : MAX_CHARGE + 2 : 2].min(axis=1) > both, both, 0.0
        )
        scores: list[tuple[int | None, FloatArray]] = [(None, _TWIN_SCORE * twin)]
        scores += [(c, level[:, n]) for n, c in enumerate(CHARGES) if c or not below]
        found = [
            Start(self._cells[cell], charge, below, float(score[cell]), float(twist[cell]))
            for charge, score in scores
            for cell in self._leaders(score)
            if score[cell] >= _LEAST_SCORE
        ]
        return sorted(found, key=lambda start: -start.score)

    def foci_of_bowl(self, arrivals: ComplexArray) -> list[FloatArray]:
        """Return points around the middle of a bowl at which the waves agree best, the best first.

        A focus of a bowl is as small as a wavelength: between the cells of a volume it is lost, and
        between those here a lobe beside it may agree as well.
        """
        if not len(self._bowl_cells):
            return []
        sums = np.abs(self._bowl_phasors @ arrivals.astype(np.complex64))
        best = self._bowl_cells[np.argsort(-sums)[:_BOWL_CELLS]]
        return [*best[leading_cells(best, self._bowl_apart_m, _BOWL_STARTS)]]

    def loudest(self, weights: ComplexArray, count: int) -> list[FloatArray]:
        """Return points where most arrives, the strongest of each region first."""
        sums = self._phasors @ weights[self.elements].astype(np.complex64)
        return [self._cells[cell] for cell in self._leaders(np.abs(sums), count)]

    def _sums_around_the_middle(self, heard: NDArray[np.complex64]) -> NDArray[np.complex64]:
        """Return (cells, charges) sums of arrivals, for vortices around the array's axis.

        *heard* (S,): phasors of the elements of this side.
        """
        powers = np.stack([heard * self._turns.conj() ** charge for charge in CHARGES], axis=1)
        return self._phasors @ powers

    def _sums_below(self, heard: NDArray[np.complex64]) -> NDArray[np.complex64]:
        """Return (cells, charges) sums of arrivals, for vortices with their axis through each cell.

        *heard* (S,): phasors of the elements of this side.
        """
        sums = np.empty((len(self._cells), len(CHARGES)), dtype=np.complex64)
        for first in range(0, len(self._cells), _AT_A_TIME):
            part = slice(first, first + _AT_A_TIME)
            waves = self._phasors[part] * heard
            sums[part, MAX_CHARGE] = waves.sum(axis=1)
            for way, turns in ((-1, self._turns_below[part]), (1, self._turns_below[part].conj())):
                turned = waves.copy()
                for charge in range(1, MAX_CHARGE + 1):
                    turned *= turns
                    sums[part, MAX_CHARGE + way * charge] = turned.sum(axis=1)
        return sums

    @cached_property
    def _turns_below(self) -> NDArray[np.complex64]:
        """Return e^{j theta} (M, S) of S elements around an axis through each of M points."""
        turns = np.empty(self._phasors.shape, dtype=np.complex64)
        for first in range(0, len(turns), _AT_A_TIME):
            part = slice(first, first + _AT_A_TIME)
            turns[part] = _pattern_phasor(self._local[None, :, :2] - self._feet[part, None, :])
        return turns

    def _leaders(self, score: FloatArray, count: int = _STARTS) -> list[int]:
        """Return the indices of up to *count* cells, best *score* first, not beside each other.

        They are apart by more than a quarter of their distance from the array.
        """
        looked_at = min(_LOOKED_AT * count // _STARTS, len(score))
        best = np.argpartition(-score, looked_at - 1)[:looked_at]
        best = best[np.argsort(-score[best])]
        leaders = leading_cells(self._cells[best], _APART * self._reach[best], count)
        return [int(cell) for cell in best[leaders]]


def array_sides_of_pattern(array: TransducerArray) -> list[BoolArray]:
    """Return the elements that look along the array's z and those that look against it."""
    ahead = array.normals @ array.axes[2] >= 0.0
    return [side for side in (ahead, ~ahead) if side.any()]


def _cells_of_bowl(model: AcousticModel) -> FloatArray:
    """Return search points (K, 3), in m, around the point that all elements face; none if flat.

    None as well (0, 3) if all normals lie in one plane.
    """
    positions, normals = model.array.positions_m, model.array.normals
    if np.linalg.matrix_rank(normals, tol=_LEAST_BEND) < len(_AXES):
        return np.zeros((0, 3))  # all look along one line, or lie in one plane
    # The point next to all lines along the normals: sum of (I - n n^T) (x - p) = 0.
    across = np.eye(3) - normals[:, :, None] * normals[:, None, :]
    middle = np.linalg.solve(across.sum(axis=0), np.einsum("nij,nj->i", across, positions))
    radius = _BOWL * np.linalg.norm(positions - middle, axis=1).min()
    step = min(model.wavelength_m / 4.0, radius)
    most = min(int(radius / step), _MOST_BOWL_STEPS)
    line = step * np.arange(-most, most + 1)
    points = np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1).reshape(-1, 3)
    cells: FloatArray = middle + points[np.linalg.norm(points, axis=1) <= radius]
    return cells


def _pattern_cells_between(model: AcousticModel, cells: FloatArray, side: BoolArray) -> BoolArray:
    """Return a mask (M,) of *cells* in front of the array and 10 mm before all of the other side.

    *side* (N,): mask of the elements of one of two sides that face each other. If that is every
    element, all cells are in the mask.
    """
    if side.all():
        return np.ones(len(cells), dtype=np.bool_)
    normals = model.array.normals[~side]
    planes = (normals * model.array.positions_m[~side]).sum(axis=1)
    lowest = np.full(len(cells), np.inf)
    for normal, plane in zip(normals, planes, strict=True):
        lowest = np.minimum(lowest, cells @ normal - plane)
    return (lowest > _CLEARANCE_M) & points_in_front(model, cells)


def _pattern_phasor(offset: FloatArray) -> NDArray[np.complex64]:
    """Return e^{j theta} of (..., 2) offsets; 1 for an offset of zero."""
    value = offset[..., 0] + 1j * offset[..., 1]
    size = np.abs(value)
    return np.where(size > 0.0, value / np.where(size > 0.0, size, 1.0), 1.0).astype(np.complex64)
