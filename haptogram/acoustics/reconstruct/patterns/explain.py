"""Explanations of a set of phases by one point: a focus, a vortex or a twin trap."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from haptogram.acoustics.arrays import BoolArray, FloatArray
from haptogram.acoustics.reconstruct.patterns.fit import (
    PatternPhases,
    PatternPointFit,
    fit_pattern_point,
    pattern_azimuths,
    pattern_residual_rms,
)
from haptogram.acoustics.solvers.focus_fit import wrapped_phases

MOST_OUTLIERS: Final = 0.2  # largest share of outliers among the elements
_HOPELESS_RAD: Final = 1.35  # chance leaves 1.8; a focus with a fifth of its elements wrong, 1.0
_MOST_SPEED: Final = 0.04  # share of the speed of sound: 24 degrees
_FIRST_COUNT: Final = 40  # elements whose wide beam forgives a start that is off
_WIDENING: Final = 2.5
_TRIM_ROUNDS: Final = 4
_TWIN_ROUNDS: Final = 4
_STANDING: Final = 0.25  # distance of the heights that are tried, in wavelengths
_HEIGHTS: Final = range(-4, 5)
_LEAST_SIDE: Final = 0.3  # least share of the elements on each side of a twin trap
_LEAST_STEEPNESS: Final = 1e-9  # per metre, of the plane that tells one half from the other
_SPLIT: Final = 0.97  # least share of the elements on the correct side of the plane
_TURNS_RAD: Final = np.radians(np.arange(-24, 25))[np.argsort(np.abs(np.arange(-24, 25)))]


@dataclass(frozen=True, eq=False, slots=True)
class Explanation:
    """A point that explains most phases.

    Attributes
    ----------
    charge : int
        Turns of the phase around the axis.
    fit : PatternPointFit
        Point, axis and speed of sound; the residuals of all elements.
    used : (A,) numpy.ndarray of bool
        The elements that it explains.
    added_rad : (A,) numpy.ndarray
        Phases of the pattern relative to those of a focus.
    normal : (3,) numpy.ndarray or None
        Across the plane that splits a twin trap.
    """

    charge: int
    fit: PatternPointFit
    used: BoolArray
    added_rad: FloatArray
    normal: FloatArray | None = None


def explain_turning_pattern(
    phases: PatternPhases,
    start_m: FloatArray,
    limit_rad: float,
    *,
    charge: int = 0,
    axis_m: FloatArray | None = None,
    side: BoolArray | None = None,
    near: bool = False,
) -> Explanation | None:
    """Return the focus or vortex next to *start_m*; None if the phases are not its.

    Parameters
    ----------
    start_m : (3,) numpy.ndarray
        Along the array's own axes.
    limit_rad : float
        The largest RMS residual.
    charge : int
        0 for a focus.
    axis_m : (2,) numpy.ndarray, optional
        Where the axis of a vortex may cross the array; by default below the point.
    side : (A,) numpy.ndarray of bool, optional
        Elements that look the same way, where others look back at them.
    near : bool
        Whether the start is so near that no wide beam is needed.
    """
    start = start_m if near else _widened_pattern_fit(phases, start_m, charge, axis_m, side)
    if start is None:
        return None
    free = charge != 0

    def refit(part: PatternPhases, point: PatternPointFit) -> PatternPointFit:
        axis = point.axis_m if free else None
        return fit_pattern_point(
            part,
            point.position_m,
            charge=charge,
            axis_m=axis,
            free_axis=free,
            free_speed=True,
        )

    first = fit_pattern_point(phases, start, charge=charge, axis_m=axis_m)
    if first.rms_rad > _HOPELESS_RAD:
        return None
    used = np.ones(len(phases.phases_rad), dtype=np.bool_)
    point = refit(phases, first)
    for _ in range(_TRIM_ROUNDS):
        residual, added = _pattern_residuals(phases, point, used, charge)
        if (
            pattern_residual_rms(residual[used]) <= limit_rad
            and abs(point.speed_share) <= _MOST_SPEED
        ):
            used = np.abs(residual) <= 2.0 * limit_rad
            if used.mean() < 1.0 - MOST_OUTLIERS:
                return None
            return Explanation(charge, _pattern_with_residual(point, residual), used, added)
        deviation = np.abs(residual)
        used = deviation <= max(2.0 * limit_rad, 3.0 * float(np.median(deviation)))
        if used.mean() < 1.0 - MOST_OUTLIERS or (
            used.all() and pattern_residual_rms(residual) > limit_rad
        ):
            return None
        point = refit(phases.part(used), point)
    return None


def explain_twin_trap(
    phases: PatternPhases,
    start_m: FloatArray,
    limit_rad: float,
    axis_m: FloatArray,
    turn_rad: float,
    side: BoolArray | None = None,
) -> Explanation | None:
    """Return the twin trap next to *start_m*; None if the phases are none of one.

    Parameters
    ----------
    axis_m : (2,) numpy.ndarray
        A point of the plane that splits it, on the array.
    turn_rad : float
        Direction across that plane.
    """
    across = np.array([np.cos(turn_rad), np.sin(turn_rad)])
    flipped = (phases.positions_m[:, :2] - axis_m) @ across < 0.0
    position = start_m
    for _ in range(_TWIN_ROUNDS):
        turned = phases.turned(np.where(flipped, np.pi, 0.0))
        found = _widened_pattern_fit(turned, position, 0, None, side)
        if found is None:
            return None
        position = found
        doubled = PatternPhases(
            phases.positions_m, 2.0 * phases.phases_rad, 2.0 * phases.wavenumber
        )
        point = fit_pattern_point(doubled, position)
        again = _twin_trap_halves(phases, point.position_m)
        if np.array_equal(again, flipped) or np.array_equal(~again, flipped):
            break
        flipped, position = again, point.position_m
    normal = twin_trap_normal(phases.positions_m, again)
    if normal is None:
        return None
    added = np.where(again, np.pi, 0.0)
    found_point = explain_turning_pattern(
        phases.turned(added), point.position_m, limit_rad, near=True
    )
    if found_point is None:
        return None
    return Explanation(0, found_point.fit, found_point.used, added, normal)


def _widened_pattern_fit(
    phases: PatternPhases,
    start_m: FloatArray,
    charge: int,
    axis_m: FloatArray | None,
    side: BoolArray | None,
) -> FloatArray | None:
    """Return the place (3,), in m, of a fit to more and more elements; None above 1.35 rad RMS.

    *charge*: of a vortex, 0 for none; *axis_m* (2,): a point of its axis, None for one through the
    place. *side*: mask of the elements, of two arrays that face each other, that are fitted first;
    then all, from 9 heights a quarter wavelength apart, since minima repeat along the height.
    """
    if side is None or side.all():
        return _pattern_by_more_elements(phases, start_m, charge, axis_m)
    place = _pattern_by_more_elements(phases.part(side), start_m, charge, axis_m)
    if place is None:
        return None
    apart = np.array([0.0, 0.0, _STANDING * 2.0 * np.pi / phases.wavenumber])
    fits = [
        fit_pattern_point(phases, place + n * apart, charge=charge, axis_m=axis_m) for n in _HEIGHTS
    ]
    return min(fits, key=lambda fit: fit.rms_rad).position_m


def _pattern_by_more_elements(
    phases: PatternPhases, start_m: FloatArray, charge: int, axis_m: FloatArray | None
) -> FloatArray | None:
    """Return the place (3,), in m, fitted to 40 central elements, then to more and more.

    None once a fit is above 1.35 rad RMS. *charge*: of a vortex, 0 for none; *axis_m* (2,): a point
    of its axis, None for one through the place.
    """
    distance = np.linalg.norm(phases.positions_m - phases.positions_m.mean(axis=0), axis=1)
    order, count = np.argsort(distance, kind="stable"), _FIRST_COUNT
    position = start_m
    while count < len(order):
        part = np.zeros(len(order), dtype=np.bool_)
        part[order[:count]] = True
        fit = fit_pattern_point(phases.part(part), position, charge=charge, axis_m=axis_m)
        if fit.rms_rad > _HOPELESS_RAD:
            return None
        position, count = fit.position_m, round(_WIDENING * count)
    return position


def _pattern_residuals(
    phases: PatternPhases, point: PatternPointFit, used: BoolArray, charge: int
) -> tuple[FloatArray, FloatArray]:
    """Return (N,) each element's phase error, and the phase that a vortex adds to a focus, in rad.

    An error is the element's phase less that of the pattern; its mean over the elements *used* is
    0. *charge*: of the vortex, 0 for none.
    """
    distance = np.linalg.norm(point.position_m - phases.positions_m, axis=1)
    added = (
        charge * pattern_azimuths(phases.positions_m, point.axis_m)
        if charge
        else np.zeros(len(used))
    )
    arrival = phases.phases_rad + phases.wavenumber * (1.0 + point.speed_share) * distance - added
    common = np.angle(np.exp(1j * arrival[used]).sum())
    residual = wrapped_phases(arrival - common)
    return wrapped_phases(residual - residual[used].mean()), added


def _pattern_with_residual(point: PatternPointFit, residual: FloatArray) -> PatternPointFit:
    """Return a copy of *point* with other phase errors, *residual* (N,) in rad."""
    return PatternPointFit(point.position_m, point.axis_m, point.speed_share, residual)


def _twin_trap_halves(phases: PatternPhases, position_m: FloatArray) -> BoolArray:
    """Return a mask (N,) of the elements that arrive at *position_m* half a turn off the others."""
    distance = np.linalg.norm(position_m - phases.positions_m, axis=1)
    arrival = np.exp(1j * (phases.phases_rad + phases.wavenumber * distance))
    common = np.angle((arrival**2).sum()) / 2.0
    flipped: BoolArray = (arrival * np.exp(-1j * common)).real < 0.0
    return flipped


def twin_trap_normal(positions_m: FloatArray, flipped: BoolArray) -> FloatArray | None:
    """Return the normal of a plane with the flipped elements on one side; None: there is none."""
    if not _LEAST_SIDE <= flipped.mean() <= 1.0 - _LEAST_SIDE:
        return None
    offset = positions_m - positions_m.mean(axis=0)
    guess = np.linalg.lstsq(offset, np.where(flipped, -1.0, 1.0), rcond=1e-9)[0]
    steepness = float(np.linalg.norm(guess))
    if steepness < _LEAST_STEEPNESS:  # the halves are the same on all sides of the middle
        return None
    normals = [_turned_pattern_axis(guess / steepness, turn) for turn in _TURNS_RAD]
    shares = [_twin_trap_separated(offset @ normal, flipped) for normal in normals]
    best = int(np.argmax(shares))
    return normals[best] if shares[best] >= _SPLIT else None


def _turned_pattern_axis(vector: FloatArray, turn_rad: float) -> FloatArray:
    """Return *vector* rotated around z by *turn_rad*."""
    x, y, z = vector.tolist()
    cosine, sine = np.cos(turn_rad), np.sin(turn_rad)
    return np.array([cosine * x - sine * y, sine * x + cosine * y, z])


def _twin_trap_separated(along: FloatArray, flipped: BoolArray) -> float:
    """Return the share of elements on their right side of a plane, the best across an axis.

    *along* (N,): positions along that axis. It is right if *flipped* elements are on one side and
    the others on the other.
    """
    order = np.argsort(along)
    below = np.cumsum(flipped[order])
    count, total = np.arange(1, len(order) + 1), int(flipped.sum())
    right = len(order) - total - count + 2 * below
    return float(np.maximum(right, len(order) - right).max()) / len(order)
