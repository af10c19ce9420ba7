"""The engine of single precision where numba is not installed."""

from __future__ import annotations

import math

import numpy as np

from haptogram.acoustics.arrays import BoolArray, ComplexArray, FloatArray
from haptogram.acoustics.field.engines.layout import SingleArray, as_single_precision
from haptogram.acoustics.field.engines.single_precision import EngineReach, SingleEngine
from haptogram.acoustics.field.reference import points_in_front
from haptogram.acoustics.memory import memory_chunks
from haptogram.acoustics.model.model import AcousticModel
from haptogram.acoustics.model.transducer import GRAZING


class Numpy32Engine(SingleEngine):
    """numpy in single precision, with buffers that are kept: a fifth of the compiled speed.

    r - r0 = (r^2 - r0^2) / (r + r0), with r0 the distance from the array's centre: the difference
    is small, so its phase is exact enough, and r^2 - r0^2 = |s|^2 - 2 s x is a matrix product.

    Examples
    --------
    >>> single = Numpy32Engine(model)
    >>> ratio = single.pressure(weights, [target]) / engine.pressure(weights, [target])
    >>> bool(abs(ratio[0] - 1.0) < 1e-4)
    True
    """

    REACH = EngineReach(aperture=32.0, aperture_loss=0.06, few=32.0, many=72.0)

    def __init__(self, model: AcousticModel) -> None:
        super().__init__(model)
        wavelength, array = model.wavelength_m, model.array
        places = (array.positions_m - array.centre_m) / wavelength
        squares = (places**2).sum(axis=1)
        self._squares = as_single_precision(np.vstack([-2.0 * places.T, squares]))
        along = -(places * array.normals).sum(axis=1)
        self._cosines = as_single_precision(np.vstack([array.normals.T, along]))
        self._size = max(1, (1 << 16) // array.count)
        shape = (self._size, array.count)
        self._buffers = [np.empty(shape, dtype=np.float32) for _ in range(4)]

    @property
    def _wave_points(self) -> int:
        return self._size

    def _usable(self, points: FloatArray, reach_m: float) -> BoolArray | None:
        """Return a mask of the points in range, in front and outside the near-field limit."""
        distance = np.linalg.norm(points - self._model.array.centre_m, axis=1)
        # r >= |x| - |s|: outside of twice the aperture no r is below half of the largest term.
        nearest = max(2.0 * self._radius_m, self.clearance_m)
        within = (distance <= reach_m) & points_in_front(self._model, points)
        usable: BoolArray = within & (distance >= nearest)
        close = np.flatnonzero(within & ~usable)
        for part in memory_chunks(len(close), self._size):
            usable[close[part]] = self._clear(points[close[part]])
        return None if usable.all() else usable

    def _clear(self, points: FloatArray) -> BoolArray:
        """Return a mask of the points that keep 0.6 of the aperture's radius from every element."""
        offsets = points[:, None, :] - self._model.array.positions_m
        nearest = np.sqrt(np.einsum("mni,mni->mn", offsets, offsets).min(axis=1))
        limit = max(0.6 * self._radius_m, self.clearance_m)
        clear: BoolArray = nearest >= limit
        return clear

    def _one_drive(
        self,
        drive: ComplexArray,
        points: FloatArray,
        careful: bool,  # noqa: ARG002  (this way is always careful)
        result: ComplexArray,
    ) -> None:
        weights = drive.astype(np.complex64)
        for part in memory_chunks(len(points), self._size):
            real, imaginary, turn = self._polar(points[part])
            both = np.stack([real @ weights, imaginary @ weights])
            result[part] = turn * (both[0] + 1j * both[1])

    def _waves(self, points: FloatArray) -> SingleArray:
        real, imaginary, turn = self._polar(points)
        c, s = turn.real[:, None], turn.imag[:, None]
        waves = np.stack([real * c - imaginary * s, real * s + imaginary * c])
        return np.ascontiguousarray(waves.transpose(0, 2, 1), dtype=np.float32)

    def _polar(self, points: FloatArray) -> tuple[SingleArray, SingleArray, ComplexArray]:
        """Return (M, N) real and imaginary parts of the waves, and their (M,) phase factors."""
        places = (points - self._model.array.centre_m) / self._model.wavelength_m
        square = (places**2).sum(axis=1)
        distance = np.sqrt(square)
        homogeneous = as_single_precision(np.hstack([places, np.ones((len(places), 1))]))
        q, r, phase, level = (buffer[: len(points)] for buffer in self._buffers)
        np.matmul(homogeneous, self._squares, out=q)
        np.add(q, as_single_precision(square)[:, None], out=r)
        np.sqrt(r, out=r)
        np.add(r, as_single_precision(distance)[:, None], out=phase)
        np.divide(q, phase, out=phase)  # r - r0
        self._level(homogeneous, r, phase, (q, level))
        np.rint(phase, out=r)
        phase -= r
        phase *= np.float32(2.0 * math.pi)
        np.cos(phase, out=q)
        q *= level
        np.sin(phase, out=r)
        r *= level
        loss = self._model.medium.absorption_np_m * self._model.wavelength_m
        return q, r, np.exp((2j * np.pi - loss) * distance - 2j * np.pi * np.rint(distance))

    def _level(
        self,
        homogeneous: SingleArray,
        r: SingleArray,
        delay: SingleArray,
        buffers: tuple[SingleArray, SingleArray],
    ) -> None:
        """Set the last buffer to D(theta) e^(-alpha (r - r0)) / r; the first is scratch."""
        cosine, level = buffers
        np.matmul(homogeneous, self._cosines, out=cosine)
        np.reciprocal(r, out=r)
        cosine *= r
        behind = cosine < GRAZING if self._model.transducer.directivity.baffled else None
        cosine *= cosine
        level[:] = self._gain[-1]
        for coefficient in self._gain[-2::-1]:
            level *= cosine
            level += coefficient
        level *= r
        loss = np.float32(self._model.medium.absorption_np_m * self._model.wavelength_m)
        if loss != 0.0:  # a cubic serves: |alpha (r - r0)| is at most REACH.aperture_loss
            np.multiply(delay, -loss, out=cosine)
            np.multiply(cosine, np.float32(1.0 / 3.0), out=r)
            r += np.float32(1.0)
            r *= cosine
            r *= np.float32(0.5)
            r += np.float32(1.0)
            r *= cosine
            r += np.float32(1.0)
            level *= r
        if behind is not None:
            level[behind] = 0.0
