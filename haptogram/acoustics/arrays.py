"""Arrays of numbers that a caller gives: their types, and checks that name value and limit."""

from __future__ import annotations

from typing import Final, TypeAlias, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from haptogram.errors import ConfigurationError

FloatArray: TypeAlias = NDArray[np.float64]
ComplexArray: TypeAlias = NDArray[np.complex128]
BoolArray: TypeAlias = NDArray[np.bool_]
_Kind = TypeVar("_Kind", bound=np.generic)

MAX_TRANSDUCERS: Final = 1024  # per array, and so per drive
MAX_POINT_M: Final = 1e6  # largest coordinate: nothing overflows, even in single precision


def as_float_vector(name: str, values: ArrayLike, length: int) -> FloatArray:
    """Return *values* as a finite float64 vector of *length*, or raise."""
    vector = as_float_array(name, values)
    if vector.shape != (length,):
        raise ConfigurationError(f"{name} has shape {vector.shape}, must be ({length},)")
    return vector


def as_coordinates(name: str, values: ArrayLike) -> FloatArray:
    """Return *values* as a (3,) float64 vector of coordinates within 1000 km, or raise."""
    place = as_float_vector(name, values, 3)
    check_array_magnitudes(name, place, MAX_POINT_M)
    return place


def as_point_array(name: str, values: ArrayLike) -> FloatArray:
    """Return *values* as an (M, 3) float64 array of coordinates within 1000 km, or raise."""
    points = _as_argument_array(name, values, np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ConfigurationError(f"{name} has shape {points.shape}, must be (M, 3)")
    check_array_magnitudes(name, points, MAX_POINT_M)
    return points


def as_float_array(name: str, values: ArrayLike) -> FloatArray:
    """Return *values* as finite float64 of any shape, or raise."""
    array = _as_argument_array(name, values, np.float64)
    _check_finite_array(name, array)
    return array


def _as_argument_array(name: str, values: ArrayLike, kind: type[_Kind]) -> NDArray[_Kind]:
    """Return *values* as an array of *kind*, if they can be converted.

    Else a ConfigurationError names the argument *name*.
    """
    try:
        return np.asarray(values, dtype=kind)
    except (TypeError, ValueError) as error:
        raise ConfigurationError(f"{name} is not an array of numbers: {error}") from error


def as_complex_array(name: str, values: ArrayLike) -> ComplexArray:
    """Return *values* as complex128 of any shape, NaN included, or raise."""
    return _as_argument_array(name, values, np.complex128)


def check_array_magnitudes(
    name: str, array: FloatArray | ComplexArray | NDArray[np.complex64], limit: float
) -> None:
    """Raise, naming the first one, if *array* holds a NaN or a magnitude above *limit*."""
    values = array.ravel()
    if np.vdot(values, values).real <= limit * limit:  # a quarter of the time; NaN is not
        return
    _check_finite_array(name, array)
    beyond = np.argwhere(np.abs(array) > limit)
    if len(beyond):
        index = tuple(int(i) for i in beyond[0])
        raise ConfigurationError(
            f"{name}{list(index)} is {array[index]:g}, must be {limit:g} at most"
        )


def _check_finite_array(name: str, array: NDArray[np.generic]) -> None:
    """Raise ConfigurationError for the first NaN or infinity in *array*; it names *name*, index."""
    finite = np.isfinite(array)
    if np.count_nonzero(finite) < finite.size:  # a tenth of the time of all() for a small array
        index = tuple(int(i) for i in np.argwhere(~finite)[0])
        raise ConfigurationError(f"{name}{list(index)} is {array[index]}, must be finite")


def read_only_array(array: NDArray[np.generic]) -> None:
    """Freeze *array*, so that a frozen dataclass cannot change through it."""
    array.flags.writeable = False
