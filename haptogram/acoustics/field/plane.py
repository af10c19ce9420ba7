"""The field on a plane parallel to a regular array, by an exact discrete convolution.

On a grid whose step divides the array's pitch, the field of a regular array of equal elements is
the convolution of the weights with the field of one element. The weights sit on every m-th node.
The nodes fall into m x m sets with the array's own step, and the field on each set is a small
convolution of the weights with that set of nodes of the element's field: one transform of the
weights serves all. The inverse transforms are matrix products as long as they are short: those
reach the full rate of the machine, make only the nodes that are wanted, and take half of the time.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from haptogram.acoustics.arrays import MAX_POINT_M, FloatArray
from haptogram.acoustics.field.reference import propagators
from haptogram.acoustics.memory import check_array_memory
from haptogram.acoustics.model.drive import as_drive
from haptogram.acoustics.model.geometry import TransducerArray
from haptogram.acoustics.model.lattice import Lattice, find_lattice
from haptogram.acoustics.model.model import AcousticModel
from haptogram.errors import ConfigurationError
from haptogram.settings.arguments import check_number, check_whole

_MAX_OVERSAMPLING: Final = 64
_MIN_HALF_WIDTH_M: Final = 1e-6
_KERNEL_POINTS: Final = 1 << 18  # one element's field is computed in parts of 12 MB
_LONGEST_PRODUCT: Final = 32  # nodes of a set along an axis; beyond, a fast transform is faster


class PlaneField:
    """The field of drive after drive on one plane.

    Parameters
    ----------
    model : AcousticModel
        A lattice of equal steps along either axis, wherever it lies and whichever way it faces.
    height_m : float
        Distance of the plane from the array, in metres; positive in front.
    half_width_m : float
        The plane reaches at least this far from the array's centre along both axes, in metres.
    oversampling : int
        Nodes per step of the array, 1 to 64.

    Attributes
    ----------
    x_m, y_m : (nx,), (ny,) numpy.ndarray
        Coordinates of the nodes along the array's axes, from its centre, in metres.

    Raises
    ------
    ConfigurationError
        The array is no regular lattice; a plane within 1 mm of an element or behind baffled ones; a
        size out of range or one that would not fit in memory.

    Examples
    --------
    >>> plane = PlaneField(model, height_m=0.15, half_width_m=0.02, oversampling=4)
    >>> level = np.abs(plane.pressure(weights))
    >>> level.shape == plane.shape, f"{level.max():.0f} Pa"
    (True, '5399 Pa')
    """

    def __init__(
        self, model: AcousticModel, height_m: float, *, half_width_m: float, oversampling: int = 10
    ) -> None:
        check_number("half_width_m", half_width_m, _MIN_HALF_WIDTH_M, MAX_POINT_M)
        check_number("height_m", height_m, -MAX_POINT_M, MAX_POINT_M)
        check_whole("oversampling", oversampling, 1, _MAX_OVERSAMPLING)
        self._model = model
        self._height_m = float(height_m)
        self._lattice = _plane_field_lattice(model.array)
        lattice, m = self._lattice, oversampling
        self._m = m
        axes = [_PlaneAxis(levels, half_width_m, m) for levels in (lattice.x_m, lattice.y_m)]
        self._axes = axes
        check_array_memory("a plane", [m * axis.period for axis in axes], 48)
        self.x_m, self.y_m = axes[0].nodes_m(), axes[1].nodes_m()
        self._spectrum = self._kernel_spectrum()
        self._buffer = np.empty_like(self._spectrum)

    @property
    def shape(self) -> tuple[int, int]:
        """(nx, ny), the number of nodes."""
        return len(self.x_m), len(self.y_m)

    @property
    def points_m(self) -> FloatArray:
        """(nx, ny, 3) positions of the nodes, in metres."""
        x, y = np.meshgrid(self.x_m, self.y_m, indexing="ij")
        places = np.stack([x, y, np.full_like(x, self._height_m)], axis=-1)
        points: FloatArray = places @ self._lattice.axes + self._model.array.centre_m
        return points

    def pressure(self, weights: ArrayLike) -> NDArray[np.complex64]:
        """Return the (nx, ny) peak pressure of (N,) weights, in pascals.

        Off by at most 1e-6 of the largest pressure that the drive could make.

        Raises
        ------
        ConfigurationError
            Weights that are not finite or not one per element.
        """
        from scipy.fft import fft2  # slow to import, and only planes need it

        drive = self._model.radiated(as_drive(weights, self._model.array.count))
        along_x, along_y = self._axes
        sources = np.zeros((along_x.period, along_y.period), dtype=np.complex64)
        nodes = np.where(self._lattice.elements >= 0, drive[self._lattice.elements], 0.0)
        sources[: nodes.shape[0], : nodes.shape[1]] = nodes
        small = fft2(sources, overwrite_x=True)
        np.multiply(self._spectrum, small[:, None, :], out=self._buffer)
        sets = self._inverse()
        plane = sets.transpose(1, 0, 3, 2).reshape(along_x.whole, along_y.whole)
        result: NDArray[np.complex64] = plane[: len(self.x_m), : len(self.y_m)].copy()
        return result

    def _inverse(self) -> NDArray[np.complex64]:
        """Return the (m, rows, m, columns) field on each set of nodes; the buffer is used up."""
        from scipy.fft import ifft

        along_x, along_y = self._axes
        m, size = self._m, along_x.period
        if max(along_x.per_set, along_y.per_set) > _LONGEST_PRODUCT:
            # One axis, the part of it that is wanted, then the other: a third less than both.
            rows = ifft(self._buffer, axis=1, overwrite_x=True)[:, along_x.wanted]
            sets: NDArray[np.complex64] = ifft(rows, axis=3, overwrite_x=True)
            return sets[..., along_y.wanted]
        rows = np.matmul(along_x.synthesis, self._buffer.reshape(m, size, -1))
        sets = np.matmul(rows.reshape(-1, along_y.period), along_y.synthesis.T)
        return sets.reshape(m, along_x.per_set, m, along_y.per_set)

    def _kernel_spectrum(self) -> NDArray[np.complex64]:
        """Return the (m, rows, m, columns) spectra of one element's field on each set of nodes."""
        from scipy.fft import fft2

        along_x, along_y = self._axes
        m = self._m
        kernel = np.empty((m * along_x.period, m * along_y.period), dtype=np.complex128)
        axes = self._lattice.axes
        element = _plane_field_element(self._model, axes[2])
        x_m, y_m = along_x.offsets_m(), along_y.offsets_m()
        rows = max(1, _KERNEL_POINTS // len(y_m))
        for start in range(0, len(x_m), rows):
            x = x_m[start : start + rows]
            grid = np.stack(np.meshgrid(x, y_m, [self._height_m], indexing="ij"), axis=-1)
            field = propagators(element, grid.reshape(-1, 3) @ axes)
            kernel[start : start + len(x)] = field.reshape(len(x), len(y_m))
        sets = kernel.reshape(along_x.period, m, along_y.period, m).transpose(1, 0, 3, 2)
        spectrum: NDArray[np.complex64] = fft2(sets, axes=(1, 3)).astype(np.complex64)
        return spectrum


class _PlaneAxis:
    """One axis of the plane: its nodes, their offsets from the sources, and the transform.

    Nodes count from the first source, so that every source is one of them.
    """

    def __init__(self, levels_m: FloatArray, half_width_m: float, m: int) -> None:
        from scipy.fft import next_fast_len

        pitch = float(np.diff(levels_m).mean()) if len(levels_m) > 1 else 2.0 * half_width_m
        self._m = m
        self._step_m = pitch / m
        self._start_m = float(levels_m[0])
        self._sources = len(levels_m)
        self._low = math.floor((-half_width_m - self._start_m) / self._step_m + 1e-9)
        high = math.ceil((half_width_m - self._start_m) / self._step_m - 1e-9)
        self._count = high + 1 - self._low
        check_array_memory("an axis", (self._count + self._sources * m,), 64)
        self.per_set = -(-self._count // m)  # nodes in the largest set
        self.whole = self.per_set * m
        self.period = int(next_fast_len(self.per_set + self._sources - 1))
        self.wanted = slice(self._sources - 1, self._sources - 1 + self.per_set)

    @cached_property
    def synthesis(self) -> NDArray[np.complex64]:
        """The (per_set, period) inverse transform to the nodes of a set."""
        turns = np.outer(np.arange(self.period)[self.wanted], np.arange(self.period)) / self.period
        matrix: NDArray[np.complex64] = (np.exp(2j * np.pi * turns) / self.period).astype(
            np.complex64
        )
        return matrix

    def nodes_m(self) -> FloatArray:
        nodes = np.arange(self._low, self._low + self._count, dtype=np.float64)
        return self._start_m + self._step_m * nodes

    def offsets_m(self) -> FloatArray:
        """Return the offsets of a period of nodes, from the last source's first one on."""
        first = self._low - (self._sources - 1) * self._m
        steps = np.arange(first, first + self.period * self._m, dtype=np.float64)
        return self._step_m * steps


def _plane_field_lattice(array: TransducerArray) -> Lattice:
    lattice = find_lattice(array)
    if lattice is None:
        raise ConfigurationError("a plane by convolution needs a planar rectangular lattice")
    for levels in (lattice.x_m, lattice.y_m):
        steps = np.diff(levels)
        if len(steps) and np.ptp(steps) > 1e-8:
            raise ConfigurationError(
                f"the lattice's steps are {steps.min() * 1e3:.6g} to {steps.max() * 1e3:.6g} mm, "
                "must be equal"
            )
    return lattice


def _plane_field_element(model: AcousticModel, normal: FloatArray) -> AcousticModel:
    """Return the model of a single element at the origin with the array's orientation.

    It is not turned upright: a directivity may have directions of its own.
    """
    array = TransducerArray.from_positions(np.zeros((1, 3)), normal[None])
    return AcousticModel(array, model.medium, model.transducer)
