"""The drive that several foci ask for, and its changes by rounding and tolerance."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Final

import numpy as np

from haptogram.acoustics import Drive
from haptogram.acoustics.arrays import ComplexArray, FloatArray
from haptogram.acoustics.model.drive import FULL_AMPLITUDE
from haptogram.errors import ConfigurationError
from haptogram.records.frame import Intended
from haptogram.settings.frozen import dataclass

from ..tolerance import Uncertainty, VerdictUncertainty
from . import criteria
from .peaks import WITHIN_LOBE_RAD, ExpectedPeak, expected_frame_peak
from .target import Bools, FrameTarget, frame_target_uncertainty
from .tolerated import ToleratedHost, scale_of_tolerance

#: Codes of an amplitude below which a board that computes may round a phase as it likes: the waves
#: of the foci all but cancel there, and the phase of next to nothing means nothing.
_LEAST_AMPLITUDE_CODE: Final = 4
_HALF: Final = 0.5 + 1e-6  # half an amplitude step, and rounding
_MARGIN: Final = 1.15  # factor for changes between the tolerated drives, which are not quite linear
_FAINT: Final = 0.1  # least pressure that an excess is compared with, relative to the loudest focus
#: The least that a solver makes of foci.  Random phases reach an efficiency of F / N, solvers 0.5
#: and more; their weakest focus of many has a third of the mean, a missing one next to none.
LEAST_EFFICIENCY: Final = 0.25
LEAST_BALANCE: Final = 0.2
_NOT_OFF: Final = np.zeros(4)


@dataclass(frozen=True, eq=False)
class IdealFrameDrive:
    """The drive that makes several foci, before its phases are rounded.

    Attributes
    ----------
    targets : sequence of FrameTarget
        One for each focus.
    placed : sequence of FrameTarget
        Those of the foci that shall be heard: the others have no place.
    weights : (N,) numpy.ndarray of complex
        Ideal phases with the intended amplitudes.
    asked : (N,) numpy.ndarray of complex
        Weights that the foci ask for; of magnitude 1 where the drive has phases only.
    drive : callable
        From how far a host is off, as :class:`.tolerated.ToleratedHost` has it, to what the foci
        then ask for.
    has_amplitudes : bool
        Whether the drive has amplitudes, and not only phases.
    allowed_codes : int
        By how many codes a board that computes may differ.
    """

    targets: Sequence[FrameTarget]
    placed: Sequence[FrameTarget]
    weights: ComplexArray
    asked: ComplexArray
    drive: Callable[[FloatArray], ComplexArray]
    has_amplitudes: bool
    allowed_codes: int

    @classmethod
    def of(
        cls,
        intended: Intended,
        targets: Sequence[FrameTarget],
        drive: Callable[[FloatArray], ComplexArray],
        off: FloatArray = _NOT_OFF,
    ) -> IdealFrameDrive:
        """Return the ideal drive of a frame for a host that is off."""
        codes, allowed = intended.drive.amplitude_codes, criteria.allowed_frame_codes(intended)
        pairs = zip(targets, intended.foci, strict=True)
        placed = [target for target, focus in pairs if focus.amplitude > 0.0]
        asked = drive(off)
        phasors = np.exp(1j * np.angle(asked))
        if (codes == FULL_AMPLITUDE).all():
            return cls(targets, placed, phasors, phasors, drive, False, allowed)
        return cls(targets, placed, codes / FULL_AMPLITUDE * phasors, asked, drive, True, allowed)

    def of_host(self, intended: Intended, host: ToleratedHost) -> IdealFrameDrive:
        """Return the ideal drive of the same frame for a host within the tolerance."""
        targets = [target.of_host(host.off, host.limit_rad) for target in self.targets]
        return self.of(intended, targets, self.drive, host.off)

    @cached_property
    def tolerated(self) -> list[ComplexArray]:
        """Weights that the foci ask for at the ends of the tolerance: of each axis, and of air."""
        scale = scale_of_tolerance(self.targets[0].tolerance, self.targets[0].model)
        found = []
        for way in (*np.diag(scale), *np.diag(-scale)):
            if way.any():
                with contextlib.suppress(ConfigurationError):  # a focus at the edge of its reach
                    found.append(self.drive(way))
        return found if self.has_amplitudes else [np.exp(1j * np.angle(one)) for one in found]

    @cached_property
    def peaks(self) -> list[ExpectedPeak | None]:
        """The peak next to each target; None where none has a place that this array observes."""
        return [self._peak(target) for target in self.placed]

    def _peak(self, target: FrameTarget) -> ExpectedPeak | None:
        """Return the peak expected at a target; None without one, or if a coordinate is unseen.

        Unseen is an x, y or z of the target that the phases cannot show.
        """
        if not target.observable.all():
            return None
        return expected_frame_peak(
            target.model,
            self.weights,
            target.position_m,
            target.direction(np.eye(3)),
            target.phase_limit_rad,
            WITHIN_LOBE_RAD,
        )

    @cached_property
    def levels(self) -> FloatArray:
        """(F,) |p| at each target."""
        return self._levels_of(self.weights)

    @cached_property
    def level_limits(self) -> FloatArray:
        """(F,) S3: how far rounding can change |p| at each target.

        To first order only what is in quadrature to the sum counts, sum_n |Im(q_n / u)| d with u
        the phasor of the sum; the second order is at most sum_n |q_n| d^2 / 2.
        """
        return np.array([self._rounding_of_level(target) for target in self.targets])

    @cached_property
    def tolerated_levels(self) -> FloatArray:
        """(F,) S3: how far the tolerance can change |p| at each target, on top of rounding."""
        return self._tolerated_change(self._levels_of)

    @cached_property
    def tolerated_amplitudes(self) -> FloatArray:
        """(N,) S5: how far the tolerance can change each amplitude, 0 to 1."""
        return self._tolerated_change(np.abs)

    def _tolerated_change(self, measure: Callable[[ComplexArray], FloatArray]) -> FloatArray:
        """Return the largest change of measure(weights) that a host within the tolerance makes.

        *measure* maps the weights (N,) of a drive to values; for each value the change from the
        drive asked for is taken, times 1.15 as margin.
        """
        asked = measure(self.asked)
        changes = [np.abs(measure(drive) - asked) for drive in self.tolerated]
        tolerated: FloatArray = _MARGIN * np.max([0.0 * asked, *changes], axis=0)
        return tolerated

    def _rounding_of_level(self, target: FrameTarget) -> float:
        """Return by how many Pa rounding of the drive can change a target's peak pressure."""
        parts = target.arrivals * self.weights
        total, error_rad = complex(parts.sum()), target.phase_limit_rad
        quadrature = np.abs((parts * (total.conjugate() / abs(total) if total else 1.0)).imag)
        limit = quadrature.sum() * error_rad + np.abs(parts).sum() * error_rad**2 / 2.0
        limit += self.allowed_codes * criteria.AMPLITUDE_STEP * np.abs(target.arrivals).sum()
        return float(limit)

    def _levels_of(self, weights: ComplexArray) -> FloatArray:
        """Return (F,) the peak pressure in Pa that *weights* (N,) make at each target."""
        return np.abs([target.arrivals @ weights for target in self.targets])

    def phase_error_rad(self, latched: Drive, active: Bools) -> float:
        """S1: half the range of the phase errors over the active elements, common phase out."""
        if not active.any():
            return math.pi
        error = np.angle(latched.weights()[active]) - np.angle(self.weights[active])
        return criteria.common_frame_error_rad(error)

    def distance(self, latched: Drive, active: Bools) -> tuple[bool, float]:
        """Return a key by which the ideal drive that suits a latched one best comes first."""
        error_rad = self.phase_error_rad(latched, active)
        suits = error_rad <= self.targets[0].phase_limit_rad and self.amplitudes_ok(latched)
        return not suits, error_rad

    def offsets_m(self, latched: ComplexArray) -> list[FloatArray | None]:
        """S2: return (3,) the offset of each peak from its place; None where there is none."""
        return criteria.peak_offsets_m(self.targets[0].model, self.peaks, latched)

    def excess_level(self, latched: ComplexArray, *, tolerant: bool) -> float:
        """S3: return the share by which |p| at a target is off beyond its limit; 0: none is."""
        limits = self.level_limits + (self.tolerated_levels if tolerant else 0.0)
        excess = np.abs(self._levels_of(latched) - self.levels) - limits
        loudest = max(float(self.levels.max()), 1e-300)
        return max(0.0, float((excess / np.maximum(self.levels, _FAINT * loudest)).max()))

    def amplitudes_ok(self, latched: Drive, slack: FloatArray | float = 0.0) -> bool:
        """S5: return True if no amplitude is off by more than rounding and *slack*, 0 to 1."""
        if not self.has_amplitudes:
            return True
        steps = np.abs(latched.amplitude_codes - FULL_AMPLITUDE * np.abs(self.asked))
        allowed = _HALF + self.allowed_codes + FULL_AMPLITUDE * slack
        return bool((steps <= allowed).all())

    def limits_m(self) -> list[FloatArray] | None:
        """Return (3,) how far each focus may be off; None where a miss of one never shows."""
        pairs = list(zip(self.placed, self.peaks, strict=True))
        limits = [peak.rounding_m + target.tolerated_m for target, peak in pairs if peak]
        return limits if len(limits) == len(pairs) else None

    def place_uncertainty(self, known: Uncertainty) -> VerdictUncertainty | None:
        """Return the uncertainty of the place of the least known focus; None: it is unknown."""
        found = [
            frame_target_uncertainty(target.model, target.position_m, peak.response, known)
            for target, peak in zip(self.placed, self.peaks, strict=True)
            if peak is not None
        ]
        whole = len(found) == len(self.placed)
        return max(found, key=lambda one: one.total, default=None) if whole else None


def meaningful_frame_elements(intended: Intended, latched: Drive) -> Bools:
    """Return (N,) the elements that sound and whose phase means something."""
    least = _LEAST_AMPLITUDE_CODE if intended.board_computed and len(intended.foci) > 1 else 1
    return (intended.drive.amplitude_codes >= least) & (latched.amplitude_codes > 0)


@dataclass(frozen=True, slots=True)
class IdealFociLevels:
    """Pressures at several foci of one frame.

    Attributes
    ----------
    efficiency : float
        sum_i (|p(t_i)| / sum_n |a_n g_n(t_i)|)^2, a_n the intended amplitudes: each focus over what
        the same output would make of it alone.  1 if they share it without loss; less of
        foci that take from each other; more of foci so near that one beam serves several.
    balance : float
        The least |p(t_i)| / A_i over the mean of them, A_i the wanted amplitudes.
    """

    efficiency: float
    balance: float

    @classmethod
    def of(
        cls, intended: Intended, latched: ComplexArray, targets: Sequence[FrameTarget]
    ) -> IdealFociLevels:
        """Return the levels of the foci of *intended* under the drive *latched*."""
        arrivals = np.array([target.arrivals for target in targets])
        levels = np.abs(arrivals @ latched)
        alone = np.abs(arrivals) @ np.abs(intended.drive.weights())
        wanted = np.array([focus.amplitude for focus in intended.foci])
        asked = wanted > 0.0
        shares = levels[asked] / wanted[asked]
        mean = float(shares.mean()) if asked.any() else 0.0
        return cls(
            float(((levels / alone) ** 2).sum()),
            float(shares.min()) / mean if mean > 0.0 else 0.0,
        )

    @property
    def made(self) -> bool:
        """True if every focus that a solver was asked for is there."""
        return self.efficiency >= LEAST_EFFICIENCY and self.balance >= LEAST_BALANCE
