"""From one intended frame and its observation to a verdict."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import itertools
from collections.abc import Iterable, Iterator
from typing import Final

import numpy as np

from haptogram.acoustics import (
    AcousticModel,
    Drive,
    NoFocus,
    NotSingle,
    Reconstruction,
    Reconstructor,
)
from haptogram.acoustics.arrays import ComplexArray, FloatArray
from haptogram.acoustics.model.drive import FULL_AMPLITUDE
from haptogram.acoustics.reconstruct.warm import DriveToFind
from haptogram.acoustics.solvers.several import frame_weights
from haptogram.errors import ConfigurationError
from haptogram.records.frame import Evidence, Focus, FrameKey, Intended, Observation

from ..faults import name_drive_faults
from ..tolerance import Tolerance, Uncertainty
from . import criteria
from .crc_drive import drive_of_crc
from .ideal_drive import IdealFrameDrive
from .ordinary import BY_CRC, OrdinaryFrames, Pair
from .several import SeveralFociFrame
from .single import SingleFocusFrame, judge_silent_frame, verdict_not_radiated
from .target import FrameTarget, check_frame_tolerance
from .verdict import WRONG, FrameStatus, FrameVerdict

# Of targets, and as many drives of solvers and verdicts: a pass that repeats costs nothing new.
_REMEMBERED_BYTES: Final = 1 << 27
_CACHES: Final = 3
_AT_ONCE: Final = 512  # frames of a call of compiled code
_BYTES: Final = 6000  # memory of an entry, without that per element
_BYTES_PER_ELEMENT: Final = 160  # memory of a target: phases, pressures, responses
_ANY: Final = FrameKey(0, 0, 0, 0)
_ITS_OWN: Final = ("number", "key", "t_apply_us", "t_latch_us", "late", "early")
_ON_THE_WIRE: Final = (
    "the bytes that left the host are the drive for this target; nobody saw what the board latched"
)
#: Wrong drives for which a focus is sought in the whole volume, in vain: 40 ms or more each.
_MOST_SEARCHES: Final = 256
_EXACT_RAD: Final = 1e-7  # largest phase error of positions that are whole micrometres


class FrameJudge:
    """Judges frame after frame of one array.

    Parameters
    ----------
    model : AcousticModel
        Array and air that the frames were radiated in: the truth, which the host may have missed.
    carrier_us : int
        Carrier period: a frame latches on the first of its multiples at or after its time.
    tolerance : Tolerance
        Which misses pass on top of those of rounding; by default none.
    uncertainty : Uncertainty
        How well *model* is known; by default exactly.
    """

    def __init__(
        self,
        model: AcousticModel,
        *,
        carrier_us: int,
        tolerance: Tolerance | None = None,
        uncertainty: Uncertainty | None = None,
    ) -> None:
        self._model = model
        self._carrier_us = carrier_us
        self.tolerance = Tolerance() if tolerance is None else tolerance
        self.uncertainty = Uncertainty() if uncertainty is None else uncertainty
        self._grain_rad = criteria.frame_position_grain_rad(model)
        self._reconstructors: dict[int, Reconstructor] = {}
        self._searches = 0
        entry = _BYTES + _BYTES_PER_ELEMENT * model.array.count
        remembered = _REMEMBERED_BYTES // (_CACHES * entry)
        self._target = functools.lru_cache(remembered)(self._make_target)
        self._ideals = functools.lru_cache(remembered)(self._make_ideals)
        self._judged = functools.lru_cache(remembered)(self._judge)
        limit_rad = functools.partial(criteria.frame_phase_limit_rad, grain_rad=self._grain_rad)
        self._ordinary = OrdinaryFrames(model, self.tolerance, self.uncertainty, limit_rad)

    def _make_target(
        self, position_m: tuple[float, float, float], amplitude_codes: bytes, limit_rad: float
    ) -> FrameTarget:
        """Return the target at a position, with the largest phase error *limit_rad*.

        Refuses a tolerance that is too large to be judged there.
        """
        codes = np.frombuffer(amplitude_codes, np.uint8)
        amplitudes, place = codes / FULL_AMPLITUDE, np.array(position_m)
        target = FrameTarget(self._model, place, amplitudes, limit_rad, self.tolerance)
        if target.active.any():  # as before a run: the verdict on it comes too late to refuse
            check_frame_tolerance(self._model, place, self.tolerance)
        return target

    def _targets(self, intended: Intended) -> list[FrameTarget]:
        """Return the target of each focus, with the largest phase error that passes there."""
        codes = intended.drive.amplitude_codes.tobytes()
        limit_rad = criteria.frame_phase_limit_rad(intended, self._grain_rad)
        return [self._target(focus.position_m, codes, limit_rad) for focus in intended.foci]

    def _make_ideals(self, intended: Intended) -> list[IdealFrameDrive]:
        """Return the ideal drive of the foci for each model with which they may have been solved.

        A model for which the solver refuses the foci is left out; [] if it refuses them for all.
        """
        targets, found = self._targets(intended), []
        for model in self._known_models(board_computed=intended.board_computed):
            drive = functools.partial(_drive_of_judged_host, model, intended)
            with contextlib.suppress(ConfigurationError):  # a focus at the edge of its reach
                found.append(IdealFrameDrive.of(intended, targets, drive))
        return found

    def _known_models(self, *, board_computed: bool) -> Iterator[AcousticModel]:
        """Yield the models that the sender may have used: the judge's and, if another, the wire's.

        On the wire the array is in whole micrometres; *board_computed*: the speed of sound is in
        whole mm/s.
        """
        model = self._model
        if board_computed:
            model = model.with_sound_speed(round(model.medium.sound_speed_m_s, 3))
        yield model
        if self._grain_rad > _EXACT_RAD:
            yield dataclasses.replace(model, array=model.array.on_wire())

    @property
    def ways(self) -> dict[str, int]:
        """Number of frames of :meth:`judge_all` in compiled code, and for each reason why not."""
        return dict(self._ordinary.ways)

    def judge_all(self, pairs: Iterable[Pair]) -> Iterator[FrameVerdict]:
        """Yield the verdicts on frames and their latches, as one call of :meth:`judge` for each."""
        for missing, coming in itertools.groupby(pairs, self._steps_of_missing_field):
            while some := list(itertools.islice(coming, _AT_ONCE)):
                if missing is not None:
                    some = self._with_fields(some, missing)
                found = self._ordinary.verdicts(some, self._carrier_us)
                for pair, verdict in zip(some, found, strict=True):
                    yield self.judge(*pair) if verdict is None else verdict

    def _steps_of_missing_field(self, pair: Pair) -> int | None:
        """Return the phase steps per turn of a frame whose latch lacks its field; else None.

        A latch lacks it if it is the drive as sent, and nobody has reconstructed its focus.
        """
        return pair[0].steps if self._ordinary.is_field_missing(*pair) else None

    def _with_fields(self, pairs: Iterable[Pair], steps: int) -> list[Pair]:
        """Return the pairs, with fields reconstructed from the intended drives at phase *steps*."""
        asked = [
            DriveToFind(intended.drive, criteria.judged_frame_step_rad(intended))
            for intended, _ in pairs
        ]
        found = self._reconstructor(steps).reconstruct_all_quickly(asked)
        return [
            (intended, dataclasses.replace(latch, reconstruction=focus))
            for (intended, latch), focus in zip(pairs, found, strict=True)
        ]

    def judge(self, intended: Intended, observation: Observation) -> FrameVerdict:
        """Return the verdict on a frame that was latched, or seen on the wire."""
        seen = self._unjudged_verdict(intended, observation)
        found = self._judged(
            _judged_frame_without_identity(intended),
            dataclasses.replace(observation, key=_ANY, t_latch_us=0, late=False),
        )
        if observation.evidence is Evidence.WIRE and found.status not in WRONG:
            return dataclasses.replace(seen, note=_ON_THE_WIRE)
        return dataclasses.replace(found, **{name: getattr(seen, name) for name in _ITS_OWN})

    def _judge(self, intended: Intended, observation: Observation) -> FrameVerdict:
        """Return the full verdict on *observation*, a latch of *intended*, for the cache.

        Both come without key and times: the caller adds those of the frame.
        """
        seen = self._unjudged_verdict(intended, observation)
        if observation.drive_crc is not None and observation.shows_by_crc(intended) is False:
            named = drive_of_crc(self._model, intended, observation.drive_crc)
            if named is None:
                fault = _crc_fault_of_frame(intended, observation)
                return dataclasses.replace(seen, status=FrameStatus.CORRUPT, faults=(fault,))
            observation = dataclasses.replace(observation, drive=named)
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
            heard = not output.is_muted if found is None else not isinstance(found, NoFocus)
            return judge_silent_frame(seen, intended, output, faults, heard=heard)
        if isinstance(found, NoFocus) and len(intended.foci) > 1:
            faults = faults or (verdict_not_radiated(found),)
            return dataclasses.replace(seen, status=FrameStatus.WRONG_DRIVE, faults=faults)
        targets = self._targets(intended)
        if not targets[0].active.any():
            note = "the calibration gives every element that shall sound a gain of 0"
            return dataclasses.replace(seen, faults=faults, note=note)
        if len(intended.foci) > 1:
            ideals = self._ideals(_judged_frame_without_identity(intended))
            if not ideals:
                note = f"the solver {intended.solver} refuses these foci for the array of the board"
                return dataclasses.replace(seen, faults=faults, note=note)
            several = SeveralFociFrame(intended, output, ideals, self.uncertainty)
            return several.judge(seen, faults)
        (target,) = targets
        one = SingleFocusFrame(intended, output, target, self.uncertainty)
        if found is None or (isinstance(found, NotSingle) and _is_frame_undecided(found, target)):
            found = self._reconstruct(one)
        return one.judge(seen, found, faults)

    def _faults(self, intended: Intended, latched: Drive, output: Drive) -> tuple[str, ...]:
        """Name the faults of the latched drive or, if none, of the radiated *output*; else ()."""
        faults = name_drive_faults(self._model, intended, latched)
        if faults or output is latched:
            return faults
        radiated = name_drive_faults(self._model, intended, output)
        return tuple(f"{fault}, at the output: the latched drive is right" for fault in radiated)

    def _latched_drive(
        self, intended: Intended, observation: Observation
    ) -> tuple[Drive | None, str]:
        """Return the latched drive, if need be by its CRC, and a note; or None and the reason."""
        drive, crc, count = observation.drive, observation.drive_crc, self._model.array.count
        if drive is None and crc is None:
            return None, "the latch was seen, but nothing of its drive"
        if drive is None and intended.board_computed:
            return None, "the board computed the drive, and only its CRC was seen"
        if drive is None:
            return intended.drive, BY_CRC
        for seen in (drive, observation.radiated or drive):
            if seen.count != count:
                return None, f"a drive of {seen.count} elements; the array has {count}"
        if isinstance(observation.reconstruction, NotSingle):
            wrong = [number for number in observation.reconstruction.outliers if number >= count]
            if wrong:
                return None, f"a field with an element {wrong[0]}; the array has {count}"
        if crc not in (None, drive.digest()):
            return None, f"the drive that was seen has the CRC {drive.digest():08x}, not {crc:08x}"
        return drive, ""

    def _unjudged_verdict(self, intended: Intended, observation: Observation) -> FrameVerdict:
        """Return a verdict with evidence and times of the observation, not yet judged.

        A latch is late if it was reported so, or from a carrier period after its time on.
        """
        lateness_us = (
            0 if intended.t_apply_us is None else observation.t_latch_us - intended.t_apply_us
        )
        return dataclasses.replace(
            lost_frame_verdict(intended),
            status=FrameStatus.NOT_VERIFIED,
            evidence=observation.evidence,
            t_latch_us=observation.t_latch_us,
            late=observation.late or lateness_us >= self._carrier_us,
            early=lateness_us < 0,
            latches=1,
        )

    def _reconstructor(self, steps: int) -> Reconstructor:
        """Return the cached reconstructor for *steps* phases in a period."""
        if steps not in self._reconstructors:
            self._reconstructors[steps] = Reconstructor(self._model)
        return self._reconstructors[steps]

    def _reconstruct(self, frame: SingleFocusFrame) -> Reconstruction | None:
        """Return the field of a latched drive; a quick search may fail and return None.

        The search is quick for a frame that is wrong anyway, after 256 failed searches.
        """
        # How well the phases fit a focus depends on the wire's steps, not on the registers.
        known = self._reconstructor(frame.intended.steps)
        weights, slack_rad = frame.latched.weights(), frame.target.tolerated_rad
        step_rad = criteria.judged_frame_step_rad(frame.intended)
        if self._searches >= _MOST_SEARCHES and frame.is_wrong_without_search:
            return known.reconstruct_quickly(weights, step_rad=step_rad, slack_rad=slack_rad)
        found = known.reconstruct_weights(weights, step_rad=step_rad, slack_rad=slack_rad)
        self._searches += isinstance(found, NotSingle) and not found.outliers
        return found


def _is_frame_undecided(found: NotSingle, target: FrameTarget) -> bool:
    """Return True if *found*, a field without a focus, does not disprove one at *target*.

    So it is if no element is an outlier, or the RMS phase error is within the target's limit: a
    board that reports the field knows neither the tolerance nor the phase resolution of the frame.
    """
    return not found.outliers or found.residual_rms_rad <= target.phase_limit_rad


def _judged_frame_without_identity(intended: Intended) -> Intended:
    """Return *intended* without number, key and times: equal drives then share a cached verdict."""
    return dataclasses.replace(
        intended, number=0, key=_ANY, t_apply_us=None, t_latest_us=None, t_sent_us=None
    )


def _drive_of_judged_host(
    model: AcousticModel, intended: Intended, off: FloatArray
) -> ComplexArray:
    """Return the weights (N,) of a host with foci and sound speed wrong by *off* (4,).

    These are x, y, z in m, added to each focus, and a share of the speed: 0.01 is 1 % faster.
    """
    if off[3]:
        model = model.with_sound_speed(model.medium.sound_speed_m_s * (1.0 + float(off[3])))
    foci = [
        Focus.at(np.add(focus.position_m, off[:3]), focus.amplitude, focus.phase_rad)
        for focus in intended.foci
    ]
    return frame_weights(model, foci, intended.solver)


def lost_frame_verdict(intended: Intended) -> FrameVerdict:
    """Return the verdict of a frame without an observation."""
    return FrameVerdict(
        number=intended.number,
        key=intended.key,
        status=FrameStatus.LOST,
        evidence=None,
        target_m=intended.foci[0].position_m,
        t_apply_us=intended.t_apply_us,
    )


def _crc_fault_of_frame(intended: Intended, observation: Observation) -> str:
    """Return a text with the CRC of the latched drive, which was not seen, and the intended."""
    return (
        f"another drive was latched: its CRC is {observation.drive_crc:08x}, that of the intended "
        f"one {intended.drive.digest():08x}"
    )
