"""Several foci in one frame: what each has of the ideal drive's pressure, and where it is.

Foci that share an aperture pull at each other, so each is compared with the peak that the ideal
drive has next to its target, and not with the target.  The ideal drive is what made the frame,
asked again in the air that there is; a frame of phases drives every element in full.

S1  every latched phase is within half a step of the ideal one, up to a phase that all share.
S2  the pressure peak next to each target is where that of the ideal drive is, within the worst
    that rounding can do.
S3  the pressure at each target is that of the ideal drive, within the worst that rounding can do.
S5  every latched amplitude is the ideal one, within half a step.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np

from haptogram.acoustics import Drive
from haptogram.acoustics.drive import FULL_AMPLITUDE
from haptogram.records import Intended

from . import criteria
from .foci_fit import FociFit, fit_foci, waves_of
from .peaks import WITHIN_LOBE_RAD, Complexes, ExpectedPeak, Floats, expected_peak
from .status import is_right, status_of, warning_of
from .target import Bools, TargetField, place_uncertainty
from .tolerance import PlaceUncertainty, Tolerance, Uncertainty
from .verdict import FrameStatus, FrameVerdict, Vector

_MM: Final = 1e3
#: Codes of an amplitude below which a board that computes may round a phase as it likes: the waves
#: of the foci all but cancel there, and the phase of next to nothing means nothing.
LEAST_AMPLITUDE_CODE: Final = 4
_HALF: Final = 0.5 + 1e-6  # of an amplitude step
_MARGIN: Final = 1.15  # between the tolerated drives, a change is not quite in proportion
_SECOND_ORDER: Final = 1.1  # of the bound of the first order
_LOST: Final = 0.4  # of the distance: rounding may move a focus so far that it has no place
_FAINT: Final = 0.1  # of the loudest: the pressure of a fainter focus is compared with that
_MOST_EXCESS: Final = 0.3  # of the pressure: beyond it no other drive for these foci explains it
_OTHER_LEVELS: Final = "the pressures of the foci are off by more than is tolerated"
_NOT_THESE: Final = (
    "the phases do not tell where these foci are: a miss within the tolerance or beyond would not "
    "show"
)
#: What a solver makes of foci at the least.  Random phases reach an efficiency of F / N, solvers
#: 0.5 and more; their weakest focus of many has a third of the mean, a missing one next to none.
_LEAST_EFFICIENCY: Final = 0.25
_LEAST_BALANCE: Final = 0.2


@dataclass(frozen=True, eq=False)
class IdealDrive:
    """The drive that makes several foci, before its phases are rounded.

    Attributes
    ----------
    targets : sequence of TargetField
        One for each focus.
    placed : sequence of TargetField
        Those of the foci that shall be heard: the others have no place.
    weights : (N,) numpy.ndarray of complex
        Ideal phases with the intended amplitudes.
    asked : (N,) numpy.ndarray of complex
        What the foci ask for; of magnitude 1 where the drive has phases only.
    tolerated : sequence of (N,) numpy.ndarray of complex
        The same in the warmest and the coldest air that is tolerated, and for foci that are off by
        the tolerated miss.
    has_amplitudes : bool
        Whether the drive has amplitudes, and not only phases.
    allowed_codes : int
        By how many codes a board that computes may differ.
    """

    targets: Sequence[TargetField]
    placed: Sequence[TargetField]
    weights: Complexes
    asked: Complexes
    tolerated: Sequence[Complexes]
    has_amplitudes: bool
    allowed_codes: int

    @classmethod
    def of(
        cls,
        intended: Intended,
        targets: Sequence[TargetField],
        asked: Complexes,
        tolerated: Sequence[Complexes],
    ) -> IdealDrive:
        """Return the ideal drive of a frame whose foci ask for the weights *asked*."""
        codes, allowed = intended.drive.amplitude_codes, criteria.allowed_codes(intended)
        pairs = zip(targets, intended.foci, strict=True)
        placed = [target for target, focus in pairs if focus.amplitude > 0.0]
        if (codes == FULL_AMPLITUDE).all():
            in_full, *others = (np.exp(1j * np.angle(drive)) for drive in (asked, *tolerated))
            return cls(targets, placed, in_full, in_full, others, False, allowed)
        weights = codes / FULL_AMPLITUDE * np.exp(1j * np.angle(asked))
        return cls(targets, placed, weights, asked, tolerated, True, allowed)

    @cached_property
    def peaks(self) -> list[ExpectedPeak | None]:
        """The peak next to each target; None where none has a place that this array observes."""
        return [self._peak(target) for target in self.placed]

    def _peak(self, target: TargetField) -> ExpectedPeak | None:
        if not target.observable.all():
            return None
        return expected_peak(
            target.model,
            self.weights,
            target.position_m,
            target.direction(np.eye(3)),
            target.phase_limit_rad,
            WITHIN_LOBE_RAD,
        )

    @cached_property
    def levels(self) -> Floats:
        """(F,) |p| at each target."""
        return self._levels_of(self.weights)

    @cached_property
    def level_limits(self) -> Floats:
        """(F,) S3: how far rounding can change |p| at each target.

        To first order only what is in quadrature to the sum counts, sum_n |Im(q_n / u)| d with u
        the phasor of the sum; the second order is at most sum_n |q_n| d^2 / 2.
        """
        return np.array([self._rounding_of_level(target) for target in self.targets])

    @cached_property
    def tolerated_levels(self) -> Floats:
        """(F,) what is tolerated on top of that."""
        asked = self._levels_of(self.asked)
        changes = [np.abs(self._levels_of(drive) - asked) for drive in self.tolerated]
        tolerated: Floats = _MARGIN * np.max([0.0 * asked, *changes], axis=0)
        return tolerated

    def _rounding_of_level(self, target: TargetField) -> float:
        parts = target.arrivals * self.weights
        total, error_rad = complex(parts.sum()), target.phase_limit_rad
        quadrature = np.abs((parts * (total.conjugate() / abs(total) if total else 1.0)).imag)
        limit = quadrature.sum() * error_rad + np.abs(parts).sum() * error_rad**2 / 2.0
        limit += self.allowed_codes * criteria.AMPLITUDE_STEP * np.abs(target.arrivals).sum()
        return float(limit)

    def _levels_of(self, weights: Complexes) -> Floats:
        levels: Floats = np.abs([target.arrivals @ weights for target in self.targets])
        return levels

    def phase_error_rad(self, latched: Drive, active: Bools) -> float:
        """S1: half the range of the phase errors over the active elements, common phase out."""
        if not active.any():
            return math.pi
        error = np.angle(latched.weights()[active]) - np.angle(self.weights[active])
        return criteria.common_phase_error_rad(error)

    def distance(self, latched: Drive, active: Bools) -> tuple[bool, float]:
        """Return a key by which the ideal drive that suits a latched one best comes first."""
        error_rad = self.phase_error_rad(latched, active)
        suits = error_rad <= self.targets[0].phase_limit_rad and self.amplitudes_ok(
            latched, tolerant=False
        )
        return not suits, error_rad

    def offsets_m(self, latched: Complexes) -> list[Floats | None]:
        """S2: return (3,) the offset of each peak from its place; None where there is none."""
        return [
            None if peak is None else peak.offset_m(target.model, latched)
            for target, peak in zip(self.placed, self.peaks, strict=True)
        ]

    def in_place(self, offsets_m: Sequence[Floats | None]) -> bool:
        """S2: tell whether every peak that has a place is within its limit of it."""
        return all(
            offset is not None and bool((np.abs(offset) <= peak.rounding_m).all())
            for peak, offset in zip(self.peaks, offsets_m, strict=True)
            if peak is not None
        )

    def excess_level(self, latched: Complexes, *, tolerant: bool) -> float:
        """S3: return the share by which |p| at a target is off beyond its limit; 0: none is."""
        limits = self.level_limits + (self.tolerated_levels if tolerant else 0.0)
        excess = np.abs(self._levels_of(latched) - self.levels) - limits
        loudest = max(float(self.levels.max()), 1e-300)
        return max(0.0, float((excess / np.maximum(self.levels, _FAINT * loudest)).max()))

    def amplitudes_ok(self, latched: Drive, *, tolerant: bool) -> bool:
        """S5: tell whether no amplitude is off from what the foci ask for by more than rounding."""
        if not self.has_amplitudes:
            return True
        asked = np.abs(self.asked)
        changes = [np.abs(np.abs(drive) - asked) for drive in self.tolerated] if tolerant else []
        tolerated = _MARGIN * np.max([0.0 * asked, *changes], axis=0)
        steps = np.abs(latched.amplitude_codes - FULL_AMPLITUDE * asked)
        allowed = _HALF + self.allowed_codes + FULL_AMPLITUDE * tolerated
        return bool((steps <= allowed).all())

    def limits_m(self) -> list[Floats] | None:
        """Return (3,) how far each focus may be off; None where a miss of one never shows."""
        pairs = list(zip(self.placed, self.peaks, strict=True))
        limits = [peak.rounding_m + target.tolerated_m for target, peak in pairs if peak]
        return limits if len(limits) == len(pairs) else None

    def place_uncertainty(self, known: Uncertainty) -> PlaceUncertainty | None:
        """Return how well the place of the least known focus is known; None: it is not."""
        found = [
            place_uncertainty(target.model, target.position_m, peak.response, known)
            for target, peak in zip(self.placed, self.peaks, strict=True)
            if peak is not None
        ]
        whole = len(found) == len(self.placed)
        return max(found, key=lambda one: one.total, default=None) if whole else None


def meaningful(intended: Intended, latched: Drive) -> Bools:
    """Return (N,) the elements that sound and whose phase means something."""
    least = LEAST_AMPLITUDE_CODE if intended.board_computed and len(intended.foci) > 1 else 1
    sounding: Bools = (intended.drive.amplitude_codes >= least) & (latched.amplitude_codes > 0)
    return sounding


@dataclass(frozen=True, slots=True)
class FociLevels:
    """What reaches several foci of one frame.

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
        cls, intended: Intended, latched: Complexes, targets: Sequence[TargetField]
    ) -> FociLevels:
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
        """Whether every focus that a solver was asked for is there."""
        return self.efficiency >= _LEAST_EFFICIENCY and self.balance >= _LEAST_BALANCE


@dataclass(frozen=True, slots=True, eq=False)
class _Findings:
    """What was found of several foci: verdicts, what cannot be told, and places.

    Attributes
    ----------
    verdicts : dict of str to bool
        S1, S2, S3, S5.
    unseen : list of str
        Why a drive without a fault does not show where its foci are.
    offsets_m : sequence of (3,) numpy.ndarray or None
        Of each focus from its place.
    limits_m : sequence of (3,) numpy.ndarray, or None
        How far each may be off; None where a miss of one never shows.
    """

    verdicts: dict[str, bool]
    unseen: list[str]
    offsets_m: Sequence[Floats | None]
    limits_m: Sequence[Floats] | None


def judge_several(
    seen: FrameVerdict,
    intended: Intended,
    latched: Drive,
    faults: tuple[str, ...],
    ideals: Sequence[IdealDrive],
    tolerance: Tolerance,
    known: Uncertainty,
) -> FrameVerdict:
    """Return the verdict on a frame with several foci.

    Parameters
    ----------
    seen : FrameVerdict
        What is known of the latch.
    latched : Drive
        What is radiated.
    faults : tuple of str
        What the codes prove to be wrong.
    ideals : sequence of IdealDrive
        What the foci ask for, as the host may have known the array: the nearest one counts.
    tolerance : Tolerance
        Which misses pass.
    known : Uncertainty
        How well array and air are known.
    """
    targets = ideals[0].targets
    active = meaningful(intended, latched) & targets[0].active
    levels = FociLevels.of(intended, latched.weights(), targets)
    ideal = min(ideals, key=lambda one: one.distance(latched, active))
    error_rad = ideal.phase_error_rad(latched, active)
    found = _strictly(ideal, intended, latched, active, error_rad)
    if not tolerance.is_strict and not all(found.verdicts.values()) and active.any():
        found = _tolerantly(ideal, intended, latched, active, tolerance)
    status = status_of(found.verdicts, faults, focused=False, tolerance=tolerance)
    unseen = [*found.unseen, *_not_made(levels, intended)]
    notes = [*([seen.note] if seen.note else []), f"{len(targets)} foci, each by itself"]
    if status is FrameStatus.ON_TARGET and unseen:
        status, notes = FrameStatus.NOT_VERIFIED, [*unseen, *notes]
    if is_right(status):
        notes += warning_of(found.verdicts, error_rad, targets[0].phase_limit_rad)
    worst_m = max(
        found.limits_m or [], key=lambda limit: float(np.linalg.norm(limit)), default=None
    )
    smallest_mm = (
        None if worst_m is None else _MM * float(np.linalg.norm(worst_m)) + tolerance.miss_mm
    )
    return dataclasses.replace(
        seen,
        status=status,
        criteria=found.verdicts,
        faults=faults,
        note="; ".join(notes),
        phase_error_rad=error_rad,
        bound_mm=None if worst_m is None else _mm(worst_m),
        smallest_miss_mm=smallest_mm,
        uncertainty_mm=ideal.place_uncertainty(known),
        balance=levels.balance,
        efficiency=levels.efficiency,
        pressure_rms_pa=abs(complex(targets[0].arrivals @ latched.weights())) / math.sqrt(2.0),
        **_farthest(ideal.placed, found),
    )


def _strictly(
    ideal: IdealDrive, intended: Intended, latched: Drive, active: Bools, error_rad: float
) -> _Findings:
    """Return what is found of a drive that may differ from the ideal one by rounding only."""
    offsets_m, limits_m = ideal.offsets_m(latched.weights()), ideal.limits_m()
    s5 = criteria.amplitudes_ok(intended, latched)
    verdicts = {
        "S1": error_rad <= ideal.targets[0].phase_limit_rad,
        "S2": ideal.in_place(offsets_m),
        "S3": ideal.excess_level(latched.weights(), tolerant=False) == 0.0,
        "S5": s5 and ideal.amplitudes_ok(latched, tolerant=False),
    }
    if limits_m is not None or not active.any():
        return _Findings(verdicts, list(_without_place(ideal)), offsets_m, limits_m)
    # Foci without a pressure peak of their own still have a place in the phases.
    fit = _fit(ideal, intended, latched, active)
    if fit is None or fit.residual_rad > ideal.targets[0].phase_limit_rad:
        return _Findings(verdicts, list(_without_place(ideal)), offsets_m, None)
    limits_m = _limits_m(ideal, fit)
    if limits_m is None or not _are_within(fit, limits_m, 0.0):
        return _Findings(verdicts, list(_without_place(ideal)), list(fit.offsets_m), None)
    return _Findings(verdicts, [], list(fit.offsets_m), limits_m)


def _tolerantly(
    ideal: IdealDrive, intended: Intended, latched: Drive, active: Bools, tolerance: Tolerance
) -> _Findings:
    """Return what is found of a drive for these foci in other air, or a little off.

    A solver may come to another drive there, with other phases between the foci.  So the places are
    fitted from the phases that there are, whatever the weights of the foci.
    """
    limit_rad = ideal.targets[0].phase_limit_rad
    excess = ideal.excess_level(latched.weights(), tolerant=True)
    s5 = criteria.amplitudes_ok(intended, latched)
    verdicts = {
        "S1": False,
        "S3": excess <= _MOST_EXCESS,
        "S5": s5 and ideal.amplitudes_ok(latched, tolerant=True),
    }
    unseen = [_OTHER_LEVELS] if excess > 0.0 else []
    fit = _fit(ideal, intended, latched, active)
    if fit is None:
        return _Findings(verdicts, [*unseen, _NOT_THESE], [], None)
    blurred = fit
    if fit.residual_rad > limit_rad:  # what is left unexplained may have moved the foci as well
        blurred = fit._replace(bound_m=3.0 * fit.residual_rad / limit_rad * fit.bound_m)
        unseen.append(_NOT_THESE)
    limits_m = _limits_m(ideal, blurred)
    if limits_m is None:
        return _Findings(verdicts, [*unseen, _NOT_THESE], list(fit.offsets_m), None)
    within = _are_within(fit, limits_m, tolerance.miss_mm)
    if not within and not _are_sharp(ideal, limits_m):
        return _Findings(verdicts, [*unseen, _NOT_THESE], list(fit.offsets_m), None)
    verdicts["S2"] = within
    return _Findings(dict(sorted(verdicts.items())), unseen, list(fit.offsets_m), limits_m)


def _fit(ideal: IdealDrive, intended: Intended, latched: Drive, active: Bools) -> FociFit | None:
    """Return where the phases say that the foci are."""
    superposed = intended.solver == "naive"
    known = [f.amplitude * np.exp(1j * f.phase_rad) for f in intended.foci if f.amplitude > 0.0]
    return fit_foci(
        ideal.targets[0].model,
        waves_of(ideal.targets[0].model, superposed=superposed),
        np.array([target.position_m for target in ideal.placed]),
        latched.weights(),
        active,
        ideal.targets[0].phase_limit_rad,
        np.array(known) if superposed else None,
    )


def _limits_m(ideal: IdealDrive, fit: FociFit) -> list[Floats] | None:
    """Return (3,) how far each fitted focus may be off; None where a miss of one never shows."""
    limits = []
    for target, bound_m in zip(ideal.placed, fit.bound_m, strict=True):
        distance_m = _length(target.position_m - target.model.array.centre_m)
        limits.append(_SECOND_ORDER * bound_m + target.tolerated_m)
        if not _length(limits[-1]) < _LOST * distance_m:
            return None
    return limits


def _are_sharp(ideal: IdealDrive, limits_m: Sequence[Floats]) -> bool:
    """Tell whether each focus has a place to within its own lobe: else the fit is no proof."""
    return all(
        target.direction(np.eye(3)).length_rad(limit_m) <= WITHIN_LOBE_RAD
        for target, limit_m in zip(ideal.placed, limits_m, strict=True)
    )


def _are_within(fit: FociFit, limits_m: Sequence[Floats], miss_mm: float) -> bool:
    pairs = zip(fit.offsets_m, limits_m, strict=True)
    return all(criteria.within(offset_m, limit_m, miss_mm) for offset_m, limit_m in pairs)


def _farthest(targets: Sequence[TargetField], found: _Findings) -> dict[str, Any]:
    """Return how far the worst of the foci is from its place; nothing if one has no place."""
    offsets = [offset for offset in found.offsets_m if offset is not None]
    if len(offsets) < len(targets) or not targets or found.limits_m is None:
        return {}
    target, offset_m = max(zip(targets, offsets, strict=True), key=lambda pair: _length(pair[1]))
    across_m, along_m = target.split(offset_m)
    return {
        "lateral_error_mm": None if across_m is None else _MM * across_m,
        "axial_error_mm": None if along_m is None else _MM * along_m,
    }


def _without_place(ideal: IdealDrive) -> Iterator[str]:
    """Yield which foci have no pressure peak that could be off."""
    lost = [str(number) for number, peak in enumerate(ideal.peaks, 1) if peak is None]
    if lost:
        yield (
            f"no pressure peak with a place of its own next to focus {', '.join(lost)}: a miss "
            "there would not show"
        )


def _not_made(levels: FociLevels, intended: Intended) -> Iterator[str]:
    """Yield why the foci are not there, although the drive is as it should be."""
    if intended.solver != "naive" and not levels.made:
        yield (
            f"the solver {intended.solver} did not make the foci: efficiency "
            f"{levels.efficiency:.2f} (at least {_LEAST_EFFICIENCY:g}), the weakest has "
            f"{levels.balance:.2f} of their mean (at least {_LEAST_BALANCE:g})"
        )


def _length(vector: Floats) -> float:
    return float(np.linalg.norm(vector))


def _mm(values: Floats) -> Vector:
    x, y, z = (float(_MM * value) for value in values)
    return x, y, z
