"""Fields of many drives at the same points: one matrix, made once."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from haptogram.acoustics.arrays import (
    FloatArray,
    as_coordinates,
    as_point_array,
    check_computed_number,
)
from haptogram.acoustics.field.engines.engine import NumbaEngine, Numpy32Engine, choose_engine
from haptogram.acoustics.field.reference import propagators
from haptogram.acoustics.memory import check_array_memory
from haptogram.acoustics.model.drive import as_single_drives
from haptogram.acoustics.model.model import AcousticModel
from haptogram.errors import ConfigurationError
from haptogram.settings.arguments import check_positive


class GridField:
    """The field at fixed points, in single precision.

    The matrix takes 8 bytes for each point and element. From 16 drives at a time on, the speed is
    that of the matrix product of the machine.

    Parameters
    ----------
    model : AcousticModel
        The array and its medium.
    points_m : (M, 3) array_like
        Points, in metres.

    Raises
    ------
    ConfigurationError
        As :func:`haptogram.acoustics.propagators`; a matrix of more than half of the memory.

    Examples
    --------
    >>> field = GridField(model, box_points_m((-0.01, 0.0, 0.15), (0.01, 0.0, 0.15), 0.005))
    >>> np.abs(field.pressure([weights, weights / 2])).round(-3)
    array([[   0., 3000., 5000., 3000.,    0.],
           [   0., 2000., 3000., 2000.,    0.]], dtype=float32)
    """

    def __init__(self, model: AcousticModel, points_m: ArrayLike) -> None:
        points = as_point_array("points_m", points_m)
        count = model.array.count
        check_array_memory("a matrix", (len(points), count), 8)
        engine = choose_engine(model)
        if isinstance(engine, NumbaEngine | Numpy32Engine):
            self._matrix = engine.propagators(points)
        else:
            self._matrix = _grid_field_matrix(model, points)

    @property
    def matrix(self) -> NDArray[np.complex64]:
        """(M, N) propagators, in pascals at unit weight."""
        return self._matrix

    def pressure(
        self, weights: ArrayLike, out: NDArray[np.complex64] | None = None
    ) -> NDArray[np.complex64]:
        """Return the peak pressure of one drive or of several, in pascals.

        Parameters
        ----------
        weights : (N,) or (F, N) array_like of complex
            Element weights.
        out : numpy.ndarray of complex64, optional
            Where to put the result, of its shape: no memory is allocated then. Fortran order, in
            which the drives of one point lie side by side, is up to a tenth faster.

        Returns
        -------
        (M,) or (F, M) numpy.ndarray of complex64
            In Fortran order, or *out*.

        Raises
        ------
        ConfigurationError
            Weights that are no drives of the array (:func:`.drive.as_drives`); *out* of another
            shape or type; a result of more than half of the memory.
        """
        points, count = self._matrix.shape
        drives = as_single_drives(weights, count)
        shape = (*drives.shape[:-1], points)
        check_array_memory("a field", shape, 8)
        if out is not None and (out.shape != shape or out.dtype != np.complex64):
            raise ConfigurationError(
                f"out is {out.dtype} of shape {out.shape}, must be complex64 of shape {shape}"
            )
        result = np.empty(shape, dtype=np.complex64, order="F") if out is None else out
        if result.flags.f_contiguous:
            np.matmul(self._matrix, drives.T, out=result.T)
        else:
            np.matmul(drives, self._matrix.T, out=result)
        return result


def box_points_m(low_m: ArrayLike, high_m: ArrayLike, step_m: float) -> FloatArray:
    """Return the (M, 3) points of a regular grid over a box, x slowest.

    Both faces are included; the step shrinks so that it divides the box.

    Raises
    ------
    ConfigurationError
        A box that is not finite or turned inside out, or a grid of more than half of the memory.

    Examples
    --------
    >>> box_points_m((0.0, 0.0, 0.1), (0.01, 0.0, 0.1), 0.005).tolist()
    [[0.0, 0.0, 0.1], [0.005, 0.0, 0.1], [0.01, 0.0, 0.1]]
    """
    step_m = check_positive("step_m", step_m)
    low, high = as_coordinates("low_m", low_m), as_coordinates("high_m", high_m)
    if (low > high).any():
        raise ConfigurationError(f"the box ends at {high}, before its start at {low}")
    counts = [
        math.ceil(check_computed_number("length of the box in steps", length / step_m) - 1e-9) + 1
        for length in (high - low).tolist()
    ]
    check_array_memory("a grid", counts, 48)
    axes = [np.linspace(a, b, n) for a, b, n in zip(low, high, counts, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def _grid_field_matrix(model: AcousticModel, points: FloatArray) -> NDArray[np.complex64]:
    matrix = np.empty((len(points), model.array.count), dtype=np.complex64)
    for start in range(0, len(points), 256):
        matrix[start : start + 256] = propagators(model, points[start : start + 256])
    return matrix
