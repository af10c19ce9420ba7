"""Single elements that are out of step with the focus that was expected."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Collection
from typing import Final

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics.arrays import FloatArray
from haptogram.acoustics.model.model import AcousticModel
from haptogram.acoustics.solvers.focus_fit import wrapped_phases

from .defect import Defect, Diagnosis
from .mistake_fit import MistakeFit
from .mistakes import Aim

_ROUNDING: Final = 0.32  # RMS error in steps: rounding and cutting off leave 0.29
_NAMED: Final = 8  # elements; more are counted
_MOST_FRAMES: Final = 1000


class ElementMistakes:
    """Collects elements out of step, frame by frame.

    Parameters
    ----------
    model : AcousticModel
        Array and air.
    """

    def __init__(self, model: AcousticModel) -> None:
        self._model = model
        self._off: dict[tuple[int, int], list[int]] = defaultdict(list)  # element, steps: latches
        self._swapped: dict[tuple[int, int], list[int]] = defaultdict(list)
        self._taken = 0

    def take(self, number: int, aim: Aim) -> None:
        """Look at a latch that is not as expected."""
        if self._taken == _MOST_FRAMES:
            return
        positions, k = self._model.array.positions_m, self._model.wavenumber
        rows = aim.phases_rad[None], aim.target_m[None], np.array([aim.step_rad])
        residual = MistakeFit(positions, k, *rows).residual_of_focus()
        if residual is None:
            return
        error = np.abs(np.nan_to_num(residual))
        off = np.flatnonzero(error > aim.step_rad)
        rest = error[error <= aim.step_rad]
        if math.sqrt(float(np.mean(rest**2))) > _ROUNDING * aim.step_rad:
            return  # air or array are not quite those that are thought
        self._taken += bool(len(off))
        if len(off) == 2 and self._is_swap(aim, residual, off):
            first, second = off.tolist()
            self._swapped[first, second].append(number)
            return
        half = round(math.pi / aim.step_rad)  # which has no sign
        for element in off.tolist():
            steps = round(residual[element] / aim.step_rad)
            self._off[element, max(steps, half) if steps == -half else steps].append(number)

    def diagnoses(self, known: Collection[int]) -> list[Diagnosis]:
        """Return the defects, but for elements that are named otherwise."""
        found = [
            Diagnosis(Defect.ELEMENTS, f"elements {a} and {b} are swapped", tuple(latches))
            for (a, b), latches in self._swapped.items()
        ][:_NAMED]
        off = {key: latches for key, latches in self._off.items() if key[0] not in known}
        if len(off) > _NAMED:
            latches = sorted({number for of_one in off.values() for number in of_one})
            count = len({element for element, _ in off})
            return [*found, Diagnosis(Defect.ELEMENTS, f"{count} elements", tuple(latches))]
        return found + [
            Diagnosis(Defect.ELEMENTS, f"element {element}, {steps:+d} steps", tuple(latches))
            for (element, steps), latches in sorted(off.items())
        ]

    def _is_swap(self, aim: Aim, residual: FloatArray, pair: NDArray[np.intp]) -> bool:
        """Return True if each of two elements has the phase that the other should have."""
        distance = np.linalg.norm(self._model.array.positions_m[pair] - aim.target_m, axis=1)
        between = float(self._model.wavenumber * (distance[1] - distance[0]))
        errors = wrapped_phases(residual[pair] - between * np.array([-1.0, 1.0]))
        return bool(np.abs(errors).max() <= aim.step_rad and math.isfinite(between))
