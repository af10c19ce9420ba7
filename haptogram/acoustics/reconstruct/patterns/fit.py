"""The fit of one point to phases, with the phases of a pattern around an axis taken out.

phi_n + k (1 + s) r_n(x) - l theta_n(c) = psi: a place x, a common phase psi, a share s by which the
speed of sound may differ, and for a vortex of charge l the point c that its axis goes through.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from haptogram.acoustics.arrays import BoolArray, FloatArray
from haptogram.acoustics.solvers.focus_fit import wrapped_phases

#: Standard deviation of the speed of sound that a fit takes for likely: 6 degrees, or 3.5 m/s.
SPEED_SHARE: Final = 0.01
_STEPS: Final = 24
_SETTLED_M: Final = 1e-8
_LONGEST_M: Final = 0.020
_SEEN: Final = 1e-4  # least singular value of an observable direction, relative to the largest
_MAX_DAMPING: Final = 1e4


@dataclass(frozen=True, eq=False, slots=True)
class PatternPhases:
    """Phases of the elements that radiate.

    Attributes
    ----------
    positions_m : (A, 3) numpy.ndarray
        Places of the elements, along the array's own axes from its centre.
    phases_rad : (A,) numpy.ndarray
        Their phases.
    wavenumber : float
        k, in rad/m.
    """

    positions_m: FloatArray
    phases_rad: FloatArray
    wavenumber: float

    def part(self, used: BoolArray) -> PatternPhases:
        """Return those of some elements."""
        return PatternPhases(self.positions_m[used], self.phases_rad[used], self.wavenumber)

    def turned(self, added_rad: FloatArray) -> PatternPhases:
        """Return these phases plus others."""
        return PatternPhases(self.positions_m, self.phases_rad + added_rad, self.wavenumber)


@dataclass(frozen=True, eq=False, slots=True)
class PatternPointFit:
    """A point that explains phases.

    Attributes
    ----------
    position_m : (3,) numpy.ndarray
        Along the array's own axes.
    axis_m : (2,) numpy.ndarray
        Where the axis of a vortex crosses the array's x and y.
    speed_share : float
        s: the phases suit a speed of sound lower by this share.
    residual_rad : (A,) numpy.ndarray
        Phase error of each element.
    """

    position_m: FloatArray
    axis_m: FloatArray
    speed_share: float
    residual_rad: FloatArray

    @property
    def rms_rad(self) -> float:
        """Root mean square of the residual."""
        return pattern_residual_rms(self.residual_rad)


def pattern_residual_rms(values: FloatArray) -> float:
    """Return the root mean square."""
    return math.sqrt(float(values @ values) / len(values))


def pattern_azimuths(positions_m: FloatArray, axis_m: FloatArray) -> FloatArray:
    """Return (A,) the angles of elements around an axis along the array's z."""
    offset = positions_m[:, :2] - axis_m
    angles: FloatArray = np.arctan2(offset[:, 1], offset[:, 0])
    return angles


def fit_pattern_point(
    phases: PatternPhases,
    start_m: FloatArray,
    *,
    charge: int = 0,
    axis_m: FloatArray | None = None,
    free_axis: bool = False,
    free_speed: bool = False,
) -> PatternPointFit:
    """Return the point next to *start_m* that explains the phases best.

    Gauss-Newton with Levenberg-Marquardt damping.

    Parameters
    ----------
    charge : int
        Charge of a vortex, 0 for none.
    axis_m : (2,) numpy.ndarray, optional
        Point of its axis; by default below the point that is sought.
    free_axis, free_speed : bool
        Whether axis and speed of sound are fitted as well.
    """
    problem = _PatternProblem(phases, charge, axis_m, free_axis, free_speed)
    return problem.solve(start_m)


def pattern_place_uncertainty(
    phases: PatternPhases, position_m: FloatArray, step_rad: float
) -> tuple[FloatArray, FloatArray]:
    """Return (3,) standard deviation and (3,) bound of a fitted place for phases of that step.

    Infinite along a direction that the phases do not tell.
    """
    slopes = _pattern_slopes(phases, position_m)
    left, values, right = np.linalg.svd(slopes, full_matrices=False)
    seen = values > _SEEN * max(values[0], 1e-9)
    inverse = (right[seen].T / values[seen]) @ left[:, seen].T
    lost = 1.0 - (right[seen] ** 2).sum(axis=0) > 1e-6
    std = np.linalg.norm(inverse, axis=1) * step_rad / math.sqrt(12.0)
    bound = np.abs(inverse).sum(axis=1) * step_rad / 2.0
    return np.where(lost, np.inf, std), np.where(lost, np.inf, bound)


def _pattern_slopes(phases: PatternPhases, position_m: FloatArray) -> FloatArray:
    """Return (A, 3) centred derivatives of the phases with respect to position."""
    rays = position_m - phases.positions_m
    rays = rays * (phases.wavenumber / np.maximum(np.linalg.norm(rays, axis=1), 1e-9))[:, None]
    slopes: FloatArray = rays - rays.mean(axis=0)
    return slopes


class _PatternProblem:
    """Unknowns: x, y, z; then the axis, if it is free; then the speed, if it is."""

    def __init__(
        self,
        phases: PatternPhases,
        charge: int,
        axis_m: FloatArray | None,
        free_axis: bool,
        free_speed: bool,
    ) -> None:
        self._phases = phases
        self._charge = charge
        self._axis = axis_m
        self._free_axis = free_axis and charge != 0
        self._free_speed = free_speed

    def solve(self, start_m: FloatArray) -> PatternPointFit:
        unknown = self._start(start_m)
        residual, cost = self._residual(unknown)
        slopes, damping = self._jacobian(unknown), 0.0
        for _ in range(_STEPS):
            step = self._step(slopes, residual, unknown, damping)
            candidate = unknown + step
            left, reached = self._residual(candidate)
            if reached <= cost:
                unknown, residual, cost = candidate, left, reached
                if np.abs(step[:3]).max() < _SETTLED_M:
                    break
                slopes, damping = self._jacobian(unknown), damping / 10.0
            else:
                damping = max(1e-2, damping * 10.0)
                if damping > _MAX_DAMPING:
                    break
        speed = float(unknown[-1]) if self._free_speed else 0.0
        return PatternPointFit(unknown[:3], self._axis_at(unknown), speed, residual)

    def _start(self, start_m: FloatArray) -> FloatArray:
        """Return the initial parameter vector: position, axis and relative sound speed."""
        axis = start_m[:2] if self._axis is None else self._axis
        parts = [start_m]
        if self._free_axis:
            parts.append(axis)
        if self._free_speed:
            parts.append(np.zeros(1))
        return np.concatenate(parts)

    def _axis_at(self, unknown: FloatArray) -> FloatArray:
        if self._free_axis:
            return unknown[3:5]
        return unknown[:2] if self._axis is None else self._axis

    def _residual(self, unknown: FloatArray) -> tuple[FloatArray, float]:
        """Return the residuals, and the cost including the prior of the sound speed."""
        phases = self._phases
        distance = np.linalg.norm(unknown[:3] - phases.positions_m, axis=1)
        speed = unknown[-1] if self._free_speed else 0.0
        arrival = phases.phases_rad + phases.wavenumber * (1.0 + speed) * distance
        if self._charge:
            arrival = arrival - self._charge * pattern_azimuths(
                phases.positions_m, self._axis_at(unknown)
            )
        residual = wrapped_phases(arrival - np.angle(np.exp(1j * arrival).sum()))
        residual = wrapped_phases(residual - residual.mean())
        return residual, float(residual @ residual) + self._prior * speed**2

    @property
    def _prior(self) -> float:
        """Weight of the sound speed prior: SPEED_SHARE costs as much as 0.1 rad of phase error."""
        return (0.1 / SPEED_SHARE) ** 2 if self._free_speed else 0.0

    def _jacobian(self, unknown: FloatArray) -> FloatArray:
        phases = self._phases
        columns = [_pattern_slopes(phases, unknown[:3])]
        if self._free_axis:
            offset = phases.positions_m[:, :2] - unknown[3:5]
            square = np.maximum((offset**2).sum(axis=1), 1e-6)[:, None]
            turn = self._charge * np.stack([-offset[:, 1], offset[:, 0]], axis=1) / square
            columns.append(turn - turn.mean(axis=0))
        if self._free_speed:
            distance = np.linalg.norm(unknown[:3] - phases.positions_m, axis=1)
            columns.append(phases.wavenumber * (distance - distance.mean())[:, None])
        return np.concatenate(columns, axis=1)

    def _step(
        self, slopes: FloatArray, residual: FloatArray, unknown: FloatArray, damping: float
    ) -> FloatArray:
        """Return the Levenberg-Marquardt step."""
        square, wanted = slopes.T @ slopes, slopes.T @ residual
        if self._free_speed:
            square[-1, -1] += self._prior
            wanted[-1] += self._prior * unknown[-1]
        scale = np.sqrt(np.maximum(np.diag(square), 1e-30))
        scaled = square / np.outer(scale, scale)
        values, vectors = np.linalg.eigh(scaled)
        seen = vectors[:, values > _SEEN**2 * values[-1]]
        kept = values[values > _SEEN**2 * values[-1]]
        step: FloatArray = (
            -(seen @ ((seen.T @ (wanted / scale)) / (kept * (1.0 + damping)))) / scale
        )
        longest = float(np.linalg.norm(step[:3]))
        return step * min(1.0, _LONGEST_M / max(longest, _LONGEST_M))
