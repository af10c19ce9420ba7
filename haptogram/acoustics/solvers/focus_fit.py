"""The fit of a focus: the point whose phases explain those of a drive best.

A focus on x has the phases phi_n = -k r_n(x) - arg h_n + psi of :mod:`.focus`, with any common psi.
"""

from __future__ import annotations

import math
import operator
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from haptogram.acoustics.arrays import BoolArray, FloatArray, as_coordinates, as_float_vector
from haptogram.acoustics.model.drive import REGISTER_BITS, phase_step_rad
from haptogram.acoustics.model.model import AcousticModel
from haptogram.errors import ConfigurationError
from haptogram.settings.arguments import check_number
from haptogram.settings.frozen import dataclass

# A direction in which moving the focus changes the phases 10 000 times less than in the best one.
# Between a planar array and the furthest target the ratio is the aperture over the distance, 1e-3.
_OBSERVABLE_RATIO: Final = 1e-4
#: Least eigenvalue of the squared slopes, of the largest, at which a direction is observable.
LEAST_SEEN_SHARE: Final = _OBSERVABLE_RATIO**2
_MAX_STEP_M: Final = 0.020
_MIN_DAMPING: Final = 1e-2
_MAX_DAMPING: Final = 1e4
_TINY_M: Final = 1e-300  # a start may lie on an element
_POINT_M: Final = 1e-6  # elements less spread than this are in one place
_ROUNDED_M: Final = 5e-6  # RMS distance from a line that rounding to whole micrometres may make


@dataclass(frozen=True, eq=False, slots=True)
class PhaseFit:
    """The point that explains a set of phases best.

    Attributes
    ----------
    position_m : (3,) numpy.ndarray
        Fitted focus, in metres.
    phase_rad : float
        Common phase psi, in (-pi, pi].
    residual_rad : (N,) numpy.ndarray
        wrap(phi_n + arg h_n + k r_n - psi) of every element, of the inactive ones too.
    residual_rms_rad : float
        Its root mean square over the active elements.
    std_m : (3,) numpy.ndarray
        Standard deviation from independent, uniform rounding errors of the phases (Cramer-Rao
        bound), in metres; infinite where not observable.
    bound_m : (3,) numpy.ndarray
        Largest deviation that rounding can cause, sum_n |J+_in| pi / 2^b, in metres; infinite where
        not observable.
    observable : (3,) numpy.ndarray of bool
        Whether the active elements tell this coordinate from the others.
    iterations : int
        Steps that were taken.
    converged : bool
        Whether the last step was below 0.1 nm.

    Examples
    --------
    >>> phases_rad = dequantise_phase(drive.phase_codes, 8)
    >>> fit = fit_focus(model, phases_rad, (0.0, 0.0, 0.14), phase_bits=8)
    >>> fit.converged, bool(fit.bound_m.max() < 1e-3)
    (True, True)
    """

    position_m: FloatArray
    phase_rad: float
    residual_rad: FloatArray
    residual_rms_rad: float
    std_m: FloatArray
    bound_m: FloatArray
    observable: BoolArray
    iterations: int
    converged: bool


def fit_focus(
    model: AcousticModel,
    phases_rad: ArrayLike,
    start_m: ArrayLike,
    *,
    phase_bits: int = REGISTER_BITS,
    step_rad: float | None = None,
    active: ArrayLike | None = None,
) -> PhaseFit:
    """Return the point that explains the phases best.

    Its place x and common phase psi minimise sum_n wrap(phi_n + arg h_n + k r_n(x) - psi)^2.
    Gauss-Newton with Levenberg-Marquardt damping. It finds the minimum next to *start_m*: on a
    16 x 16 array of 10 mm pitch, for certain from 4 mm away.

    Parameters
    ----------
    phases_rad : (N,) array_like
        Phases of the elements.
    start_m : (3,) array_like
        Where to start, in metres. A coordinate that is not observable is left where it starts.
    phase_bits : int
        Resolution of the phases, for `std_m` and `bound_m`.
    step_rad : float, optional
        The same as a step in radians, of a board whose period has another number of steps.
    active : (N,) array_like of bool, optional
        Elements to use; those with amplitude 0 say nothing about the focus. Those that do not
        radiate (gain 0) are never used.

    Raises
    ------
    ConfigurationError
        Shapes that do not fit the array, values that are not finite, no active element, or a step
        that is not within pi and a millionth of it.

    Examples
    --------
    >>> phases_rad = dequantise_phase(drive.phase_codes, 8)
    >>> fit = fit_focus(model, phases_rad, (0.0, 0.0, 0.14), phase_bits=8)
    >>> bool(np.linalg.norm(fit.position_m - target) < 0.1e-3)
    True
    """
    phases = as_float_vector("phases_rad", phases_rad, model.array.count)
    used = _as_fit_mask(active, model.array.count)
    if model.calibration is not None:
        phases = phases + model.calibration.phase_rad
        used = _as_fit_mask(used & model.calibration.heard, model.array.count)
    positions, k = model.array.positions_m, model.wavenumber
    everything = bool(used.all())
    problem = (
        PhaseProblem(positions, phases, k)
        if everything
        else PhaseProblem(positions[used], phases[used], k)
    )
    position, steps, converged = problem.solve(as_coordinates("start_m", start_m))
    own, phase, slopes = problem.residual(position)
    residual = own
    if not everything:
        arrivals = phases + k * np.linalg.norm(position - positions, axis=1)
        residual = wrapped_phases(arrivals - phase)
        own = residual[used]
    step = phase_step_rad(phase_bits) if step_rad is None else step_rad
    check_number("step_rad", step, 1e-6 * math.pi, math.pi)
    std_m, bound_m, observable = problem.uncertainty(slopes, step)
    rms = math.sqrt(float(own @ own) / len(own))
    return PhaseFit(position, phase, residual, rms, std_m, bound_m, observable, steps, converged)


def focus_phase_response(
    model: AcousticModel, position_m: ArrayLike, *, active: ArrayLike | None = None
) -> tuple[FloatArray, BoolArray]:
    """Return the displacement of the fitted focus for each radian of phase of each element.

    Parameters
    ----------
    position_m : (3,) array_like
        Focus, in metres.
    active : (N,) array_like of bool, optional
        Elements that the fit uses.

    Returns
    -------
    response : (3, N) numpy.ndarray
        -J+, J+ the pseudo-inverse of the slopes of the residuals, in m/rad; 0 for an element that
        is not used.
    observable : (3,) numpy.ndarray of bool
        Whether the active elements tell this coordinate from the others.
    """
    used = _as_fit_mask(active, model.array.count)
    if model.calibration is not None:
        used = _as_fit_mask(used & model.calibration.heard, model.array.count)
    positions = model.array.positions_m[used]
    problem = PhaseProblem(positions, np.zeros(len(positions)), model.wavenumber)
    response = np.zeros((3, model.array.count))
    response[:, used], observable = problem.response(as_coordinates("position_m", position_m))
    return response, observable


def wrapped_phases(phases_rad: FloatArray) -> FloatArray:
    """Return phases modulo 2 pi, in [-pi, pi]."""
    return phases_rad - 2.0 * np.pi * np.rint(phases_rad / (2.0 * np.pi))


class PhaseProblem:
    """The least-squares problem of one fit, with psi eliminated: three unknowns remain.

    A problem with more of them has the place first, and linearises itself.
    """

    most_steps = 32  # a fit that converges takes 4 to 8
    settled_m = 1e-10

    def __init__(self, positions_m: FloatArray, phases_rad: FloatArray, wavenumber: float) -> None:
        self._positions, self._phases = positions_m, phases_rad
        self._wavenumber = wavenumber

    def solve(self, start: FloatArray) -> tuple[FloatArray, int, bool]:
        """Return the unknowns, the number of steps, and whether they converged."""
        unknown, damping = start.copy(), 0.0
        residual, slopes = self.linearise(unknown)
        for iteration in range(1, self.most_steps + 1):
            step = self.step(slopes, residual, damping)
            step *= min(1.0, _MAX_STEP_M / max(float(np.linalg.norm(step[:3])), _MAX_STEP_M))
            candidate = unknown + step
            if np.linalg.norm(step[:3]) < self.settled_m:
                return candidate, iteration, True
            new_residual, new_slopes = self.linearise(candidate)
            if new_residual @ new_residual <= residual @ residual:
                unknown, residual, slopes = candidate, new_residual, new_slopes
                damping = damping / 10.0 if damping > _MIN_DAMPING else 0.0
            else:
                damping = max(_MIN_DAMPING, damping * 10.0)
                if damping > _MAX_DAMPING:
                    break  # no descent: a kink of the wrapped cost
        return unknown, iteration, False

    def step(self, slopes: FloatArray, residual: FloatArray, damping: float) -> FloatArray:
        """Return the Levenberg-Marquardt step within the observable directions."""
        values, vectors, kept = _focus_fit_spectrum(slopes)
        seen = vectors[:, kept]
        wanted = seen.T @ (slopes.T @ residual)
        return -seen @ (wanted / (values[kept] * (1.0 + damping)))

    def residual(self, position: FloatArray) -> tuple[FloatArray, float, FloatArray]:
        """Return the wrapped residuals, their common phase, and their slopes."""
        offset, distance = self.ray(position)
        residual, phase = centred_phases(self._phases + self._wavenumber * distance)
        return residual, math.remainder(phase, 2.0 * math.pi), self.slopes(offset, distance)

    def uncertainty(
        self, slopes: FloatArray, step_rad: float
    ) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Return std, bound and observability of each coordinate for phases rounded to a step."""
        inverse, observable = self._inverse(slopes)
        std = np.sqrt(np.diag(inverse)) * (step_rad / math.sqrt(12.0))
        bound = np.abs(inverse @ slopes.T).sum(axis=1) * (step_rad / 2.0)
        return np.where(observable, std, np.inf), np.where(observable, bound, np.inf), observable

    def response(self, position: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Return d(position)/d(phase), (3, N), and the observability of each coordinate."""
        slopes = self.slopes(*self.ray(position))
        inverse, observable = self._inverse(slopes)
        return -inverse @ slopes.T, observable

    def _inverse(self, slopes: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Return (J^T J)^-1 on the observable subspace, and a mask (3,) of observable coordinates.

        J are the *slopes* (N, 3); a coordinate counts unless 1e-6 of it lies in directions left
        out.
        """
        values, vectors, kept = _focus_fit_spectrum(slopes)
        # A coordinate is lost if the directions that were dropped contain any of it.
        observable = ((vectors[:, ~kept] ** 2).sum(axis=1) < 1e-6) & _separable_coordinates(
            self._positions
        )
        return (vectors[:, kept] / values[kept]) @ vectors[:, kept].T, observable

    def ray(self, position: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the vectors and distances from the elements to a position."""
        offset = position - self._positions
        return offset, np.sqrt(np.einsum("ni,ni->n", offset, offset))

    def slopes(self, offset: FloatArray, distance: FloatArray) -> FloatArray:
        """Return the centred Jacobian d(residual)/d(position), (N, 3)."""
        slopes: FloatArray = offset * (self._wavenumber / (distance + _TINY_M))[:, None]
        slopes -= np.add.reduce(slopes) / len(slopes)  # `mean` takes four times as long
        return slopes

    def linearise(self, unknown: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return residuals and Jacobian at the unknowns."""
        residual, _, slopes = self.residual(unknown)
        return residual, slopes


def centred_phases(arrival: FloatArray) -> tuple[FloatArray, float]:
    """Return the arrival phases less their common phase, wrapped; and that phase."""
    common = float(np.angle(np.exp(1j * arrival).sum()))
    residual = wrapped_phases(arrival - common)
    # From the circular to the least-squares mean.
    mean = float(np.add.reduce(residual)) / len(residual)
    return wrapped_phases(residual - mean), common + mean


def _focus_fit_spectrum(slopes: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return eigenvalues (3,) and eigenvectors (3, 3) of J^T J, and a mask of those that count.

    J are the *slopes* (N, 3). Eigenvalues above 1e-8 of the largest count.
    """
    values, vectors = np.linalg.eigh(slopes.T @ slopes)
    kept: BoolArray = values > max(values[-1], 1e-12) * LEAST_SEEN_SHARE
    return values, vectors, kept


def _separable_coordinates(positions: FloatArray) -> BoolArray:
    """Return a mask (3,) of coordinates that elements separate: all, unless on one line.

    Elements on one line see a whole circle around it alike, even where the slope along z is not 0:
    only a coordinate along the line is left. Elements in one point separate none.
    """
    if _are_points_off_line(
        *positions[[0, len(positions) // 2, -1]].tolist()
    ):  # most arrays, at a glance
        return np.ones(3, dtype=np.bool_)
    centred = positions - positions.mean(axis=0)
    squares, directions = np.linalg.eigh(centred.T @ centred)
    if squares[1] > len(positions) * _ROUNDED_M**2:
        return np.ones(3, dtype=np.bool_)
    along: BoolArray = (directions[:, 2] ** 2 > 1.0 - 1e-6) & (
        squares[2] > len(positions) * _ROUNDED_M**2
    )
    return along


def _are_points_off_line(a: list[float], b: list[float], c: list[float]) -> bool:
    """Return True if the points a, b, c, (3,) each, are not on one line.

    That is: b and c are 0.01 rad apart, seen from a, and over 0.1 mm away from it.
    """
    u, v = [q - p for p, q in zip(a, b, strict=True)], [q - p for p, q in zip(a, c, strict=True)]
    uu, vv, uv = math.hypot(*u) ** 2, math.hypot(*v) ** 2, sum(map(operator.mul, u, v))
    return uu * vv - uv * uv > 1e-4 * uu * vv and min(uu, vv) > (100.0 * _POINT_M) ** 2


def _as_fit_mask(active: ArrayLike | None, count: int) -> BoolArray:
    """Return a mask (count,) of active elements, all without *active*; refuse an empty one."""
    mask = np.ones(count, dtype=np.bool_) if active is None else np.asarray(active, dtype=np.bool_)
    if mask.shape != (count,):
        raise ConfigurationError(f"active has shape {mask.shape}, must be ({count},)")
    if not mask.any():
        raise ConfigurationError(f"0 of {count} elements are active, must be at least 1")
    return mask
