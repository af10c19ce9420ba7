"""Phases of the opposite sign, by the conjugate of each drive.

A client that takes exp(-i) for exp(+i) drives the conjugate of what it means. Flat boards then
radiate a wave that spreads as from the mirror image of the target behind them, and no focus: the
conjugate alone is one. So are boards face to face. Near the middle of bowls the conjugate of a
focus is a focus on the other side of the middle, which several targets tell apart.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from haptogram.acoustics.arrays import ComplexArray, FloatArray
from haptogram.acoustics.model.model import AcousticModel
from haptogram.acoustics.reconstruct.patterns.classifier import PatternClassifier
from haptogram.acoustics.reconstruct.patterns.found import OneFocus, Pattern

from .defect import Defect, Diagnosis
from .latch import SeenLatch
from .mistakes import Aim, is_mistake_explained_alone, name_client_mistake

_MOST_TARGETS: Final = 64
_GIVES_UP: Final = 8  # targets without a focus: the sign is not what is wrong
_SHARE: Final = 0.8  # of the targets whose conjugate is a focus
_NEAR: Final = 0.1  # of the distance from the array: so far a conjugate may miss the target


class ConjugateFociOfClient:
    """Foci of the conjugate drives, where the drives themselves are not on target.

    Parameters
    ----------
    model : AcousticModel
        Array and air of the board.
    """

    def __init__(self, model: AcousticModel) -> None:
        self._model = model
        self._classifiers: dict[int, PatternClassifier] = {}
        self._tried: set[tuple[float, ...]] = set()
        self._found: dict[tuple[float, ...], Aim] = {}
        self._own: dict[tuple[float, ...], Aim] = {}  # foci of the drives themselves

    def take(self, latch: SeenLatch, pattern: Pattern, target_m: FloatArray) -> None:
        """Look at a drive that is not on its target."""
        key = tuple(target_m.tolist())
        hopeless = not self._found and len(self._tried) >= _GIVES_UP
        if key in self._tried or hopeless or len(self._tried) >= _MOST_TARGETS:
            return
        self._tried.add(key)
        if latch.steps not in self._classifiers:
            self._classifiers[latch.steps] = PatternClassifier(self._model, latch.steps)
        found = self._classifiers[latch.steps].classify(self._turned(latch.weights), target_m)
        for kept, seen in ((self._found, found), (self._own, pattern)):
            if isinstance(seen, OneFocus):
                kept[key] = Aim(target_m, np.array(seen.position_m), np.array(seen.std_m))

    def diagnosis(self) -> Diagnosis | None:
        """Return the defect if the conjugates are the foci that were expected, else None."""
        aims = list(self._found.values())
        if not aims or len(aims) < _SHARE * len(self._tried):
            return None
        own = list(self._own.values())
        if 2 * len(own) > len(self._tried) and not is_mistake_explained_alone(
            self._model, aims, own
        ):
            return None  # where few drives are a focus themselves, the others prove it
        other = name_client_mistake(self._model, aims)
        if other is None and not all(map(self._is_near, aims)):
            return None
        count = len(self._tried)
        drives = "the drive has" if count == 1 else f"{len(aims)} of {count} drives have"
        detail = f"{drives} the expected focus once the sign of all phases is turned"
        if other is not None:
            detail += f"; and {other.defect}: {other.detail}"
        return Diagnosis(Defect.SIGN, detail, ())

    def _turned(self, weights: ComplexArray) -> ComplexArray:
        """Return the weights whose wave has the opposite sign of each phase."""
        response = self._model.response
        if response is None:
            return weights.conjugate()
        # The response of an element, as how it is mounted, is none of the client's.
        ones = np.ones_like(response)
        turns: ComplexArray = np.divide(
            response.conjugate(), response, out=ones, where=response != 0
        )
        return weights.conjugate() * turns

    def _is_near(self, aim: Aim) -> bool:
        distance_m = np.linalg.norm(aim.target_m - self._model.array.positions_m, axis=1).min()
        off_m = np.where(np.isfinite(aim.std_m), aim.found_m - aim.target_m, 0.0)
        return bool(np.linalg.norm(off_m) <= _NEAR * distance_m)
