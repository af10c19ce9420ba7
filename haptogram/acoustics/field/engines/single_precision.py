"""The common part of the engines of single precision: checks, chunks, and the reference.

They serve circular pistons and point sources. A point that single precision would not serve to 2e-5
of the sum of magnitudes (too near to an element, or far away) goes the reference way; the caller
sees only the time that it takes.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from haptogram.acoustics.arrays import BoolArray, ComplexArray, FloatArray, as_point_array
from haptogram.acoustics.field.engines.layout import SingleArray, as_single_precision
from haptogram.acoustics.field.engines.polynomials import gain_polynomial
from haptogram.acoustics.field.reference import (
    MIN_DISTANCE_M,
    NumpyEngine,
    check_field_points,
    propagators,
)
from haptogram.acoustics.memory import check_array_memory, memory_chunks
from haptogram.acoustics.model.drive import as_drives
from haptogram.acoustics.model.model import AcousticModel
from haptogram.errors import ConfigurationError

CALL_POINTS: Final = 1 << 15  # some 10 ms: Ctrl-C waits no longer
_MANY: Final = 64.0  # elements, in effect: (sum |w|)^2 / sum |w|^2
_CLEARANCE: Final = 0.3  # wavelengths; nearer, the rounding of a position shows
_MAX_LOSS: Final = 0.15  # nepers over the half-width of the range of distances in a block


@dataclass(frozen=True, slots=True)
class EngineReach:
    """The limits within which an engine is exact to 2e-5.

    Attributes
    ----------
    aperture : float
        Wavelengths from the array's centre to an element.
    aperture_loss : float
        Nepers from the array's centre to an element.
    few, many : float
        Wavelengths from a point to an element, for a drive of few elements, and for one in which
        the errors of many average out.
    """

    aperture: float
    aperture_loss: float
    few: float
    many: float


class SingleEngine(ABC):
    """Common part of both engines: checks, chunks, and the way to the reference."""

    REACH: ClassVar[EngineReach]

    @classmethod
    def why_not(cls, model: AcousticModel) -> str | None:
        """Return why this engine does not serve *model*, or None if it does."""
        if gain_polynomial(model) is None:
            return f"no polynomial serves {model.transducer.directivity}"
        offsets = model.array.positions_m - model.array.centre_m
        radius = float(np.linalg.norm(offsets, axis=1).max())
        limit = cls.REACH.aperture * model.wavelength_m
        if radius > limit:
            return f"an element is {radius:.3g} m from the array's centre, more than {limit:.3g} m"
        if model.medium.absorption_np_m * radius > cls.REACH.aperture_loss:
            return f"the absorption is {model.medium.absorption_np_m:.3g} Np/m"
        return None

    def __init__(self, model: AcousticModel) -> None:
        reason = self.why_not(model)
        gain = gain_polynomial(model)
        if reason is not None or gain is None:
            raise ConfigurationError(f"single precision does not serve this model: {reason}")
        self._model = model
        wavelength = model.wavelength_m
        strength = math.sqrt(2.0) * model.transducer.source_strength_pa_m / wavelength
        self._gain = (strength * gain).astype(np.float32)
        offsets = model.array.positions_m - model.array.centre_m
        self._radius_m = float(np.linalg.norm(offsets, axis=1).max())
        # The reference refuses what is nearer than the second.
        self.clearance_m = max(_CLEARANCE * wavelength, MIN_DISTANCE_M)
        self._reach_of_few_m = self._reach_m(self.REACH.few)
        self._reach_of_many_m = self._reach_m(self.REACH.many)

    def _reach_m(self, wavelengths: float) -> float:
        """Return the largest distance from the array's centre within the error bound."""
        absorption = self._model.medium.absorption_np_m
        lossy_m = 2.0 * _MAX_LOSS / absorption if absorption > 0.0 else math.inf
        return min(wavelengths * self._model.wavelength_m, lossy_m) - self._radius_m

    @property
    def model(self) -> AcousticModel:
        """The model whose field this is."""
        return self._model

    def pressure(self, weights: ArrayLike, points_m: ArrayLike) -> ComplexArray:
        """Return the result of :func:`haptogram.acoustics.pressure`, to 2e-5 of the magnitudes.

        Parameters
        ----------
        weights : (N,) or (F, N) array_like of complex
            Element weights A e^{+j phi}.
        points_m : (M, 3) array_like
            Points, in metres.

        Returns
        -------
        (M,) or (F, M) numpy.ndarray of complex128
            Peak pressure, in pascals; off by at most 2e-5 of the sum of the elements' magnitudes.

        Raises
        ------
        ConfigurationError
            What does not fit the model, is not finite, lies within 1 mm of an element or behind
            the baffle of all; a result of more than half of the memory.
        """
        drives = as_drives(weights, self._model.array.count)
        points = np.ascontiguousarray(as_point_array("points_m", points_m))
        shape = (*drives.shape[:-1], len(points))
        check_array_memory("a field", shape, 16)
        radiated = self._model.radiated(drives)
        many = _effective_drive_count(radiated) >= _MANY
        usable = self._usable(points, self._reach_of_many_m if many else self._reach_of_few_m)
        if usable is None:
            return self._fast(radiated, points, careful=not many)
        check_field_points(self._model, points)
        result = np.empty(shape, dtype=np.complex128)
        result[..., ~usable] = NumpyEngine(self._model).pressure(drives, points[~usable])
        result[..., usable] = self._fast(radiated, points[usable], careful=not many)
        return result

    def propagators(self, points_m: ArrayLike) -> NDArray[np.complex64]:
        """Return the (M, N) pressures of the elements at unit weight, in pascals.

        Raises
        ------
        ConfigurationError
            As :meth:`pressure`.
        """
        points = np.ascontiguousarray(as_point_array("points_m", points_m))
        shape = (len(points), self._model.array.count)
        check_array_memory("a matrix", shape, 8)
        usable = self._usable(points, self._reach_of_few_m)
        fast = np.ones(len(points), dtype=np.bool_) if usable is None else usable
        result = np.empty(shape, dtype=np.complex64)
        if usable is not None:
            check_field_points(self._model, points)
            result[~fast] = propagators(self._model, points[~fast])
        rows, response = np.flatnonzero(fast), self._model.response
        for part in memory_chunks(len(rows), self._wave_points):
            real, imaginary = self._waves(points[rows[part]])
            result.real[rows[part]] = real.T
            result.imag[rows[part]] = imaginary.T
            if response is not None:
                result[rows[part]] *= response
        return result

    def _fast(self, drives: ComplexArray, points: FloatArray, *, careful: bool) -> ComplexArray:
        """Return the pressure at usable points.

        *careful*: so few elements are active that their rounding errors do not average out.
        """
        result = np.empty((*drives.shape[:-1], len(points)), dtype=np.complex128)
        if drives.ndim == 1:
            for part in memory_chunks(len(points), CALL_POINTS):
                self._one_drive(drives, points[part], careful, result[part])
            return result
        matrix = _real_form_of_drives(drives)
        count = len(drives)
        for part in memory_chunks(len(points), self._wave_points):
            waves = self._waves(points[part])
            both = matrix @ waves.reshape(-1, waves.shape[2])
            result[:, part].real = both[:count]
            result[:, part].imag = both[count:]
        return result

    @property
    @abstractmethod
    def _wave_points(self) -> int:
        """The largest number of points per call of `_waves`."""

    @abstractmethod
    def _usable(self, points: FloatArray, reach_m: float) -> BoolArray | None:
        """Return a mask of the points in front and within reach, or None if all are."""

    @abstractmethod
    def _one_drive(
        self, drive: ComplexArray, points: FloatArray, careful: bool, result: ComplexArray
    ) -> None:
        """Compute the pressure of one drive."""

    @abstractmethod
    def _waves(self, points: FloatArray) -> SingleArray:
        """Return the (2, N, M) real and imaginary parts of the propagators."""


def _effective_drive_count(drives: ComplexArray) -> float:
    """Return the smallest effective number of elements of any drive."""
    square = drives.real**2 + drives.imag**2  # half the time of abs()
    level = np.sqrt(square)
    if drives.ndim == 1:  # one call for a few points must not cost more than the points
        return float(np.add.reduce(level)) ** 2 / max(float(np.add.reduce(square)), 1e-300)
    power = np.maximum(square.sum(axis=1), 1e-300)
    return float((level.sum(axis=1) ** 2 / power).min(initial=math.inf))


def _real_form_of_drives(drives: ComplexArray) -> SingleArray:
    """Return (2F, 2N) real matrices equivalent to multiplication by the complex *drives*."""
    real, imaginary = drives.real, drives.imag
    return as_single_precision(np.block([[real, -imaginary], [imaginary, real]]))
