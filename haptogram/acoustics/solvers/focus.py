"""The phases of a focus, the superposition of several, and the targets that an array can reach.

Focusing on x needs phi_n = -k r_n(x) - arg h_n + psi, with any common psi; h_n is the response of
the element, 1 without a calibration.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from haptogram.acoustics.arrays import (
    ComplexArray,
    FloatArray,
    as_coordinates,
    as_float_array,
    as_float_vector,
    as_point_array,
)
from haptogram.acoustics.field.reference import (
    check_field_points,
    points_clear_of_elements,
    points_in_front,
)
from haptogram.acoustics.model.geometry import TransducerArray
from haptogram.acoustics.model.model import AcousticModel
from haptogram.acoustics.model.own_axes import mean_array_normal
from haptogram.errors import ConfigurationError

MIN_TARGET_DISTANCE_M: Final = 0.020
MAX_TARGET_DISTANCE_M: Final = 1.0
_TARGET_MARGIN_M: Final = 0.150
_AGAINST: Final = -0.1  # cosine to the array's own z: so far an element looks the other way

_ROUNDING_M: Final = 1e-9


def check_focus_target(model: AcousticModel, target_m: ArrayLike) -> None:
    """Raise unless *target_m* is a point that this array can sensibly focus on.

    Raises
    ------
    ConfigurationError
        Not three finite numbers; less than 20 mm from any element or, where all of them look one
        way, above the array's centre; not between elements that look at each other; more than 1 m
        from the centre; |x|, |y| beyond the array's half-width plus 150 mm; behind it. Height, x
        and y are along the array's own axes.

    Examples
    --------
    >>> check_focus_target(model, (0.0, 0.0, -0.1))
    Traceback (most recent call last):
        ...
    haptogram.errors.ConfigurationError: target: height z is -100 mm, must be at least 20 mm
    """
    target = as_coordinates("target_m", target_m)
    offset = model.array.local_m(target)
    names = _coordinate_names(model)
    low_m, high_m = focus_target_heights_m(model.array)
    _check_focus_limit(names[2], offset[2], low_m=low_m)
    nearest = float(np.linalg.norm(model.array.positions_m - target, axis=1).min())
    _check_focus_limit("distance from an element", nearest, low_m=MIN_TARGET_DISTANCE_M)
    _check_focus_limit("distance", float(np.linalg.norm(offset)), high_m=MAX_TARGET_DISTANCE_M)
    _check_focus_limit(names[2], offset[2], high_m=high_m)
    reach = focus_steering_reach_m(model)
    _check_focus_limit(names[0], abs(offset[0]), high_m=reach[0])
    _check_focus_limit(names[1], abs(offset[1]), high_m=reach[1])
    check_field_points(model, target[None])


def check_focus_targets(model: AcousticModel, targets_m: FloatArray) -> None:
    """Raise as :func:`check_focus_target` unless it lets all of (T, 3) targets through.

    Thousands take the time of a few, as long as none is refused.
    """
    offsets = model.array.local_m(targets_m)
    low_m, high_m = focus_target_heights_m(model.array)
    clear = points_clear_of_elements(model, targets_m, MIN_TARGET_DISTANCE_M)
    clear &= (offsets[:, 2] >= low_m) & (offsets[:, 2] <= high_m)
    clear &= np.linalg.norm(offsets, axis=1) <= MAX_TARGET_DISTANCE_M
    clear &= (np.abs(offsets[:, :2]) <= focus_steering_reach_m(model)).all(axis=1)
    clear &= points_in_front(model, targets_m)
    for target in targets_m[~clear]:
        check_focus_target(model, target)


def _coordinate_names(model: AcousticModel) -> list[str]:
    """Return the names of x, y, z for errors; those of a rotated array include its three axes."""
    names = ["offset |x|", "offset |y|", "height z"]
    if model.array.is_upright:
        return names
    axes = (", ".join(f"{value + 0.0:g}" for value in row) for row in model.array.axes.round(3))
    return [f"{name} along the array's ({axis})" for name, axis in zip(names, axes, strict=True)]


@lru_cache(maxsize=8)
def focus_target_heights_m(array: TransducerArray) -> tuple[float, float]:
    """Return the least and the largest height of a target above the array's centre, in metres.

    It is 20 mm to 1 m. Where elements look down on others that look up (boards face to face, the
    bowls of TinyLev), a target lies anywhere between the lowest element and the highest one: each
    board has it in front of itself. Where they look at an axis from all around it (a ring), it may
    be 150 mm beyond them.

    Examples
    --------
    >>> from haptogram.acoustics.model.boards.table import LAYOUTS
    >>> focus_target_heights_m(LAYOUTS["sonicsurface"].array())
    (0.02, 1.0)
    >>> [round(1e3 * z, 1) for z in focus_target_heights_m(LAYOUTS["sonicsurface-stack"].array())]
    [-121.5, 121.5]
    """
    ahead = array.normals @ array.axes[2]
    looks_back = ahead.min() < _AGAINST
    offsets = array.positions_m - array.centre_m
    looks_inwards = np.einsum("ni,ni->", array.normals, offsets) < -_ROUNDING_M
    looks_around = mean_array_normal(array.normals) is None
    if not looks_inwards or not (looks_back or looks_around):
        return MIN_TARGET_DISTANCE_M, MAX_TARGET_DISTANCE_M
    heights = offsets @ array.axes[2]
    beyond = 0.0 if looks_back else _TARGET_MARGIN_M
    return float(heights.min()) - beyond, float(heights.max()) + beyond


def focus_steering_reach_m(model: AcousticModel) -> tuple[float, float]:
    """Return the largest |x| and |y| of a target along the array's own axes, in metres."""
    return _steering_reach_m(model.array)


@lru_cache(maxsize=8)
def _steering_reach_m(array: TransducerArray) -> tuple[float, float]:
    """Return how far from the centre a target may be along the own x and y axes.

    That is the sum of half the array, half a pitch if known, and 150 mm.
    """
    half = array.half_extent_m + (array.pitch_m or 0.0) / 2
    return float(half[0]) + _TARGET_MARGIN_M, float(half[1]) + _TARGET_MARGIN_M


def focus_phases(model: AcousticModel, target_m: ArrayLike) -> FloatArray:
    """Return the phases that make all elements arrive in phase at a target.

    Parameters
    ----------
    target_m : (3,) or (T, 3) array_like
        Target or targets, in metres.

    Returns
    -------
    (N,) or (T, N) numpy.ndarray
        phi_n = -k r_n - arg h_n, in radians, not wrapped.

    Examples
    --------
    >>> phases = focus_phases(model, target)
    >>> phases.shape, f"{abs(pressure(model, np.exp(1j * phases), [target])[0]):.0f} Pa"
    ((256,), '5399 Pa')
    """
    targets = as_float_array("target_m", target_m)
    points = as_point_array("target_m", np.atleast_2d(targets))
    # A third of the time of norm(), and (T, N) numbers at a time instead of (T, N, 3).
    squares = sum(np.square(points[:, i, None] - model.array.positions_m[:, i]) for i in range(3))
    phases: FloatArray = -model.wavenumber * np.sqrt(squares)
    if model.calibration is not None:
        phases -= model.calibration.phase_rad
    return phases[0] if targets.ndim == 1 else phases


def superpose_foci(
    model: AcousticModel, points_m: ArrayLike, amplitudes: ArrayLike, phases_rad: ArrayLike
) -> ComplexArray:
    """Return the naive superposition of several foci: the normative one.

    Parameters
    ----------
    points_m : (F, 3) array_like
        Foci, in metres.
    amplitudes, phases_rad : (F,) array_like
        a_i and psi_i.

    Returns
    -------
    (N,) numpy.ndarray of complex128
        w_n = sum_i a_i e^{j psi_i} e^{-j (k r_n(i) + arg h_n)}; magnitudes above 1 are clipped by
        :meth:`Drive.from_weights`, not here.

    Examples
    --------
    >>> both = superpose_foci(model, [target, (0.03, 0.0, 0.15)], [0.5, 0.5], [0.0, np.pi])
    >>> both.shape
    (256,)
    """
    points = as_point_array("points_m", points_m)
    levels = as_float_vector("amplitudes", amplitudes, len(points))
    lags = as_float_vector("phases_rad", phases_rad, len(points))
    weights: ComplexArray = (levels * np.exp(1j * lags)) @ np.exp(1j * focus_phases(model, points))
    return weights


def _check_focus_limit(
    name: str, value_m: float, *, low_m: float = -math.inf, high_m: float = math.inf
) -> None:
    """Refuse a target's coordinate below *low_m* or above *high_m*; the error calls it *name*."""
    if value_m < low_m - _ROUNDING_M:
        raise ConfigurationError(
            f"target: {name} is {value_m * 1e3:.6g} mm, must be at least {low_m * 1e3:.6g} mm"
        )
    if value_m > high_m + _ROUNDING_M:
        raise ConfigurationError(
            f"target: {name} is {value_m * 1e3:.6g} mm, must be at most {high_m * 1e3:.6g} mm"
        )
