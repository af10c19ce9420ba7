"""Drives that pins hold, and frames that are like them, in the order of both."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics.arrays import ComplexArray, FloatArray
from haptogram.errors import ConfigurationError

from .drives import HeldDrives

_Ints: TypeAlias = NDArray[np.int64]

_LEAST_MATCH: Final = 0.5  # least correlation of a drive with a frame
_TURNS: Final = 4  # phases that are tried
_MOST_PAIRS: Final = 50_000_000


def matched_drives(held: HeldDrives, meant: ComplexArray) -> tuple[_Ints, _Ints]:
    """Return the frames at which the drive changes, and which of them the pins show.

    Parameters
    ----------
    meant : (F, E) numpy.ndarray of complex
        The drives of the frames, at the pins.

    Returns
    -------
    firsts : (G,) numpy.ndarray of int
        The first frame of each drive.
    pairs : (K, 2) numpy.ndarray of int
        Places of a held drive and of the one of *firsts* that is like it, both ascending.

    Raises
    ------
    ConfigurationError
        More drives and frames than can be compared.
    """
    if held.record.reference_element is not None:
        own = meant[:, [held.elements.index(held.record.reference_element)]]
        meant = meant * np.conj(np.exp(1j * np.angle(own)))
    firsts = np.flatnonzero(np.append(True, (meant[1:] != meant[:-1]).any(axis=1)))
    seen = np.where(np.isfinite(held.weights), held.weights, 0.0)
    if len(firsts) * held.count > _MOST_PAIRS:
        raise ConfigurationError(
            f"{held.record.name}: {held.count} drives for {len(firsts)} frames are too many to be "
            f"compared, can be {_MOST_PAIRS} pairs; capture a shorter time"
        )
    found = map(_pairs_in_order, _drive_correlations(seen, meant[firsts]))
    return firsts, max(found, key=lambda one: one[0])[1]


def _drive_correlations(seen: ComplexArray, meant: ComplexArray) -> Iterator[FloatArray]:
    """Yield (S, F) the correlation of drives and frames, for each likely phase that all share."""
    sizes = np.linalg.norm(seen, axis=1)[:, None] * np.linalg.norm(meant, axis=1)
    both = (seen @ np.conj(meant).T) / np.where(sizes > 0.0, sizes, 1.0)
    lags = range(1 - len(seen), len(meant))
    sums = np.array([np.trace(both, lag) for lag in lags])
    sounding = np.any(seen, axis=1)[:, None] | np.any(meant, axis=1)
    for lag in np.abs(sums).argsort()[-_TURNS:]:
        match = (both * np.exp(-1j * np.angle(sums[lag]))).real
        yield np.where(sounding, match, 1.0)


def _pairs_in_order(match: FloatArray) -> tuple[float, _Ints]:
    """Return the sum of agreement and the (K, 2) pairs of the best match that keeps the order."""
    gain = np.maximum(match - _LEAST_MATCH, 0.0)
    rows = [np.zeros(match.shape[1] + 1)]
    for row in gain:
        paired = np.append(0.0, rows[-1][:-1] + row)
        rows.append(np.maximum.accumulate(np.maximum(rows[-1], paired)))
    drive, frame = match.shape
    pairs = []
    while drive and frame:
        here = rows[drive][frame]
        if here == rows[drive - 1][frame]:
            drive -= 1
        elif here == rows[drive][frame - 1]:
            frame -= 1
        else:
            drive, frame = drive - 1, frame - 1
            pairs.append((drive, frame))
    return float(rows[-1][-1]), np.array(pairs[::-1], dtype=np.int64).reshape(-1, 2)
