"""The result of a verification: of one frame, and of a run."""

from __future__ import annotations

import enum
import math
from collections.abc import Iterator
from typing import TypeAlias

from haptogram.records.frame import Evidence, FrameKey
from haptogram.settings.frozen import dataclass, field

from ..tolerance import VerdictUncertainty

Vector: TypeAlias = tuple[float, float, float]
Observed: TypeAlias = tuple[float | None, float | None, float | None]


class FrameStatus(enum.StrEnum):
    """The status of one intended frame."""

    ON_TARGET = "on target"
    OFF_TARGET = "off target"  # a focus, but elsewhere
    WRONG_DRIVE = "wrong drive"  # not the drive that was asked for, and the field shows it
    CORRUPT = "corrupt"  # not the drive that was asked for, although the focus is in its place
    NOT_VERIFIED = "not verified"  # latched, but what was seen of it does not suffice
    LOST = "lost"  # it left the host in time, and the board did not latch it
    HELD_UP = "held up"  # the host or its machine was too late with it
    CANCELLED = "cancelled"  # the host ended the run, and muted the board, before it was due


JUDGED: frozenset[FrameStatus] = frozenset(
    {
        FrameStatus.ON_TARGET,
        FrameStatus.OFF_TARGET,
        FrameStatus.WRONG_DRIVE,
        FrameStatus.CORRUPT,
    }
)
WRONG: frozenset[FrameStatus] = JUDGED - {FrameStatus.ON_TARGET}
#: A frame that was due, and that the board did not latch.
MISSED: frozenset[FrameStatus] = frozenset({FrameStatus.LOST, FrameStatus.HELD_UP})
NOTHING_WRONG: frozenset[FrameStatus] = frozenset({FrameStatus.ON_TARGET, FrameStatus.CANCELLED})


class Verdict(enum.StrEnum):
    """The verdict of a run, with its exit status."""

    PASS = "pass"
    FAIL = "fail"
    INCONCLUSIVE = "inconclusive"

    @property
    def exit_status(self) -> int:
        """0 pass, 1 fail, 3 inconclusive."""
        return {Verdict.PASS: 0, Verdict.FAIL: 1, Verdict.INCONCLUSIVE: 3}[self]

    def __bool__(self) -> bool:
        """Return True for a pass only."""
        return self is Verdict.PASS


class Judged:
    """Base of a result with a verdict: true if it passed, and only then (``assert result``)."""

    __slots__ = ()
    verdict: Verdict

    @property
    def passed(self) -> bool:
        """True if the verdict is a pass."""
        return self.verdict is Verdict.PASS

    def __bool__(self) -> bool:
        """Return :attr:`passed`."""
        return self.passed

    @property
    def exit_status(self) -> int:
        """0 pass, 1 fail, 3 inconclusive."""
        return self.verdict.exit_status


def is_share_reached(count: int, share: float, total: int) -> bool:
    """Return True if *count* is a *share* of *total*, whatever the rounding of 0.55 times 100."""
    return count >= (share - 1e-12) * total


@dataclass(frozen=True, slots=True)
class Cut:
    """Interruption of a run before its end.

    Attributes
    ----------
    reason : str
        Why.
    muted_us : int or None
        Device time at which the host muted the board, on the clock of what was intended: what was
        due later is cancelled, not lost.  None: it did not.
    not_sent : int
        Frames of the run that never left the host; of a sequence, that were not played.
    """

    reason: str
    muted_us: int | None = None
    not_sent: int = 0

    def cancelled(self, t_apply_us: int | None) -> bool:
        """Return True if a frame with this time was due after the stream ended."""
        if t_apply_us is None or self.muted_us is None:
            return False
        return t_apply_us > self.muted_us


@dataclass(frozen=True, slots=True)
class Consequence:
    """The effect in space of a frame that was not latched, or not in time.

    Attributes
    ----------
    focus_error_mm : float or None
        Distance of the focus that was held instead from the one intended; None: silence.
    pressure_rms_pa, intended_pressure_rms_pa : float
        Pressure at the intended point under the drive that was held, and as it should have been.
    """

    focus_error_mm: float | None
    pressure_rms_pa: float
    intended_pressure_rms_pa: float


@dataclass(slots=True)  # frozen would take four times as long to make
class FrameVerdict:
    """The verdict on one intended frame.

    Attributes
    ----------
    number, key
        Which frame.
    status : FrameStatus
        Status of the frame.
    evidence : Evidence or None
        Who saw it; None if nobody did.
    target_m : tuple
        First focus that was intended, in metres; of a board that is watched, the one farthest off.
    measured_m : tuple or None
        Where the focus was found; None for a coordinate that this array cannot observe.
    lateral_error_mm, axial_error_mm : float or None
        Distance of the two across, and signed along, the line from the centre of the elements that
        sound to the target; None where that direction cannot be observed. Of a wrong drive that no
        one point explains: how far the peak of its pressure is from its place (S4), if it is still
        a focus.  Of several foci: how far the worst of their peaks is from that of the ideal drive.
    bound_mm : tuple or None
        S2: largest error per axis that rounding can make; None for a direction that this array
        cannot observe.  Of several foci: of the one whose miss shows last.
    smallest_miss_mm : float or None
        Length of that bound, and the tolerance: a shorter miss does not show.  None where a miss in
        some direction would never show.
    uncertainty_mm : VerdictUncertainty or None
        How well the place is known, for what is not known of air and elements.
    phase_error_rad : float or None
        S1: half the range of the element residuals.
    coherence : float or None
        S3: at the target, normalised by the intended amplitudes.
    balance, efficiency : float or None
        Of several foci: the least pressure for the wanted amplitude over the mean of them, and
        sum_i (|p_i| / sum_n |a_n g_in|)^2 with the intended amplitudes a_n.
    peak_error : float or None
        S4: largest distance of the pressure peak from its place, in radians of phase.
    pressure_rms_pa, force_n : float or None
        At the focus that was found.
    intended_pressure_rms_pa : float or None
        At the target, of the intended amplitudes with ideal phases.
    criteria : dict of str to bool
        S1 to S5, those that were judged.
    faults : tuple of str
        Faults of the drive, by name; of a frame that was not latched, what became of it.
    note : str
        Why it was not verified, or with what allowance it was.
    t_apply_us, t_latch_us : int or None
        Device times.
    late : bool
        Whether it was latched later than the first carrier boundary at or after its time.
    early : bool
        Whether it was latched before its time.
    latches : int
        How often it was latched.
    consequence : Consequence or None
        Of a lost frame, or of a late one until it was latched; None also where nobody knows what
        was held meanwhile.

    Examples
    --------
    >>> import numpy as np
    >>> from haptogram.acoustics import AcousticModel, focus_phases
    >>> model = AcousticModel.default(nx=8, ny=8)
    >>> phases = focus_phases(model, (0.0, 0.0, 0.1))
    >>> found = judge(model, (0.0, 0.0, 0.105), np.exp(1j * phases))
    >>> str(found.status), found.passed, f"{found.axial_error_mm:.0f} mm"
    ('off target', False, '-5 mm')
    """

    number: int
    key: FrameKey
    status: FrameStatus
    evidence: Evidence | None
    target_m: Vector
    measured_m: Observed | None = None
    lateral_error_mm: float | None = None
    axial_error_mm: float | None = None
    bound_mm: Observed | None = None
    smallest_miss_mm: float | None = None
    uncertainty_mm: VerdictUncertainty | None = None
    phase_error_rad: float | None = None
    coherence: float | None = None
    balance: float | None = None
    efficiency: float | None = None
    peak_error: float | None = None
    pressure_rms_pa: float | None = None
    force_n: float | None = None
    intended_pressure_rms_pa: float | None = None
    criteria: dict[str, bool] = field(default_factory=dict)
    faults: tuple[str, ...] = ()
    note: str = ""
    t_apply_us: int | None = None
    t_latch_us: int | None = None
    late: bool = False
    early: bool = False
    latches: int = 0
    consequence: Consequence | None = None

    @property
    def passed(self) -> bool:
        """True if the focus is on target, by all criteria."""
        return self.status is FrameStatus.ON_TARGET

    def __bool__(self) -> bool:
        """Return :attr:`passed`."""
        return self.passed

    def __str__(self) -> str:
        """Return the status of the frame and its evidence, in a line."""
        return _frame_verdict_text(self)

    @property
    def is_wrong(self) -> bool:
        """True if what was latched is not what was asked for."""
        return self.status in WRONG

    @property
    def is_silence(self) -> bool:
        """True if the frame was to radiate nothing: there is no focus to miss."""
        return [*self.criteria] == ["S5"] and self.phase_error_rad is None

    @property
    def target_pressure_rms_pa(self) -> float | None:
        """Pressure of the radiated drive at the target."""
        if self.coherence is None or self.intended_pressure_rms_pa is None:
            return None
        return self.coherence * self.intended_pressure_rms_pa

    @property
    def error_mm(self) -> float | None:
        """Distance of the focus from its target, in the directions that can be observed."""
        if self.lateral_error_mm is None:
            return None
        return math.hypot(self.lateral_error_mm, self.axial_error_mm or 0.0)

    @property
    def lateness_us(self) -> int | None:
        """Time from when it was due to when it was latched, in microseconds."""
        if self.t_apply_us is None or self.t_latch_us is None:
            return None
        return self.t_latch_us - self.t_apply_us


# --- Texts ------------------------------------------------------------------------------------


def verdict_consequence_text(effect: Consequence) -> str:
    """Return the effect in space of a frame that was not latched in time, in words."""
    wanted = f"instead of {effect.intended_pressure_rms_pa:.0f} Pa"
    if effect.focus_error_mm is None:
        return f"silence {wanted}"
    away = f"the focus stayed {effect.focus_error_mm:.1f} mm away"
    return f"{away}: {effect.pressure_rms_pa:.0f} Pa {wanted}"


def verdict_pressure_text(frame: FrameVerdict) -> str | None:
    """Return the change of the pressure at the target by a wrong drive; None: unknown."""
    if frame.status not in WRONG or frame.target_pressure_rms_pa is None:
        return None
    wanted = f"instead of {frame.intended_pressure_rms_pa:.0f} Pa"
    return f"{frame.target_pressure_rms_pa:.0f} Pa at the target {wanted}"


def frame_verdict_text(frame: FrameVerdict) -> str:
    """Return the faults of one frame, with their size, in a line."""
    parts = [f"frame {frame.number}: {frame.status}"]
    if (frame.late or frame.early) and frame.lateness_us is not None:
        parts.append(f"{abs(frame.lateness_us)} µs {'late' if frame.late else 'early'}")
    if frame.latches > 1:
        parts.append(f"latched {frame.latches} times")
    parts += [*frame.faults, *frame_verdict_measures(frame)]
    if frame.note and (frame.status is FrameStatus.NOT_VERIFIED or not frame.faults):
        parts += [frame.note] if frame.status in (FrameStatus.NOT_VERIFIED, *WRONG) else []
    if frame.note and frame.status in MISSED:
        parts.append(frame.note)
    return "; ".join(parts)


def _frame_verdict_text(frame: FrameVerdict) -> str:
    """Return the status of one frame, its evidence, and the smallest miss that would show."""
    parts = [frame_verdict_text(frame)]
    if frame.status not in WRONG and (place := _frame_verdict_place(frame)) is not None:
        parts.append(place)
    if frame.criteria and not frame.is_silence:
        smallest_mm = frame.smallest_miss_mm
        parts.append(
            "a miss that cannot be observed does not show"
            if smallest_mm is None
            else f"every miss from {smallest_mm:.3f} mm on shows"
        )
    failed = "failed" if frame.status in WRONG else "warns"
    judged = [name if passed else f"{name} {failed}" for name, passed in frame.criteria.items()]
    parts += [", ".join(judged)] if judged else []
    parts += [] if frame.evidence is None else [f"{frame.evidence} evidence"]
    return "; ".join(parts)


def _frame_verdict_place(frame: FrameVerdict) -> str | None:
    """Return the error in mm across and along the beam as text; None if neither is measured."""
    parts = [
        None if frame.lateral_error_mm is None else f"{frame.lateral_error_mm:.3f} mm across",
        None if frame.axial_error_mm is None else f"{frame.axial_error_mm:+.3f} mm along",
    ]
    return ", ".join(filter(None, parts)) or None


def frame_verdict_measures(frame: FrameVerdict) -> Iterator[str]:
    """Yield the millimetres and pascals of the faults."""
    if frame.status in WRONG and (place := _frame_verdict_place(frame)) is not None:
        yield place
    if (pressure := verdict_pressure_text(frame)) is not None:
        yield pressure
    if frame.consequence is not None:
        yield verdict_consequence_text(frame.consequence)
