"""What a trial came to: the verdict of the program against the truth."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from haptogram.verification.faults import UNNAMED
from haptogram.verification.frame.verdict import WRONG, FrameStatus, FrameVerdict

from . import truth
from .cases import Allowance, Session, Wanted, fresnel_number, superposed
from .chain import Program, Ran, Seen
from .truth import Complexes, Lie, Scene
from .wrongs import Registers, moved

#: Outcomes that must never be.
BAD: Final = ("false pass", "false fail", "crash")
#: Outcomes, in the order of the table.
OUTCOMES: Final = (
    "passed",
    "caught",
    "below, passed",
    "below, failed",
    "not verified",
    "lost",
    "stopped",
    *BAD,
)

_SMALLEST_OVER_ROUNDING: Final = 1.1
_PLACE_SHARE: Final = 0.5  # of the smallest miss: how far the two places found may be apart
_PLACE_MM: Final = 2e-3  # of the search itself, and of the digits that are kept
_FRESNEL: Final = 3.0
_ELEMENTS: Final = 8
_RADIANS: Final = 0.35  # of a peak next to one of several targets, where nothing else is printed
_NO_PEAK_RAD: Final = 1.0
_ONE_LOBE_RAD: Final = math.pi
_NUMERICS: Final = 1e-6
_SEEN_FROM_MM: Final = 1.0
#: Of a pressure: the tolerated host is sought with other weights of the elements than it has.
_OTHER_WEIGHTS: Final = 1.3
_FAR_OFF_RAD: Final = 0.6
_FEW: Final = 0.2  # share of the elements
_LOUD: Final = 0.5  # of the mean: an element on which the foci do not cancel out


@dataclass
class Trial:
    """One frame, judged twice.

    Attributes
    ----------
    case : str
        ``GROUP:SEED:FRAME``, which replays it.
    kind : str
        Of what is wrong, or of what is honest.
    outcome : str
        One of :data:`OUTCOMES`.
    status : str
        What the program said.
    findings : list of str
        What does not hold, beside the outcome.
    numbers : dict
        Of the truth and of the program.
    """

    case: str
    kind: str
    outcome: str
    status: str
    findings: list[str] = field(default_factory=list)
    numbers: dict[str, Any] = field(default_factory=dict)


@dataclass
class Effect:
    """What really came of a drive.

    Attributes
    ----------
    miss_mm : float
        How far the place where the waves arrive in phase, or of several foci the worst peak, is
        from where the ideal drive has it.
    miss_rad : float
        The same in radians of phase.
    share : float
        Largest deviation of the pressure at a target, as a share of that of the ideal drive.
    allowed : float
        What rounding can make of that.
    scattered : float
        What single elements do to the pressure, added up; one focus only.
    rounding_mm, rounding_rad : float
        What rounding makes of the miss: in the directions that can be observed; of several foci,
        what it makes of the ideal drive.
    tolerated_mm, tolerated : float
        What a tolerance that was stated adds to that, and to the pressure.
    place_m : array or None
        Of one focus: where the waves arrive in phase.
    coherence : float
        There.
    """

    miss_mm: float
    miss_rad: float
    share: float
    allowed: float
    rounding_mm: float = 0.0
    rounding_rad: float = 0.0
    tolerated_mm: float = 0.0
    tolerated: float = 0.0
    scattered: float = 0.0
    place_m: truth.Floats | None = None
    coherence: float = 1.0

    def why_beyond(self, smallest_mm: float | None) -> str | None:
        """What exceeds what could be shown; None: nothing."""
        most = self.allowed + self.tolerated
        if self.share > most + _NUMERICS:
            return f"pressure off by {self.share:.3g}, rounding makes {most:.3g}"
        if self.scattered > most + _NUMERICS:
            return f"elements off by {self.scattered:.3g}, rounding makes {most:.3g}"
        if smallest_mm is None and self.place_m is None:
            if self.miss_rad > max(_RADIANS, 2.0 * self.rounding_rad) and not self.tolerated_mm:
                return f"peak off by {self.miss_rad:.3g} rad, no smallest miss printed"
            return None
        least_mm = max(smallest_mm or 0.0, self.rounding_mm + self.tolerated_mm)
        if self.miss_mm > least_mm + _PLACE_MM:
            return f"miss of {self.miss_mm:.4g} mm, smallest that shows {least_mm:.4g} mm"
        return None


def judged(ran: Ran, program: Program) -> list[Trial]:
    """Every frame of a session as a trial; of one that did not run, as many as it had."""
    session = ran.session
    trials = []
    for place, seen in enumerate(ran.frames):
        trials.append(_frame(ran, program, place, seen))
    for place in range(len(ran.frames), len(session.frames)):
        outcome = "stopped" if ran.expected or ran.error is None else "crash"
        why = [] if outcome == "stopped" else [str(ran.error)]
        trials.append(Trial(_case(session, place), _kind(ran, None), outcome, "-", why))
    _judge_run(ran, trials)
    return trials


def _case(session: Session, place: int) -> str:
    return f"{session.group}:{session.seed}:{place}"


def _kind(ran: Ran, seen: Seen | None) -> str:
    if seen is not None and seen.wrong is not None:
        return seen.wrong.kind + (" (host)" if seen.wrong.of_host else " (line)")
    if "fault" in ran.tags:
        return str(ran.tags["fault"].split()[0])
    for name in ("host air", "host pitch", "uncompensated"):
        if name in ran.tags:
            return name
    layout = ran.session.layout
    size = "" if layout.kind == "line" or layout.count >= 64 else " small"
    what = "several foci" if seen is not None and len(seen.wanted.foci) > 1 else "one focus"
    if ran.session.elements is not None:
        what += ", calibrated"
    if ran.session.allowance is not None:
        what += ", tolerance"
    return f"{layout.kind}{size}, {what}"


def _judge_run(ran: Ran, trials: list[Trial]) -> None:
    """The verdict of the whole run must follow from those of its frames."""
    if ran.run is None:
        return
    bad = WRONG | {FrameStatus.LOST}
    failed = any(f.status in bad or f.early or f.latches > 1 for f in ran.run.frames)
    if failed != (str(ran.run.verdict) == "fail") and not ran.run.unexpected:
        trials[0].findings.append(f"run is {ran.run.verdict}, though frames say otherwise")


# --- one frame -------------------------------------------------------------------------------


def _frame(ran: Ran, program: Program, place: int, seen: Seen) -> Trial:
    session, verdict = ran.session, seen.verdict
    if isinstance(verdict, str):
        return Trial(_case(session, place), _kind(ran, seen), "crash", "-", [verdict])
    trial = Trial(_case(session, place), _kind(ran, seen), "", str(verdict.status))
    if not seen.radiated:
        return _unseen(trial, verdict, session)
    scene = session.scene
    ideal = program.weights(seen.wanted)
    bits = session.wire_bits
    lie = truth.lie_of(scene, _heard(scene, ideal), seen.wanted.targets_m[0], bits)
    effect = _effect(session, seen.wanted, seen.radiated[0], ideal, lie)
    if session.allowance is not None:
        _tolerate(effect, program, seen.wanted, ideal, lie)
    untouched = np.array_equal(seen.radiated[0], _intended(seen, ran))
    _note(trial, verdict, effect, lie)
    trial.outcome = _outcome(trial, ran, seen, effect, lie, untouched=untouched)
    if verdict.status is FrameStatus.ON_TARGET:
        _check_printed(trial, seen, session, ideal, effect, lie)
    if session.group == "honest":
        _check_silence(trial, session, seen, ideal, lie)
    return trial


def _unseen(trial: Trial, verdict: FrameVerdict, session: Session) -> Trial:
    """A frame that left no transducer must not pass; where nothing is broken, none is lost."""
    if verdict.status is FrameStatus.ON_TARGET:
        trial.outcome = "false pass"
        trial.findings.append("nothing was radiated")
    elif session.group == "honest":
        trial.outcome = "false fail"
        trial.findings.append("lost without a fault")
    else:
        trial.outcome = "lost"
    return trial


def _intended(seen: Seen, ran: Ran) -> tuple[Any, Any] | None:
    """The registers of the frame, if nothing was made wrong in it or in the whole session."""
    if seen.wrong is not None or {"host air", "host pitch", "uncompensated"} & set(ran.tags):
        return None
    intended = next((i for i in ran.intended if i.key == seen.verdict.key), None)
    return None if intended is None else (
        intended.drive.phase_codes, intended.drive.amplitude_codes
    )  # fmt: skip


def _heard(scene: Scene, drive: Complexes) -> truth.Floats:
    """How loud each element is."""
    return np.abs(drive * scene.sensitivity)


def _steps(session: Session) -> float:
    """How many steps a phase may be off: half, and one more where the board computes (SPEC.md)."""
    return 1.5 if session.mode == "points" else 0.5


def _effect(
    session: Session, wanted: Wanted, radiated: Registers, ideal: Complexes, lie: Lie
) -> Effect:
    actual = truth.weights_of(*radiated)
    if len(wanted.foci) > 1:
        return _of_several(session, wanted, actual, ideal, _peaks(session, wanted, ideal))
    phases = radiated[0] * (2.0 * math.pi / 256.0)
    return _of_one(session, wanted, (phases, actual), ideal, lie)


def _tolerate(effect: Effect, program: Program, wanted: Wanted, ideal: Complexes, lie: Lie) -> None:
    """Add to what is allowed what the tolerance itself does: other air, and a miss."""
    session = program.session
    allowance = session.allowance or Allowance()
    share, miss_m = allowance.speed_share(session.temperature_c), allowance.miss_mm * 1e-3
    air = [program.weights(wanted, 1.0 + sign * share) for sign in (1, -1) if share]
    ways = [sign * miss_m * axis for axis in lie.axes for sign in (1.0, -1.0) if miss_m]
    if len(wanted.foci) == 1:
        effect.tolerated_mm = allowance.miss_mm + max(
            (_moved_by_air_mm(session, wanted, other, lie) for other in air), default=0.0
        )
        return
    peaks = _peaks(session, wanted, ideal)
    for others in (air, [program.weights(moved(wanted, way)) for way in ways]):
        found = [_of_several(session, wanted, other, ideal, peaks) for other in others]
        effect.tolerated += max((its.share for its in found), default=0.0)
        effect.tolerated_mm += max((its.miss_mm for its in found), default=0.0)
    effect.tolerated_mm = max(effect.tolerated_mm, allowance.miss_mm)


def _moved_by_air_mm(session: Session, wanted: Wanted, other: Complexes, lie: Lie) -> float:
    """How far the focus of a host in other air is off: by all elements alike, or as they sound."""
    weightings = {tuple(levels) for levels in (np.abs(other), (other != 0.0) * 1.0)}
    phases, target, bits = np.angle(other), wanted.targets_m[0], session.wire_bits
    found = [
        truth.nearest(session.scene, phases, np.array(levels), target, lie, bits).miss_m
        for levels in weightings
    ]
    return max(float(np.linalg.norm(miss_m)) for miss_m in found) * 1e3


def _of_one(
    session: Session,
    wanted: Wanted,
    drive: tuple[truth.Floats, Complexes],
    ideal: Complexes,
    lie: Lie,
) -> Effect:
    """The effect of a drive: its phases, those of silent elements too, and its weights.

    Its elements are compared with those of the tolerated host that suits them best.
    """
    scene, bits, steps = session.scene, session.wire_bits, _steps(session)
    target, (phases, actual) = wanted.targets_m[0], drive
    levels = np.abs(ideal)
    found = truth.nearest(scene, phases, levels, target, lie, bits)
    one_step_mm = 2.0 * steps * truth.rounding_mm(scene, _heard(scene, ideal), target, bits)
    allowed, at, right = truth.rounding_share(bits, ideal, steps), target, ideal
    if session.allowance is not None:
        within_m = 1e-3 * (session.allowance.miss_mm + one_step_mm)
        share = session.allowance.speed_share(session.temperature_c)
        scene, at = truth.explained(scene, phases, levels, target, within_m, share, bits)
        lags = -scene.wavenumber * scene.distances(at[None])[0] - np.angle(scene.sensitivity)
        right = levels * truth.turned(lags)
        allowed = _OTHER_WEIGHTS * (allowed + _scatter_share(session, scene.wavenumber, bits))
    share = truth.shares(scene, actual, right, at[None])
    effect = Effect(
        float(np.linalg.norm(found.miss_m) * 1e3),
        float(np.linalg.norm(lie.axes @ found.miss_m / lie.units_m)),
        float(abs(share[0] - 1.0)),
        allowed,
        scattered=truth.scattered(scene, actual, right, at),
        place_m=found.place_m,
        coherence=found.coherence,
    )
    if lie.flat.any():  # what is printed may be of fewer directions than those that were searched
        axes = lie.axes[~lie.flat]
        one_step = truth.rounding_mm(
            session.scene, _heard(session.scene, ideal), target, bits, axes
        )
        effect.rounding_mm = 2.0 * steps * one_step
    return effect


def _scatter_share(session: Session, wavenumber: float, bits: int) -> float:
    """What elements that are off as the user states take from a pressure, on top of rounding."""
    allowance, count = session.allowance or Allowance(), session.layout.count
    scatter = wavenumber * allowance.position_mm * 1e-3 * (1.0 + 3.0 / math.sqrt(count))
    half = math.tau * _steps(session) / 2**bits
    return math.cos(half) - math.cos(half + scatter)


def _peaks(session: Session, wanted: Wanted, ideal: Complexes) -> list[tuple[Lie, truth.Floats]]:
    """The place of the peak next to each of several targets that has one of its own."""
    scene, found = session.scene, []
    for target in wanted.targets_m:
        lie = truth.lie_of(scene, _heard(scene, ideal), target, session.wire_bits)
        right = truth.loudest(scene, ideal, target, lie)
        if _radians(lie, right - target) <= _NO_PEAK_RAD:  # else foci that merge: only a pressure
            found.append((lie, right))
    return found


def _of_several(
    session: Session,
    wanted: Wanted,
    actual: Complexes,
    ideal: Complexes,
    peaks: list[tuple[Lie, truth.Floats]],
) -> Effect:
    scene, bits, steps = session.scene, session.wire_bits, _steps(session)
    targets = wanted.targets_m
    change = np.abs(truth.shares(scene, actual, ideal, targets) - 1.0)
    allowed = truth.rounding_share(bits, ideal, steps)
    if session.allowance is None and steps == 0.5:  # it is known which way each phase was rounded
        allowed = allowed + truth.rounding_reach(scene, ideal, targets, bits)
    else:
        allowed = allowed + truth.rounding_worst(scene, ideal, targets, bits, steps)
    worst = int((change - allowed).argmax())
    effect = Effect(0.0, 0.0, float(change[worst]), float(allowed[worst]))
    for lie, right in peaks:
        miss = truth.loudest(scene, actual, right, lie) - right
        effect.miss_mm = max(effect.miss_mm, float(np.linalg.norm(miss) * 1e3))
        effect.miss_rad = max(effect.miss_rad, _radians(lie, miss))
        if _radians(lie, miss) > _RADIANS:
            again = truth.loudest(scene, truth.rounded(ideal, bits), right, lie) - right
            effect.rounding_mm = max(effect.rounding_mm, float(np.linalg.norm(again) * 1e3))
            effect.rounding_rad = max(effect.rounding_rad, _radians(lie, again))
    return effect


def _radians(lie: Lie, way: truth.Floats) -> float:
    return float(np.linalg.norm(lie.axes @ way / lie.units_m))


def _outcome(
    trial: Trial, ran: Ran, seen: Seen, effect: Effect, lie: Lie, *, untouched: bool
) -> str:
    verdict = seen.verdict
    passed, failed = verdict.status is FrameStatus.ON_TARGET, verdict.status in WRONG
    beyond = effect.why_beyond(verdict.smallest_miss_mm)
    if ran.session.group == "honest" or untouched:
        if beyond is not None and (passed or failed):
            trial.findings.append(f"truth: {beyond}, of an honest drive")
        if failed:
            trial.findings.append("; ".join(verdict.faults) or "no fault named")
            return "false fail"
        return "passed" if passed else "not verified"
    if not passed:
        if not failed:
            return "not verified"
        return "below, failed" if beyond is None else "caught"
    if beyond is None:
        beyond = _blind(ran, seen, lie) or _broken(ran, seen)
    if beyond is None:
        return "below, passed"
    trial.findings.append(beyond)
    return "false pass"


def _blind(ran: Ran, seen: Seen, lie: Lie) -> str | None:
    """A miss that this array cannot show, and that passed all the same."""
    if not lie.flat.any():
        return None
    missed_m = 0.0 if seen.wrong is None else seen.wrong.nominal_m or 0.0
    if "host air" in ran.tags:
        kelvin = ran.session.temperature_c + 273.15
        missed_m = abs(math.sqrt(1.0 + ran.tags["host air"] / kelvin) - 1.0) * lie.distance_m
    smallest_mm = seen.verdict.smallest_miss_mm or 0.0
    if missed_m * 1e3 > max(2.0 * smallest_mm, _SEEN_FROM_MM):
        return f"a miss of {missed_m * 1e3:.3g} mm that this array cannot show"
    return None


def _broken(ran: Ran, seen: Seen) -> str | None:
    """Few elements of several foci that are far off, which no tolerated host has."""
    session, wanted = ran.session, seen.wanted
    if session.allowance is None or seen.wrong is None or len(wanted.foci) == 1:
        return None
    if wanted.solver != "naive" or session.layout.count < 32 + 10 * len(wanted.foci):
        return None
    off = np.abs(seen.wrong.off_rad)
    level = np.abs(superposed(session.scene, wanted.foci, cut=False))
    far = (off > _FAR_OFF_RAD) & (level > _LOUD * level.mean()) & (seen.radiated[0][1] > 0)
    if not far.any() or (off > 0.0).mean() > _FEW:
        return None
    return f"{far.sum()} elements off by up to {off[far].max():.3g} rad, below a tolerance"


# --- what is printed -------------------------------------------------------------------------


def _note(trial: Trial, verdict: FrameVerdict, effect: Effect, lie: Lie) -> None:
    trial.numbers = {
        "miss_mm": effect.miss_mm,
        "smallest_mm": verdict.smallest_miss_mm,
        "share": effect.share,
        "allowed": effect.allowed,
        "scattered": effect.scattered,
        "flat": int(lie.flat.sum()),
        "note": verdict.note,
        "named": any(fault != UNNAMED for fault in verdict.faults)
        or (verdict.status is FrameStatus.OFF_TARGET and verdict.error_mm is not None),
    }


def _check_printed(
    trial: Trial, seen: Seen, session: Session, ideal: Complexes, effect: Effect, lie: Lie
) -> None:
    """What a frame that passed says of itself must be so."""
    scene, verdict = session.scene, seen.verdict
    smallest = verdict.smallest_miss_mm
    if lie.flat.any():
        _check_null(trial, verdict, lie)
        return
    if smallest is None or smallest <= 0.0:
        trial.findings.append(f"smallest miss is {smallest}")
        return
    if effect.place_m is None:
        return
    target, bits = seen.wanted.targets_m[0], session.wire_bits
    worst = truth.rounding_mm(scene, _heard(scene, ideal), target, bits)
    worst = 2.0 * _steps(session) * worst + effect.tolerated_mm
    trial.numbers["over_rounding"] = smallest / worst
    whole = verdict.bound_mm is not None and None not in verdict.bound_mm
    if whole and smallest > _SMALLEST_OVER_ROUNDING * worst:
        trial.findings.append(f"smallest miss {smallest:.4g} mm, rounding makes {worst:.4g} mm")
    if verdict.measured_m is None:
        trial.findings.append("on target, and no place is told")
        return
    if whole and effect.coherence > 0.9:
        apart = float(np.linalg.norm(np.array(verdict.measured_m) - effect.place_m) * 1e3)
        trial.numbers["apart_of_smallest"] = apart / smallest
        # Of a taper, a fit may count every element alike, and is as far off as rounding makes it.
        share = _PLACE_SHARE if len(set(np.abs(ideal[ideal != 0.0]).round(3))) == 1 else 1.0
        if apart > share * smallest + _PLACE_MM:
            trial.findings.append(
                f"place is {apart:.4g} mm from the true one, smallest miss {smallest:.4g} mm"
            )


def _check_null(trial: Trial, verdict: FrameVerdict, lie: Lie) -> None:
    """What cannot be observed is null, and never 0."""
    if verdict.smallest_miss_mm == 0.0:
        trial.findings.append("smallest miss 0 of what cannot be observed")
    along = np.abs(lie.axes[lie.flat] @ lie.outward)
    if along.max() > 0.99 and verdict.axial_error_mm is not None:
        trial.findings.append(f"axial error {verdict.axial_error_mm:.3g} mm, not observable")
    if lie.flat.all() and verdict.lateral_error_mm is not None:
        trial.findings.append(f"lateral error {verdict.lateral_error_mm:.3g} mm, not observable")


def _are_apart(wanted: Wanted, session: Session, ideal: Complexes) -> bool:
    """Whether no two foci share a lobe: then nothing tells where each of them is."""
    places = wanted.targets_m
    for n, place in enumerate(places):
        lie = truth.lie_of(session.scene, _heard(session.scene, ideal), place, session.wire_bits)
        if any(_radians(lie, other - place) < _ONE_LOBE_RAD for other in places[:n]):
            return False
    return True


def _check_silence(trial: Trial, session: Session, seen: Seen, ideal: Complexes, lie: Lie) -> None:
    """Where an array can show everything, and well, nothing may stay unverified."""
    trial.numbers["observable"] = not lie.flat.any() and _are_apart(seen.wanted, session, ideal)
    if trial.outcome != "not verified" or len(seen.wanted.foci) > 1 or lie.flat.any():
        return
    fresnel, half = fresnel_number(
        session.layout,
        _heard(session.scene, ideal),
        seen.wanted.targets_m[0],
        session.scene.wavenumber,
    )
    sides = session.layout.grid or (float(np.count_nonzero(ideal)) ** 0.5,) * 2
    if min(sides) >= _ELEMENTS and half >= 0.9 * _ELEMENTS / 2 and fresnel >= _FRESNEL:
        trial.findings.append(f"silent at a Fresnel number of {fresnel:.3g}: {seen.verdict.note}")
