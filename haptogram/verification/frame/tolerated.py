"""The host that is tolerated, and whose phases come nearest to those of a drive.

A tolerance of place and air allows a set of hosts: each takes places within the miss for the
targets, in air within the range.  A drive is right if it is that of one of them, up to rounding.
So the criteria of a strict verdict are asked of the nearest one; what no place and no air within
the tolerance explains of an element stays an error of that element.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics import AcousticModel
from haptogram.acoustics.arrays import ComplexArray, FloatArray
from haptogram.acoustics.solvers.focus_fit import wrapped_phases
from haptogram.settings.frozen import dataclass, field

from ..faults import faulty_elements_text
from ..tolerance import Tolerance, Uncertainty
from .target import Bools, FrameTarget

_STEPS: Final = 12
_SETTLED: Final = 1e-4  # step, relative to the tolerance, at which the solution has converged
_SLOPE: Final = 0.02  # step of the finite differences, relative to the tolerance
_ROUNDS: Final = 3  # rounds of the exact solution, each linearised again
_SHORTER: Final = (1.0, 0.3, 0.1, 0.03)  # factors tried on the step of such a solution
_HOPELESS: Final = 1.5  # times the limit: an RMS error that no place within rounding explains
_EXACT: Final = 1.0 + 1e-4
_SECOND_ORDER: Final = 1.5  # factor on the first-order bound
_LOUD: Final = 0.5  # least level, relative to the mean: below it the waves of foci nearly cancel
_FEW: Final = 0.25  # share of the elements that can be wrong one by one
#: Standard uncertainties by which one element of some hundreds may be off.
_COVERAGE: Final = 5.0
_PAIR: Final = 2
_DIRECTIONS: Final = 128  # directions of a tolerated miss: 2 % short of a ball at most
_ANYWHERE: Final = Tolerance(miss_mm=10.0, temperature_c=20.0)


@dataclass(frozen=True, eq=False)
class ToleratedHost:
    """A host within a tolerance, beside a drive.

    Attributes
    ----------
    drive : callable
        From how far a host is off, (4,) metres along x, y, z and share of the speed of sound, to
        the weights (N,) that it asks for.
    scale : (4,) numpy.ndarray
        The whole tolerance; 0: nothing is tolerated.
    rounding_rad, scatter_rad : float
        Largest phase error by rounding, and by what is not known of an element.
    phases_rad : (N,) numpy.ndarray
        Phases of the drive beside it.
    active : (N,) numpy.ndarray of bool
        Elements that sound.
    share : (4,) numpy.ndarray
        How much of the tolerance it takes: of the miss along x, y and z, and of the air.
    """

    drive: Callable[[FloatArray], ComplexArray]
    scale: FloatArray
    rounding_rad: float
    scatter_rad: float
    phases_rad: FloatArray
    active: Bools
    share: FloatArray = field(default_factory=lambda: np.zeros(4))

    @classmethod
    def nearest(
        cls,
        target: FrameTarget,
        known: Uncertainty,
        drive: Callable[[FloatArray], ComplexArray],
        phases_rad: FloatArray,
        active: Bools,
    ) -> ToleratedHost:
        """Return the host within the tolerance of a target whose phases come nearest.

        Parameters
        ----------
        drive : callable
            What the hosts ask for.
        phases_rad, active : (N,) numpy.ndarray
            Phases that came, and the elements that sound.
        """
        scale = scale_of_tolerance(target.tolerance, target.model)
        scatter_rad = frame_scatter_rad(target, known)
        return cls(drive, scale, target.phase_limit_rad, scatter_rad, phases_rad, active).searched()

    def searched(self) -> ToleratedHost:
        """Return the host of the same tolerance whose phases come nearest."""
        host = dataclasses.replace(self, share=np.zeros(4))
        if self.is_strict or host.explains:
            return host
        host = host.fitted()
        if host.explains or host.rms_rad > _HOPELESS * host.limit_rad:
            return host
        for _ in range(_ROUNDS):
            host = host.balanced()
            if host.explains:
                break
        return host

    @property
    def is_strict(self) -> bool:
        """True if nothing is tolerated."""
        return not self.scale.any()

    @property
    def off(self) -> FloatArray:
        """(4,) how far it is off: metres, and a share of the speed of sound."""
        return self.scale * self.share

    @property
    def limit_rad(self) -> float:
        """Largest phase error of an element: of rounding, and of what is not known of it."""
        return self.rounding_rad + self.scatter_rad

    @cached_property
    def _drive(self) -> ComplexArray:
        """Return the weights (N,) that a host with this error asks for."""
        return self.drive(self.off)

    @cached_property
    def levels(self) -> FloatArray:
        """(N,) how loud it asks for each element, over the mean; 1 at most."""
        levels = np.abs(self._drive)
        loudness: FloatArray = np.minimum(levels / levels[self.active].mean(), 1.0)
        return loudness

    @cached_property
    def errors_rad(self) -> FloatArray:
        """(N,) phase error of each element; that of the middle of the active ones is 0."""
        errors = self.errors_about(self.active)
        sounding = errors[self.active]
        centred: FloatArray = errors - (sounding.max() + sounding.min()) / 2.0
        return centred

    def errors_about(self, used: Bools) -> FloatArray:
        """Return (N,) the phase errors; the mean of the *used* ones is 0."""
        levels, errors = self.levels, self.phases_rad - np.angle(self._drive)
        common = np.angle((levels * np.exp(1j * errors))[used].sum())
        errors = wrapped_phases(errors - common)
        return errors - np.average(errors[used], weights=levels[used])

    @property
    def error_rad(self) -> float:
        """S1: half the range of the phase errors, the phase that all share taken out."""
        return float(np.ptp(self.errors_rad[self.active])) / 2.0

    @property
    def rms_rad(self) -> float:
        """RMS phase error, each element weighted by its level."""
        errors, levels = self.errors_rad[self.active], self.levels[self.active]
        return math.sqrt(np.average(errors**2, weights=levels**2))

    @property
    def explains(self) -> bool:
        """True if no element is off by more than rounding and what is not known of it."""
        if self.error_rad > self.limit_rad * (1.0 if self.is_strict else _EXACT):
            return False
        return self.explains_roughly

    @property
    def explains_roughly(self) -> bool:
        """True if the root mean square of the phase errors is no more than that leaves."""
        scatter_rad = self.scatter_rad / _COVERAGE
        allowed_rad = scatter_rad * (1.0 + 3.0 / math.sqrt(self.active.sum()))
        spread_rad = float(np.std(self.errors_rad[self.active]))
        return spread_rad <= self.rounding_rad + allowed_rad

    @property
    def _off_rad(self) -> float:
        """Phase error above which an element is wrong: the limit plus what rounding adds."""
        return self.limit_rad + self.rounding_rad

    # --- search ----------------------------------------------------------------------------------

    def slopes_about(self, used: Bools) -> FloatArray:
        """Return (N, 4) how the phase errors change with the share; the mean of the *used* is 0."""
        slopes = np.zeros((len(self.phases_rad), 4))
        for place in np.flatnonzero(self.scale):
            way = _SLOPE * np.eye(4)[place]
            less, more = (self.drive(self.scale * (self.share + sign * way)) for sign in (-1, 1))
            slopes[:, place] = np.angle(less * more.conj()) / (2.0 * _SLOPE)
        return slopes - np.average(slopes[used], axis=0, weights=self.levels[used])

    def fitted(self) -> ToleratedHost:
        """Return the host of the least squares; elements that stick out by far do not count.

        A share of the tolerance weighs as much as the same share of the error by rounding.
        """
        host, used = self, self.active
        prior = self.rounding_rad * np.eye(4)
        for _ in range(_STEPS):
            errors, slopes, levels = host.errors_about(used), host.slopes_about(used), host.levels
            rows = np.vstack([slopes[used] * levels[used, None], prior])
            wanted = np.concatenate([-(errors * levels)[used], -prior @ host.share])
            step = np.linalg.lstsq(rows, wanted, rcond=None)[0]
            host = dataclasses.replace(host, share=_tolerated_shares(host.share + step))
            sizes = np.abs(host.errors_about(used)) * host.levels
            widest = max(self._off_rad, 3.0 * float(np.median(sizes[self.active])))
            before, used = used, self.active & (sizes <= widest)
            if np.abs(step).max() < _SETTLED and (used == before).all():
                break
        return host

    def balanced(self) -> ToleratedHost:
        """Return the host whose largest phase error is the least."""
        from scipy.optimize import linprog  # slow to import, and only a tolerance needs it

        errors = self.errors_about(self.active)[self.active]
        slopes = self.slopes_about(self.active)[self.active]
        ones, ball = np.ones((len(errors), 1)), _unit_directions()
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
        for size in _SHORTER:  # along what hardly shows, a solution may be far off
            other = dataclasses.replace(self, share=self.share + size * found.x[:4])
            if other.error_rad < self.error_rad:
                return other
        return self

    def anywhere(self, model: AcousticModel) -> ToleratedHost:
        """Return the nearest host within any tolerance that can be stated."""
        return dataclasses.replace(self, scale=scale_of_tolerance(_ANYWHERE, model)).searched()

    def is_beyond(self, scale: FloatArray) -> bool:
        """Return True if it is off by more than a tolerance and what rounding may add to that."""
        slopes = self.slopes_about(self.active)[self.active]
        doubt = _SECOND_ORDER * np.abs(np.linalg.pinv(slopes)).sum(axis=1) * self.limit_rad
        least = np.maximum(np.abs(self.share) - doubt, 0.0) * self.scale
        return bool(np.linalg.norm(least[:3]) > scale[0] or least[3] > scale[3])

    # --- what it does not explain ----------------------------------------------------------------

    def fault(self, model: AcousticModel, *, proven: bool = False) -> str | None:
        """Name the elements that no place and no air within the tolerance explains.

        *proven*: only where a host within the tolerance explains all the others, and none that does
        explains one of these.
        """
        host = self.fitted()
        errors = host.errors_about(self.active)
        errors = wrapped_phases(errors - float(np.median(errors[self.active])))
        off = self.active & (np.abs(errors) > self._off_rad)
        rest = errors[self.active & ~off]
        within = bool(len(rest)) and np.sqrt(np.mean(rest**2)) <= self.limit_rad
        few = 0 < off.sum() <= _FEW * self.active.sum()
        if not (within and few and bool((host.levels[off] > _LOUD).all())):
            return None
        if proven and not self._is_proven(off):
            return None
        return self._elements_text(model, errors, np.flatnonzero(off))

    def _is_proven(self, off: Bools) -> bool:
        """Return True if some place and air explain all elements but *off*, and none of these.

        Place and air are within the tolerance; a small change of the air can turn an element of a
        solver's drive far.
        """
        rest = self.active & ~off
        host = dataclasses.replace(self, active=rest).searched()
        slopes, errors_rad = host.slopes_about(rest), wrapped_phases(host.errors_about(rest)[off])
        leverage = np.abs(slopes[off] @ np.linalg.pinv(slopes[rest])).sum(axis=1)
        explained_rad = self._off_rad + _SECOND_ORDER * leverage * self.limit_rad
        return host.explains and bool((np.abs(errors_rad) > explained_rad).all())

    def scatter_text(self, model: AcousticModel) -> str | None:
        """Return that the phases are those of no focus, within any tolerance that can be stated."""
        if self.anywhere(model).explains_roughly:
            return None
        errors = self.fitted().errors_about(self.active)[self.active]
        return (
            f"phases of {int(self.active.sum())} elements scattered by "
            f"{math.sqrt(np.mean(errors**2)):.2f} rad RMS, more than a focus within the tolerance "
            "leaves"
        )

    def _elements_text(
        self, model: AcousticModel, errors: FloatArray, numbers: NDArray[np.intp]
    ) -> str:
        """Return how elements *numbers* are wrong: inverted, two swapped, or off by up to N rad.

        *errors* (N,) are the phase errors of all in rad.
        """
        names, limit_rad = faulty_elements_text(model, numbers), self._off_rad
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


def frame_scatter_rad(target: FrameTarget, known: Uncertainty) -> float:
    """Return by how much one element may be off for what is stated not to be known of it.

    Nothing for a strict verdict, which has the elements as they are told.
    """
    if target.tolerance.is_strict or known.is_guess:
        return 0.0
    moved_rad = target.model.wavenumber * known.position_mm / 1e3
    return _COVERAGE * math.hypot(moved_rad, known.phase_rad)


def scale_of_tolerance(tolerance: Tolerance, model: AcousticModel) -> FloatArray:
    """Return (4,) the whole tolerance: metres, and the share of the speed of sound."""
    return np.array([tolerance.miss_mm / 1e3] * 3 + [tolerance.speed_share(model.medium)])


def _tolerated_shares(share: FloatArray) -> FloatArray:
    """Return *share* (4,), parts of the tolerance that a host uses up, cut to what is tolerated.

    The first three (miss along x, y, z) are shortened to length 1, the last (air) is cut to ±1.
    """
    length = max(1.0, float(np.linalg.norm(share[:3])))
    return np.append(share[:3] / length, np.clip(share[3], -1.0, 1.0))


def _unit_directions() -> FloatArray:
    """Return (128, 3) unit vectors that are spread evenly over all directions."""
    n = np.arange(_DIRECTIONS) + 0.5
    z, turn = 1.0 - 2.0 * n / _DIRECTIONS, n * math.pi * (3.0 - math.sqrt(5.0))
    flat = np.sqrt(1.0 - z**2)
    return np.column_stack([flat * np.cos(turn), flat * np.sin(turn), z])
