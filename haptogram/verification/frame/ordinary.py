"""Verdicts of ordinary frames, many at once, in compiled code.

A frame is ordinary if its drive, of full amplitude and for one focus, was latched as it was sent,
and all criteria hold. Of any other, and where nothing compiled serves the array, None is returned:
then :class:`.judge.FrameJudge` asks the criteria one by one.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any, Final, TypeAlias

import numpy as np

from haptogram.acoustics import AcousticModel, SingleFocus
from haptogram.acoustics.arrays import FloatArray
from haptogram.acoustics.field.engines.parallel import ParallelPistons
from haptogram.acoustics.model.drive import FULL_AMPLITUDE, REGISTER_BITS
from haptogram.records.frame import Evidence, Intended, Observation

from ..tolerance import Tolerance, Uncertainty, VerdictUncertainty
from . import criteria
from .peaks import PEAK_SETTINGS
from .target import OBSERVED
from .verdict import FrameStatus, FrameVerdict

Pair: TypeAlias = tuple[Intended, Observation]

_MM: Final = 1e3
#: Note of a verdict by the CRC of the drive alone.
BY_CRC: Final = "by the CRC of the drive, which is that of the intended one"
_HOLD: Final = ("S1", "S2", "S3", "S4", "S5")
COMPILED: Final = "compiled"
#: Meaning of each result of the loops.
_REASONS: Final = (
    "",
    "a coordinate of the focus that does not show",
    "a peak that has no place, or that rounding moves far",
    "a criterion that does not hold",
)


class OrdinaryFrames:
    """Judges frames of one array that are as they should be.

    Parameters
    ----------
    model : AcousticModel
        Array and air.
    tolerance, uncertainty : Tolerance, Uncertainty
        As of :class:`.judge.FrameJudge`.
    limit_rad : callable
        Returns S1's limit of a frame.

    Attributes
    ----------
    ways : Counter of str
        How many frames were judged here (`COMPILED`), and of the others how many for each reason.
    """

    def __init__(
        self,
        model: AcousticModel,
        tolerance: Tolerance,
        uncertainty: Uncertainty,
        limit_rad: Callable[[Intended], float],
    ) -> None:
        self.ways: Counter[str] = Counter()
        self._model, self._known, self._limit_rad = model, uncertainty, limit_rad
        self._why_not = ParallelPistons.why_not(model)
        if not tolerance.is_strict:
            self._why_not = "a tolerance"
        elif set(_HOLD) != set(criteria.CRITERIA):
            self._why_not = "a criterion that is not compiled"
        if self._why_not is None:
            self._pistons = ParallelPistons.of(model)
        self._wavenumber = model.wavenumber
        self._air_rad_m = uncertainty.speed_share(model.medium) * self._wavenumber
        self._full = bytes([FULL_AMPLITUDE]) * model.array.count
        self._limits: dict[tuple[Any, ...], tuple[float, float]] = {}

    def is_field_missing(self, intended: Intended, latch: Observation) -> bool:
        """Return True if a frame may be ordinary, but nobody has rebuilt the field of its latch."""
        is_missing = latch.reconstruction is None and self._why_not is None
        return is_missing and _why_not_as_sent(intended, latch, self._full) is None

    def verdicts(self, pairs: Sequence[Pair], carrier_us: int) -> list[FrameVerdict | None]:
        """Return the verdicts of frames and their latches; None: not ordinary."""
        found: list[FrameVerdict | None] = [None] * len(pairs)
        reasons = [self._why_not or _why_not_ordinary(*pair, self._full) for pair in pairs]
        places = [place for place, reason in enumerate(reasons) if reason is None]
        if places:
            some = [pairs[place] for place in places]
            for place, verdict in zip(places, self._judged(some, carrier_us), strict=True):
                if isinstance(verdict, FrameVerdict):
                    found[place], reasons[place] = verdict, COMPILED
                else:
                    reasons[place] = verdict
        self.ways.update(reason for reason in reasons if reason is not None)
        return found

    def _judged(self, pairs: Sequence[Pair], carrier_us: int) -> list[FrameVerdict | str]:
        """Return the verdict on each pair, or why it needs the full judge.

        A latch is late if it was reported so, or from *carrier_us* after its time on.
        """
        pistons, kernels = self._pistons, self._pistons.kernels
        codes = np.array([intended.drive.phase_codes for intended, _ in pairs])
        limits, coherences = np.array([self._limits_of(intended) for intended, _ in pairs]).T.copy()
        targets = np.array([intended.foci[0].position_m for intended, _ in pairs])
        offsets = np.array([_focus_of(latch).position_m for _, latch in pairs]) - targets
        rays = targets - self._model.array.centre_m
        distances = np.linalg.norm(rays, axis=1)
        measures = np.empty((len(pairs), kernels.JUDGED_MEASURES))
        answers = np.empty(len(pairs), dtype=np.int64)
        kernels.judged_frames_kernel(
            codes, 1.0 / (1 << REGISTER_BITS), targets, _beam_axes(rays / distances[:, None]),
            distances, offsets, limits, coherences, pistons.places, pistons.medium, OBSERVED,
            PEAK_SETTINGS.copy(), measures, answers,
        )  # fmt: skip
        return [
            _REASONS[answer] or self._verdict(*pair, row, carrier_us)
            for pair, row, answer in zip(pairs, measures.tolist(), answers.tolist(), strict=True)
        ]

    def _limits_of(self, intended: Intended) -> tuple[float, float]:
        """Return the limit of S1 in rad, and of S3 (least coherence, 0 to 1) at full amplitude."""
        key = (intended.steps, intended.drive.phase_bits, intended.board_computed)
        if key not in self._limits:
            limit_rad = self._limit_rad(intended)
            missing = criteria.allowed_frame_codes(intended) * criteria.AMPLITUDE_STEP
            self._limits[key] = limit_rad, criteria.least_coherence(limit_rad, 1.0 - missing)
        return self._limits[key]

    def _verdict(
        self, intended: Intended, latch: Observation, measures: list[float], carrier_us: int
    ) -> FrameVerdict:
        """Return the verdict on a frame that meets all criteria: ON_TARGET.

        *measures* is its row of the compiled kernel's results: offsets, errors, coherence, levels.
        It is late if reported so, or latched *carrier_us* or more after its time.
        """
        bx, by, bz, scatter, drift, phase_rad, coherence, loudness, peak_rad, across, along = (
            measures
        )
        found, known = _focus_of(latch), self._known
        target_m = intended.foci[0].position_m
        due_us, seen_us = intended.t_apply_us, latch.t_latch_us
        late_us = 0 if due_us is None else seen_us - due_us
        # The order of the fields: by name they take a third more time.
        return FrameVerdict(
            intended.number,
            intended.key,
            FrameStatus.ON_TARGET,
            latch.evidence,
            target_m,
            _sum_of_places(target_m, found.position_m),
            _MM * across,
            _MM * along,
            (_MM * bx, _MM * by, _MM * bz),
            _MM * math.sqrt(bx * bx + by * by + bz * bz),
            VerdictUncertainty(
                _MM * drift * self._air_rad_m,
                _MM * scatter * self._wavenumber * known.position_mm / _MM,
                _MM * scatter * known.phase_rad,
            ),
            phase_rad,
            coherence,
            None,
            None,
            peak_rad,
            found.pressure_rms_pa,
            found.force_n if math.isfinite(found.force_n) else None,
            loudness / math.sqrt(2.0),
            dict.fromkeys(_HOLD, True),
            (),
            BY_CRC if latch.drive is None else "",
            due_us,
            seen_us,
            latch.late or late_us >= carrier_us,
            late_us < 0,
            1,
        )


def _why_not_ordinary(intended: Intended, latch: Observation, full: bytes) -> str | None:
    """Return why a frame needs the full judge; None if it is one focus latched as sent.

    *full* holds the amplitude codes of a drive at full amplitude.
    """
    reason = _why_not_as_sent(intended, latch, full)
    if reason is not None:
        return reason
    found = latch.reconstruction
    return None if isinstance(found, SingleFocus) and not found.rivals_m else "no single focus"


def _why_not_as_sent(intended: Intended, latch: Observation, full: bytes) -> str | None:
    """Return why a latch differs from the one focus sent at amplitudes *full*; None if equal."""
    wanted = intended.drive
    drive = wanted if latch.shows_by_crc(intended) else latch.drive
    if len(intended.foci) != 1:
        return "several foci"
    if latch.evidence is Evidence.WIRE or drive is None:
        return "no drive of the board, or another CRC"
    if wanted.phase_bits != REGISTER_BITS or drive.phase_bits != REGISTER_BITS:
        return "phases that are not of 8 bits"
    if drive.amplitude_codes.tobytes() != full:
        return "amplitudes"
    crc = latch.drive_crc
    is_other = latch.radiated is not None or (crc is not None and crc != wanted.digest())
    if is_other or (drive is not wanted and drive != wanted):
        return "another drive than the intended one"
    return None


def _beam_axes(along: FloatArray) -> FloatArray:
    """Return (F, 4, 3) axes for each beam *along* (F, 3): two across it, the beam, and (0, 0, 0).

    All three are orthonormal; *along* has unit vectors.
    """
    axes, rows = np.zeros((len(along), 4, 3)), np.arange(len(along))
    furthest_off = np.abs(along).argmin(axis=1)
    first = -along[rows, furthest_off][:, None] * along
    first[rows, furthest_off] += 1.0
    first /= np.linalg.norm(first, axis=1)[:, None]
    axes[:, 0], axes[:, 1], axes[:, 2] = first, np.cross(along, first), along
    return axes


def _focus_of(latch: Observation) -> SingleFocus:
    """Return the focus reconstructed from a latch; the caller knows that there is one."""
    assert isinstance(latch.reconstruction, SingleFocus)
    return latch.reconstruction


def _sum_of_places(
    target_m: tuple[float, float, float], found_m: tuple[float, float, float]
) -> tuple[float, float, float]:
    """Return *found_m* as target + (found - target), rounded as in the full judge."""
    (x, y, z), (u, v, w) = target_m, found_m
    return x + (u - x), y + (v - y), z + (w - z)
