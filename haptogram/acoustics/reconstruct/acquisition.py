"""Finding a focus from phases alone, with no hint of where it is.

The steering volume is divided into cells so small that moving from the centre of a cell to a corner
changes the phases of a sub-array little. The cells whose centres explain the phases best are where
:func:`fit_focus` starts: on the sub-array first, whose wide beam forgives a start that is off, then
on ever larger parts of the array.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from haptogram.acoustics.arrays import BoolArray, FloatArray
from haptogram.acoustics.model.geometry import MIN_SPACING_M
from haptogram.acoustics.model.model import AcousticModel
from haptogram.acoustics.reconstruct.cells import leading_cells, search_volume
from haptogram.acoustics.solvers.focus_fit import PhaseFit, fit_focus

_SUBARRAY_COUNT: Final = 100
_SUBARRAY_RADIUS_M: Final = 0.075
HOPELESS_RAD: Final = 1.2  # a chance fit leaves about 1.5; one inverted element in ten, 1.0
_RIVALS: Final = 64  # cells looked at, best first
_RIVAL_SEPARATION: Final = 0.25  # least distance of cells, relative to that of the array


class FocusAcquisition:
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
        self._cells, self._phasors = search_volume(model, positions[self.subarray])
        if model.calibration is not None:
            lags_rad = model.calibration.phase_rad[self.subarray]
            self._phasors = self._phasors * np.exp(1j * lags_rad).astype(np.complex64)

    def _subarray_radius(self, active: BoolArray) -> float:
        """Return the radius (m) about the centre that holds the active elements of a first fit.

        It holds 100 of them or all within 75 mm, whichever is less; four at least, if there are.
        """
        nearest = np.sort(self._distance[active])
        radius = min(_SUBARRAY_RADIUS_M, float(nearest[:_SUBARRAY_COUNT][-1]))
        # A sparse array still needs four elements for four unknowns; of one that sounds alone the
        # radius would be 0, and would never grow.
        return max(radius, float(nearest[:4][-1]), MIN_SPACING_M) * (1.0 + 1e-9)

    def starts(self, phases_rad: FloatArray, active: BoolArray) -> list[FloatArray]:
        """Return cell centres to start from, the likeliest first.

        One per region comes first, so that the grating lobes of a steered focus do not crowd it
        out; then the runners-up.
        """
        used = active[self.subarray]
        arrivals = np.where(used, np.exp(1j * phases_rad[self.subarray]), 0.0)
        score = np.abs(self._phasors @ arrivals.astype(np.complex64))
        best = self._cells[np.argsort(-score)[:_RIVALS]]
        apart_m = np.linalg.norm(best - self._model.array.centre_m, axis=1) * _RIVAL_SEPARATION
        leaders = leading_cells(best, apart_m)
        return [*best[leaders], *np.delete(best, leaders, axis=0)]

    def fits(
        self, phases_rad: FloatArray, active: BoolArray, step_rad: float, limit: int
    ) -> Iterator[PhaseFit]:
        """Yield the fits of the active array from the first *limit* starts.

        A fit that is hopeless on the sub-array is yielded as it is.
        """
        for start in self.starts(phases_rad, active)[:limit]:
            yield self.widening_fit(phases_rad, active, step_rad, start)

    def widening_fit(
        self, phases_rad: FloatArray, active: BoolArray, step_rad: float, start: FloatArray
    ) -> PhaseFit:
        """Return the fit from *start* by the middle of the array first, then by more and more.

        Few elements see a focus from further away: the middle of a 16 x 16 array of 10 mm pitch
        finds one that is 10 mm off, where the whole array needs to be within 4 mm.
        """
        radius, outermost = self._radius_m, float(self._distance[active].max())
        while True:
            part = active & (self._distance <= radius)
            fit = fit_focus(self._model, phases_rad, start, step_rad=step_rad, active=part)
            if radius >= outermost or fit.residual_rms_rad > HOPELESS_RAD:
                return fit
            start, radius = fit.position_m, 2.0 * radius
