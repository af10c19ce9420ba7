"""The focus of frame after frame, in microseconds.

The arithmetic of :func:`.focus_fit.fit_focus` in single precision, from phase codes as they are
latched. It answers where and how well; uncertainty and verdict are the reference's business.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics.arrays import FloatArray
from haptogram.acoustics.field.engines.compiled import Kernels, compiled_kernels, load_kernels
from haptogram.acoustics.field.engines.layout import EngineLayout, as_single_precision
from haptogram.acoustics.model.drive import REGISTER_BITS, phase_step_rad
from haptogram.acoustics.model.model import AcousticModel
from haptogram.acoustics.reconstruct.acquisition import HOPELESS_RAD
from haptogram.acoustics.reconstruct.cells import search_volume
from haptogram.acoustics.solvers.focus import MAX_TARGET_DISTANCE_M, MIN_TARGET_DISTANCE_M
from haptogram.errors import ConfigurationError
from haptogram.settings.arguments import check_whole

_MAX_STEPS: Final = 16
_FIRST_COUNT: Final = 40  # elements whose wide beam forgives a start that is off
_WIDENING: Final = 2.5  # growth of the number of elements from fit to fit
_RIVALS: Final = 48  # regions looked at, best first
_APART: Final = 0.1  # least distance of two regions, relative to that of the array
_REACH_M: Final = 1.25 * MAX_TARGET_DISTANCE_M
_CLEARANCE_M: Final = 0.75 * MIN_TARGET_DISTANCE_M
_CODES: Final = np.dtype(np.uint8)

Point: TypeAlias = tuple[float, float, float]


class Fix(NamedTuple):  # a dataclass would take as long to make as a Gauss-Newton step
    """The point that explains a frame's phases best.

    Attributes
    ----------
    position_m : tuple of float
        Fitted focus, in metres.
    phase_rad : float
        Common phase of the arrivals there.
    residual_rms_rad : float
        RMS phase residual of the fit, in radians.
    steps : int
        Gauss-Newton steps taken.
    converged : bool
        Whether the last step was below 1e-4 wavelengths.
    clearance_m : float
        Distance from the nearest element, in metres.

    Examples
    --------
    >>> found = FocusTracker(model).acquire(drive.phase_codes)
    >>> found.converged, bool(np.linalg.norm(np.array(found.position_m) - target) < 0.1e-3)
    (True, True)
    """

    position_m: Point
    phase_rad: float
    residual_rms_rad: float
    steps: int
    converged: bool
    clearance_m: float


class FocusTracker:
    """Finds the focus of frames of phase codes; every element that radiates counts as driven.

    Parameters
    ----------
    model : AcousticModel
        The array and its medium, at least four elements that radiate.
    phase_bits : int
        Resolution of the codes, 1 to 8.

    Raises
    ------
    ConfigurationError
        numba is not installed (use :class:`.Reconstructor`), or fewer than four elements radiate.

    Examples
    --------
    >>> tracker = FocusTracker(model)
    >>> found = tracker.fit(drive.phase_codes, start_m=(0.001, 0.0, 0.149))
    >>> tracker.explains(found), [round(1e3 * value + 0.0, 1) + 0.0 for value in found.position_m]
    (True, [0.0, 0.0, 150.0])
    """

    def __init__(self, model: AcousticModel, phase_bits: int = REGISTER_BITS) -> None:
        phase_bits = check_whole("phase_bits", phase_bits, 1, REGISTER_BITS)
        kernels = load_kernels()
        if kernels is None:
            raise ConfigurationError("numba is not installed: pip install numba")
        distance = np.linalg.norm(model.array.positions_m - model.array.centre_m, axis=1)
        self._order, lags_rad = _tracked_elements(model, np.argsort(distance, kind="stable"))
        if len(self._order) < 4:
            raise ConfigurationError(f"{len(self._order)} elements, a fit needs at least 4")
        self._kernels: Kernels = kernels
        self._model = model
        self._steps = 1 << phase_bits
        self._limit_rad = phase_step_rad(phase_bits) / 2.0
        layout = EngineLayout.of(model)
        self._frame = layout.frame
        self._places = as_single_precision(layout.elements[self._order, :3].T)
        self._lags = as_single_precision(lags_rad / (2.0 * np.pi))
        self._counts = _widening_counts(len(self._order))
        self._shape = (model.array.count,)
        self._ahead: Point = tuple(model.array.axes[2].tolist())
        self._bottom_m = float(model.array.centre_m @ model.array.axes[2])
        self._cells: FloatArray | None = None

    @property
    def kernel_arguments(self) -> tuple[object, ...]:
        """Arguments of the loop of :meth:`fit` besides codes and start, for other loops."""
        return self._order, self._places, self._lags, self._frame, _MAX_STEPS

    def fit(self, codes: NDArray[np.uint8], start_m: Point) -> Fix:
        """Return the focus next to *start_m*.

        Parameters
        ----------
        codes : (N,) numpy.ndarray of uint8
            Phase codes; C-contiguous.
        start_m : tuple of float
            Where to start, in metres.

        Raises
        ------
        ConfigurationError
            Codes of another type or length; a start that is not finite.
        """
        self._check_codes(codes)
        x, y, z = start_m
        if not math.isfinite(x + y + z):
            raise ConfigurationError(f"start_m is {start_m}, must be finite")
        return self._fit(codes, (x, y, z), self._counts[-1])

    def acquire(self, codes: NDArray[np.uint8], limit_rad: float | None = None) -> Fix:
        """Return the focus, wherever it is within the reach of :func:`.focus.check_focus_target`.

        The best fit, if no point explains the phases to *limit_rad*, see :meth:`explains`.

        Raises
        ------
        ConfigurationError
            Codes of another type or length.
        """
        self._check_codes(codes)
        if self._cells is None:
            self._set_up_search()
        cells = self._cells
        assert cells is not None
        score = np.empty(cells.shape[1], np.float32)
        self._kernels.cell_scores_kernel(codes, self._order, self._phasors, self._steps, score)
        best: Fix | None = None
        for _ in range(_RIVALS):
            index = self._kernels.best_cell_kernel(score, cells, self._apart)
            fix = self._widening_fit(codes, tuple(cells[:, index].tolist()))
            if self.explains(fix, limit_rad):
                return fix
            if best is None or fix.residual_rms_rad < best.residual_rms_rad:
                best = fix
        assert best is not None
        return best

    def warm_up(self) -> None:
        """Make the search volume, and load or make the machine code.

        numba is imported, whose calls take the least time.
        """
        self._kernels = compiled_kernels()
        self.acquire(np.zeros(self._model.array.count, dtype=np.uint8))

    def _set_up_search(self) -> None:
        """Set the search cells, and the phasors there of the elements that are fitted first."""
        first = self._order[: self._counts[0]]
        positions = self._model.array.positions_m[first]
        cells, matrix = search_volume(self._model, positions)
        if self._lags.any():
            matrix = matrix * np.exp(2j * np.pi * self._lags[: len(first)])
        self._phasors = np.ascontiguousarray(np.stack([matrix.real.T, matrix.imag.T]))
        self._apart = _APART * np.linalg.norm(cells - self._model.array.centre_m, axis=1)
        self._cells = np.ascontiguousarray(cells.T)

    def _widening_fit(self, codes: NDArray[np.uint8], start: Point) -> Fix:
        """Fit a focus to more and more elements; return the last fit, or one above 1.2 rad RMS.

        *codes*: phase codes of all elements; *start* is in m.
        """
        for count in self._counts:
            fix = self._fit(codes, start, count)
            if fix.residual_rms_rad > HOPELESS_RAD:
                break
            start = fix.position_m
        return fix

    def _fit(self, codes: NDArray[np.uint8], start: Point, count: int) -> Fix:
        """Fit a focus to the phase codes of the first *count* elements."""
        return Fix(
            *self._kernels.fit_phases_kernel(
                codes,
                self._order,
                self._places,
                self._lags,
                self._frame,
                start,
                self._steps,
                count,
                _MAX_STEPS,
            )
        )

    def explains(self, fix: Fix, limit_rad: float | None = None) -> bool:
        """Return True if *fix* is a focus: in front, within reach, and its residual small enough.

        Parameters
        ----------
        limit_rad : float, optional
            The largest RMS residual; half a phase step if not given.
        """
        if fix.residual_rms_rad > (self._limit_rad if limit_rad is None else limit_rad):
            return False
        (x, y, z), (ahead_x, ahead_y, ahead_z) = fix.position_m, self._ahead
        above = x * ahead_x + y * ahead_y + z * ahead_z > self._bottom_m
        return above and _CLEARANCE_M <= fix.clearance_m <= _REACH_M

    def _check_codes(self, codes: NDArray[np.uint8]) -> None:
        """Raise ConfigurationError for phase codes of another type or number of elements."""
        # One object for each type: a comparison takes longer.
        if (codes.dtype is not _CODES and codes.dtype != _CODES) or codes.shape != self._shape:
            raise ConfigurationError(
                f"codes are {codes.dtype} of shape {codes.shape}, "
                f"must be uint8 of shape {self._shape}"
            )


def _tracked_elements(
    model: AcousticModel, order: NDArray[np.intp]
) -> tuple[NDArray[np.intp], FloatArray]:
    """Return the elements of *order* that radiate, and by how much calibration turns each, in rad.

    Without a calibration: all, and 0.
    """
    if model.calibration is None:
        return order, np.zeros(len(order))
    order = order[model.calibration.heard[order]]
    return order, model.calibration.phase_rad[order]


def _widening_counts(count: int) -> list[int]:
    """Return the numbers of elements of successive fits: 40, then 2.5 times, to *count*."""
    counts = [min(_FIRST_COUNT, count)]
    while counts[-1] < count:
        counts.append(min(count, round(_WIDENING * counts[-1])))
    return counts
