"""Local maxima between the points of a grid."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Final

import numpy as np

from haptogram.acoustics.arrays import FloatArray

_HALVINGS: Final = 7

STEPS: Final[FloatArray] = np.array(list(itertools.product((0.0, -1.0, 1.0), repeat=3)))


def climb_to_maximum(
    level: Callable[[FloatArray], FloatArray],
    starts: FloatArray,
    spacing: float,
    steps: FloatArray = STEPS,
) -> tuple[FloatArray, float]:
    """Return the loudest place (3,) next to *starts*, the best points of a grid, and its level.

    Parameters
    ----------
    level : callable
        Levels (M,) at places (M, 3).
    starts : (K, 3) numpy.ndarray
        Where to start.
    spacing : float
        Of the grid, in the unit of *starts*: no place is further off than twice of it, and none
        more than a hundredth of it from the maximum.
    steps : (S, 3) numpy.ndarray
        Directions to look in; the first is none.
    """
    for halving in range(1, _HALVINGS + 1):
        around = starts[:, None, :] + spacing / 2**halving * steps
        found = level(around.reshape(-1, 3)).reshape(around.shape[:2])
        starts = around[np.arange(len(starts)), found.argmax(axis=1)]
    best = int(found.max(axis=1).argmax())
    return starts[best], float(found[best].max())
