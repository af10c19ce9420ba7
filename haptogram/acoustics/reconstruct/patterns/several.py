"""Several foci in one drive, found one after the other without knowing how many there are."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, TypeAlias

import numpy as np

from haptogram.acoustics.arrays import BoolArray, ComplexArray, FloatArray
from haptogram.acoustics.field.reference import points_with_field, propagators
from haptogram.acoustics.model.model import AcousticModel
from haptogram.acoustics.reconstruct.estimates import as_vector
from haptogram.acoustics.reconstruct.patterns.chance import are_beyond_chance
from haptogram.acoustics.reconstruct.patterns.foci_fit import (
    FociFit,
    Waves,
    fit_foci,
    waves_of_foci_pattern,
)
from haptogram.acoustics.reconstruct.patterns.found import SeveralFoci
from haptogram.acoustics.solvers.focus import focus_phases

MOST_FOCI: Final = 8
_ELEMENTS_A_FOCUS: Final = 36  # seven for each of its five unknowns
_LOOKED_AT: Final = 24
_APART: Final = 0.7  # least distance of two foci, in wavelengths
_LEAST_SHARE: Final = 0.2  # least amplitude, of the strongest focus: fainter ones are side lobes
_CLIMBS: Final = 6
_CLIMB_M: Final = 4e-3
_SLACK_RAD: Final = 0.06  # phase error of air that differs a little
_ROUNDING: Final = 0.36  # RMS error of the phases in steps: rounding and cutting off leave 0.29
_EXPLAINED: Final = 0.6  # least share of energy: phases of any foci leave 0.22, of near ones less
_A_FOCUS_EXPLAINS: Final = 0.08  # least share of energy of the first few foci: chance gives 0.05


#: Returns at most so many points where most of (N,) weights arrives, the strongest first.
Loudest: TypeAlias = Callable[[ComplexArray, int], list[FloatArray]]


def find_foci_pattern(
    model: AcousticModel,
    drive: ComplexArray,
    active: BoolArray,
    loudest: Loudest,
    step_rad: float,
) -> SeveralFoci | None:
    """Return the several foci that explain the phases of *drive*; None if none do.

    The loudest point comes first. What the foci so far do not explain says where the next one is.
    """
    phasors = np.where(active, np.exp(1j * np.angle(drive)), 0.0)
    most = min(MOST_FOCI, max(2, int(active.sum()) // _ELEMENTS_A_FOCUS))
    places = np.empty((0, 3))
    rest = phasors
    for _ in range(most):
        place = _next_pattern_focus(model, rest, places, loudest)
        if place is None:
            return None
        places = np.concatenate([places, place[None]])
        rest = _unexplained_by_pattern(model, phasors, active, places)
        explained = 1.0 - float(np.mean(np.abs(rest[active]) ** 2))
        if explained < _A_FOCUS_EXPLAINS * len(places):
            return None
        if len(places) > 1 and explained >= _EXPLAINED:
            found = _fitted_foci_pattern(model, drive, active, places, step_rad)
            if found is not None:
                return found
    return None


def _next_pattern_focus(
    model: AcousticModel, rest: ComplexArray, places: FloatArray, loudest: Loudest
) -> FloatArray | None:
    """Return the loudest point (3,), in m, of *rest* away from the known *places*; None if none.

    *rest* (N,): phasors that the places leave unexplained of a drive. Away is more than 0.7
    wavelengths; 24 points of *loudest* are tried, from each a climb.
    """
    apart = _APART * model.wavelength_m
    for cell in loudest(rest, _LOOKED_AT):
        place = _climb_to_pattern_focus(model, rest, cell)
        if not len(places) or np.linalg.norm(places - place, axis=1).min() > apart:
            return place
    return None


def _climb_to_pattern_focus(
    model: AcousticModel, drive: ComplexArray, start_m: FloatArray
) -> FloatArray:
    """Return the pressure maximum (3,), in m, reached from *start_m* by ever smaller steps."""
    ways = np.concatenate([np.eye(3), -np.eye(3), np.zeros((1, 3))])
    place, step_m = start_m, _CLIMB_M
    for _ in range(3 * _CLIMBS):
        tried = place + step_m * ways
        level = np.abs(np.exp(-1j * focus_phases(model, tried)) @ drive)
        best = int(level.argmax())
        if best == len(ways) - 1:
            step_m /= 2.0
            if step_m < _CLIMB_M / 2**_CLIMBS:
                break
        place = tried[best]
    return place


def _unexplained_by_pattern(
    model: AcousticModel, phasors: ComplexArray, active: BoolArray, places: FloatArray
) -> ComplexArray:
    """Return (N,) what the best sum of waves from foci at *places* leaves of the phasors.

    The best sum has the least squares; inactive elements get 0.
    """
    waves = np.exp(1j * focus_phases(model, places))[:, active].T
    weights = np.linalg.lstsq(waves, phasors[active], rcond=1e-6)[0]
    rest = np.zeros_like(phasors)
    rest[active] = phasors[active] - waves @ weights
    return rest


def _fitted_foci_pattern(
    model: AcousticModel,
    drive: ComplexArray,
    active: BoolArray,
    places: FloatArray,
    step_rad: float,
) -> SeveralFoci | None:
    """Return the foci next to *places* that explain the phases beyond chance; else None.

    Their RMS residual is at most 0.36 of *step_rad* plus 0.06 rad.
    """
    if not points_with_field(model, places).all():
        return None
    limit_rad = _ROUNDING * step_rad + _SLACK_RAD
    for superposed in (True, False):
        waves = waves_of_foci_pattern(model, superposed=superposed)
        fit = _foci_fit_or_none(model, waves, places, drive, active, step_rad / 2.0)
        if fit is None or fit.residual_rad > limit_rad:
            continue
        if are_beyond_chance(len(places), int(active.sum()), fit.residual_rad, step_rad):
            return _foci_as_pattern(model, drive, places + fit.offsets_m, fit)
    return None


def _foci_fit_or_none(
    model: AcousticModel,
    waves: Waves,
    places: FloatArray,
    drive: ComplexArray,
    active: BoolArray,
    limit_rad: float,
) -> FociFit | None:
    """Return a fit of foci, from *places* (F, 3) on, to the phases of *drive*; None if singular.

    *limit_rad*: the phase error for which the fit states the bounds of the places.
    """
    try:
        return fit_foci(model, waves, places, drive, active, limit_rad)
    except np.linalg.LinAlgError:  # an SVD that does not converge: no fit
        return None


def _foci_as_pattern(
    model: AcousticModel, drive: ComplexArray, places: FloatArray, fit: FociFit
) -> SeveralFoci | None:
    """Return a multi-focus pattern, strongest focus first; None if the foci are not distinct.

    They are if 0.7 wavelengths apart, in the field, and each at least 0.2 of the strongest.
    """
    apart = np.linalg.norm(places[:, None] - places, axis=2) + 1e3 * np.eye(len(places))
    if apart.min() < _APART * model.wavelength_m or not points_with_field(model, places).all():
        return None
    level = np.abs(propagators(model, places) @ drive)
    order = np.argsort(-level)
    shares = level[order] / level[order[0]]
    if shares[-1] < _LEAST_SHARE:
        return None
    return SeveralFoci(
        tuple(as_vector(places[n]) for n in order),
        tuple(as_vector(fit.bound_m[n]) for n in order),
        tuple(float(share) for share in shares),
        fit.residual_rad,
    )
