"""Finding a focus from phases alone, with no hint of where it is.

The steering volume is divided into cells so small that moving from the centre of a cell to a corner
changes the phases of a sub-array little. The cells whose centres explain the phases best are where
:func:`fit_focus` starts: on the sub-array first, whose wide beam forgives a start that is off, then
on ever larger parts of the array.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics._validation import BoolArray, FloatArray
from haptogram.acoustics.focus import (
    MAX_TARGET_DISTANCE_M,
    MIN_TARGET_DISTANCE_M,
    PhaseFit,
    fit_focus,
    steering_reach_m,
)
from haptogram.acoustics.model import AcousticModel

_SUBARRAY_COUNT: Final = 100
_SUBARRAY_RADIUS_M: Final = 0.075
_COARSE_CELL_M: Final = 0.040
_CELL_SPREAD_RAD: Final = 1.2  # RMS phase change to a corner: coherence exp(-0.72) there
_CELLS_PER_CHUNK: Final = 32  # temporaries stay in the cache
HOPELESS_RAD: Final = 1.2  # a chance fit leaves about 1.5; one inverted element in ten, 1.0
_RIVALS: Final = 64  # cells looked at, best first
_RIVAL_SEPARATION: Final = 0.25  # of their distance: a grating lobe lies further away


class Acquisition:
    """The search volume of one array, or of the part of it that is driven.

    Parameters
    ----------
    model : AcousticModel
        The array and its medium.
    active : (N,) numpy.ndarray of bool
        The elements that may be used.
    """

    def __init__(self, model: AcousticModel, active: BoolArray) -> None:
        self._model = model
        positions = model.array.positions_m
        self._distance = np.linalg.norm(positions - positions[active].mean(axis=0), axis=1)
        self._radius_m = self._subarray_radius(active)
        self.subarray: BoolArray = active & (self._distance <= self._radius_m)
        self._cells = _divide_volume(model, positions[self.subarray])
        self._phasors = _phasors(model, self._cells, positions[self.subarray])

    def _subarray_radius(self, active: BoolArray) -> float:
        nearest = np.sort(self._distance[active])
        radius = min(_SUBARRAY_RADIUS_M, float(nearest[:_SUBARRAY_COUNT][-1]))
        # A sparse array still needs four elements for four unknowns.
        return max(radius, float(nearest[:4][-1])) * (1.0 + 1e-9)

    def starts(self, phases_rad: FloatArray, active: BoolArray) -> list[FloatArray]:
        """Return cell centres to start from, the likeliest first.

        One per region comes first, so that the grating lobes of a steered focus do not crowd it
        out; then the runners-up.
        """
        used = active[self.subarray]
        arrivals = np.where(used, np.exp(1j * phases_rad[self.subarray]), 0.0)
        score = np.abs(self._phasors @ arrivals.astype(np.complex64))
        best = self._cells[np.argsort(-score)[:_RIVALS]]
        leaders, others = _separate(best, self._model.array.centre_m)
        return leaders + others

    def fits(
        self, phases_rad: FloatArray, active: BoolArray, phase_bits: int, limit: int
    ) -> Iterator[PhaseFit]:
        """Yield the fits of the active array from the first *limit* starts.

        A fit that is hopeless on the sub-array is yielded as it is.
        """
        for start in self.starts(phases_rad, active)[:limit]:
            yield self.widening_fit(phases_rad, active, phase_bits, start)

    def widening_fit(
        self, phases_rad: FloatArray, active: BoolArray, phase_bits: int, start: FloatArray
    ) -> PhaseFit:
        """Return the fit from *start* by the middle of the array first, then by more and more.

        Few elements see a focus from further away: the middle of a 16 x 16 array of 10 mm pitch
        finds one that is 10 mm off, where the whole array needs to be within 4 mm.
        """
        radius, outermost = self._radius_m, float(self._distance[active].max())
        while True:
            part = active & (self._distance <= radius)
            fit = fit_focus(self._model, phases_rad, start, phase_bits=phase_bits, active=part)
            if radius >= outermost or fit.residual_rms_rad > HOPELESS_RAD:
                return fit
            start, radius = fit.position_m, 2.0 * radius


def _phasors(
    model: AcousticModel, cells: FloatArray, positions: FloatArray
) -> NDArray[np.complex64]:
    """Return e^{j k r}, (M, N); single precision, since only the order of the cells needs it."""
    phasors = np.empty((len(cells), len(positions)), dtype=np.complex64)
    for n, position in enumerate(positions):
        turns = np.linalg.norm(cells - position, axis=1) / model.wavelength_m
        phasors[:, n] = np.exp(2j * np.pi * (turns - np.rint(turns)))
    return phasors


def _separate(cells: FloatArray, centre: FloatArray) -> tuple[list[FloatArray], list[FloatArray]]:
    """Return the best cell of each region, then the other cells, each best first."""
    leaders: list[FloatArray] = []
    others: list[FloatArray] = []
    for cell in cells:
        apart = _RIVAL_SEPARATION * float(np.linalg.norm(cell - centre))
        alone = all(np.linalg.norm(cell - leader) > apart for leader in leaders)
        (leaders if alone else others).append(cell)
    return leaders, others


def _divide_volume(model: AcousticModel, positions: FloatArray) -> FloatArray:
    """Return the (M, 3) centres of cells that cover everything `check_target` lets through."""
    centres, halves = _coarse_cells(model)
    finished: list[FloatArray] = []
    while len(centres):
        spread = model.wavenumber * _ray_spread(centres, positions) * halves
        split = np.linalg.norm(spread, axis=1) > _CELL_SPREAD_RAD
        finished.append(centres[~split])
        centres, halves = _halve(centres[split], halves[split], spread[split].argmax(axis=1))
    cells = np.concatenate(finished)
    usable = _clearance_m(cells, positions) >= 0.75 * MIN_TARGET_DISTANCE_M
    return cells[usable]


def _coarse_cells(model: AcousticModel) -> tuple[FloatArray, FloatArray]:
    """Return centres and half-sizes of a regular division of the steering volume."""
    reach = steering_reach_m(model)
    thin = model.array.half_extent_m < 1e-6
    # A line of elements cannot tell y from z (or x from z): look only straight above the line.
    lateral = [0.0 if thin[i] and not thin[1 - i] else reach[i] for i in (0, 1)]
    spans = [(-lateral[0], lateral[0]), (-lateral[1], lateral[1])]
    spans.append((MIN_TARGET_DISTANCE_M, MAX_TARGET_DISTANCE_M))
    axes, halves = zip(*(_intervals(low, high) for low, high in spans), strict=True)
    centres = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    return centres + model.array.centre_m, np.tile(np.array(halves), (len(centres), 1))


def _intervals(low: float, high: float) -> tuple[FloatArray, float]:
    count = max(1, math.ceil((high - low) / _COARSE_CELL_M))
    half = (high - low) / count / 2.0
    centres = low + half * np.arange(1.0, 2.0 * count, 2.0, dtype=np.float64)
    return centres, half


def _ray_spread(centres: FloatArray, positions: FloatArray) -> FloatArray:
    """Return the standard deviation, over the elements, of the unit vectors to each centre."""
    spread = np.empty_like(centres)
    for first in range(0, len(centres), _CELLS_PER_CHUNK):
        part = slice(first, first + _CELLS_PER_CHUNK)
        rays = centres[part, :, None] - positions.T
        distance = np.sqrt(np.einsum("min,min->mn", rays, rays))
        rays /= np.maximum(distance, 1e-6)[:, None, :]  # a cell may sit on top of an element
        rays -= rays.mean(axis=2, keepdims=True)
        spread[part] = np.sqrt(np.einsum("min,min->mi", rays, rays) / len(positions))
    return spread


def _halve(
    centres: FloatArray, halves: FloatArray, axes: NDArray[np.intp]
) -> tuple[FloatArray, FloatArray]:
    """Return both halves of each cell, cut across its given axis."""
    rows = np.arange(len(centres))
    smaller, shift = halves.copy(), np.zeros_like(halves)
    smaller[rows, axes] /= 2.0
    shift[rows, axes] = smaller[rows, axes]
    return np.concatenate([centres - shift, centres + shift]), np.concatenate([smaller, smaller])


def _clearance_m(cells: FloatArray, positions: FloatArray) -> FloatArray:
    clearance = np.full(len(cells), np.inf)
    for position in positions:
        clearance = np.minimum(clearance, np.linalg.norm(cells - position, axis=1))
    return clearance
