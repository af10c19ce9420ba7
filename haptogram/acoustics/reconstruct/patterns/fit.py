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
from haptogram.acoustics.solvers.focus_fit import PhaseProblem, centred_phases

#: Weight of a share of the speed of sound: 0.01, 6 degrees or 3.5 m/s, costs as much as 0.1 rad.
_UNLIKELY_RAD: Final = 0.1 / 0.01


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
    return np.arctan2(offset[:, 1], offset[:, 0])


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
    return problem.fitted(start_m)


class _PatternProblem(PhaseProblem):
    """Unknowns: x, y, z; then the axis, if it is free; then the speed, if it is."""

    most_steps = 24
    settled_m = 1e-8

    def __init__(
        self,
        phases: PatternPhases,
        charge: int,
        axis_m: FloatArray | None,
        free_axis: bool,
        free_speed: bool,
    ) -> None:
        super().__init__(phases.positions_m, phases.phases_rad, phases.wavenumber)
        self._charge = charge
        self._axis = axis_m
        self._free_axis = free_axis and charge != 0
        self._free_speed = free_speed

    def fitted(self, start_m: FloatArray) -> PatternPointFit:
        """Return the point next to *start_m*."""
        axis = start_m[:2] if self._axis is None else self._axis
        free = [axis] * self._free_axis + [np.zeros(1)] * self._free_speed
        unknown, _, _ = self.solve(np.concatenate([start_m, *free]))
        residual = self.linearise(unknown)[0][: len(self._phases)]
        return PatternPointFit(
            unknown[:3], self._axis_at(unknown), self._speed_at(unknown), residual
        )

    def _axis_at(self, unknown: FloatArray) -> FloatArray:
        """Return x and y (m) of the pattern's axis for a vector of unknowns.

        The axis if it is free or given; else that through the place.
        """
        if self._free_axis:
            return unknown[3:5]
        return unknown[:2] if self._axis is None else self._axis

    def _speed_at(self, unknown: FloatArray) -> float:
        """Return the relative change of the sound speed for a vector of unknowns; 0 if fixed."""
        return float(unknown[-1]) if self._free_speed else 0.0

    def step(self, slopes: FloatArray, residual: FloatArray, damping: float) -> FloatArray:
        """Return the step; close to the array the slopes along z are small, and count as much."""
        scale = np.sqrt(np.maximum((slopes**2).sum(axis=0), 1e-30))
        step: FloatArray = super().step(slopes / scale, residual, damping) / scale
        return step

    def linearise(self, unknown: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return residuals and Jacobian; a row more if the speed is free: how unlikely it is."""
        offset, distance = self.ray(unknown[:3])
        speed = self._speed_at(unknown)
        arrival = self._phases + self._wavenumber * (1.0 + speed) * distance
        if self._charge:
            arrival -= self._charge * pattern_azimuths(self._positions, self._axis_at(unknown))
        residual, _ = centred_phases(arrival)
        columns = [self.slopes(offset, distance)]
        if self._free_axis:
            across = self._positions[:, :2] - unknown[3:5]
            square = np.maximum((across**2).sum(axis=1), 1e-6)[:, None]
            turn = self._charge * np.stack([-across[:, 1], across[:, 0]], axis=1) / square
            columns.append(turn - turn.mean(axis=0))
        if self._free_speed:
            columns.append(self._wavenumber * (distance - distance.mean())[:, None])
        slopes = np.concatenate(columns, axis=1)
        if not self._free_speed:
            return residual, slopes
        unlikely = np.append(np.zeros(slopes.shape[1] - 1), _UNLIKELY_RAD)
        return np.append(residual, _UNLIKELY_RAD * speed), np.vstack([slopes, unlikely])
