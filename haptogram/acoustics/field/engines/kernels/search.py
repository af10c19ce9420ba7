"""Which cell of a volume explains a frame of phase codes best."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics.field.engines.kernels.blocks import F4, F8
from haptogram.acoustics.field.engines.kernels.jit import jit_entry, jit_inline
from haptogram.acoustics.field.engines.kernels.waves import ONE


@jit_entry
def cell_scores_kernel(
    codes: NDArray[np.uint8], order: NDArray[np.int64], phasors: F4, code_steps: int, score: F4
) -> None:
    """Set the *score* |sum of e^(j (phi + k r))|^2 of each cell.

    *phasors* (2, S, C): e^(j k r) of the first S elements of *order*.
    """
    re = np.zeros(phasors.shape[2], np.float32)
    im = np.zeros(phasors.shape[2], np.float32)
    for n in range(phasors.shape[1]):
        angle = 2.0 * math.pi * codes[order[n]] / code_steps
        cosine, sine = np.float32(math.cos(angle)), np.float32(math.sin(angle))
        _turn_and_add_kernel(phasors[0, n], phasors[1, n], cosine, sine, re, im)
    for c in range(score.size):
        score[c] = re[c] * re[c] + im[c] * im[c]


@jit_inline
def _turn_and_add_kernel(pr: Any, pi: Any, cosine: Any, sine: Any, re: Any, im: Any) -> Any:
    """Add the phasors pr + j pi of all cells to re + j im, turned by one angle."""
    for c in range(re.size):
        re[c] = re[c] + pr[c] * cosine - pi[c] * sine
        im[c] = im[c] + pr[c] * sine + pi[c] * cosine


@jit_entry
def best_cell_kernel(score: F4, cells: F8, apart: F8) -> int:
    """Return the cell of the highest score; take it and those nearer than *apart* out."""
    best = 0
    for c in range(score.size):
        if score[c] > score[best]:
            best = c
    limit = apart[best] * apart[best]
    x, y, z = cells[0, best], cells[1, best], cells[2, best]
    for c in range(score.size):
        u, v, w = cells[0, c] - x, cells[1, c] - y, cells[2, c] - z
        score[c] = -ONE if u * u + v * v + w * w <= limit else score[c]
    return best
