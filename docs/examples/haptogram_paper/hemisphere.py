"""The tactile object of the paper: the lower half of a sphere, at four resolutions."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from haptogram.acoustics.arrays import FloatArray
from haptogram.errors import ConfigurationError

RADIUS_M: Final = 0.050
_CENTRE_HEIGHT_M: Final = 0.100
RESOLUTIONS_M: Final = (0.020, 0.010, 0.005, 0.002)  # 20, 10, 5 and 2 % of the diameter
_MIN_RESOLUTION_M: Final = 1e-4


def paper_hemisphere(resolution_m: float) -> FloatArray:
    """Return points of the lower hemisphere, from the pole (nearest to the array) upward.

    The paper does not say how it samples.  Rings at polar angles 0, s/R, 2s/R, ... up to the
    equator, each of round(2 pi R sin(angle) / s) points, explain its averages best of the
    samplings that were tried: 33, 146, 615 and 3963 points at its resolutions.

    Raises
    ------
    ConfigurationError
        A resolution below 0.1 mm or above the radius.
    """
    if not _MIN_RESOLUTION_M <= resolution_m <= RADIUS_M:
        raise ConfigurationError(
            f"resolution_m is {resolution_m:g}, must be {_MIN_RESOLUTION_M:g} to {RADIUS_M:g}"
        )
    count = math.floor(math.pi / 2.0 * RADIUS_M / resolution_m + 1e-9)
    angles = resolution_m / RADIUS_M * np.arange(count + 1)
    return np.concatenate(
        [_paper_hemisphere_ring(angle, resolution_m) for angle in angles.tolist()]
    )


def paper_hemisphere_by_height(resolution_m: float) -> FloatArray:
    """Return rings at equal steps of the height instead: the sampling of another reading."""
    heights = np.arange(round(RADIUS_M / resolution_m) + 1) * resolution_m
    angles = np.arccos(np.clip(1.0 - heights / RADIUS_M, 0.0, 1.0))
    return np.concatenate(
        [_paper_hemisphere_ring(angle, resolution_m) for angle in angles.tolist()]
    )


def _paper_hemisphere_ring(angle: float, resolution_m: float) -> FloatArray:
    radius = RADIUS_M * math.sin(angle)
    count = max(1, round(2.0 * math.pi * radius / resolution_m))
    turns = 2.0 * np.pi * np.arange(count) / count
    height = np.full(count, _CENTRE_HEIGHT_M - RADIUS_M * math.cos(angle))
    return np.stack([radius * np.cos(turns), radius * np.sin(turns), height], axis=1)
