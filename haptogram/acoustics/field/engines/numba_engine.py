"""The compiled engine."""

from __future__ import annotations

import math
from typing import Final, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from haptogram.acoustics.arrays import BoolArray, ComplexArray, FloatArray, as_point_array
from haptogram.acoustics.field.engines.compiled import Kernels, compiled_kernels, load_kernels
from haptogram.acoustics.field.engines.layout import EngineLayout, SingleArray, as_single_precision
from haptogram.acoustics.field.engines.polynomials import gain_polynomial
from haptogram.acoustics.field.reference import (
    MIN_DISTANCE_M,
    NumpyEngine,
    check_field_points,
    propagators,
    sounding_half_spaces,
)
from haptogram.acoustics.memory import check_array_memory, memory_chunks
from haptogram.acoustics.model.drive import as_drives
from haptogram.acoustics.model.model import AcousticModel
from haptogram.errors import ConfigurationError

_CALL_POINTS: Final = 1 << 15  # some 10 ms: Ctrl-C waits no longer
_MANY: Final = 64.0  # elements, in effect: (sum |w|)^2 / sum |w|^2
_CLEARANCE: Final = 0.3  # wavelengths; nearer, the rounding of a position shows
_APERTURE: Final = 256.0  # wavelengths from the array's centre to an element
_APERTURE_LOSS: Final = 0.15  # nepers from the array's centre to an element
_REACH: Final = 1000.0  # wavelengths from a point to an element
_WAVE_POINTS: Final = 256
_MAX_LOSS: Final = 0.15  # nepers over the half-width of the range of distances in a block


_T = TypeVar("_T", bound=np.generic)


class NumbaEngine:
    """Compiled loops in single precision, one thread: for circular pistons and point sources.

    A point that single precision would not serve to 2e-5 of the sum of magnitudes (too near to an
    element, or far away) goes the reference way; the caller sees only the time that it takes.

    The first call of a process takes the machine code from the cache, or makes it (seconds):
    :meth:`warm_up` does so at a time of one's own choosing.

    Raises
    ------
    ConfigurationError
        numba is not installed, or single precision does not serve the model.

    Examples
    --------
    >>> fast = choose_engine(model)  # a NumbaEngine, if numba is installed
    >>> ratio = fast.pressure(weights, [target]) / engine.pressure(weights, [target])
    >>> bool(abs(ratio[0] - 1.0) < 1e-4)
    True
    """

    @classmethod
    def why_not(cls, model: AcousticModel) -> str | None:
        """Return why this engine does not serve *model*, or None if it does."""
        if load_kernels() is None:
            return "numba is not installed"
        if gain_polynomial(model) is None:
            return f"no polynomial serves {model.transducer.directivity}"
        offsets = model.array.positions_m - model.array.centre_m
        radius = float(np.linalg.norm(offsets, axis=1).max())
        limit = _APERTURE * model.wavelength_m
        if radius > limit:
            return f"an element is {radius:.3g} m from the array's centre, more than {limit:.3g} m"
        if model.medium.absorption_np_m * radius > _APERTURE_LOSS:
            return f"the absorption is {model.medium.absorption_np_m:.3g} Np/m"
        return None

    def __init__(self, model: AcousticModel) -> None:
        kernels = load_kernels()
        if kernels is None:
            raise ConfigurationError("numba is not installed: pip install numba")
        reason = self.why_not(model)
        gain = gain_polynomial(model)
        if reason is not None or gain is None:
            raise ConfigurationError(f"single precision does not serve this model: {reason}")
        self._kernels: Kernels = kernels
        self._model = model
        wavelength = model.wavelength_m
        strength = math.sqrt(2.0) * model.transducer.source_strength_pa_m / wavelength
        self._gain = (strength * gain).astype(np.float32)
        self._layout = EngineLayout.of(model)
        # The reference refuses what is nearer than the second.
        self.clearance_m = max(_CLEARANCE * wavelength, MIN_DISTANCE_M)
        self._reach_m = self._exact_reach_m()
        half = np.ptp(model.array.bounds_m, axis=0) / 2
        shift = np.abs(model.array.bounds_m.mean(axis=0) - model.array.centre_m)
        self._bounds = np.concatenate([model.array.centre_m, half + shift + self.clearance_m])
        self._fronts = sounding_half_spaces(model).copy()  # writeable, as all that the loops take

    def _exact_reach_m(self) -> float:
        """Return the distance (m) from the array's centre to which single precision suffices.

        So far every element is within 1000 wavelengths and 0.3 nepers of absorption.
        """
        absorption = self._model.medium.absorption_np_m
        lossy_m = 2.0 * _MAX_LOSS / absorption if absorption > 0.0 else math.inf
        return min(_REACH * self._model.wavelength_m, lossy_m) - self._layout.radius_m

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
            Points that do not fit the model, are not finite, within 1 mm of an element or behind
            the baffle of all; a result of more than half of the memory.
        """
        drives = as_drives(weights, self._model.array.count)
        points = np.ascontiguousarray(as_point_array("points_m", points_m))
        shape = (*drives.shape[:-1], len(points))
        check_array_memory("a field", shape, 16)
        radiated = self._model.radiated(drives)
        many = _effective_drive_count(radiated) >= _MANY
        usable = self._usable(points, self._reach_m)
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
        usable = self._usable(points, self._reach_m)
        fast = np.ones(len(points), dtype=np.bool_) if usable is None else usable
        result = np.empty(shape, dtype=np.complex64)
        if usable is not None:
            check_field_points(self._model, points)
            result[~fast] = propagators(self._model, points[~fast])
        rows, response = np.flatnonzero(fast), self._model.response
        for part in memory_chunks(len(rows), _WAVE_POINTS):
            real, imaginary = self._waves(points[rows[part]])
            result.real[rows[part]] = real.T
            result.imag[rows[part]] = imaginary.T
            if response is not None:
                result[rows[part]] *= response
        return result

    def _fast(self, drives: ComplexArray, points: FloatArray, *, careful: bool) -> ComplexArray:
        """Return the pressure (M,) or (F, M) of one or F drives, by compiled code.

        *points* (M, 3) are those that `_usable` accepts. *careful*: fewer than 64 elements are
        active, in effect, so that their rounding errors do not average out.
        """
        result = np.empty((*drives.shape[:-1], len(points)), dtype=np.complex128)
        if drives.ndim == 1:
            for part in memory_chunks(len(points), _CALL_POINTS):
                self._one_drive(drives, points[part], careful, result[part])
            return result
        matrix = _real_drive_matrices(drives)
        count = len(drives)
        for part in memory_chunks(len(points), _WAVE_POINTS):
            waves = self._waves(points[part])
            both = matrix @ waves.reshape(-1, waves.shape[2])
            result[:, part].real = both[:count]
            result[:, part].imag = both[count:]
        return result

    def warm_up(self) -> None:
        """Load or make the machine code of every call that this engine can make.

        There is one for each loop: points are copied if their array is read-only or strided.
        numba is imported: each call then takes 10 us less than with stored code.
        """
        self._kernels = compiled_kernels()
        drive = np.ones(self._model.array.count, dtype=np.complex128)
        for count in (1, 20):
            points = np.tile(self._model.array.centre_m + 0.1, (count, 1))
            self._usable(points, 1.0)
            self._fast(drive, points, careful=False)
            self._fast(np.tile(drive, (2, 1)), points, careful=True)

    def disc_arguments(
        self, axes: FloatArray, nodes_m: FloatArray, areas_m2: FloatArray
    ) -> tuple[object, object]:
        """Return the arguments that the loop for the stress on a disc takes of disc and engine.

        Parameters
        ----------
        axes : (3, 3) numpy.ndarray
            Two axes along the disc, and its normal.
        nodes_m : (M, 3) numpy.ndarray
            Nodes from its centre, along these axes.
        areas_m2 : (M,) numpy.ndarray
            Their areas.
        """
        array, wavelength, constants = (
            self._model.array,
            self._model.wavelength_m,
            self._layout.constants,
        )
        frame = np.concatenate([axes / wavelength, array.centre_m[None, :]])
        places = np.ascontiguousarray(frame[:3] @ (array.positions_m - array.centre_m).T)
        elements = as_single_precision(np.concatenate([places, axes @ array.normals.T]))
        nodes = as_single_precision(nodes_m[:, :2] / wavelength)
        engine = self._gain, float(constants[1]), float(constants[2])
        return (frame, nodes, areas_m2, places, elements), engine

    def disc_stress(
        self,
        weights: ArrayLike,
        centre_m: FloatArray,
        points_m: FloatArray,
        disc: tuple[object, object],
    ) -> float | None:
        """Return the integral of |p|^2 less |rho c v|^2 along a disc, in Pa^2 m^2.

        None: single precision does not serve some of its *points_m*, or these are several drives.
        *disc*: of :meth:`disc_arguments`.
        """
        drive = self._model.radiated(as_drives(weights, self._model.array.count))
        if drive.ndim > 1 or self._usable(points_m, self._reach_m) is not None:
            return None
        return float(self._kernels.disc_stress_kernel(self._polar(drive), centre_m, *disc))

    def _usable(self, points: FloatArray, reach_m: float) -> BoolArray | None:
        """Return a mask (M,) of points in reach, in front, clear of elements; None if all are.

        *reach_m*: the greatest distance from the array's centre.
        """
        usable, refused = np.empty(len(points), dtype=np.bool_), 0
        for part in memory_chunks(len(points), _CALL_POINTS):
            refused += self._kernels.usable_points_kernel(
                _writeable_for_engine(points[part]),
                self._layout.positions_m,
                self._fronts,
                self._bounds,
                reach_m,
                self.clearance_m,
                usable[part],
            )
        return usable if refused else None

    def _one_drive(
        self, drive: ComplexArray, points: FloatArray, careful: bool, result: ComplexArray
    ) -> None:
        """Write the complex pressure (Pa) of one drive at *points* into *result* (M,).

        *careful*: fewer than 64 elements are active, in effect, so that their rounding errors do
        not average out.
        """
        layout, points, polar = self._layout, _writeable_for_engine(points), self._polar(drive)
        if layout.lattice is None:
            self._kernels.free_pressure_kernel(
                points, layout.frame, layout.constants, careful, self._gain, layout.elements,
                layout.flat, polar, result,
            )  # fmt: skip
        else:
            self._kernels.lattice_pressure_kernel(
                points, layout.frame, layout.constants, careful, self._gain, layout.x, layout.y,
                layout.nodes, polar, result,
            )  # fmt: skip

    def _polar(self, drive: ComplexArray) -> SingleArray:
        """Return (2, N) the magnitudes of a drive, and its phases in half turns."""
        polar = np.empty((2, len(drive)), dtype=np.float32)
        self._kernels.polar_form_kernel(_writeable_for_engine(drive), polar)
        return polar

    def _waves(self, points: FloatArray) -> SingleArray:
        """Return (2, N, M): real and imaginary part (Pa) of each of N elements' wave at M points.

        Every element is at full amplitude, its phase 0.
        """
        layout, points = self._layout, _writeable_for_engine(points)
        size = (len(points) + 15) // 16 * 16
        waves = np.empty((2, self._model.array.count, size), dtype=np.float32)
        if layout.lattice is None:
            self._kernels.free_waves_kernel(
                points, layout.frame, layout.constants, self._gain, layout.elements, waves
            )
        else:
            self._kernels.lattice_waves_kernel(
                points, layout.frame, layout.constants, self._gain, layout.x, layout.y,
                layout.nodes, waves,
            )  # fmt: skip
        return waves[:, :, : len(points)]


def _effective_drive_count(drives: ComplexArray) -> float:
    """Return the effective number of elements, (sum a)^2 / sum a^2; of several drives the least."""
    square = drives.real**2 + drives.imag**2  # half the time of abs()
    level = np.sqrt(square)
    if drives.ndim == 1:  # one call for a few points must not cost more than the points
        return float(np.add.reduce(level)) ** 2 / max(float(np.add.reduce(square)), 1e-300)
    power = np.maximum(square.sum(axis=1), 1e-300)
    return float((level.sum(axis=1) ** 2 / power).min(initial=math.inf))


def _real_drive_matrices(drives: ComplexArray) -> SingleArray:
    """Return (2F, 2N) real matrices equivalent to multiplication by the complex *drives*."""
    real, imaginary = drives.real, drives.imag
    return as_single_precision(np.block([[real, -imaginary], [imaginary, real]]))


def _writeable_for_engine(values: NDArray[_T]) -> NDArray[_T]:
    """Return *values* as a writeable contiguous array, the one type that is compiled for."""
    return values if values.flags.writeable and values.flags.c_contiguous else values.copy()
