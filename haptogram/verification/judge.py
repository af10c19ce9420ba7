"""From one intended frame and what was seen of it to a verdict."""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import Any, Final

import numpy as np

from haptogram.acoustics import (
    AcousticModel,
    Drive,
    NoFocus,
    NotSingle,
    Reconstruction,
    Reconstructor,
    SingleFocus,
    phase_step_rad,
)
from haptogram.acoustics.solvers import Method, weights_for_foci
from haptogram.records import Focus, FrameKey, Intended, Observation

from . import criteria
from .faults import UNNAMED, name_faults, named_elements
from .target import Complexes, Floats, TargetField
from .verdict import FrameStatus, FrameVerdict

# Of targets, and as many drives of solvers and verdicts: a pass that repeats costs nothing new.
_REMEMBERED_BYTES: Final = 1 << 27
_BYTES_PER_ELEMENT: Final = 24  # of a target: a phase and a complex pressure
_ANY: Final = FrameKey(0, 0, 0, 0)
_ITS_OWN: Final = ("number", "key", "t_apply_us", "t_latch_us", "late", "early")
_MM: Final = 1e3
_STILL_A_FOCUS: Final = 0.5  # coherence: below it, the next peak may be any
_ACROSS_AND_ALONG: Final = 2
_AMBIGUOUS: Final = (
    "the phases suit the target, but a search that is not told the target finds another point or "
    "none: S2 is not judged"
)

_SUPERPOSED: Final = "S2 is not judged: plain superposition promises no share of the output to any"


class Judge:
    """Judges frame after frame of one array.

    Parameters
    ----------
    model : AcousticModel
        Array and air that the frames were radiated in: the truth, which the host may have missed.
    carrier_us : int
        Carrier period: a frame latches on the first of its multiples at or after its time.
    """

    def __init__(self, model: AcousticModel, *, carrier_us: int) -> None:
        self._model = model
        self._carrier_us = carrier_us
        self._reconstructors: dict[int, Reconstructor] = {}
        remembered = _REMEMBERED_BYTES // (_BYTES_PER_ELEMENT * model.array.count)
        self._target = functools.lru_cache(remembered)(self._make_target)
        self._asked = functools.lru_cache(remembered)(self._solve)
        self._judged = functools.lru_cache(remembered)(self._judge)

    def _make_target(self, focus: Focus, phase_bits: int) -> TargetField:
        return TargetField.of(self._model, focus, phase_bits)

    def _solve(self, foci: tuple[Focus, ...], solver: Method) -> Complexes:
        points, levels, lags = zip(
            *((f.position_m, f.amplitude, f.phase_rad) for f in foci), strict=True
        )
        return weights_for_foci(self._model, points, levels, lags, method=solver)

    def judge(self, intended: Intended, observation: Observation) -> FrameVerdict:
        """Return what became of a frame that was latched."""
        seen = self._seen(intended, observation)
        found = self._judged(
            dataclasses.replace(intended, number=0, key=_ANY, t_apply_us=None),
            dataclasses.replace(observation, key=_ANY, t_latch_us=0, late=False),
        )
        return dataclasses.replace(found, **{name: getattr(seen, name) for name in _ITS_OWN})

    def _judge(self, intended: Intended, observation: Observation) -> FrameVerdict:
        """Return the verdict of all frames and latches that differ in key and times only."""
        seen = self._seen(intended, observation)
        if _crc_differs(intended, observation):
            return dataclasses.replace(
                seen, status=FrameStatus.CORRUPT, faults=(_crc_fault(intended, observation),)
            )
        latched, note = self._latched_drive(intended, observation)
        seen = dataclasses.replace(seen, note=note)
        if latched is None:
            return seen
        found = observation.reconstruction
        if isinstance(found, NoFocus) and found.reason == "ramping":
            return dataclasses.replace(seen, note="the output was ramping down when it was latched")
        # The field is that of what was radiated, so that is what is judged where somebody saw it.
        output = observation.radiated or latched
        faults = self._faults(intended, latched, output)
        if intended.drive.is_muted:
            return self._judge_silence(seen, intended, output, faults)
        if len(intended.foci) > 1:
            return self._judge_several(seen, intended, output, faults)
        found = found or self._reconstruct(output, intended.phase_bits)
        return self._judge_single(seen, intended, output, found, faults)

    def _faults(self, intended: Intended, latched: Drive, output: Drive) -> tuple[str, ...]:
        """Name what is wrong with the latched drive or, if it is right, with the output."""
        faults = name_faults(self._model, intended, latched)
        if faults or output is latched:
            return faults
        radiated = name_faults(self._model, intended, output)
        return tuple(f"{fault}, at the output: the latched drive is right" for fault in radiated)

    def _latched_drive(
        self, intended: Intended, observation: Observation
    ) -> tuple[Drive | None, str]:
        """Return the drive that was latched, as far as it was seen, and what to say about that."""
        drive, crc, count = observation.drive, observation.drive_crc, self._model.array.count
        if drive is None and crc is None:
            return None, "the latch was seen, but nothing of its drive"
        if drive is None and intended.board_computed:
            return None, "the board computed the drive, and only its CRC was seen"
        if drive is None:
            return intended.drive, "by the CRC of the drive, which is that of the intended one"
        if drive.count != count:
            return None, f"a drive of {drive.count} elements; the array has {count}"
        if crc not in (None, drive.digest()):
            return None, f"the drive that was seen has the CRC {drive.digest():08x}, not {crc:08x}"
        return drive, ""

    def _seen(self, intended: Intended, observation: Observation) -> FrameVerdict:
        lateness_us = (
            0 if intended.t_apply_us is None else observation.t_latch_us - intended.t_apply_us
        )
        return dataclasses.replace(
            lost(intended),
            status=FrameStatus.NOT_VERIFIED,
            evidence=observation.evidence,
            t_latch_us=observation.t_latch_us,
            late=observation.late or lateness_us >= self._carrier_us,
            early=lateness_us < 0,
            latches=1,
        )

    def _reconstruct(self, latched: Drive, phase_bits: int) -> Reconstruction:
        # The registers have 8 bits; how well the phases fit a focus depends on those of the wire.
        if phase_bits not in self._reconstructors:
            self._reconstructors[phase_bits] = Reconstructor(self._model, phase_bits)
        return self._reconstructors[phase_bits].reconstruct(latched)

    def _judge_single(
        self,
        seen: FrameVerdict,
        intended: Intended,
        latched: Drive,
        found: Reconstruction,
        faults: tuple[str, ...],
    ) -> FrameVerdict:
        target = self._target(intended.foci[0], intended.phase_bits)
        measures, verdicts, peaks = self._drive_criteria(intended, latched, target)
        if verdicts["S1"] and self._ambiguous(intended, latched, target, found):
            measures["note"] = "; ".join(filter(None, (seen.note, _AMBIGUOUS)))
        else:
            verdicts["S2"] = self._in_place(intended, target, found)
            if isinstance(found, SingleFocus):
                measures |= _where(target, found)
            elif isinstance(found, NotSingle):
                faults += _radiated_otherwise(self._model, found, faults)
                if not faults:  # the right drive in other air: a focus, but not a sharp one
                    measures |= _where(target, found)
                elif measures["coherence"] >= _STILL_A_FOCUS:
                    measures |= _where_the_peak_is(target, peaks)
                    measures["pressure_rms_pa"] = found.pressure_rms_pa
                measures["note"] = "; ".join(filter(None, (seen.note, _no_focus(found))))
            elif not faults:
                faults = (f"the drive is right, but nothing was radiated: {found.reason}",)
        bound_m = self._bound_m(intended, target)
        return dataclasses.replace(
            seen,
            status=_status(verdicts, faults, isinstance(found, SingleFocus)),
            criteria=dict(sorted(verdicts.items())),
            faults=faults,
            bound_mm=_finite_mm(bound_m),
            smallest_miss_mm=_MM * float(np.linalg.norm(_finite(bound_m))),
            **measures,
        )

    def _in_place(self, intended: Intended, target: TargetField, found: Reconstruction) -> bool:
        """S2."""
        if not isinstance(found, SingleFocus):
            return False
        offset_m = criteria.focus_offset_m(target, found)
        return criteria.on_target(offset_m, self._bound_m(intended, target))

    def _ambiguous(
        self, intended: Intended, latched: Drive, target: TargetField, found: Reconstruction
    ) -> bool:
        """Tell whether the latched phases, which suit the target, suit what was found as well.

        Few elements with few bits can fit two points, or a search that is not told the target none;
        S2 then says nothing about the drive.
        """
        if self._in_place(intended, target, found):
            return False
        if isinstance(found, SingleFocus):
            return criteria.explains(self._model, intended, latched, found.position_m)
        if not isinstance(found, NotSingle) or found.outliers:
            return False
        if found.residual_rms_rad <= criteria.phase_limit_rad(intended):
            return True  # one point does explain all phases: the search gave up too early
        return isinstance(self._reconstruct(latched, intended.phase_bits), NotSingle)

    def _bound_m(self, intended: Intended, target: TargetField) -> Floats:
        """Return S2's bound: in proportion to the largest error of a phase, as S1 allows it."""
        rounding_rad = phase_step_rad(intended.phase_bits) / 2.0
        bound_m: Floats = target.bound_m * (criteria.phase_limit_rad(intended) / rounding_rad)
        return bound_m

    def _drive_criteria(
        self, intended: Intended, latched: Drive, target: TargetField
    ) -> tuple[dict[str, Any], dict[str, bool], list[criteria.PeakError]]:
        """Return measures and verdicts that need the drive alone, S1, S3, S4, S5, and the peaks."""
        active = (latched.amplitude_codes > 0) & (intended.drive.amplitude_codes > 0)
        s5 = criteria.amplitudes_ok(intended, latched)
        sounding, wanted = latched.weights(), np.abs(intended.drive.weights())
        intended_pa = float(np.abs(target.arrivals) @ wanted) / math.sqrt(2.0)
        measures: dict[str, Any] = {"coherence": 0.0, "intended_pressure_rms_pa": intended_pa}
        if not active.any():
            return measures, {"S1": False, "S3": False, "S5": s5}, []
        error_rad = criteria.phase_error_rad(target, latched, active)
        coherence = criteria.coherence(target, sounding, wanted.astype(complex))
        verdicts = {
            "S1": error_rad <= criteria.phase_limit_rad(intended),
            "S3": coherence >= criteria.least_coherence(target, intended),
            "S5": s5,
        }
        measures |= {"phase_error_rad": error_rad, "coherence": coherence}
        limit_rad = criteria.phase_limit_rad(intended)
        peaks = criteria.peak_errors(self._model, target, sounding, wanted, limit_rad)
        if peaks:
            measures["peak_error"] = max(peak.error_rad for peak in peaks)
            verdicts["S4"] = all(peak.ok for peak in peaks)
        return measures, verdicts, peaks

    def _judge_silence(
        self, seen: FrameVerdict, intended: Intended, latched: Drive, faults: tuple[str, ...]
    ) -> FrameVerdict:
        """Judge a frame that shall radiate nothing: there is no focus, only S5."""
        verdicts = {"S5": criteria.amplitudes_ok(intended, latched)}
        faults = () if verdicts["S5"] else faults
        return dataclasses.replace(
            seen,
            status=_status(verdicts, faults, focused=False),
            criteria=verdicts,
            faults=faults,
            note="silence was intended",
        )

    def _judge_several(
        self, seen: FrameVerdict, intended: Intended, latched: Drive, faults: tuple[str, ...]
    ) -> FrameVerdict:
        targets = [self._target(focus, intended.phase_bits) for focus in intended.foci]
        levels = criteria.FociLevels.of(intended, latched.weights(), targets)
        note = f"{len(targets)} foci, each judged by the pressure at its point"
        verdicts = {"S2": levels.ok}
        if intended.solver == "naive":
            verdicts, note = {}, f"{note}; {_SUPERPOSED}"
        asked = self._asked(intended.foci, intended.solver)
        verdicts["S3"] = criteria.several_foci_ok(intended, latched.weights(), targets, asked)
        verdicts["S5"] = criteria.amplitudes_ok(intended, latched)
        return dataclasses.replace(
            seen,
            status=_status(verdicts, faults, focused=False),
            criteria=verdicts,
            faults=faults,
            note=note,
            balance=levels.balance,
            efficiency=levels.efficiency,
            pressure_rms_pa=abs(complex(targets[0].arrivals @ latched.weights())) / math.sqrt(2.0),
        )


def lost(intended: Intended) -> FrameVerdict:
    """Return the verdict of a frame that nobody saw."""
    return FrameVerdict(
        number=intended.number,
        key=intended.key,
        status=FrameStatus.LOST,
        evidence=None,
        target_m=intended.foci[0].position_m,
        t_apply_us=intended.t_apply_us,
    )


def _crc_fault(intended: Intended, observation: Observation) -> str:
    return (
        f"another drive was latched: its CRC is {observation.drive_crc:08x}, that of the intended "
        f"one {intended.drive.digest():08x}"
    )


def _crc_differs(intended: Intended, observation: Observation) -> bool:
    """Tell whether the CRC alone proves that another drive was latched."""
    return (
        observation.drive is None
        and observation.drive_crc is not None
        and not intended.board_computed
        and observation.drive_crc != intended.drive.digest()
    )


def _status(verdicts: dict[str, bool], faults: tuple[str, ...], focused: bool) -> FrameStatus:
    if all(verdicts.values()):
        return FrameStatus.CORRUPT if faults else FrameStatus.ON_TARGET
    if not faults or (focused and faults == (UNNAMED,)):
        return FrameStatus.OFF_TARGET  # the drive that was sent, in other air; or for another point
    return FrameStatus.WRONG_DRIVE


def _radiated_otherwise(
    model: AcousticModel, found: NotSingle, faults: tuple[str, ...]
) -> tuple[str, ...]:
    """Name the elements that radiated what was not latched, where the drive shows no fault."""
    if faults or not found.outliers:
        return ()
    return (f"{named_elements(model, found.outliers)} radiated otherwise than latched",)


def _no_focus(found: NotSingle) -> str:
    x, y, z = (_MM * coordinate for coordinate in found.position_m)
    return (
        f"no single focus; the most that was found is {found.pressure_rms_pa:.0f} Pa at "
        f"({x:.1f}, {y:.1f}, {z:.1f}) mm"
    )


def _where(target: TargetField, found: SingleFocus | NotSingle) -> dict[str, Any]:
    observable = np.isfinite(target.bound_m)
    if isinstance(found, SingleFocus):
        observable &= np.array(found.observable)
    offset_m = np.where(observable, criteria.focus_offset_m(target, found), 0.0)
    across_m, along_m = target.split(offset_m)
    axial = observable[np.abs(target.axis).argmax()]
    return {
        "measured_m": found.position_m,
        "lateral_error_mm": _MM * across_m,
        "axial_error_mm": _MM * along_m if axial else None,
        "pressure_rms_pa": found.pressure_rms_pa,
        "force_n": found.force_n if isinstance(found, SingleFocus) else None,
    }


def _where_the_peak_is(target: TargetField, peaks: list[criteria.PeakError]) -> dict[str, Any]:
    """Return how far the pressure peak is from its place, if it was looked for all around."""
    if len(peaks) < len(target.directions) or len(peaks) != _ACROSS_AND_ALONG:
        return {}
    across, along = (target.split(peak.offset_m) for peak in peaks)
    return {"lateral_error_mm": _MM * across[0], "axial_error_mm": _MM * along[1]}


def _finite(values: Floats) -> Floats:
    finite: Floats = values[np.isfinite(values)]
    return finite


def _finite_mm(bound_m: Floats) -> tuple[float | None, float | None, float | None]:
    x, y, z = (float(_MM * value) if math.isfinite(value) else None for value in bound_m)
    return x, y, z
