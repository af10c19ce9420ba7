"""What a target asks of the field: computed once per target, used for every frame that has it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics import AcousticModel, fit_focus, focus_phases, in_front
from haptogram.acoustics.field import propagators
from haptogram.acoustics.shift import direction_covariance
from haptogram.records import Focus

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

LEAST_FRESNEL_NUMBER: Final = 3.0  # below it the focal shift is not a small one: no prediction
#: Higher orders of the focal shift, as a share of the first: 0.125 was the most in 600 targets up
#: to 250 mm over a 16 x 16 array (see `predicted_shift_m`).
PREDICTION_SHARE: Final = 0.15
#: A peak that even an ideal drive puts that far from the target is no focus in that direction.
LONGEST_SHIFT_RAD: Final = 0.5
_STENCIL_M: Final = 2e-4
_GRADIENT_STEP_M: Final = 1e-5
_ASCENTS: Final = 12
_LONGEST_STEP_RAD: Final = 0.7  # in the metric of the focus: the main lobe reaches to about 2
_SETTLED_M: Final = 2e-6
_TURNED_RATIO: Final = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Direction:
    """Where the pressure peak is looked for: a plane across the beam, or a line along it.

    Attributes
    ----------
    axes : (D, 3) numpy.ndarray
        Orthonormal.
    metric : (D, D) numpy.ndarray
        k^2 C restricted to them; C is the covariance of the unit vectors from the elements,
        weighted by the amplitudes that arrive.  A displacement e has the length
        sqrt(e^T k^2 C e), in radians of phase.
    """

    axes: Floats
    metric: Floats


@dataclass(frozen=True, slots=True, eq=False)
class TargetField:
    """One focus, in the air and over the array that the frame was really radiated in.

    Attributes
    ----------
    position_m : (3,) numpy.ndarray
        The target.
    axis : (3,) numpy.ndarray
        Unit vector from the array's centre to it.
    phases_rad : (N,) numpy.ndarray
        The phases that focus on it.
    arrivals : (N,) numpy.ndarray
        Peak pressure at the target, of each element at unit weight.
    bound_m : (3,) numpy.ndarray
        S2: sum_n |J+_in| pi / 2^b; infinite where not observable.
    directions : tuple of Direction
        In which S4 looks for the peak; those that this array can tell apart.
    fresnel_number : float
        a^2 / (wavelength * distance), a: half the width of the array where it is narrowest.
    """

    position_m: Floats
    axis: Floats
    phases_rad: Floats
    arrivals: Complexes
    bound_m: Floats
    directions: tuple[Direction, ...]
    fresnel_number: float

    @classmethod
    def of(cls, model: AcousticModel, focus: Focus, phase_bits: int) -> TargetField:
        """Return what *focus* asks of *model*, with phases of *phase_bits*."""
        position = np.array(focus.position_m)
        ray = position - model.array.centre_m
        distance_m = float(np.linalg.norm(ray))
        axis = ray / distance_m
        phases = focus_phases(model, position)
        arrivals = propagators(model, position[None, :])[0]
        fit = fit_focus(model, phases, position, phase_bits=phase_bits)
        return cls(
            position,
            axis,
            phases,
            arrivals,
            fit.bound_m,
            _directions(model, position, axis, np.abs(arrivals)),
            _half_width_m(model) ** 2 / (model.wavelength_m * distance_m),
        )

    def split(self, offset_m: Floats) -> tuple[float, float]:
        """Return the parts of an offset across and along the beam, in metres."""
        along = float(offset_m @ self.axis)
        return float(np.linalg.norm(offset_m - along * self.axis)), along


def _half_width_m(model: AcousticModel) -> float:
    half_extent_m = np.sort(model.array.half_extent_m)[-2:]  # the two of the aperture
    return float(half_extent_m[0]) + (model.array.pitch_m or 0.0) / 2.0


def _directions(
    model: AcousticModel, position: Floats, axis: Floats, loudness: Floats
) -> tuple[Direction, ...]:
    covariance = direction_covariance(model, position, loudness)
    across = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # in the plane parallel to the array
    found = []
    for axes in (across, axis[None, :]):
        metric = model.wavenumber**2 * (axes @ covariance @ axes.T)
        lengths = np.linalg.eigvalsh(metric)
        if lengths[0] > _TURNED_RATIO * model.wavenumber**2:
            found.append(Direction(axes, metric))
    return tuple(found)


def predicted_shift_m(
    model: AcousticModel, target: TargetField, amplitudes: Floats, direction: Direction
) -> Floats:
    """Return where diffraction moves the peak along *direction*, (3,), from the target.

    (k^2 C)^-1 grad ln S, S = sum_n |a_n g_n|: the first order of the focal shift, which holds with
    steering and directivity (compare Makov and Sanchez-Morcillo, arXiv 0801.1476).
    """
    steps = _GRADIENT_STEP_M * np.concatenate([direction.axes, -direction.axes])
    loudness = np.log(np.abs(propagators(model, target.position_m + steps)) @ amplitudes)
    count = len(direction.axes)
    gradient = (loudness[:count] - loudness[count:]) / (2.0 * _GRADIENT_STEP_M)
    shift: Floats = np.linalg.solve(direction.metric, gradient) @ direction.axes
    return shift


def peak_offset_m(
    model: AcousticModel, weights: Complexes, start: Floats, direction: Direction
) -> Floats:
    """Return the offset (3,) of the pressure peak next to *start*, looked for along *direction*.

    Newton steps on ln |p|^2 with derivatives from a stencil; its curvature is replaced by that of
    an ideal focus, -2 k^2 C, where the field is not convex.
    """
    axes = direction.axes
    offset = np.zeros(len(axes))
    stencil = _stencil(len(axes))
    for _ in range(_ASCENTS):
        points = start + (offset + stencil) @ axes
        if not in_front(model, points).all():
            break  # it ran away: further than any limit already
        level = 2.0 * np.log(np.abs(propagators(model, points) @ weights) + 1e-300)
        gradient, curvature = _derivatives(level, len(axes))
        if np.linalg.eigvalsh(curvature)[-1] >= 0.0:
            curvature = -2.0 * direction.metric
        step = np.linalg.solve(-curvature, gradient)
        length_rad = math.sqrt(float(step @ direction.metric @ step))
        step *= min(1.0, _LONGEST_STEP_RAD / max(length_rad, 1e-12))
        offset = offset + step
        if float(np.linalg.norm(step)) < _SETTLED_M:
            break
    found: Floats = offset @ axes
    return found


def _stencil(count: int) -> Floats:
    """Return the centre, the neighbours along each axis and, in a plane, the four corners."""
    steps = [np.zeros(count)]
    for axis in np.eye(count):
        steps += [axis, -axis]
    if count == 2:
        steps += [np.array(corner) for corner in ((1, 1), (-1, -1), (1, -1), (-1, 1))]
    return _STENCIL_M * np.array(steps)


def _derivatives(level: Floats, count: int) -> tuple[Floats, Floats]:
    plus, minus = level[1 : 1 + 2 * count : 2], level[2 : 2 + 2 * count : 2]
    gradient = (plus - minus) / (2.0 * _STENCIL_M)
    curvature = np.diag((plus - 2.0 * level[0] + minus) / _STENCIL_M**2)
    if count == 2:
        mixed = (level[5] + level[6] - level[7] - level[8]) / (4.0 * _STENCIL_M**2)
        curvature[0, 1] = curvature[1, 0] = mixed
    return gradient, curvature


def metric_length(offset_m: Floats, direction: Direction) -> float:
    """Return the length of an offset in radians of phase."""
    local = direction.axes @ offset_m
    return math.sqrt(float(local @ direction.metric @ local))
