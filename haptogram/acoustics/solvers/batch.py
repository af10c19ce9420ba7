"""Phase codes for many foci at once."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from haptogram.acoustics.arrays import FloatArray, as_coordinates, as_float_array, as_point_array
from haptogram.acoustics.field.engines.compiled import compiled_kernels, load_kernels
from haptogram.acoustics.field.engines.layout import EngineLayout, as_single_precision
from haptogram.acoustics.memory import check_array_memory
from haptogram.acoustics.model.drive import REGISTER_BITS, quantise_phase
from haptogram.acoustics.model.model import AcousticModel
from haptogram.acoustics.solvers.focus import focus_phases
from haptogram.errors import ConfigurationError
from haptogram.settings.arguments import check_whole

_MAX_DISTANCE: Final = (
    100.0  # wavelengths; beyond it a float32 no longer resolves a phase step well
)
_CALL_TARGETS: Final = 1 << 14  # some milliseconds: Ctrl-C waits no longer


class FocusCodes:
    """Makes the phase codes that focus on targets.

    With numba, in single precision: one code in about a thousand differs by one step from
    ``quantise_phase(focus_phases(...))``, where the exact phase lies on the edge between two codes.
    Without numba, beyond 100 wavelengths, or with a calibration, it is that call.

    Parameters
    ----------
    model : AcousticModel
        The array and its medium.
    phase_bits : int
        Resolution of the codes, 1 to 8.

    Examples
    --------
    >>> codes = FocusCodes(model).codes([target, (0.02, 0.0, 0.15)])
    >>> codes.shape, codes.dtype.name
    ((2, 256), 'uint8')
    """

    def __init__(self, model: AcousticModel, phase_bits: int = REGISTER_BITS) -> None:
        check_whole("phase_bits", phase_bits, 1, REGISTER_BITS)
        self._model = model
        self._phase_bits = phase_bits
        self._kernels = load_kernels() if model.calibration is None else None
        layout = EngineLayout.of(model)
        self._frame = layout.frame
        self._places = as_single_precision(layout.elements[:, :3].T)
        self._centre: list[float] = model.array.centre_m.tolist()
        self._near_m = _MAX_DISTANCE * model.wavelength_m - layout.radius_m
        self._target = np.empty((1, 3))

    def codes(
        self, targets_m: ArrayLike, out: NDArray[np.uint8] | None = None
    ) -> NDArray[np.uint8]:
        """Return the codes floor(-k r / 2 pi * 2^bits + 1/2) mod 2^bits.

        Parameters
        ----------
        targets_m : (3,) or (T, 3) array_like
            Target or targets, in metres.
        out : numpy.ndarray of uint8, optional
            Where to put the result, of its shape and C-contiguous.

        Returns
        -------
        (N,) or (T, N) numpy.ndarray of uint8

        Raises
        ------
        ConfigurationError
            Targets that are not finite; *out* of another shape; a result of more than half of the
            memory.
        """
        values = as_float_array("targets_m", targets_m)
        if values.ndim == 1 and out is None:
            return self.focus(*as_coordinates("targets_m", values).tolist())
        targets = values.reshape(1, -1) if values.ndim == 1 else values
        if targets.ndim != 2 or targets.shape[1] != 3:
            raise ConfigurationError(f"targets_m has shape {values.shape}, must be (3,) or (T, 3)")
        shape = (*values.shape[:-1], self._model.array.count)
        check_array_memory("codes", (len(targets), shape[-1]), 1)
        result = np.empty(shape, dtype=np.uint8) if out is None else out
        if result.shape != shape or result.dtype != np.uint8 or not result.flags.c_contiguous:
            raise ConfigurationError(
                f"out is {result.dtype} of shape {result.shape}, "
                f"must be C-contiguous uint8 of shape {shape}"
            )
        rows = result.reshape(len(targets), shape[-1])
        for start in range(0, len(targets), _CALL_TARGETS):
            part = slice(start, start + _CALL_TARGETS)
            self._fill(np.array(targets[part]), rows[part])  # writeable, as the kernel wants it
        return result

    def focus(self, x_m: float, y_m: float, z_m: float) -> NDArray[np.uint8]:
        """Return the (N,) codes of one target: the quick way, for a loop that sends frames.

        Raises
        ------
        ConfigurationError
            A target that is not finite.
        """
        result = np.empty((1, self._model.array.count), dtype=np.uint8)
        target = self._target
        target[0, 0], target[0, 1], target[0, 2] = x_m, y_m, z_m
        offset = (
            abs(x_m - self._centre[0]) + abs(y_m - self._centre[1]) + abs(z_m - self._centre[2])
        )
        if self._kernels is not None and offset < self._near_m:  # not for NaN
            self._compute(target, result)
        else:
            self._fill(as_point_array("target", target), result)
        codes: NDArray[np.uint8] = result[0]
        return codes

    def warm_up(self) -> None:
        """Load or make the machine code; numba is imported, whose calls take the least time."""
        if self._kernels is not None:
            self._kernels = compiled_kernels()
        self.codes(self._model.array.centre_m + 0.1 * self._model.array.normals[0])

    def _fill(self, targets: FloatArray, rows: NDArray[np.uint8]) -> None:
        offsets = targets - self._model.array.centre_m
        furthest = math.sqrt(np.einsum("ti,ti->t", offsets, offsets).max(initial=0.0))
        if self._kernels is not None and furthest < self._near_m:
            self._compute(targets, rows)
            return
        for start in range(0, len(targets), 256):
            phases = focus_phases(self._model, targets[start : start + 256])
            rows[start : start + 256] = quantise_phase(phases, self._phase_bits)

    def _compute(self, targets: FloatArray, rows: NDArray[np.uint8]) -> None:
        assert self._kernels is not None
        self._kernels.focus_codes_kernel(
            targets, self._frame, self._places, 1 << self._phase_bits, rows
        )
