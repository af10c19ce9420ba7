"""Percentiles with their number of values, and their scatter within one run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

LEVELS: Final = (50.0, 90.0, 99.0, 99.9)
BLOCKS: Final = 10  # parts of a run, whose percentiles show the scatter
_LEAST_PER_BLOCK: Final = 20


@dataclass(frozen=True, slots=True)
class TimingPercentiles:
    """Percentiles of n values, in microseconds; the fields are those of the JSON.

    Attributes
    ----------
    n : int
        Number of values.
    levels : dict of str to float
        ``p50`` to ``p99.9``: the smallest value that so many per cent do not exceed.
    max : float
        The largest value.
    blocks : dict of str to list of float
        The percentiles of the ten tenths of the run, in order of time; their scatter is the noise
        of one run.  Empty for less than 200 values.
    """

    n: int
    levels: dict[str, float]
    max: float
    blocks: dict[str, list[float]]

    @classmethod
    def of(cls, values_us: ArrayLike) -> TimingPercentiles:
        """Return the percentiles of (n,) values in order of time, without those that are nan."""
        values = np.asarray(values_us, dtype=np.float64)
        values = values[~np.isnan(values)]
        if not len(values):
            return cls(0, {}, 0.0, {})
        blocks: dict[str, list[float]] = {}
        if len(values) >= BLOCKS * _LEAST_PER_BLOCK:
            tenths = [_percentile_levels(block) for block in np.array_split(values, BLOCKS)]
            blocks = {name: [tenth[name] for tenth in tenths] for name in tenths[0]}
        return cls(len(values), _percentile_levels(values), float(values.max()), blocks)


def percentiles_with_missed_ticks(
    lateness_us: NDArray[np.float64], period_us: float
) -> NDArray[np.float64]:
    """Return the lateness of every tick, missed ticks included.

    A loop that is late by three periods skips the ticks in between.  Those ticks would have been
    late by two and by one; without them the percentiles would look better than they are.

    Parameters
    ----------
    lateness_us : (n,) numpy.ndarray
        Lateness of each tick at which the loop woke, microseconds.
    period_us : float
        Period of the ticks, microseconds.
    """
    each = 1 + np.floor(np.maximum(lateness_us, 0.0) / period_us).astype(np.int64)
    ends = np.cumsum(each)
    place = np.arange(ends[-1] if len(ends) else 0) - np.repeat(ends - each, each)
    return np.repeat(lateness_us, each) - place * period_us


def _percentile_levels(values: NDArray[np.float64]) -> dict[str, float]:
    """Return the percentiles LEVELS by name, such as p99; each is one of the values."""
    found = np.percentile(values, LEVELS, method="inverted_cdf")
    return {f"p{level:g}": float(value) for level, value in zip(LEVELS, found, strict=True)}
