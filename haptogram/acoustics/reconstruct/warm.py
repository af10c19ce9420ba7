"""The foci of drive after drive, in compiled code, as long as none jumps."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from haptogram.acoustics.arrays import FloatArray
from haptogram.acoustics.field.engines.numba_engine import NumbaEngine
from haptogram.acoustics.field.engines.parallel import ParallelPistons
from haptogram.acoustics.levels.force import ReflectingDisc, level_db_spl
from haptogram.acoustics.model.drive import FULL_AMPLITUDE, REGISTER_BITS, Drive, phase_step_rad
from haptogram.acoustics.model.model import AcousticModel
from haptogram.acoustics.reconstruct.estimates import SingleFocus
from haptogram.acoustics.solvers.focus import MAX_TARGET_DISTANCE_M, MIN_TARGET_DISTANCE_M
from haptogram.acoustics.solvers.focus_fit import LEAST_SEEN_SHARE

if TYPE_CHECKING:
    from haptogram.acoustics.reconstruct.tracking import FocusTracker

CLEARANCE_M: Final = 0.75 * MIN_TARGET_DISTANCE_M  # a fit nearer to an element is no focus
REACH_M: Final = 1.25 * MAX_TARGET_DISTANCE_M  # nor is one this far away: a plane wave
COARSE_RAD: Final = math.tau / 8.0 * (1.0 - 1e-9)  # phase step with ambiguous places (3 bits)
_DISC_M: Final = 0.012  # above the highest element: a disc there touches none, however it lies
_ALL: Final = (True, True, True)
_LEAST_QUICK_RAD: Final = phase_step_rad(REGISTER_BITS) / 2.0
_QUICK_MARGIN_RAD: Final = 1e-3  # the rounding of the quick fit, and of phases between two codes


class DriveToFind(NamedTuple):
    """A drive whose focus is asked for, and how exact its phases are.

    Attributes
    ----------
    drive : Drive
        The drive.
    step_rad, slack_rad : float
        As in :meth:`.Reconstructor.reconstruct_weights`.
    """

    drive: Drive
    step_rad: float
    slack_rad: float = 0.0


class WarmReconstructor:
    """Finds the foci of drives of full amplitude, each beside the one before.

    Parameters
    ----------
    model : AcousticModel
        Array and medium, of which :meth:`why_not` says nothing.
    disc : ReflectingDisc
        The disc that the force is exerted on, of a :class:`.NumbaEngine`.
    tracker : FocusTracker
        Says where the fit starts.
    """

    def __init__(self, model: AcousticModel, disc: ReflectingDisc, tracker: FocusTracker) -> None:
        engine = disc.engine
        assert isinstance(engine, NumbaEngine)
        self._pistons = ParallelPistons.of(model)
        self._full = bytes([FULL_AMPLITUDE]) * model.array.count
        self._tracker = tracker.kernel_arguments
        self._disc = *disc.kernel_arguments, disc.force_per_stress
        least_height_m = max(CLEARANCE_M, engine.clearance_m + _DISC_M)
        self._bounds = np.array([CLEARANCE_M, REACH_M, least_height_m, LEAST_SEEN_SHARE])

    @classmethod
    def why_not(cls, model: AcousticModel, disc: ReflectingDisc) -> str | None:
        """Return why a model has no such reconstructor; None: it has."""
        if not isinstance(disc.engine, NumbaEngine):
            return "another field engine"
        return ParallelPistons.why_not(model)

    def warm_up(self, start: FloatArray) -> None:
        """Load or make the machine code."""
        drive = Drive(np.zeros(len(self._full), np.uint8), np.frombuffer(self._full, np.uint8))
        self.foci([DriveToFind(drive, math.pi / 128.0)], start)

    def serves(self, asked: DriveToFind) -> bool:
        """Return True for full amplitudes, and for phases that do not suit several places."""
        drive = asked.drive
        is_usual = asked.step_rad < COARSE_RAD and drive.phase_bits == REGISTER_BITS
        return is_usual and drive.amplitude_codes.tobytes() == self._full

    def foci(self, asked: list[DriveToFind], start: FloatArray) -> list[SingleFocus]:
        """Return the foci of the first of the drives, until one is not beside that before."""
        kernels = self._pistons.kernels
        codes = np.array([one.drive.phase_codes for one in asked])
        found = np.empty((len(asked), kernels.FOCUSED_MEASURES))
        steps_rad = np.array([one.step_rad for one in asked])
        limits_rad = steps_rad / 2.0 + 1e-9 + np.array([one.slack_rad for one in asked])
        count = kernels.focused_frames_kernel(
            codes, 1 << REGISTER_BITS, steps_rad, limits_rad, quick_limits_rad(limits_rad),
            start.copy(), self._tracker, self._bounds, self._pistons.places, self._pistons.medium,
            *self._disc, found,
        )  # fmt: skip
        return [_warm_focus(row) for row in found[:count].tolist()]


def quick_limits_rad(limits_rad: ArrayLike) -> FloatArray:
    """Return the residuals that the search in single precision may leave."""
    return np.maximum(limits_rad, _LEAST_QUICK_RAD) + _QUICK_MARGIN_RAD


def _warm_focus(row: list[float]) -> SingleFocus:
    """Convert a kernel's result row of 13 numbers to a SingleFocus."""
    px, py, pz, sx, sy, sz, bx, by, bz, residual_rad, coherence, pressure, force_n = row
    return SingleFocus(
        (px, py, pz), (sx, sy, sz), (bx, by, bz), _ALL, residual_rad, coherence, pressure,
        level_db_spl(pressure), force_n, "warm",
    )  # fmt: skip
