"""The compiled engine."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics.arrays import BoolArray, ComplexArray, FloatArray
from haptogram.acoustics.field.engines.compiled import Kernels, compiled_kernels, load_kernels
from haptogram.acoustics.field.engines.layout import EngineLayout, SingleArray
from haptogram.acoustics.field.engines.single_precision import (
    CALL_POINTS,
    EngineReach,
    SingleEngine,
)
from haptogram.acoustics.field.reference import sounding_half_spaces
from haptogram.acoustics.memory import memory_chunks
from haptogram.acoustics.model.model import AcousticModel
from haptogram.errors import ConfigurationError

_T = TypeVar("_T", bound=np.generic)


class NumbaEngine(SingleEngine):
    """Compiled loops, one thread.

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

    REACH = EngineReach(aperture=256.0, aperture_loss=0.15, few=1000.0, many=1000.0)

    def __init__(self, model: AcousticModel) -> None:
        super().__init__(model)
        kernels = load_kernels()
        if kernels is None:
            raise ConfigurationError("numba is not installed: pip install numba")
        self._kernels: Kernels = kernels
        self._layout = EngineLayout.of(model)
        half = np.ptp(model.array.bounds_m, axis=0) / 2
        shift = np.abs(model.array.bounds_m.mean(axis=0) - model.array.centre_m)
        self._bounds = np.concatenate([model.array.centre_m, half + shift + self.clearance_m])
        self._fronts = sounding_half_spaces(model).copy()  # writeable, as all that the loops take

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

    @property
    def is_lattice(self) -> bool:
        """True if the elements lie on a lattice."""
        return self._layout.lattice is not None

    def kernel_arguments(self, *, careful: bool) -> tuple[object, ...]:
        """Return the arguments of the loops for a lattice, for other loops that call them."""
        layout = self._layout
        return (
            layout.frame, layout.constants, careful, self._gain, layout.x, layout.y, layout.nodes,
        )  # fmt: skip

    @property
    def _wave_points(self) -> int:
        return 256

    def _usable(self, points: FloatArray, reach_m: float) -> BoolArray | None:
        """Return a mask of the points in reach and in front; None if all points are usable."""
        usable, refused = np.empty(len(points), dtype=np.bool_), 0
        for part in memory_chunks(len(points), CALL_POINTS):
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
        layout, points = self._layout, _writeable_for_engine(points)
        polar = np.empty((2, len(drive)), dtype=np.float32)
        self._kernels.polar_form_kernel(_writeable_for_engine(drive), polar)
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

    def _waves(self, points: FloatArray) -> SingleArray:
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


def _writeable_for_engine(values: NDArray[_T]) -> NDArray[_T]:
    """Return *values*, copied if read-only: to the compiler that would be another type."""
    return values if values.flags.writeable and values.flags.c_contiguous else values.copy()
