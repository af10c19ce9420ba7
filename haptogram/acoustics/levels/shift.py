"""The pressure maximum of a focus, and its expected distance from the target.

All elements arrive in phase at the target, so |p| there is S = sum |a_n g_n|, and no other phases
give more, unless it is in the side lobe of an element.  Yet elsewhere the elements may be louder:
S grows toward the array, the coherence falls off from the target, and the maximum of |p| lies where
the two balance.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from haptogram.acoustics.arrays import ComplexArray, FloatArray, as_coordinates, as_float_vector
from haptogram.acoustics.field import reference
from haptogram.acoustics.model.drive import as_drive
from haptogram.acoustics.model.model import AcousticModel
from haptogram.acoustics.solvers.focus import focus_phases
from haptogram.errors import ConfigurationError
from haptogram.settings.frozen import dataclass

_STENCIL_M: Final = 1e-5
_STENCIL: Final = 3e-3  # of the ends of unit rays
_MAX_STEPS: Final = 400  # a steered focus of a small aperture creeps along its ridge
_SETTLED_M: Final = 1e-7
#: A step so short leads no higher where rounding errors are larger.
AT_TOP_M: Final = 2e-4
_HALVINGS: Final = 10
_LEAST_CLIMB: Final = 0.05  # of ln |p|^2 by the slope: a quarter is due, and less overshoots
_LONGEST_SHIFT_RAD: Final = 0.2  # beyond it the second order says nothing of the maximum
_LONGEST_MIXED_RAD: Final = 0.05  # the same where some elements arrive in antiphase
_NO_SPREAD: Final = 1e-12  # least spread of the directions to the elements
_UNOBSERVABLE: Final = 1e-6  # least share of the largest eigenvalue: a line has two below it

_LEAST_CURVED: Final = 1e-9  # least curvature, relative to the largest


@dataclass(frozen=True, eq=False, slots=True)
class FocalShift:
    """Expected position of the maximum of |p|.

    Attributes
    ----------
    offset_m : (3,) numpy.ndarray
        Maximum minus target, in metres; NaN if the prediction does not hold.
    gain : float
        |p| at the maximum over |p| at the target, NaN if the prediction does not hold; the measured
        one is never above it by more than 0.1 % for a 16 x 16 array up to 200 mm.
    size_rad : float
        Length of the offset in radians of phase, sqrt(d^T k^2 C d); it decides whether the
        prediction holds. Infinite if |p| has no maximum around the target.

    Examples
    --------
    >>> shift = predict_focal_shift(model, target)
    >>> f"{1e3 * shift.offset_m[2]:.1f} mm"
    '-3.4 mm'
    """

    offset_m: FloatArray
    gain: float
    size_rad: float

    @property
    def valid(self) -> bool:
        """True if the prediction holds: `size_rad` is 0.2 at most, with side lobes 0.05."""
        return bool(np.isfinite(self.offset_m).all())


def predict_focal_shift(
    model: AcousticModel, target_m: ArrayLike, amplitudes: ArrayLike | None = None
) -> FocalShift:
    """Return the expected focal shift of an array that is focused on a target.

    To second order ln |p(t + d)| = ln S(t) + grad ln S . d - k^2 d^T C d / 2, with C the covariance
    of the unit vectors from the elements to the target, weighted by |a_n| g_n.  Its maximum is at
    d = (k^2 C)^-1 grad ln S, the gain 1 + grad ln S . d / 2.  It over-states the shift of a 16 x 16
    array by up to 5 % at 50 to 100 mm and 7 % to 150 mm.

    It holds while d is short, 0.2 rad at most in the metric k^2 C: of 5827 such shifts of random
    grids (1 to 20 elements a side, 6 to 14 mm pitch, targets at 30 to 600 mm) 99 of 100 were
    within a quarter of the true shift, of :func:`find_pressure_peak`, and so were 97 of 100 of
    those above 0.15 rad; from 0.25 to 0.3 rad it was 82 of 100.  Beyond it the maximum is
    elsewhere, or there is none: a 6 x 6 array at 400 mm would get -4066 mm, and has -285 mm.
    An element with a side lobe towards the target arrives in antiphase there: then S is the sum of
    |a_n| g_n with their signs, the shift is 0.05 rad at most, and often there is no maximum.
    Around a line of elements, where no phase tells directions apart, it holds if S is level there.

    Parameters
    ----------
    target_m : (3,) array_like
        Target, in metres.
    amplitudes : (N,) array_like, optional
        Amplitudes of the elements; 1 each if not given.

    Raises
    ------
    ConfigurationError
        As :func:`~haptogram.acoustics.propagators`, or amplitudes that do not fit the array.

    Examples
    --------
    >>> f"{1e3 * predict_focal_shift(model, target).offset_m[2]:.1f} mm"
    '-3.4 mm'
    """
    target = as_coordinates("target_m", target_m)
    count = model.array.count
    levels = (
        np.ones(count) if amplitudes is None else as_float_vector("amplitudes", amplitudes, count)
    )
    stencil = target + _STENCIL_M * np.concatenate([np.zeros((1, 3)), np.eye(3), -np.eye(3)])
    in_phase = np.exp(1j * focus_phases(model, stencil))
    shares = (reference.propagators(model, stencil) * in_phase).real * np.abs(levels)
    if not np.abs(shares).sum(axis=1).min() > 0.0:
        raise ConfigurationError("no element is heard at the target")
    shares *= np.sign(shares[0].sum())
    sums = shares.sum(axis=1)
    if not sums.min() > 0.0:
        return FocalShift(np.full(3, math.nan), math.nan, math.inf)
    slope = (np.log(sums[1:4]) - np.log(sums[4:7])) / (2.0 * _STENCIL_M)
    spread, ways = np.linalg.eigh(focal_shift_covariance(model, target, shares[0]))
    least = max(_UNOBSERVABLE * float(np.abs(spread).max()), _NO_SPREAD)
    seen = spread > least
    floor = np.where(seen, spread, least)
    steps = (ways.T @ slope) / (model.wavenumber**2 * floor)
    size = model.wavenumber * math.sqrt(float(floor @ steps**2))
    if spread[0] < -least:  # |p| grows from the target on: it is no maximum
        size = math.inf
    offset = ways[:, seen] @ steps[seen]
    if size > (_LONGEST_SHIFT_RAD if shares[0].min() >= 0.0 else _LONGEST_MIXED_RAD):
        offset = np.full(3, math.nan)
    return FocalShift(offset, 1.0 + float(slope @ offset) / 2.0, size)


def focal_shift_covariance(
    model: AcousticModel, target_m: FloatArray, shares: FloatArray
) -> FloatArray:
    """Return C, the (3, 3) covariance of the unit vectors from the elements to the target.

    Parameters
    ----------
    target_m : (3,) numpy.ndarray
        Target, in metres.
    shares : (N,) numpy.ndarray
        Weight of each element, not all zero.
    """
    rays = target_m - model.array.positions_m
    rays = rays / np.linalg.norm(rays, axis=1)[:, None]
    weights = shares / shares.sum()
    centred = rays - weights @ rays
    covariance: FloatArray = (centred * weights[:, None]).T @ centred
    return covariance


def find_pressure_peak(
    engine: reference.FieldEngine, weights: ArrayLike, start_m: ArrayLike
) -> FloatArray:
    """Return the local maximum of |p| next to a point, by Newton's method on ln |p|^2.

    Parameters
    ----------
    engine : FieldEngine
        Engine of the field; the search itself is in double precision.
    weights : (N,) array_like of complex
        One drive.
    start_m : (3,) array_like
        Where to start, in metres: within the main lobe.

    Returns
    -------
    (3,) numpy.ndarray
        Position of the maximum, in metres.

    Raises
    ------
    ConfigurationError
        A start that has no field (:func:`~haptogram.acoustics.pressure`) or no sound; no
        maximum within 400 steps, each of at most a quarter of a wavelength, or before the field
        rises up to the array itself: the search keeps 1 mm away from every element.

    Examples
    --------
    >>> peak = find_pressure_peak(engine, weights, target)
    >>> bool(peak[2] < target[2])  # diffraction pulls the maximum towards the array
    True
    """
    model = engine.model
    drive = as_drive(weights, model.array.count)
    start = as_coordinates("start_m", start_m)
    if not abs(reference.pressure(model, drive, start[None])[0]) > 0.0:
        raise ConfigurationError(f"no sound at {start.tolist()} m")
    longest = model.wavelength_m / 4.0

    def step_of(here: PressureLevel) -> FloatArray:
        step = here.ascent
        return step * min(1.0, longest / max(float(np.linalg.norm(step)), longest))

    offset = climb_to_pressure_peak(
        model, drive, start, np.eye(3), step_of, settled_m=_SETTLED_M, most_steps=_MAX_STEPS
    )
    if offset is None:
        raise ConfigurationError(
            f"no maximum of |p| next to {start.tolist()} m: the field rises up to the array, or "
            f"the search has found none in {_MAX_STEPS} steps"
        )
    return start + offset


def climb_to_pressure_peak(
    model: AcousticModel,
    weights: ComplexArray,
    start_m: FloatArray,
    axes: FloatArray,
    step_of: Callable[[PressureLevel], FloatArray],
    *,
    settled_m: float,
    most_steps: int,
) -> FloatArray | None:
    """Return (D,) the offset of the pressure peak next to *start_m* along (D, 3) *axes*.

    A step that hardly climbs is halved: far from the peak the second order leads beyond it.

    Parameters
    ----------
    step_of : callable
        Returns the step (D,) to try from a level.
    settled_m : float
        Length of a step that is the last one.

    Returns
    -------
    (D,) numpy.ndarray or None
        None: the ascent leads to the elements or behind them, or does not settle.
    """
    offset, here = np.zeros(len(axes)), PressureLevel.at(model, weights, start_m, axes)
    for _ in range(most_steps):
        if here is None:
            return None
        step = step_of(here)
        if float(np.linalg.norm(step)) < settled_m:
            return offset + step
        for halving in range(_HALVINGS):
            part = 0.5**halving * step
            there = PressureLevel.at(model, weights, start_m + (offset + part) @ axes, axes)
            least = math.exp(_LEAST_CLIMB * min(float(here.gradient @ part), 1.0))
            if there is not None and there.level > least * here.level:
                break
        else:  # at the edge of the field, or at the top, as far as rounding errors can tell
            is_top = there is not None and float(np.linalg.norm(step)) < AT_TOP_M
            return offset if is_top else None
        offset, here = offset + part, there
    return None


@dataclass(frozen=True, slots=True, eq=False)
class PressureLevel:
    """L = ln |p|^2 and its derivatives along D axes; the waves (N,) and slopes (D, N) of p."""

    pressure: complex
    waves: ComplexArray
    slopes: ComplexArray
    gradient: FloatArray
    curvature: FloatArray

    @classmethod
    def at(
        cls, model: AcousticModel, weights: ComplexArray, place_m: FloatArray, axes: FloatArray
    ) -> PressureLevel | None:
        """Return those at a place; None at an element, behind the array or without sound.

        A wave is q = g m, the gain g by direction and m = e^{(jk - absorption) r} / r by distance.
        """
        around_m = place_m + _STENCIL_M * np.concatenate([0.0 * axes[:1], axes, -axes])
        try:
            reference.check_field_points(model, around_m)
        except ConfigurationError:  # within 1 mm of an element, at the plane of the array or behind
            return None
        rays_m = place_m - model.array.positions_m
        r = np.sqrt(np.einsum("ni,ni->n", rays_m, rays_m))
        rays = rays_m / r[:, None]
        strength = math.sqrt(2.0) * model.transducer.source_strength_pa_m
        rate = complex(-model.medium.absorption_np_m, model.wavenumber)
        m = model.radiated(weights) * (strength * np.exp(rate * r) / r)
        gain, turn, bend = _gain_derivatives(model, rays, axes)
        waves = m * gain
        pressure = complex(waves.sum())
        if not abs(pressure) > 0.0:
            return None
        cosines, steep = axes @ rays.T, rate - 1.0 / r  # steep: of ln m, along the ray
        turn, bend = turn / r, bend / r**2
        both = cosines[:, None] * cosines
        apart = (np.eye(len(axes))[:, :, None] - both) / r
        across = cosines[:, None] * turn
        slopes = m * (steep * cosines * gain + turn)
        bends = gain * ((steep**2 + 1.0 / r**2) * both + steep * apart)
        bends = m * (bends + steep * (across + across.swapaxes(0, 1)) + bend)
        first = slopes.sum(axis=1) / pressure
        second = bends.sum(axis=2) / pressure - np.outer(first, first)
        return cls(pressure, waves, slopes, 2.0 * first.real, 2.0 * second.real)

    @property
    def ascent(self) -> FloatArray:
        """(D,) the Newton step to the peak; its sign is turned where L curves upwards."""
        values, vectors = np.linalg.eigh(self.curvature)
        floor = max(float(np.abs(values).max()), 1e-12) * 1e-6
        step: FloatArray = vectors @ (
            (vectors.T @ self.gradient) / np.maximum(np.abs(values), floor)
        )
        return step

    @property
    def level(self) -> float:
        """|p|, which grows with L."""
        return abs(self.pressure)

    @property
    def is_peak(self) -> bool:
        """True if the curvature is that of a peak, in every direction."""
        values = np.linalg.eigvalsh(self.curvature)
        return bool(values[-1] < _LEAST_CURVED * values[0] < 0.0)


def _gain_derivatives(
    model: AcousticModel, rays: FloatArray, axes: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return gains (N,) along *rays* (N, 3), their first (D, N) and second derivatives (D, D, N).

    Derivatives are by how far the end of a unit ray moves along *axes* (D, 3): differences of the
    fourth order. An element whose gain is 0 at any of those places has derivatives of 0.
    """
    count = len(axes)
    pairs = [(i, j) for i in range(count) for j in range(i, count)]
    ways = np.array([axes[i] if i == j else axes[i] + axes[j] for i, j in pairs])
    moves = _STENCIL * np.array([0.0, -2.0, -1.0, 1.0, 2.0])
    ends = rays + moves[:, None, None, None] * ways[:, None, :]
    ends = ends.reshape(-1, *rays.shape)
    lengths = np.sqrt(np.einsum("mni,mni->mn", ends, ends))
    gains = reference.field_gain(model, tuple(np.moveaxis(ends, 2, 0)), lengths)
    gains = np.where((gains == 0.0).any(axis=0), gains[0], gains).reshape(5, len(ways), -1)
    middle, *around = gains
    twice_down, down, up, twice_up = around
    slope = (8.0 * (up - down) - (twice_up - twice_down)) / (12.0 * _STENCIL)
    bend = 16.0 * (up + down) - (twice_up + twice_down) - 30.0 * middle
    bend /= 12.0 * _STENCIL**2
    bends = np.empty((count, count, len(rays)))
    own = [pairs.index((i, i)) for i in range(count)]
    for (i, j), along in zip(pairs, bend, strict=True):
        mixed = along if i == j else (along - bend[own[i]] - bend[own[j]]) / 2.0
        bends[i, j] = bends[j, i] = mixed
    return middle[0], slope[own], bends
