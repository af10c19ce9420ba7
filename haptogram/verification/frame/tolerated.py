"""The host that is tolerated, and whose phases come nearest to those of one focus.

A tolerance of place and air allows a set of hosts: each takes a place within the miss for the
target, in air within the range.  A drive is right if it is that of one of them, up to rounding.  So
the criteria of a strict verdict are asked of the nearest one; what no place and no air within the
tolerance explains of an element stays an error of that element.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics.arrays import FloatArray
from haptogram.acoustics.solvers.focus_fit import wrapped_phases

from ..faults import faulty_elements_text
from ..tolerance import Tolerance, Uncertainty
from .target import Bools, FrameTarget

_STEPS: Final = 12
_SETTLED: Final = 1e-4  # of the tolerance
_ROUNDS: Final = 3  # of the exact solution, each linearised anew
_HOPELESS: Final = 1.5  # times the limit: an RMS error that no place within rounding explains
_EXACT: Final = 1.0 + 1e-4
FEW_FRAME_ELEMENTS: Final = 0.25  # share of the elements that can be wrong one by one
#: Standard uncertainties by which one element of some hundreds may be off.
_COVERAGE: Final = 5.0
_PAIR: Final = 2
_DIRECTIONS: Final = 128  # on the ball of the tolerated miss: their planes are within 2 % of it
_ANYWHERE: Final = Tolerance(miss_mm=10.0, temperature_c=20.0)


@dataclass(frozen=True, eq=False)
class ToleratedHost:
    """A host within a tolerance.

    Attributes
    ----------
    asked : FrameTarget
        What the target asks for, with the tolerance.
    phases_rad : (N,) numpy.ndarray
        Phases of the drive.
    active : (N,) numpy.ndarray of bool
        Elements that sound.
    share : (4,) numpy.ndarray
        How much of the tolerance it takes: of the miss along x, y and z, and of the air.
    known : Uncertainty
        How well the elements are known.
    """

    asked: FrameTarget
    phases_rad: FloatArray
    active: Bools
    share: FloatArray
    known: Uncertainty

    @classmethod
    def nearest(
        cls,
        asked: FrameTarget,
        phases_rad: FloatArray,
        active: Bools,
        known: Uncertainty | None = None,
    ) -> ToleratedHost:
        """Return the host whose phases come nearest to those of the *active* elements."""
        host = cls(asked, phases_rad, active, np.zeros(4), known or Uncertainty())
        if asked.tolerance.is_strict or host.explains:
            return host
        host = host.fitted()
        errors = host.errors_rad[active]
        if host.explains or math.sqrt(np.mean(errors**2)) > _HOPELESS * host.limit_rad:
            return host
        for _ in range(_ROUNDS):
            host = host.balanced()
            if host.explains:
                break
        return host

    @cached_property
    def _scale(self) -> FloatArray:
        """(4,) the whole tolerance: metres, and the share of the speed of sound."""
        tolerance = self.asked.tolerance
        share = tolerance.speed_share(self.asked.model.medium)
        return np.array([tolerance.miss_mm / 1e3] * 3 + [share])

    @property
    def limit_rad(self) -> float:
        """Largest phase error of an element: of rounding, and of what is not known of it."""
        return self.asked.phase_limit_rad + frame_scatter_rad(self.asked, self.known)

    @cached_property
    def target(self) -> FrameTarget:
        """The demands of the place that it takes for the target, in the air that it assumes."""
        if not self.share.any() and self.limit_rad == self.asked.phase_limit_rad:
            return self.asked
        *away_m, faster = (self._scale * self.share).tolist()
        model = self.asked.model
        return FrameTarget(
            model.with_sound_speed(model.medium.sound_speed_m_s * (1.0 + faster)),
            self.asked.position_m + away_m,
            self.asked.amplitudes,
            self.limit_rad,
            Tolerance(),
        )

    @cached_property
    def errors_rad(self) -> FloatArray:
        """(N,) phase error of each element; that of the middle of the active ones is 0."""
        errors, _ = self.linearised(self.active)
        sounding = errors[self.active]
        centred: FloatArray = errors - (sounding.max() + sounding.min()) / 2.0
        return centred

    @property
    def error_rad(self) -> float:
        """S1: half the range of the phase errors, the phase that all share taken out."""
        return float(np.ptp(self.errors_rad[self.active])) / 2.0

    @property
    def explains(self) -> bool:
        """True if no element is off by more than rounding and what is not known of it."""
        if self.error_rad > self.limit_rad * (1.0 if self.asked.tolerance.is_strict else _EXACT):
            return False
        return self.explains_roughly

    @property
    def explains_roughly(self) -> bool:
        """True if the root mean square of the phase errors is no more than that leaves."""
        scatter_rad = frame_scatter_rad(self.asked, self.known) / _COVERAGE
        allowed_rad = scatter_rad * (1.0 + 3.0 / math.sqrt(self.active.sum()))
        spread_rad = float(np.std(self.errors_rad[self.active]))
        return spread_rad <= self.asked.phase_limit_rad + allowed_rad

    @property
    def _off_rad(self) -> float:
        """Phase error of an element that is off by itself: a fit may move what is right."""
        return self.limit_rad + self.asked.phase_limit_rad

    # --- search ----------------------------------------------------------------------------------

    def linearised(self, used: Bools) -> tuple[FloatArray, FloatArray]:
        """Return phase errors (N,), the mean of the *used* ones 0, and their slopes (N, 4)."""
        model, scale = self.asked.model, self._scale
        faster = 1.0 + float(scale[3] * self.share[3])
        rays = self.asked.position_m + scale[:3] * self.share[:3] - model.array.positions_m
        distances = np.linalg.norm(rays, axis=1)
        k = model.wavenumber / faster
        lags = 0.0 if model.calibration is None else model.calibration.phase_rad
        errors = self.phases_rad + lags + k * distances
        errors = wrapped_phases(errors - np.angle(np.exp(1j * errors[used]).sum()))
        slopes = np.column_stack([rays / distances[:, None], -distances / faster]) * (k * scale)
        return errors - errors[used].mean(), slopes - slopes[used].mean(axis=0)

    def fitted(self) -> ToleratedHost:
        """Return the host of the least squares; elements that stick out by far do not count.

        What of the tolerance it takes weighs as much as an error by rounding does.
        """
        host, used = self, self.active
        prior = self.asked.phase_limit_rad * np.eye(4)
        for _ in range(_STEPS):
            errors, slopes = host.linearised(used)
            rows = np.vstack([slopes[used], prior])
            wanted = np.concatenate([-errors[used], -prior @ host.share])
            step = np.linalg.lstsq(rows, wanted, rcond=None)[0]
            host = dataclasses.replace(host, share=_tolerated_shares(host.share + step))
            sizes = np.abs(host.linearised(used)[0])
            widest = max(self._off_rad, 3.0 * float(np.median(sizes[self.active])))
            before, used = used, self.active & (sizes <= widest)
            if np.abs(step).max() < _SETTLED and (used == before).all():
                break
        return host

    def balanced(self) -> ToleratedHost:
        """Return the host whose largest phase error is the least."""
        from scipy.optimize import linprog  # slow to import, and only a tolerance needs it

        errors, slopes = self.linearised(self.active)
        errors, slopes = errors[self.active], slopes[self.active]
        ones, ball = np.ones((len(errors), 1)), _directions_of_tolerance()
        rows = np.vstack(
            [
                np.hstack([slopes, ones, -ones]),
                np.hstack([-slopes, -ones, -ones]),
                np.hstack([ball, np.zeros((len(ball), 3))]),
            ]
        )
        most = np.concatenate([-errors, errors, 1.0 - ball @ self.share[:3]])
        air = (-1.0 - self.share[3], 1.0 - self.share[3])
        free = (None, None)
        found = linprog(
            [0.0] * 5 + [1.0], rows, most, bounds=[free, free, free, air, free, (0.0, None)]
        )
        if found.x is None:
            return self
        other = dataclasses.replace(self, share=self.share + found.x[:4])
        return other if other.error_rad < self.error_rad else self

    # --- what it does not explain ----------------------------------------------------------------

    def fault(self) -> str | None:
        """Name what no place and no air within the tolerance explains of the elements."""
        host = self.fitted()
        errors, _ = host.linearised(self.active)
        errors = wrapped_phases(errors - float(np.median(errors[self.active])))
        off = self.active & (np.abs(errors) > self._off_rad)
        rest = errors[self.active & ~off]
        within = bool(len(rest)) and np.sqrt(np.mean(rest**2)) <= self.limit_rad
        if off.any() and within and off.sum() <= FEW_FRAME_ELEMENTS * self.active.sum():
            return self._elements_text(errors, np.flatnonzero(off))
        if self._anywhere().explains_roughly:
            return None
        rms_rad = math.sqrt(np.mean(errors[self.active] ** 2))
        return (
            f"phases of {int(self.active.sum())} elements scattered by {rms_rad:.2f} rad RMS, more "
            "than a focus within the tolerance leaves"
        )

    def _elements_text(self, errors: FloatArray, numbers: NDArray[np.intp]) -> str:
        names, limit_rad = faulty_elements_text(self.asked.model, numbers), self._off_rad
        if bool((np.abs(np.abs(errors[numbers]) - math.pi) <= limit_rad).all()):
            return f"{names} inverted"
        if len(numbers) == _PAIR:
            swapped = self.phases_rad.copy()
            swapped[numbers] = self.phases_rad[numbers[::-1]]
            other = dataclasses.replace(self, phases_rad=swapped).fitted()
            if bool((np.abs(other.errors_rad[numbers]) <= limit_rad).all()):
                return f"{names} swapped"
        worst_rad = float(np.abs(errors[numbers]).max())
        return f"{names} out of step with the others, by up to {worst_rad:.2f} rad"

    def _anywhere(self) -> ToleratedHost:
        """Return the host of the least squares within any tolerance that can be stated."""
        asked = dataclasses.replace(self.asked, tolerance=_ANYWHERE)
        return dataclasses.replace(self, asked=asked, share=np.zeros(4)).fitted()


def frame_scatter_rad(target: FrameTarget, known: Uncertainty) -> float:
    """Return by how much one element may be off for what is stated not to be known of it.

    Nothing for a strict verdict, which has the elements as they are told.
    """
    if target.tolerance.is_strict or known.is_guess:
        return 0.0
    moved_rad = target.model.wavenumber * known.position_mm / 1e3
    return _COVERAGE * math.hypot(moved_rad, known.phase_rad)


def _tolerated_shares(share: FloatArray) -> FloatArray:
    """Return (4,) shares of a tolerance brought within it."""
    length = max(1.0, float(np.linalg.norm(share[:3])))
    return np.append(share[:3] / length, np.clip(share[3], -1.0, 1.0))


def _directions_of_tolerance() -> FloatArray:
    """Return unit vectors all around, evenly."""
    n = np.arange(_DIRECTIONS) + 0.5
    z, turn = 1.0 - 2.0 * n / _DIRECTIONS, n * math.pi * (3.0 - math.sqrt(5.0))
    flat = np.sqrt(1.0 - z**2)
    return np.column_stack([flat * np.cos(turn), flat * np.sin(turn), z])
