"""A run: intended and latched joined by their keys, every frame accounted for."""

from __future__ import annotations

import dataclasses
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from haptogram.acoustics import AcousticModel
from haptogram.errors import ConfigurationError, VerificationError
from haptogram.records import FrameKey, Intended, Observation

from .effect import Effect
from .held import Held, consequence, dues, still_held
from .judge import Judge, lost
from .summary import summary
from .tolerance import PlaceUncertainty, Tolerance, Uncertainty
from .verdict import JUDGED, NOTHING_WRONG, Cut, FrameStatus, FrameVerdict, Verdict

_PERCENTILES: Final = {"p50": 50.0, "p99": 99.0, "p99.9": 99.9, "max": 100.0}

Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True)
class RunVerdict:
    """What is known of a run; it is true if the run passed, and only then.

    Attributes
    ----------
    verdict : Verdict
        pass, fail or inconclusive.
    reasons : tuple of str
        Why it is not a pass; empty if it is.
    frames : list of FrameVerdict
        One for every intended frame, in order.
    unexpected : list of FrameKey
        What was latched although nobody intended it.
    min_verified : float
        Share of frames that had to be verified.
    counts : dict of str to int
        How many frames were sent, latched, verified, lost and so on.  ``cancelled`` are those that
        were sent, but not due any more when the host ended the run; ``not_sent`` come on top.
    effect : Effect or None
        What lost, late and wrong frames did in space; None: there were none that have a time.
    tolerance : Tolerance
        Which misses passed on top of what rounding makes.
    uncertainty : Uncertainty
        How well array and air were known.
    """

    verdict: Verdict
    reasons: tuple[str, ...]
    frames: list[FrameVerdict]
    unexpected: list[FrameKey]
    min_verified: float
    counts: dict[str, int] = field(default_factory=dict)
    effect: Effect | None = None
    tolerance: Tolerance = field(default_factory=Tolerance)
    uncertainty: Uncertainty = field(default_factory=Uncertainty)

    @property
    def passed(self) -> bool:
        """Whether the run passed."""
        return self.verdict is Verdict.PASS

    def __bool__(self) -> bool:
        """Return :attr:`passed`: ``assert board.verify(...)`` fails unless the run passed."""
        return self.passed

    def raise_for_verdict(self) -> None:
        """Raise unless the run passed.

        Raises
        ------
        VerificationError
            With the summary: what failed, or why it could not be told.
        """
        if not self.passed:
            raise VerificationError(str(self))

    @property
    def exit_status(self) -> int:
        """0 pass, 1 fail, 3 inconclusive."""
        return self.verdict.exit_status

    @property
    def due(self) -> int:
        """Frames that were sent and not cancelled: those that count."""
        return self.counts["sent"] - self.counts["cancelled"]

    @property
    def too_few(self) -> bool:
        """Whether fewer frames were verified than had to be, or none."""
        verified = self.counts["verified"]
        return not verified or verified < self.min_verified * self.due

    def values(self, name: str) -> np.ndarray:
        """Return one measure of all frames that have it, e.g. ``"axial_error_mm"``."""
        found = (getattr(frame, name) for frame in self.frames)
        return np.array([value for value in found if value is not None], dtype=np.float64)

    @property
    def smallest_miss_mm(self) -> float | None:
        """The smallest miss that shows in every judged frame; None: one in some never would."""
        misses = [f.smallest_miss_mm for f in self.frames if f.criteria and not f.is_silence]
        known = [miss for miss in misses if miss is not None]
        return max(known) if known and len(known) == len(misses) else None

    @property
    def place_uncertainty(self) -> PlaceUncertainty | None:
        """How well the place of the least known focus is known; None: no frame tells."""
        found = [f.uncertainty_mm for f in self.frames if f.uncertainty_mm is not None]
        return max(found, key=lambda one: one.total, default=None)

    def _uncertainty_dict(self) -> dict[str, float] | None:
        found = self.place_uncertainty
        return None if found is None else {**found._asdict(), "total": found.total}

    def as_dict(self) -> dict[str, Any]:
        """Return the result for JSON: no host, date or duration, so that it repeats."""
        coherence, pressure = self.values("coherence"), self.values("pressure_rms_pa")
        force_mn = 1e3 * self.values("force_n")
        evidence = sorted({str(f.evidence) for f in self.frames if f.evidence is not None})
        return {
            "verdict": str(self.verdict),
            "reasons": list(self.reasons),
            "evidence": evidence[0] if len(evidence) == 1 else evidence,
            "min_verified": self.min_verified,
            "frames": self.counts,
            "lateral_error_mm": _percentiles(self.values("lateral_error_mm"), "p50 p99 max"),
            "axial_error_mm": _percentiles(np.abs(self.values("axial_error_mm")), "p50 p99 max"),
            "smallest_miss_mm": self.smallest_miss_mm,
            "tolerance": dataclasses.asdict(self.tolerance),
            "known_to": dataclasses.asdict(self.uncertainty),
            "uncertainty_mm": self._uncertainty_dict(),
            "effect": None if self.effect is None else self.effect.as_dict(),
            "coherence": {"min": _least(coherence)},
            "balance": {"min": _least(self.values("balance"))},
            "efficiency": {"min": _least(self.values("efficiency"))},
            "pressure_rms_pa": _spread(pressure),
            "force_mn": _spread(force_mn),
            "lateness_us": _percentiles(self.values("lateness_us"), "p50 p99 p99.9 max"),
            "not_on_target": [_frame_dict(f) for f in self.frames if f.status not in NOTHING_WRONG],
            "cancelled": [f.number for f in self.frames if f.status is FrameStatus.CANCELLED],
            "late": [_frame_dict(f) for f in self.frames if f.late],
            "duplicated": [_frame_dict(f) for f in self.frames if f.latches > 1],
            "unexpected": [dataclasses.asdict(key) for key in self.unexpected],
        }

    def __str__(self) -> str:
        """Return a summary that fits a screen."""
        return "\n".join(summary(self))


def verify_run(
    intended: Sequence[Intended],
    observations: Iterable[Observation],
    *,
    model: AcousticModel,
    min_verified: float = 1.0,
    cut: Cut | None = None,
    unseen: str | None = None,
    silences: Iterable[int] = (),
    tolerance: Tolerance | None = None,
    uncertainty: Uncertainty | None = None,
    progress: Progress | None = None,
) -> RunVerdict:
    """Join what was intended with what was latched, by key, and judge every frame.

    Parameters
    ----------
    model : AcousticModel
        Array and air that the drives were radiated in.
    min_verified : float
        Share of the intended frames that must be verified, 0 to 1.
    cut : Cut, optional
        How the run ended before its end: then it can fail, but not pass.
    unseen : str, optional
        Why a frame may have been latched that nobody saw: then one that was not seen is not
        verified, rather than lost.
    silences : iterable of int
        Device times at which the output fell silent, on the clock of *intended*: what was latched
        before is no longer radiated then.
    tolerance : Tolerance, optional
        Which misses pass on top of what rounding of the phases makes; by default none.
    uncertainty : Uncertainty, optional
        How well *model* is known, which the result tells in mm; by default exactly.
    progress : callable, optional
        Called with the number of frames judged and their total.

    Raises
    ------
    ConfigurationError
        If *min_verified* is not 0 to 1, or two intended frames have one key; if a focus is behind
        the array or at one of its elements.
    """
    if not 0.0 <= min_verified <= 1.0:
        raise ConfigurationError(f"min_verified is {min_verified:g}, must be 0 to 1")
    _check_keys(intended)
    seen: dict[FrameKey, list[Observation]] = defaultdict(list)
    for observation in observations:
        seen[observation.key].append(observation)
    for latches in seen.values():
        latches.sort(key=lambda latch: latch.t_latch_us)
    judge = Judge(
        model,
        carrier_us=max(1, round(1e6 / model.frequency_hz)),
        tolerance=tolerance,
        uncertainty=uncertainty,
    )
    frames: list[FrameVerdict] = []
    held: Held | None = None
    quiet_us = sorted(silences)
    for number, (wanted, due) in enumerate(zip(intended, dues(intended, seen), strict=True)):
        latches = seen.pop(wanted.key, [])
        verdict = judge.judge(wanted, latches[0]) if latches else _missing(wanted, unseen, cut)
        if verdict.late or verdict.status is FrameStatus.LOST:
            effect = consequence(model, wanted, still_held(held, due, quiet_us))
            verdict = dataclasses.replace(verdict, consequence=effect)
        frames.append(dataclasses.replace(verdict, latches=len(latches)))
        if latches:
            held = Held.after(wanted, latches[0], verdict)
        elif unseen is not None:
            held = Held(None, verdict.target_m, due.latest_us)  # who knows whether it was latched?
        if progress is not None:
            progress(number + 1, len(intended))
    run = _conclude(frames, sorted(seen), min_verified, cut, quiet_us)
    return dataclasses.replace(run, tolerance=judge.tolerance, uncertainty=judge.uncertainty)


def _missing(wanted: Intended, unseen: str | None, cut: Cut | None) -> FrameVerdict:
    """Return the verdict of a frame that nobody saw latched."""
    verdict = lost(wanted)
    if cut is not None and cut.cancelled(wanted.t_apply_us):
        return dataclasses.replace(verdict, status=FrameStatus.CANCELLED)
    if unseen is None:
        return verdict
    return dataclasses.replace(verdict, status=FrameStatus.NOT_VERIFIED, note=unseen)


def _check_keys(intended: Sequence[Intended]) -> None:
    key, times = next(iter(Counter(frame.key for frame in intended).most_common(1)), (None, 0))
    if times > 1:
        raise ConfigurationError(f"{key} is intended {times} times; a key names one frame")


def _conclude(
    frames: list[FrameVerdict],
    unexpected: list[FrameKey],
    min_verified: float,
    cut: Cut | None,
    quiet_us: Sequence[int],
) -> RunVerdict:
    counts = _counts(frames, unexpected) | {"not_sent": 0 if cut is None else cut.not_sent}
    effect = Effect.of(frames, quiet_us)
    run = RunVerdict(Verdict.PASS, (), frames, unexpected, min_verified, counts, effect)
    wrong = [f"{counts[name]} {text}" for name, text in _FAILURES.items() if counts[name]]
    missing = [] if cut is None else [cut.reason]
    if run.too_few:
        needed = f"{100.0 * min_verified:g} %"
        missing.append(f"{counts['verified']} of {run.due} frames were verified; {needed} must be")
    verdict = Verdict.FAIL if wrong else Verdict.INCONCLUSIVE if missing else Verdict.PASS
    return dataclasses.replace(run, verdict=verdict, reasons=(*wrong, *missing))


_FAILURES: Final = {
    "off_target": "off target",
    "wrong_drive": "with a wrong drive",
    "corrupt": "damaged, but latched",
    "early": "latched before their time",
    "duplicated": "latched more than once",
    "unexpected": "latched that nobody intended",
}


def _counts(frames: list[FrameVerdict], unexpected: list[FrameKey]) -> dict[str, int]:
    by_status = Counter(frame.status for frame in frames)
    return {
        "sent": len(frames),
        "latched": sum(frame.latches > 0 for frame in frames),
        "verified": sum(frame.status in JUDGED for frame in frames),
        "on_target": by_status[FrameStatus.ON_TARGET],
        "off_target": by_status[FrameStatus.OFF_TARGET],
        "wrong_drive": by_status[FrameStatus.WRONG_DRIVE],
        "corrupt": by_status[FrameStatus.CORRUPT],
        "not_verified": by_status[FrameStatus.NOT_VERIFIED],
        "lost": by_status[FrameStatus.LOST],
        "cancelled": by_status[FrameStatus.CANCELLED],
        "late": sum(frame.late for frame in frames),
        "early": sum(frame.early for frame in frames),
        "duplicated": sum(frame.latches > 1 for frame in frames),
        "unexpected": len(unexpected),
    }


# --- Numbers and words -------------------------------------------------------------------------


def _percentiles(values: np.ndarray, names: str) -> dict[str, float | None]:
    if not len(values):
        return dict.fromkeys(names.split())
    return {name: float(np.percentile(values, _PERCENTILES[name])) for name in names.split()}


def _spread(values: np.ndarray) -> dict[str, float | None]:
    if not len(values):
        return dict.fromkeys(("mean", "std", "min", "max"))
    return {
        "mean": float(values.mean()),
        "std": float(values.std()),
        "min": float(values.min()),
        "max": float(values.max()),
    }


def _least(values: np.ndarray) -> float | None:
    return float(values.min()) if len(values) else None


def _frame_dict(frame: FrameVerdict) -> dict[str, Any]:
    """Return what is known of one frame, without what is not."""
    fields = dataclasses.asdict(frame) | {"status": str(frame.status)}
    fields["evidence"] = None if frame.evidence is None else str(frame.evidence)
    fields["lateness_us"] = frame.lateness_us
    if frame.uncertainty_mm is not None:
        fields["uncertainty_mm"] = frame.uncertainty_mm.total
    return {name: value for name, value in fields.items() if value not in (None, (), {}, "")}
