"""The verdict on a frame with several foci.

The criteria of :mod:`.criteria` are asked of each focus beside the ideal drive, which is what made
the frame, asked again in the air that there is; a frame of phases drives every element in full.
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import Any, Final

import numpy as np

from haptogram.acoustics import Drive
from haptogram.acoustics.arrays import ComplexArray, FloatArray
from haptogram.acoustics.reconstruct.estimates import as_vector
from haptogram.acoustics.reconstruct.patterns.foci_fit import (
    FociFit,
    fit_foci,
    waves_of_foci_pattern,
)
from haptogram.errors import ConfigurationError
from haptogram.records.frame import Intended
from haptogram.settings.frozen import dataclass

from ..tolerance import Uncertainty
from . import criteria
from .ideal_drive import (
    LEAST_BALANCE,
    LEAST_EFFICIENCY,
    IdealFociLevels,
    IdealFrameDrive,
    meaningful_frame_elements,
)
from .peaks import LOST, WITHIN_LOBE_RAD
from .target import Bools, FrameTarget
from .tolerated import ToleratedHost, frame_scatter_rad, scale_of_tolerance
from .verdict import FrameStatus, FrameVerdict

_MM: Final = 1e3
_SECOND_ORDER: Final = 1.1  # factor on the first-order bound
_EXACT: Final = 1.0 + 1e-4
_FLAT: Final = 1.02  # factor on the distance to a peak that was found: it may be so flat
_MOST_SLACK: Final = 2.0  # slack of an amplitude, times the phase error of the found host
_MOST_EXCESS: Final = 0.3  # largest excess pressure that another drive for these foci explains
_OTHER_LEVELS: Final = "the pressures of the foci are off by more than is tolerated"
_OTHER_AMPLITUDES: Final = "the amplitudes are off by more than the solver makes of the tolerance"
_OTHER_PEAKS: Final = "the pressure peaks of the foci are not where their phases put the foci"
_NOT_THESE: Final = (
    "the phases do not tell where these foci are: a miss within the tolerance or beyond would not "
    "show"
)


@dataclass(frozen=True, slots=True, eq=False)
class _Findings:
    """Verdicts and places of several foci, and reasons why a place does not show.

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
    offsets_m: Sequence[FloatArray | None]
    limits_m: Sequence[FloatArray] | None


@dataclass(frozen=True, eq=False)
class SeveralFociFrame:
    """A frame with several foci, and the drive that its board radiates.

    Attributes
    ----------
    intended : Intended
        The frame.
    latched : Drive
        Radiated drive.
    ideals : sequence of IdealFrameDrive
        Drives that the foci ask for, for each array that the host may know: the nearest one counts.
    known : Uncertainty
        How well array and air are known.
    """

    intended: Intended
    latched: Drive
    ideals: Sequence[IdealFrameDrive]
    known: Uncertainty

    def judge(self, seen: FrameVerdict, faults: tuple[str, ...]) -> FrameVerdict:
        """Return the verdict.

        Parameters
        ----------
        seen : FrameVerdict
            Verdict of the frame so far.
        faults : tuple of str
            Faults that the codes prove.
        """
        ideal = min(self.ideals, key=lambda one: one.distance(self.latched, self._active))
        targets, tolerance = ideal.targets, ideal.targets[0].tolerance
        levels = IdealFociLevels.of(self.intended, self._weights, targets)
        error_rad = ideal.phase_error_rad(self.latched, self._active)
        found = self._judge_strictly(ideal, error_rad)
        if not tolerance.is_strict and not all(found.verdicts.values()) and self._active.any():
            host, fault = self._host(ideal)
            if host is not None:
                found, error_rad = self._judge_of_host(ideal, host), host.error_rad
            else:
                found = self._judge_with_tolerance(ideal, fault)
                faults = faults or ((fault,) if fault else ())
        status = criteria.frame_status_of(found.verdicts, faults, focused=False)
        unseen = [*found.unseen, *_solver_failure(levels, self.intended)]
        notes = [*([seen.note] if seen.note else []), f"{len(targets)} foci, each by itself"]
        if status is FrameStatus.ON_TARGET and unseen:
            status, notes = FrameStatus.NOT_VERIFIED, [*unseen, *notes]
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
            bound_mm=None if worst_m is None else as_vector(_MM * worst_m),
            smallest_miss_mm=smallest_mm,
            uncertainty_mm=ideal.place_uncertainty(self.known),
            balance=levels.balance,
            efficiency=levels.efficiency,
            pressure_rms_pa=abs(complex(targets[0].arrivals @ self._weights)) / math.sqrt(2.0),
            **_farthest_miss_mm(ideal.placed, found),
        )

    @cached_property
    def _weights(self) -> ComplexArray:
        """Return the complex weights of the latched drive."""
        return self.latched.weights()

    @cached_property
    def _active(self) -> Bools:
        """(N,) the elements that are meant to sound, sound, and are not too faint for a phase."""
        active: Bools = self.ideals[0].targets[0].active
        return meaningful_frame_elements(self.intended, self.latched) & active

    def _judge_strictly(
        self, ideal: IdealFrameDrive, error_rad: float, slack: FloatArray | float = 0.0
    ) -> _Findings:
        """Return the findings about the latched drive, which shall be *ideal* but for rounding.

        *error_rad* is the largest phase error of the latched drive; *slack* is how much its
        amplitudes (0 to 1) may differ besides.
        """
        offsets_m, limits_m = ideal.offsets_m(self._weights), ideal.limits_m()
        limit_rad = ideal.targets[0].phase_limit_rad
        s5 = criteria.frame_amplitudes_ok(self.intended, self.latched)
        verdicts = {
            "S1": error_rad <= limit_rad,
            "S2": criteria.are_peaks_in_place(ideal.peaks, offsets_m),
            "S3": ideal.excess_level(self._weights, tolerant=False) == 0.0,
            "S5": s5 and ideal.amplitudes_ok(self.latched, slack),
        }
        # A drive that is the ideal one but for rounding cannot be off: then its peaks are too flat.
        flat = verdicts["S1"] and verdicts["S5"] and not verdicts["S2"]
        if (limits_m is not None and not flat) or not self._active.any():
            return _Findings(verdicts, list(_frame_without_place(ideal)), offsets_m, limits_m)
        if flat:
            del verdicts["S2"]
        # Foci without a pressure peak of their own still have a place in the phases.
        unseen = list(_frame_without_place(ideal)) or [_NOT_THESE]
        fit = self._fit(ideal)
        if fit is None or fit.residual_rad > limit_rad:
            return _Findings(verdicts, unseen, offsets_m, None)
        limits_m = _frame_foci_limits_m(ideal, fit)
        if limits_m is None or not criteria.are_foci_within(fit.offsets_m, limits_m, 0.0):
            return _Findings(verdicts, unseen, list(fit.offsets_m), None)
        return _Findings(verdicts, [], list(fit.offsets_m), limits_m)

    def _host(self, ideal: IdealFrameDrive) -> tuple[ToleratedHost | None, str | None]:
        """Return the host, of shifted foci or other air, that explains this drive; else the fault.

        The nearest host within the tolerance is tried first, then any that is certainly beyond it.
        Both are None if the solver refuses the foci or no element can be named.
        """
        target, model = ideal.targets[0], ideal.targets[0].model
        phases_rad = np.angle(self._weights)
        with contextlib.suppress(ConfigurationError):  # a solver refuses some of them
            host = ToleratedHost.nearest(target, self.known, ideal.drive, phases_rad, self._active)
            if host.explains:
                return host, None
            other = host.anywhere(model)
            if other.explains and other.is_beyond(host.scale):
                return other, None
            return None, host.fault(model, proven=True)
        return None, None

    def _judge_of_host(self, ideal: IdealFrameDrive, host: ToleratedHost) -> _Findings:
        """Return the findings about the latched drive, against what *host* would have sent.

        *host* shifts the foci and assumes other air. Peaks of several foci may move further than
        the foci of the host, so that smaller misses do not show. A host beyond the tolerance fails
        S2, unless the foci have no place and a solver made the drive.
        """
        # Foci far apart: what hardly turns the phases of their sum may change its amplitudes much.
        tolerated = ideal.tolerated_amplitudes if ideal.has_amplitudes else 0.0
        slack = np.maximum(_MOST_SLACK * max(host.error_rad, host.rounding_rad), tolerated)
        nearest = ideal.of_host(self.intended, host)
        found = self._judge_strictly(nearest, host.error_rad / _EXACT, slack)
        target = ideal.targets[0]
        beyond = host.is_beyond(scale_of_tolerance(target.tolerance, target.model))
        own_m = [None] * len(ideal.placed) if beyond else ideal.offsets_m(self._weights)
        limits_m = found.limits_m and [
            np.maximum(limit_m + target.tolerated_m, _FLAT * target.tolerance.left_m(offset_m))
            for limit_m, target, offset_m in zip(found.limits_m, ideal.placed, own_m, strict=True)
        ]
        offsets_m = [None if one is None else one + host.off[:3] for one in found.offsets_m]
        # Without places a host beyond proves nothing: a solver may make this drive for others too.
        if beyond and (limits_m is not None or self.intended.solver == "naive"):
            found = dataclasses.replace(found, verdicts=found.verdicts | {"S2": False})
        return dataclasses.replace(found, limits_m=limits_m, offsets_m=offsets_m)

    def _judge_with_tolerance(self, ideal: IdealFrameDrive, fault: str | None) -> _Findings:
        """Judge a multi-focus drive with the positions of the foci fitted from its phases.

        For displaced foci a solver may choose other phases between the foci, so the positions are
        fitted to the phases with free weights of the foci. A *fault* fails S1; None: none was
        named.
        """
        target = ideal.targets[0]
        limit_rad, miss_mm = target.phase_limit_rad, target.tolerance.miss_mm
        excess = ideal.excess_level(self._weights, tolerant=True)
        s5 = criteria.frame_amplitudes_ok(self.intended, self.latched)
        verdicts = {"S5": s5} | ({"S1": False} if fault else {})
        if self.intended.solver == "naive":  # in other air a solver may jump to another drive
            verdicts["S3"] = excess <= _MOST_EXCESS
        unseen = [_OTHER_LEVELS] if excess > 0.0 else []
        if not ideal.amplitudes_ok(self.latched, ideal.tolerated_amplitudes):
            unseen.append(_OTHER_AMPLITUDES)
        fit = self._fit(ideal)
        if fit is None:
            return _Findings(verdicts, [*unseen, _NOT_THESE], [], None)
        slack_rad = (
            frame_scatter_rad(target, self.known),
            max(target.aberration_rad for target in ideal.targets),
        )
        if not fault and (_relative_errors(fit, limit_rad, slack_rad) <= _SECOND_ORDER).all():
            verdicts["S1"] = True
        blurred = fit
        if fit.residual_rad > limit_rad:  # what is left unexplained may have moved the foci as well
            blurred = fit._replace(bound_m=3.0 * fit.residual_rad / limit_rad * fit.bound_m)
            unseen.append(_NOT_THESE)
        limits_m = _frame_foci_limits_m(ideal, blurred)
        within = limits_m is not None and criteria.are_foci_within(fit.offsets_m, limits_m, miss_mm)
        if limits_m is None or not (within or _are_frame_peaks_sharp(ideal, limits_m)):
            return _Findings(verdicts, [*unseen, _NOT_THESE], list(fit.offsets_m), None)
        verdicts["S2"] = within
        if "S1" not in verdicts:
            unseen.append(_NOT_THESE)
        if not self._do_peaks_follow(ideal, limits_m, miss_mm):
            unseen.append(_OTHER_PEAKS)
        return _Findings(dict(sorted(verdicts.items())), unseen, list(fit.offsets_m), limits_m)

    def _fit(self, ideal: IdealFrameDrive) -> FociFit | None:
        """Return foci fitted to the latched phases of active elements; None if that fails."""
        superposed, foci = self.intended.solver == "naive", self.intended.foci
        known = [f.amplitude * np.exp(1j * f.phase_rad) for f in foci if f.amplitude > 0.0]
        return fit_foci(
            ideal.targets[0].model,
            waves_of_foci_pattern(ideal.targets[0].model, superposed=superposed),
            np.array([target.position_m for target in ideal.placed]),
            self._weights,
            self._active,
            ideal.targets[0].phase_limit_rad,
            np.array(known) if superposed else None,
        )

    def _do_peaks_follow(
        self, ideal: IdealFrameDrive, limits_m: Sequence[FloatArray], miss_mm: float
    ) -> bool:
        """Return True if each pressure peak is within its focus's limit (3,) plus *miss_mm*.

        The distance is that from where the ideal drive has the peak; without a peak False.
        """
        return all(
            offset_m is not None
            and np.linalg.norm(offset_m) <= np.linalg.norm(limit_m) + miss_mm / _MM
            for offset_m, limit_m in zip(ideal.offsets_m(self._weights), limits_m, strict=True)
        )


def _relative_errors(fit: FociFit, limit_rad: float, slack_rad: tuple[float, float]) -> FloatArray:
    """Return (N,) phase errors divided by what rounding and tolerance allow: 1 is the limit.

    *limit_rad* is the phase limit of an element. *slack_rad* is what may be added for an element as
    a whole, and for each of the waves (one from each focus) of which its drive is the sum.
    """
    scatter_rad, aberration_rad = slack_rad
    most = fit.limits_rad * (1.0 + scatter_rad / limit_rad) + fit.wave_limits * aberration_rad
    return np.abs(fit.errors_rad) / most


def _frame_foci_limits_m(ideal: IdealFrameDrive, fit: FociFit) -> list[FloatArray] | None:
    """Return how far (3,) in m each focus may be off; None if any reaches 0.4 of its distance."""
    limits = []
    for target, bound_m in zip(ideal.placed, fit.bound_m, strict=True):
        limits.append(_SECOND_ORDER * bound_m + target.tolerated_m)
        if not np.linalg.norm(limits[-1]) < LOST * target.distance_m:
            return None
    return limits


def _are_frame_peaks_sharp(ideal: IdealFrameDrive, limits_m: Sequence[FloatArray]) -> bool:
    """Return True if each limit (3,) in m is within its focus's lobe: 1.8 rad of phase (RMS).

    Then a fitted focus beyond its limit is a proven miss.
    """
    return all(
        target.direction(np.eye(3)).length_rad(limit_m) <= WITHIN_LOBE_RAD
        for target, limit_m in zip(ideal.placed, limits_m, strict=True)
    )


def _farthest_miss_mm(targets: Sequence[FrameTarget], found: _Findings) -> dict[str, Any]:
    """Return the errors in mm of the focus farthest from its place, as fields of a verdict.

    {} if a focus has no place, or no limit is known.
    """
    offsets = [offset for offset in found.offsets_m if offset is not None]
    if len(offsets) < len(targets) or not targets or found.limits_m is None:
        return {}
    target, offset_m = max(
        zip(targets, offsets, strict=True), key=lambda pair: np.linalg.norm(pair[1])
    )
    return target.errors_mm(offset_m)


def _frame_without_place(ideal: IdealFrameDrive) -> Iterator[str]:
    """Yield one finding if foci have no pressure peak of their own, as a miss would not show."""
    lost = [str(number) for number, peak in enumerate(ideal.peaks, 1) if peak is None]
    if lost:
        yield (
            f"no pressure peak with a place of its own next to focus {', '.join(lost)}: a miss "
            "there would not show"
        )


def _solver_failure(levels: IdealFociLevels, intended: Intended) -> Iterator[str]:
    """Yield one finding if the solver did not make the foci; nothing for the solver "naive".

    Foci are made if the solver's efficiency is at least 0.25 and the weakest focus has at least 0.2
    of their mean pressure.
    """
    if intended.solver != "naive" and not levels.made:
        yield (
            f"the solver {intended.solver} did not make the foci: efficiency "
            f"{levels.efficiency:.2f} (at least {LEAST_EFFICIENCY:g}), the weakest has "
            f"{levels.balance:.2f} of their mean (at least {LEAST_BALANCE:g})"
        )
