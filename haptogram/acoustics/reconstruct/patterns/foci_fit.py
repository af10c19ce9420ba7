"""Fit of the positions of several foci to the phases of one drive.

Whatever made them, superposition or a solver, the drive of several foci is a weighted sum of the
waves that focus on each: w_n = sum_i c_i k_n(x_i).  The fit asks the phases of all elements for the
complex weights c_i and the places x_i at once; it starts at the targets.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, NamedTuple, TypeAlias

import numpy as np

from haptogram.acoustics.arrays import BoolArray as Bools
from haptogram.acoustics.arrays import ComplexArray as Complexes
from haptogram.acoustics.arrays import FloatArray as Floats
from haptogram.acoustics.field.reference import points_with_field, propagators
from haptogram.acoustics.model.model import AcousticModel
from haptogram.acoustics.solvers.focus import focus_phases

Waves: TypeAlias = Callable[[Floats], Complexes]

_PROJECTIONS: Final = 40
_STEPS: Final = 25
_SETTLED_M: Final = 1e-7
_LONGEST_M: Final = 2e-3  # longest step of the fit
_LEAST_SEEN: Final = 1e-5  # least singular value of an observable direction, of the largest
_TINY: Final = 1e-300  # least magnitude of a sum of waves that cancel
_SEEN: Final = 1e-3  # share of a direction that is lost, and may still be in a coordinate


class FociFit(NamedTuple):
    """Several foci that explain the phases of a drive best.

    Attributes
    ----------
    offsets_m : (F, 3) numpy.ndarray
        From each target to its focus.
    bound_m : (F, 3) numpy.ndarray
        Largest error that a phase error of the given limit can make; infinite: not observable.
    residual_rad : float
        RMS phase residual of the foci; elements where the waves cancel count less.
    errors_rad : (N,) numpy.ndarray
        Phase error of each active element.
    limits_rad, wave_limits : (N,) numpy.ndarray
        Largest error of each that phase errors of the given limit can make, and that each radian
        of error of the waves can make, before they are summed.
    """

    offsets_m: Floats
    bound_m: Floats
    residual_rad: float
    errors_rad: Floats
    limits_rad: Floats
    wave_limits: Floats


def waves_of_foci_pattern(model: AcousticModel, *, superposed: bool) -> Waves:
    """Return the function from (F, 3) places in m to the (F, N) drives that focus there.

    Plain superposition drives all elements alike; solvers send back what arrives.
    """
    if superposed:
        return lambda places: np.exp(1j * focus_phases(model, places))
    return lambda places: propagators(model, places).conj()


def fit_foci(
    model: AcousticModel,
    waves: Waves,
    targets_m: Floats,
    drive: Complexes,
    active: Bools,
    phase_limit_rad: float,
    known: Complexes | None = None,
) -> FociFit | None:
    """Return the foci next to *targets_m* (F, 3) that explain the phases of *drive* (N,).

    Gauss-Newton on Im(m_n e^{-j phi_n}), m the sum of the waves: what of each element's sum is out
    of step with its phase.  Elements where the waves cancel count as little as they radiate.

    Parameters
    ----------
    known : (F,) numpy.ndarray of complex, optional
        Weights to start from; found from the drive if not given.

    Returns
    -------
    FociFit or None
        None: the fit does not settle, or leaves the space where a field is defined.
    """
    places, phasors = targets_m.copy(), np.exp(1j * np.angle(drive[active]))
    positions, count = model.array.positions_m[active], len(targets_m)
    parts = waves(places)[:, active]
    weights = _initial_foci_weights(parts, drive[active]) if known is None else known
    weights = weights / (phasors.conj() @ (weights @ parts) / len(phasors))
    for _ in range(_STEPS):
        turned = waves(places)[:, active] * phasors.conj()
        problem = _LinearisedPatternFoci.at(turned, weights, places, positions, model.wavenumber)
        step = problem.step()
        change = step[2 * count :].reshape(count, 3)
        longest = float(np.linalg.norm(change, axis=1).max())
        share = min(1.0, _LONGEST_M / max(longest, 1e-12))
        weights = weights + share * (step[:count] + 1j * step[count : 2 * count])
        places = places + share * change
        if not points_with_field(model, places).all():
            return None
        if longest < _SETTLED_M:
            bound_m = problem.bound_m(phase_limit_rad)
            errors_rad, gross = np.angle(weights @ turned), np.abs(weights) @ np.abs(turned)
            limits = phase_limit_rad * problem.left(problem.levels), problem.left(gross)
            return FociFit(places - targets_m, bound_m, problem.rms_rad, errors_rad, *limits)
    return None


def _initial_foci_weights(waves: Complexes, drive: Complexes) -> Complexes:
    """Return (F,) complex weights of foci whose summed waves have nearly the phases of *drive*.

    *waves* (F, N): the wave that each focus asks of each element.
    """
    inverse = np.linalg.pinv(waves.T, rcond=1e-9)
    phasors, level = np.exp(1j * np.angle(drive)), np.abs(drive)
    for _ in range(_PROJECTIONS):
        weights: Complexes = inverse @ (level * phasors)
        level = np.abs(weights @ waves)
        level /= max(float(level.mean()), 1e-300)
    return weights


class _LinearisedPatternFoci(NamedTuple):
    """The fit around one estimate.

    Columns of the slopes are Re c, Im c of every focus, then x, y, z of every focus.
    """

    rows: Floats  # the last one keeps the size of the sum
    residual: Floats
    levels: Floats

    @classmethod
    def at(
        cls, turned: Complexes, weights: Complexes, places: Floats, positions: Floats, k: float
    ) -> _LinearisedPatternFoci:
        """Return residuals and slopes for waves (F, N) whose phases are those of the drive less."""
        total = weights @ turned
        rays = places[:, None, :] - positions
        rays /= np.linalg.norm(rays, axis=2)[:, :, None]
        moved = (weights[:, None] * turned)[:, :, None] * (-1j * k * rays)
        slopes = np.concatenate(
            [turned, 1j * turned, moved.transpose(0, 2, 1).reshape(-1, len(total))]
        )
        size = np.sqrt(len(total)) * slopes.real.mean(axis=1)
        return cls(np.vstack([slopes.imag.T, size]), total.imag, np.abs(total))

    def step(self) -> Floats:
        """Return the change that brings the waves into step and keeps the size of their sum."""
        wanted = -np.append(self.residual, 0.0)
        step: Floats = np.linalg.lstsq(self.rows, wanted, rcond=_LEAST_SEEN)[0]
        return step

    @property
    def rms_rad(self) -> float:
        """RMS phase error, each element weighted by what it radiates."""
        return float(np.sqrt((self.residual**2).sum() / (self.levels**2).sum()))

    def left(self, errors: Floats) -> Floats:
        """Return (N,) the largest phase errors that errors of the sum (N,) leave the elements."""
        fitted = self.rows @ np.linalg.pinv(self.rows, rcond=_LEAST_SEEN)
        left = np.abs(np.eye(len(errors)) - fitted[:-1, :-1]) @ errors
        return left / np.maximum(self.levels, _TINY)

    def bound_m(self, limit_rad: float) -> Floats:
        """Return (F, 3) how far phase errors of *limit_rad* can move the foci; infinite: lost."""
        size = np.linalg.norm(self.rows, axis=0)
        size = np.where(size > 0.0, size, 1.0)
        left, values, right = np.linalg.svd(self.rows / size, full_matrices=False)
        seen = values > _LEAST_SEEN * values[0]
        lost = 1.0 - (right[seen] ** 2).sum(axis=0)  # fewer elements than unknowns lose some
        inverse = (right[seen].T / values[seen]) @ left[:, seen].T / size[:, None]
        bound = np.abs(inverse[:, :-1] * self.levels).sum(axis=1) * limit_rad
        places = slice(2 * len(size) // 5, None)
        return np.where(lost < _SEEN, bound, np.inf)[places].reshape(-1, 3)
