"""The pressure field of a driven array.

p(x) = sum_n w_n h_n sqrt(2) P1 D(theta_n) e^{(j k - alpha) r_n} / r_n, a peak phasor in pascals;
theta_n is the angle to the element's own normal, h_n its response (1 without a calibration). Linear
acoustics, free field, no scattering.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Final, Protocol, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from haptogram.acoustics.arrays import BoolArray, ComplexArray, FloatArray, as_point_array
from haptogram.acoustics.memory import check_array_memory, memory_chunks
from haptogram.acoustics.model.drive import as_drive, as_drives
from haptogram.acoustics.model.model import AcousticModel
from haptogram.errors import ConfigurationError

if TYPE_CHECKING:
    from haptogram.acoustics.model.directivities import OrientedDirectivity

MIN_DISTANCE_M: Final = 1e-3
_POINTS_PER_CHUNK: Final = 1 << 14  # points of a chunk: some 0.1 ms, so that Ctrl-C is heard
_PAIRS_PER_CHUNK: Final = 1 << 13  # pairs of a chunk: temporaries of 64 kB stay in the cache


class FieldEngine(Protocol):
    """Something that computes the field; :class:`NumpyEngine` is the reference.

    Examples
    --------
    >>> field: FieldEngine = choose_engine(model)
    >>> field.pressure(weights, [target]).shape
    (1,)
    """

    @property
    def model(self) -> AcousticModel:
        """The model whose field this is."""

    def pressure(self, weights: ArrayLike, points_m: ArrayLike) -> ComplexArray:
        """Return the result of :func:`pressure` for the model of this engine."""


class NumpyEngine:
    """The reference engine: float64 throughout, no precomputation.

    Examples
    --------
    >>> f"{abs(NumpyEngine(model).pressure(weights, [target])[0]):.0f} Pa"
    '5399 Pa'
    """

    def __init__(self, model: AcousticModel) -> None:
        self._model = model

    @property
    def model(self) -> AcousticModel:
        """The model whose field this is."""
        return self._model

    def pressure(self, weights: ArrayLike, points_m: ArrayLike) -> ComplexArray:
        """Return the result of :func:`pressure` for the model of this engine."""
        return pressure(self._model, weights, points_m)


def propagators(model: AcousticModel, points_m: ArrayLike) -> ComplexArray:
    """Return the pressure that each element at unit weight makes at each point.

    Parameters
    ----------
    points_m : (M, 3) array_like
        Points, in metres. A baffled element gives 0 behind it; others must be in front of them.

    Returns
    -------
    (M, N) numpy.ndarray of complex128
        Peak pressure, in pascals.

    Raises
    ------
    ConfigurationError
        A point that is not finite, closer than 1 mm to an element, or behind all of them if they
        are baffled; a result of more than half of the memory.

    Examples
    --------
    >>> field = propagators(model, [target]) @ weights
    >>> bool(np.allclose(field, pressure(model, weights, [target])))
    True
    """
    points = as_point_array("points_m", points_m)
    check_array_memory("a matrix", (len(points), model.array.count), 16)
    check_field_points(model, points)
    return _field_propagators(model, points)


def _field_propagators(model: AcousticModel, points: FloatArray) -> ComplexArray:
    """Return (M, N) the complex pressure (Pa) at each point by each element at full amplitude."""
    x, y, z = (points[:, None, i] - model.array.positions_m[:, i] for i in range(3))
    distance = np.sqrt(x * x + y * y + z * z)
    gain = field_gain(model, (x, y, z), distance)
    strength = math.sqrt(2.0) * model.transducer.source_strength_pa_m
    magnitude = strength * gain * np.exp(-model.medium.absorption_np_m * distance) / distance
    turns = distance / model.wavelength_m
    phase = 2.0 * math.pi * (turns - np.rint(turns))  # sine and cosine are slow far from zero
    result = np.empty(distance.shape, dtype=np.complex128)
    # Two real functions cost a third of one complex exponential.
    np.multiply(magnitude, np.cos(phase), out=result.real)
    np.multiply(magnitude, np.sin(phase), out=result.imag)
    if model.response is not None:
        result *= model.response
    return result


def pressure(model: AcousticModel, weights: ArrayLike, points_m: ArrayLike) -> ComplexArray:
    """Return the complex pressure of one drive, or of several, at given points.

    Parameters
    ----------
    weights : (N,) or (F, N) array_like of complex
        Element weights A e^{+j phi}.
    points_m : (M, 3) array_like
        Points, in metres. They are worked through in chunks, so that memory stays bounded.

    Returns
    -------
    (M,) or (F, M) numpy.ndarray of complex128
        Peak pressure, in pascals.

    Raises
    ------
    ConfigurationError
        As :func:`propagators`; and for weights that are not finite or not one per element.

    Examples
    --------
    >>> f"{abs(pressure(model, weights, [target])[0]):.0f} Pa"
    '5399 Pa'
    """
    drives = as_drives(weights, model.array.count)
    points = as_point_array("points_m", points_m)
    check_array_memory("a field", (*drives.shape[:-1], len(points)), 16)
    check_field_points(model, points)
    result = np.empty((*drives.shape[:-1], len(points)), dtype=np.complex128)
    for chunk in memory_chunks(len(points), _point_batch_size(model)):
        result[..., chunk] = drives @ _field_propagators(model, points[chunk]).T
    return result


def arrival_at_point(
    model: AcousticModel, weights: ComplexArray, point_m: FloatArray
) -> tuple[float, float]:
    """Return the RMS pressure of one drive at a point (3,), and its coherence there, 0 to 1."""
    arrivals = weights * propagators(model, point_m[None, :])[0]
    total, largest = abs(complex(arrivals.sum())), float(np.abs(arrivals).sum())
    return total / math.sqrt(2.0), (total / largest if largest > 0.0 else 0.0)


def field_gain(
    model: AcousticModel, offsets: tuple[FloatArray, ...], distance: FloatArray
) -> FloatArray:
    """Return the directivity of each element toward each point, from its own normal.

    Parameters
    ----------
    offsets : tuple of numpy.ndarray
        x, y and z (M, N) from each element to each point.
    distance : (M, N) numpy.ndarray
        Their lengths.
    """
    normals, directivity = model.array.normals, model.transducer.directivity
    if hasattr(directivity, "gain_towards"):  # isinstance of a Protocol takes 20 µs
        directions = np.stack(offsets, axis=-1) / distance[..., None]
        oriented = cast("OrientedDirectivity", directivity)
        return oriented.gain_towards(directions, normals, model.wavenumber)
    along = sum(offset * normals[:, axis] for axis, offset in enumerate(offsets))
    return directivity.gain(along / distance, model.wavenumber)


def _point_batch_size(model: AcousticModel) -> int:
    """Return how many points are computed at once: 8192 over the elements, but 1 at least."""
    return max(1, _PAIRS_PER_CHUNK // model.array.count)


def sounding_half_spaces(model: AcousticModel) -> FloatArray:
    """Return the (U, 4) half-spaces n x + d >= 0, in metres, that have sound: the union of them.

    See :attr:`TransducerArray.fronts`; all of space if the elements are not baffled.
    """
    return model.array.fronts if model.transducer.directivity.baffled else np.zeros((1, 4))


def points_in_front(model: AcousticModel, points_m: ArrayLike) -> BoolArray:
    """Return which of (M, 3) points are not behind every element, if the elements are baffled.

    There the model has no sound: what is behind depends on a housing that it does not know.

    Returns
    -------
    (M,) numpy.ndarray of bool

    Examples
    --------
    >>> points_in_front(model, [target, (0.0, 0.0, -0.15)]).tolist()
    [True, False]
    """
    points = as_point_array("points_m", points_m)
    front = np.ones(len(points), dtype=np.bool_)
    for part in memory_chunks(len(points), _POINTS_PER_CHUNK):
        front[part][_field_points_behind(model, points[part])] = False
    return front


def points_with_field(model: AcousticModel, points_m: ArrayLike) -> BoolArray:
    """Return which of (M, 3) points have a field, (M,): in front, and 1 mm off every element."""
    points = as_point_array("points_m", points_m)
    return points_in_front(model, points) & points_clear_of_elements(model, points, MIN_DISTANCE_M)


def pressure_level_in_front(
    engine: FieldEngine, weights: ArrayLike, points_m: ArrayLike
) -> FloatArray:
    """Return |p| of one drive, (M,), and 0 where no field is defined: for a search there."""
    drive = as_drive(weights, engine.model.array.count)
    points = as_point_array("points_m", points_m)
    level = np.zeros(len(points))
    known = points_with_field(engine.model, points)
    level[known] = np.abs(engine.pressure(drive, points[known]))
    return level


def check_field_points(model: AcousticModel, points: FloatArray) -> None:
    """Raise, before any work, unless the field of *model* is defined at all of (M, 3) points.

    Raises
    ------
    ConfigurationError
        A point within 1 mm of an element, or behind all of them if they are baffled.
    """
    for part in memory_chunks(len(points), _POINTS_PER_CHUNK):
        behind = part.start + _field_points_behind(model, points[part])
        if len(behind):
            ahead_m = (sounding_half_spaces(model) @ np.append(points[behind[0]], 1.0)).max()
            raise ConfigurationError(
                f"point {behind[0]} is {-ahead_m * 1e3:.3g} mm behind the baffle of the array, "
                "must be in front of an element"
            )
    for near, distance in _field_distances(model, points, MIN_DISTANCE_M):
        if distance.min() < MIN_DISTANCE_M:
            point, element = np.unravel_index(int(distance.argmin()), distance.shape)
            raise ConfigurationError(
                f"point {near[point]} is {distance.min() * 1e3:.3g} mm from element {element}, "
                f"must be at least {MIN_DISTANCE_M * 1e3:g} mm"
            )


def points_clear_of_elements(
    model: AcousticModel, points_m: ArrayLike, distance_m: float
) -> BoolArray:
    """Return which of (M, 3) points keep a distance from every element, (M,)."""
    points = as_point_array("points_m", points_m)
    clear = np.ones(len(points), dtype=np.bool_)
    for near, distance in _field_distances(model, points, distance_m):
        clear[near] = distance.min(axis=1) >= distance_m
    return clear


def _field_points_behind(model: AcousticModel, points: FloatArray) -> NDArray[np.intp]:
    """Return the indices of the points that lie behind every baffled element."""
    first, *others = sounding_half_spaces(model)
    behind = np.flatnonzero(points @ first[:3] + first[3] < 0.0)
    for front in others:
        if not len(behind):
            break
        behind = behind[points[behind] @ front[:3] + front[3] < 0.0]
    return behind


def _field_distances(
    model: AcousticModel, points: FloatArray, reach_m: float
) -> Iterator[tuple[NDArray[np.intp], FloatArray]]:
    """Yield, in parts, the indices (m,) of points about the array, and (m, N) distances in metres.

    All others are further than *reach_m* from every element: outside the box around them.
    """
    low, high = model.array.bounds_m
    for part in memory_chunks(len(points), _POINTS_PER_CHUNK):
        outside = np.maximum(low - points[part], points[part] - high) >= reach_m
        about = part.start + np.flatnonzero(~outside.any(axis=1))
        for chunk in memory_chunks(len(about), _point_batch_size(model)):
            offsets = points[about[chunk]][:, None, :] - model.array.positions_m
            yield about[chunk], np.sqrt(np.einsum("mni,mni->mn", offsets, offsets))
