"""The verdict on a frame with one focus, or with none."""

from __future__ import annotations

import dataclasses
import math
from functools import cached_property
from typing import Any, Final

import numpy as np

from haptogram import acoustics
from haptogram.acoustics.arrays import ComplexArray
from haptogram.acoustics.solvers.focus_fit import wrapped_phases
from haptogram.records.frame import Intended
from haptogram.settings.frozen import dataclass

from ..faults import faulty_elements_text
from ..tolerance import Uncertainty
from . import criteria
from .target import Bools, FrameTarget
from .tolerated import ToleratedHost
from .verdict import FrameStatus, FrameVerdict

_MM: Final = 1e3
_STILL_A_FOCUS: Final = 0.5  # least coherence of a focus: below it, the next peak may be any
_ACROSS_AND_ALONG: Final = 2
#: Limit between the rounding of 8 bits and an element that a reconstruction calls off.
_FINEST_RAD: Final = 0.75 * acoustics.phase_step_rad(8)
_ABOUT: Final = 1.5  # phase limit of a focus that somebody fitted, relative to ours
_NOT_SEARCHED: Final = (
    "where the drive focuses, if anywhere, was not searched for: many frames before have no focus"
)
_ELSEWHERE: Final = (
    "rounding has moved the focus further than in proportion: how far it is off does not show"
)


def verdict_not_radiated(found: acoustics.NoFocus) -> str:
    """Name the fault of a board that latched a right drive and radiated nothing."""
    return f"the drive is right, but nothing was radiated: {found.reason}"


def judge_silent_frame(
    seen: FrameVerdict,
    intended: Intended,
    latched: acoustics.Drive,
    faults: tuple[str, ...],
    *,
    heard: bool,
) -> FrameVerdict:
    """Judge a frame that shall radiate nothing: there is no focus, only S5.

    Parameters
    ----------
    heard : bool
        Whether somebody found a field all the same.
    """
    verdicts = {"S5": criteria.frame_amplitudes_ok(intended, latched) and not heard}
    if criteria.frame_amplitudes_ok(intended, latched):
        faults = ("sound was radiated where silence was intended",) if heard else ()
    return dataclasses.replace(
        seen,
        status=criteria.frame_status_of(verdicts, faults, focused=False),
        criteria=verdicts,
        faults=faults,
        note="silence was intended",
    )


@dataclass(frozen=True, eq=False)
class SingleFocusFrame:
    """A frame with one focus, and the drive that its board radiates.

    Attributes
    ----------
    intended : Intended
        The frame.
    latched : Drive
        Radiated drive.
    target : FrameTarget
        Demands of its focus on the field.
    known : Uncertainty
        How well array and air are known.
    """

    intended: Intended
    latched: acoustics.Drive
    target: FrameTarget
    known: Uncertainty

    def judge(
        self,
        seen: FrameVerdict,
        found: acoustics.Reconstruction | None,
        faults: tuple[str, ...],
    ) -> FrameVerdict:
        """Return the verdict.

        Parameters
        ----------
        seen : FrameVerdict
            Verdict of the frame so far.
        found : Reconstruction or None
            Reconstruction of the radiated drive without the target; None: that was not searched
            for, as the frame :attr:`is_wrong_without_search`.
        faults : tuple of str
            Faults that the codes prove.
        """
        target = self.target
        by_drive, by_criterion = self._drive_criteria
        measures, verdicts = by_drive.copy(), by_criterion.copy()
        notes = [seen.note] if seen.note else []
        unseen = [] if target.observable.all() else [_unobservable_frame_target(target)]
        if found is None:
            notes.append(_NOT_SEARCHED)
        elif self._is_ambiguous(verdicts, found):
            notes.append(_ambiguity_note(target, found))
            offset_m = target.nearest_focus_m(np.angle(self.latched.weights()), self._active)
            measures |= target.miss(offset_m)
            if criteria.is_frame_on_target(target, offset_m):
                verdicts["S2"] = True
            else:
                unseen.append(_ELSEWHERE)
        else:
            if target.observable.any():
                verdicts["S2"] = self._is_in_place(found)
            if isinstance(found, acoustics.SingleFocus):
                notes += [found.ambiguity_text] if found.rivals_m else []
                measures |= _focus_miss(target, found)
                faults += self._other_faults(verdicts, faults)
            elif isinstance(found, acoustics.NotSingle):
                faults += self._other_faults(verdicts, faults) or self._outliers(found, faults)
                if not faults:  # the right drive in other air: a focus, but not a sharp one
                    measures |= _focus_miss(target, found)
                elif measures["coherence"] >= _STILL_A_FOCUS:
                    measures |= _peak_miss(target, self.latched.weights())
                    measures["pressure_rms_pa"] = found.pressure_rms_pa
                notes.append(_frame_without_focus(found))
            elif not faults:
                faults = (verdict_not_radiated(found),)
        status = criteria.frame_status_of(
            verdicts, faults, focused=isinstance(found, acoustics.SingleFocus)
        )
        if status is FrameStatus.ON_TARGET and unseen:
            status, notes = FrameStatus.NOT_VERIFIED, [*unseen, *notes]
        return dataclasses.replace(
            seen,
            status=status,
            criteria=dict(sorted(verdicts.items())),
            faults=faults,
            note="; ".join(notes),
            **target.shown_miss(self.known) | measures,
        )

    @property
    def _active(self) -> Bools:
        """(N,) the elements that are intended to sound, and do."""
        sounding: Bools = self.latched.amplitude_codes > 0
        return sounding & self.target.active

    @property
    def is_wrong_without_search(self) -> bool:
        """True if the drive alone fails the frame, wherever it focuses."""
        return not all(self._drive_criteria[1].values())

    @cached_property
    def _host(self) -> ToleratedHost:
        """The host, of a place and air within the tolerance, whose phases are nearest."""
        phases_rad = np.angle(self.latched.weights())
        target, known = self.target, self.known
        return ToleratedHost.nearest(target, known, target.drive_of_host, phases_rad, self._active)

    @cached_property
    def _drive_criteria(self) -> tuple[dict[str, Any], dict[str, bool]]:
        """Return measures, and verdicts that need the drive alone: S1, S3, S4, S5.

        If no element sounds, S1 and S3 fail and the coherence is 0.
        """
        intended, latched, target, active = self.intended, self.latched, self.target, self._active
        s5 = criteria.frame_amplitudes_ok(intended, latched)
        if not active.any():
            intended_pa = target.intended_pressure_rms_pa
            measures = {"coherence": 0.0, "intended_pressure_rms_pa": intended_pa}
            return measures, {"S1": False, "S3": False, "S5": s5}
        verdicts, measures = criteria.judge_frame_drive(
            target, self._host, latched.weights(), criteria.allowed_frame_codes(intended)
        )
        return measures, verdicts | {"S5": s5}

    def _is_in_place(self, found: acoustics.Reconstruction) -> bool:
        """Return True if criterion S2 holds: *found* is a focus, and at its target.

        At the target is within what rounding and the tolerance allow.
        """
        if not isinstance(found, acoustics.SingleFocus):
            return False
        offset_m = np.array(found.position_m) - self.target.position_m
        return criteria.is_frame_on_target(self.target, offset_m)

    def _is_ambiguous(self, verdicts: dict[str, bool], found: acoustics.Reconstruction) -> bool:
        """Return True if phases within limits (S1) also fit another point, or no point at all.

        With few elements of few bits two points can fit, or a search without the target finds none.
        """
        if not verdicts["S1"] or self._is_in_place(found):
            return False
        return isinstance(
            found, acoustics.SingleFocus | acoustics.NotSingle
        ) and self._is_of_this_drive(found)

    def _other_faults(self, verdicts: dict[str, bool], faults: tuple[str, ...]) -> tuple[str, ...]:
        """Return one fault of elements that no place or air within the tolerance explains.

        () if there is none, *faults* has one already, S1 holds, or nothing is tolerated.
        """
        if faults or verdicts["S1"] or self.target.tolerance.is_strict or not self._active.any():
            return ()
        model = self.target.model
        fault = self._host.fault(model) or self._host.scatter_text(model)
        return () if fault is None else (fault,)

    def _outliers(self, found: acoustics.NotSingle, faults: tuple[str, ...]) -> tuple[str, ...]:
        """Name the outliers of *found*: elements that do not fit the focus of the others.

        The text says if the latched phases are out of step, or only what was radiated. () if
        *found* has no outliers, or *faults* names a fault already.
        """
        if faults or not found.outliers:
            return ()
        names = faulty_elements_text(self.target.model, found.outliers)
        if self._is_of_this_drive(found):
            return (f"{names} out of step with the others",)
        return (f"{names} radiated otherwise than latched",)

    def _is_of_this_drive(self, found: acoustics.SingleFocus | acoustics.NotSingle) -> bool:
        """Return True if a reconstruction fits the latched phases to within 1.5 times the limit.

        It does not if its outlier elements are no outliers in these phases.
        """
        if isinstance(found, acoustics.NotSingle) and not found.outliers:
            return True  # nothing was found, which any search may come to
        model, limit_rad = self.target.model, self.target.phase_limit_rad
        off = np.zeros(model.array.count, dtype=np.bool_)
        off[list(found.outliers if isinstance(found, acoustics.NotSingle) else ())] = True
        arrivals = np.angle(self.latched.weights()) - acoustics.focus_phases(
            model, found.position_m
        )
        agreeing = arrivals[self._active & ~off]
        error_rad = np.abs(wrapped_phases(arrivals - np.angle(np.exp(1j * agreeing).sum())))
        rms = math.sqrt(np.mean(error_rad[self._active & ~off] ** 2))
        within_rad = _ABOUT * limit_rad + self.target.tolerated_rad
        finest_rad = min(_FINEST_RAD, 0.75 * acoustics.phase_step_rad(self.latched.phase_bits))
        return rms <= within_rad and bool((error_rad[off] > finest_rad).all())


def _ambiguity_note(target: FrameTarget, found: acoustics.Reconstruction) -> str:
    """Return a note on a search without the target: *found* is no focus, or another point."""
    if not isinstance(found, acoustics.SingleFocus):
        return (
            "the phases suit the target, but a search that is not told the target finds no focus: "
            "S2 judges the one next to the target"
        )
    away_m = float(np.linalg.norm(np.array(found.position_m) - target.position_m))
    waves = away_m / target.model.wavelength_m
    return (
        f"the phases suit another point as well, {_MM * away_m:.2f} mm ({waves:.2f} wavelengths) "
        "from the target, and cannot tell which: S2 judges the one next to the target"
    )


def _frame_without_focus(found: acoustics.NotSingle) -> str:
    """Return a finding that names the loudest point instead of a focus."""
    x, y, z = (_MM * coordinate for coordinate in found.position_m)
    return (
        f"no single focus; the most that was found is {found.pressure_rms_pa:.0f} Pa at "
        f"({x:.1f}, {y:.1f}, {z:.1f}) mm"
    )


def _unobservable_frame_target(target: FrameTarget) -> str:
    """Return a finding that names the coordinates that the phases cannot determine."""
    names = [name for name, seen in zip("xyz", target.observable, strict=True) if not seen]
    along = " and ".join(names)
    count = int(target.active.sum())
    elements = "one element that sounds" if count == 1 else f"{count} elements that sound"
    return (
        f"the {elements} cannot tell where the focus is along {along}: a miss there would not show"
    )


def _focus_miss(
    target: FrameTarget, found: acoustics.SingleFocus | acoustics.NotSingle
) -> dict[str, Any]:
    """Return the found focus's miss, pressure (Pa RMS) and force (N or None) as verdict fields."""
    force_n = found.force_n if isinstance(found, acoustics.SingleFocus) else None
    if force_n is not None and not math.isfinite(force_n):
        force_n = None
    return target.miss(np.array(found.position_m) - target.position_m) | {
        "pressure_rms_pa": found.pressure_rms_pa,
        "force_n": force_n,
    }


def _peak_miss(target: FrameTarget, latched: ComplexArray) -> dict[str, Any]:
    """Return how many mm the pressure peak is off across and along the beam, as verdict fields.

    The distance is that to the peak of the ideal drive; {} unless there is a peak in both
    directions.
    """
    offsets = [
        offset_m @ peak.direction.axes
        for peak in target.peaks
        if (offset_m := peak.offset_m(target.model, latched)) is not None
    ]
    if len(offsets) != _ACROSS_AND_ALONG:
        return {}
    across_m, along_m = offsets
    return {
        "lateral_error_mm": _MM * float(np.linalg.norm(across_m)),
        "axial_error_mm": _MM * float(along_m @ target.axis),
    }
