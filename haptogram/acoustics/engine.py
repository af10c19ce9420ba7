"""Fast field engines: single precision, held to the reference of :mod:`.field`.

Both engines serve circular pistons and point sources. A point that single precision would not
serve to 2e-5 of the sum of magnitudes (too near to an element, or far away), and a model that it
would not serve, goes the reference way; the caller sees only the time that it takes.
"""

from __future__ import annotations

import logging
import math
from abc import ABC, abstractmethod
from collections.abc import Iterator
from types import ModuleType
from typing import Final, Literal, TypeAlias, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from haptogram.acoustics._compiled import load_kernels
from haptogram.acoustics._layout import Layout, SingleArray, single
from haptogram.acoustics._memory import check_memory
from haptogram.acoustics._polynomials import gain_polynomial, is_baffled
from haptogram.acoustics._validation import BoolArray, ComplexArray, FloatArray, as_points
from haptogram.acoustics.drive import as_weights
from haptogram.acoustics.field import FieldEngine, NumpyEngine, propagators
from haptogram.acoustics.model import AcousticModel
from haptogram.errors import ConfigurationError

Preference: TypeAlias = Literal["auto", "numpy", "numpy32", "numba"]

_CALL_POINTS: Final = 1 << 15  # some 10 ms: Ctrl-C waits no longer
_MAX_APERTURE: Final = 32.0  # wavelengths from the centre to an element
_REACH: Final = 32.0  # wavelengths from a point to an element,
_REACH_OF_MANY: Final = 72.0  # and where the errors of many elements average out
_MANY: Final = 64.0  # elements, in effect: (sum |w|)^2 / sum |w|^2
_CLEARANCE: Final = 0.3  # wavelengths; nearer, the rounding of a position shows
_MAX_LOSS: Final = 0.15  # nepers over the half-width of the range of distances in a block

_MAX_APERTURE_LOSS: Final = 0.06  # nepers from the centre to an element

_T = TypeVar("_T", bound=np.generic)
_log = logging.getLogger(__name__)


def choose_engine(model: AcousticModel, *, prefer: Preference = "auto") -> FieldEngine:
    """Return the fastest engine for *model*, or the one asked for.

    Parameters
    ----------
    prefer : {"auto", "numpy", "numpy32", "numba"}
        "numpy" is the float64 reference. "auto" is compiled code where numba is installed, else
        numpy in single precision; one line in the log says so if it is not the first.

    Raises
    ------
    ConfigurationError
        An unknown preference; "numba" where it is not installed; single precision for a model that
        it does not serve.
    """
    if prefer == "numpy":
        return NumpyEngine(model)
    if prefer == "numpy32":
        return Numpy32Engine(model)
    if prefer == "numba":
        return NumbaEngine(model)
    if prefer != "auto":
        raise ConfigurationError(f"engine is {prefer!r}, must be auto, numpy, numpy32 or numba")
    reason = _why_not_single(model)
    if reason is not None:
        _log.info("field engine: numpy in double precision, since %s", reason)
        return NumpyEngine(model)
    if load_kernels() is None:
        _log.info("field engine: numpy in single precision, since numba is not installed")
        return Numpy32Engine(model)
    return NumbaEngine(model)


def _why_not_single(model: AcousticModel) -> str | None:
    """Return why single precision does not serve *model*, or None if it does."""
    if gain_polynomial(model) is None:
        return f"no polynomial serves {model.transducer.directivity}"
    aperture = float(np.linalg.norm(model.array.positions_m - model.array.centre_m, axis=1).max())
    if aperture > _MAX_APERTURE * model.wavelength_m:
        limit = _MAX_APERTURE * model.wavelength_m
        return f"an element is {aperture:.3g} m from the array's centre, more than {limit:.3g} m"
    if model.medium.absorption_np_m * aperture > _MAX_APERTURE_LOSS:
        return f"the absorption is {model.medium.absorption_np_m:.3g} Np/m"
    return None


class _SingleEngine(ABC):
    """What both engines share: checks, chunks, and the way to the reference."""

    def __init__(self, model: AcousticModel) -> None:
        reason = _why_not_single(model)
        gain = gain_polynomial(model)
        if reason is not None or gain is None:
            raise ConfigurationError(f"single precision does not serve this model: {reason}")
        self._model = model
        wavelength = model.wavelength_m
        strength = math.sqrt(2.0) * model.transducer.source_strength_pa_m / wavelength
        self._gain = (strength * gain).astype(np.float32)
        offsets = model.array.positions_m - model.array.centre_m
        self._radius_m = float(np.linalg.norm(offsets, axis=1).max())
        self._reach_of_few_m = self._reach_m(_REACH)
        self._reach_of_many_m = self._reach_m(_REACH_OF_MANY)

    def _reach_m(self, wavelengths: float) -> float:
        """Return how far from the array's centre the errors stay within the promise."""
        absorption = self._model.medium.absorption_np_m
        lossy_m = 2.0 * _MAX_LOSS / absorption if absorption > 0.0 else math.inf
        return min(wavelengths * self._model.wavelength_m, lossy_m) - self._radius_m

    @property
    def model(self) -> AcousticModel:
        """The model whose field this is."""
        return self._model

    def pressure(self, weights: ArrayLike, points_m: ArrayLike) -> ComplexArray:
        """Return what :func:`haptogram.acoustics.pressure` returns, to 2e-5 of the magnitudes.

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
            What does not fit the model, is not finite, lies within 1 mm of an element, or a result
            of more than half of the memory.
        """
        drives = as_weights(weights)
        if drives.ndim not in (1, 2) or drives.shape[-1] != self._model.array.count:
            raise ConfigurationError(
                f"weights have shape {drives.shape}, must end in {self._model.array.count} elements"
            )
        points = np.ascontiguousarray(as_points("points_m", points_m))
        shape = (*drives.shape[:-1], len(points))
        check_memory("a field", shape, 16)
        many = _effective_count(drives) >= _MANY
        usable = self._usable(points, self._reach_of_many_m if many else self._reach_of_few_m)
        if usable is None:
            return self._fast(drives, points, careful=not many)
        result = np.empty(shape, dtype=np.complex128)
        result[..., ~usable] = NumpyEngine(self._model).pressure(drives, points[~usable])
        result[..., usable] = self._fast(drives, points[usable], careful=not many)
        return result

    def propagators(self, points_m: ArrayLike) -> NDArray[np.complex64]:
        """Return the (M, N) pressures of the elements at unit weight, in pascals.

        Raises
        ------
        ConfigurationError
            As :meth:`pressure`.
        """
        points = np.ascontiguousarray(as_points("points_m", points_m))
        shape = (len(points), self._model.array.count)
        check_memory("a matrix", shape, 8)
        usable = self._usable(points, self._reach_of_few_m)
        fast = np.ones(len(points), dtype=np.bool_) if usable is None else usable
        result = np.empty(shape, dtype=np.complex64)
        if usable is not None:
            result[~fast] = propagators(self._model, points[~fast])
        rows = np.flatnonzero(fast)
        for part in chunks(len(rows), self._wave_points):
            real, imaginary = self._waves(points[rows[part]])
            result.real[rows[part]] = real.T
            result.imag[rows[part]] = imaginary.T
        return result

    def _fast(self, drives: ComplexArray, points: FloatArray, *, careful: bool) -> ComplexArray:
        """Return the pressure at points that are all served.

        *careful*: so few elements are active that their rounding errors do not average out.
        """
        result = np.empty((*drives.shape[:-1], len(points)), dtype=np.complex128)
        if drives.ndim == 1:
            for part in chunks(len(points), _CALL_POINTS):
                self._one_drive(drives, points[part], careful, result[part])
            return result
        matrix = _real_form(drives)
        count = len(drives)
        for part in chunks(len(points), self._wave_points):
            waves = self._waves(points[part])
            both = matrix @ waves.reshape(-1, waves.shape[2])
            result[:, part].real = both[:count]
            result[:, part].imag = both[count:]
        return result

    @property
    @abstractmethod
    def _wave_points(self) -> int:
        """The largest number of points that `_waves` takes."""

    @abstractmethod
    def _usable(self, points: FloatArray, reach_m: float) -> BoolArray | None:
        """Return which points within reach are served, or None if all are."""

    @abstractmethod
    def _one_drive(
        self, drive: ComplexArray, points: FloatArray, careful: bool, result: ComplexArray
    ) -> None:
        """Set the pressure of one drive."""

    @abstractmethod
    def _waves(self, points: FloatArray) -> SingleArray:
        """Return the (2, N, M) real and imaginary parts of the propagators."""


class NumbaEngine(_SingleEngine):
    """Compiled loops, one thread.

    The first call of a process takes the machine code from the cache, or makes it (seconds):
    :meth:`warm_up` does so at a time of one's own choosing.

    Raises
    ------
    ConfigurationError
        numba is not installed, or single precision does not serve the model.
    """

    def __init__(self, model: AcousticModel) -> None:
        super().__init__(model)
        kernels = load_kernels()
        if kernels is None:
            raise ConfigurationError("numba is not installed: pip install 'haptogram[fast]'")
        self._kernels: ModuleType = kernels
        self._layout = Layout.of(model)
        half = model.array.half_extent_m
        clearance = _CLEARANCE * model.wavelength_m
        middle = (model.array.positions_m.max(axis=0) + model.array.positions_m.min(axis=0)) / 2.0
        shift = np.abs(middle - model.array.centre_m)
        self._bounds = np.concatenate([model.array.centre_m, half + shift + clearance])
        self._clearance_m = clearance

    def warm_up(self) -> None:
        """Load or make the machine code of every call that this engine can make.

        There is one for each loop: points are copied if their array is read-only or strided.
        """
        drive = np.ones(self._model.array.count, dtype=np.complex128)
        for count in (1, 20):
            points = np.tile(self._model.array.centre_m + 0.1, (count, 1))
            self._usable(points, 1.0)
            self._fast(drive, points, careful=False)
            self._fast(np.tile(drive, (2, 1)), points, careful=True)

    @property
    def _wave_points(self) -> int:
        return 256

    def _usable(self, points: FloatArray, reach_m: float) -> BoolArray | None:
        usable = np.empty(len(points), dtype=np.bool_)
        refused = self._kernels.usable_points(
            _writeable(points),
            self._layout.positions_m,
            self._bounds,
            reach_m,
            self._clearance_m,
            usable,
        )
        return usable if refused else None

    def _one_drive(
        self, drive: ComplexArray, points: FloatArray, careful: bool, result: ComplexArray
    ) -> None:
        layout, points = self._layout, _writeable(points)
        polar = np.empty((2, len(drive)), dtype=np.float32)
        self._kernels.polar_form(_writeable(drive), polar)
        if layout.lattice is None:
            self._kernels.free_pressure(
                points, layout.frame, layout.constants, careful, self._gain, layout.elements, polar,
                result,
            )  # fmt: skip
        else:
            self._kernels.lattice_pressure(
                points, layout.frame, layout.constants, careful, self._gain, layout.x, layout.y,
                layout.nodes, polar, result,
            )  # fmt: skip

    def _waves(self, points: FloatArray) -> SingleArray:
        layout, points = self._layout, _writeable(points)
        size = (len(points) + 15) // 16 * 16
        waves = np.empty((2, self._model.array.count, size), dtype=np.float32)
        if layout.lattice is None:
            self._kernels.free_waves(
                points, layout.frame, layout.constants, self._gain, layout.elements, waves
            )
        else:
            self._kernels.lattice_waves(
                points, layout.frame, layout.constants, self._gain, layout.x, layout.y,
                layout.nodes, waves,
            )  # fmt: skip
        return waves[:, :, : len(points)]


class Numpy32Engine(_SingleEngine):
    """numpy in single precision, with buffers that are kept: a fifth of the compiled speed.

    r - r0 = (r^2 - r0^2) / (r + r0), with r0 the distance from the array's centre: the difference
    is small, so its phase is exact enough, and r^2 - r0^2 = |s|^2 - 2 s x is a matrix product.
    """

    def __init__(self, model: AcousticModel) -> None:
        super().__init__(model)
        wavelength, array = model.wavelength_m, model.array
        places = (array.positions_m - array.centre_m) / wavelength
        squares = (places**2).sum(axis=1)
        self._squares = single(np.vstack([-2.0 * places.T, squares]))
        along = -(places * array.normals).sum(axis=1)
        self._cosines = single(np.vstack([array.normals.T, along]))
        self._size = max(1, (1 << 16) // array.count)
        shape = (self._size, array.count)
        self._buffers = [np.empty(shape, dtype=np.float32) for _ in range(4)]

    @property
    def _wave_points(self) -> int:
        return self._size

    def _usable(self, points: FloatArray, reach_m: float) -> BoolArray | None:
        """Return the points neither far away nor so near that r^2 loses digits."""
        distance = np.linalg.norm(points - self._model.array.centre_m, axis=1)
        # r >= |x| - |s|: outside of twice the aperture no r is below half of the largest term.
        nearest = max(2.0 * self._radius_m, _CLEARANCE * self._model.wavelength_m)
        usable: BoolArray = (distance <= reach_m) & (distance >= nearest)
        close = np.flatnonzero((distance <= reach_m) & ~usable)
        for part in chunks(len(close), self._size):
            usable[close[part]] = self._clear(points[close[part]])
        return None if usable.all() else usable

    def _clear(self, points: FloatArray) -> BoolArray:
        """Return which points keep 0.6 of the aperture's radius from every element."""
        offsets = points[:, None, :] - self._model.array.positions_m
        nearest = np.sqrt(np.einsum("mni,mni->mn", offsets, offsets).min(axis=1))
        limit = max(0.6 * self._radius_m, _CLEARANCE * self._model.wavelength_m)
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
        for part in chunks(len(points), self._size):
            real, imaginary, turn = self._polar(points[part])
            both = np.stack([real @ weights, imaginary @ weights])
            result[part] = turn * (both[0] + 1j * both[1])

    def _waves(self, points: FloatArray) -> SingleArray:
        real, imaginary, turn = self._polar(points)
        c, s = turn.real[:, None], turn.imag[:, None]
        waves = np.stack([real * c - imaginary * s, real * s + imaginary * c])
        return np.ascontiguousarray(waves.transpose(0, 2, 1), dtype=np.float32)

    def _polar(self, points: FloatArray) -> tuple[SingleArray, SingleArray, ComplexArray]:
        """Return (M, N) real and imaginary parts, and the (M,) phasors they still lack."""
        places = (points - self._model.array.centre_m) / self._model.wavelength_m
        square = (places**2).sum(axis=1)
        distance = np.sqrt(square)
        homogeneous = single(np.hstack([places, np.ones((len(places), 1))]))
        q, r, phase, level = (buffer[: len(points)] for buffer in self._buffers)
        np.matmul(homogeneous, self._squares, out=q)
        np.add(q, single(square)[:, None], out=r)
        np.sqrt(r, out=r)
        np.add(r, single(distance)[:, None], out=phase)
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
        behind = cosine < 0.0 if is_baffled(self._model) else None
        cosine *= cosine
        level[:] = self._gain[-1]
        for coefficient in self._gain[-2::-1]:
            level *= cosine
            level += coefficient
        level *= r
        loss = np.float32(self._model.medium.absorption_np_m * self._model.wavelength_m)
        if loss != 0.0:  # a cubic serves: |alpha (r - r0)| is at most _MAX_APERTURE_LOSS
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


def chunks(count: int, size: int) -> Iterator[slice]:
    """Return the slices that divide *count* items into parts of at most *size*."""
    return (slice(start, min(start + size, count)) for start in range(0, count, size))


def _effective_count(drives: ComplexArray) -> float:
    """Return how many elements share the work, in the drive where they are fewest."""
    level = np.abs(drives)
    if drives.ndim == 1:  # one call for a few points must not cost more than the points
        return float(level.sum()) ** 2 / max(float(level @ level), 1e-300)
    power = np.maximum((level * level).sum(axis=1), 1e-300)
    return float((level.sum(axis=1) ** 2 / power).min(initial=math.inf))


def _real_form(drives: ComplexArray) -> SingleArray:
    """Return the (2F, 2N) real matrix that does to (real, imaginary) what *drives* do."""
    real, imaginary = drives.real, drives.imag
    return single(np.block([[real, -imaginary], [imaginary, real]]))


def _writeable(values: NDArray[_T]) -> NDArray[_T]:
    """Return *values*, copied if read-only: to the compiler that would be another type."""
    return values if values.flags.writeable and values.flags.c_contiguous else values.copy()
