"""The verdict on a run: what it came to, its measures, and the lines that say so."""

from __future__ import annotations

import dataclasses
import functools
import operator
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np

from haptogram.errors import VerificationError
from haptogram.records.frame import FrameKey
from haptogram.settings.frozen import dataclass, field

from .consequences.effect import RunConsequences
from .frame.verdict import (
    NOTHING_WRONG,
    FrameStatus,
    FrameVerdict,
    Judged,
    Verdict,
    frame_verdict_measures,
    frame_verdict_text,
    is_share_reached,
)
from .tolerance import Tolerance, Uncertainty, VerdictUncertainty, tolerance_text

_PERCENTILES: Final = {"p50": 50.0, "p99": 99.0, "p99.9": 99.9, "max": 100.0}
_SPREAD: Final = ("mean", "std", "min", "max")
_NAMED_FRAMES: Final = 8  # most frames that a line names; the JSON names all


@dataclass(frozen=True)
class RunVerdict(Judged):
    """The verdict on a run; it is true if the run passed, and only then.

    Attributes
    ----------
    verdict : Verdict
        pass, fail or inconclusive.
    reasons : tuple of str
        Why it is not a pass; empty if it is.
    frames : list of FrameVerdict
        One for every intended frame, in order.
    unexpected : list of FrameKey
        Latches that the host did not intend.
    min_verified : float
        Share of frames that had to be verified.
    counts : dict of str to int
        How many frames were sent, latched, verified, lost and so on.  ``cancelled`` are those that
        were sent, but not due any more when the host ended the run; ``not_sent`` come on
        top, and ``not_kept``, which the driver had dropped from its record.
    effect : RunConsequences or None
        Effect of lost, late and wrong frames in space; None: there were none that have a time.
    tolerance : Tolerance
        Which misses passed on top of what rounding makes.
    uncertainty : Uncertainty
        How well array and air were known.
    ways : dict of str to int
        How many frames were judged by compiled code, and of the others how many for each reason.

    Examples
    --------
    >>> from haptogram_protocol.messages import TraceMode
    >>> with Driver(url, seed=1, trace=TraceMode.DRIVE) as driver:
    ...     state = driver.arm()
    ...     report = driver.stream([(0.0, 0.0, 0.15), (0.01, 0.0, 0.15)], rate_hz=500)
    ...     verdict = verify_run(driver.intended, driver.observations, model=driver.model)
    >>> verdict.passed, verdict.counts["on_target"]
    (True, 2)
    """

    verdict: Verdict
    reasons: tuple[str, ...]
    frames: list[FrameVerdict]
    unexpected: list[FrameKey]
    min_verified: float
    counts: dict[str, int] = field(default_factory=dict)
    effect: RunConsequences | None = None
    tolerance: Tolerance = field(default_factory=Tolerance)
    uncertainty: Uncertainty = field(default_factory=Uncertainty)
    ways: dict[str, int] = field(default_factory=dict)

    @property
    def sentence(self) -> str:
        """The verdict and its reason, for every report alike."""
        every = "every focus" if self.counts["verified"] == self.due else "every verified focus"
        return f"{self.verdict.upper()}: {'; '.join(self.reasons) or f'{every} is on target'}"

    @property
    def odd_frames(self) -> list[FrameVerdict]:
        """Frames that are not on target, or not in time."""
        return [
            f
            for f in self.frames
            if f.status not in NOTHING_WRONG or f.late or f.early or f.latches > 1
        ]

    def findings(self) -> Iterator[tuple[str, list[FrameVerdict]]]:
        """Yield a line for each odd frame; of many, one for all with the same thing wrong."""
        yield from grouped_frame_findings(self.odd_frames)

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
    def due(self) -> int:
        """Frames that were sent and not cancelled: those that count."""
        return self.counts["sent"] - self.counts["cancelled"]

    @property
    def too_few(self) -> bool:
        """True if fewer frames were verified than had to be, or none; lost ones are no evidence."""
        verified, lost = self.counts["verified"], self.counts["lost"]
        is_enough = is_share_reached(verified, self.min_verified, self.due - lost)
        return not (verified or lost) or not is_enough

    def values(self, name: str) -> np.ndarray:
        """Return one measure of all frames that have it, e.g. ``"axial_error_mm"``."""
        found = map(operator.attrgetter(name), self.frames)
        return np.array([value for value in found if value is not None], dtype=np.float64)

    @property
    def smallest_miss_mm(self) -> float | None:
        """The smallest miss that shows in every judged frame; None: one in some never would."""
        misses = [f.smallest_miss_mm for f in self.frames if f.criteria and not f.is_silence]
        known = [miss for miss in misses if miss is not None]
        return max(known) if known and len(known) == len(misses) else None

    @functools.cached_property
    def place_uncertainty(self) -> VerdictUncertainty | None:
        """Uncertainty of the place of the least known focus; None: no frame tells."""
        found = [f.uncertainty_mm for f in self.frames if f.uncertainty_mm is not None]
        return max(found, key=lambda one: one.total, default=None)

    def _uncertainty_dict(self) -> dict[str, float] | None:
        """Return the parts of the position uncertainty and their total in mm; None if not known."""
        found = self.place_uncertainty
        return None if found is None else {**found._asdict(), "total": found.total}

    def as_dict(self) -> dict[str, Any]:
        """Return the result for JSON: no host, date or duration, so that it repeats."""
        return dict(self._result)

    @functools.cached_property
    def _result(self) -> dict[str, Any]:
        """Return verdict, reasons, counts and statistics for JSON."""
        coherence, pressure = self.values("coherence"), self.values("pressure_rms_pa")
        force_mn = 1e3 * self.values("force_n")
        evidence = sorted({str(f.evidence) for f in self.frames if f.evidence is not None})
        return {
            "verdict": str(self.verdict),
            "reasons": list(self.reasons),
            "evidence": evidence[0] if len(evidence) == 1 else evidence,
            "min_verified": self.min_verified,
            "frames": self.counts,
            "lateral_error_mm": _run_verdict_percentiles(
                self.values("lateral_error_mm"), "p50 p99 max"
            ),
            "axial_error_mm": _run_verdict_percentiles(
                np.abs(self.values("axial_error_mm")), "p50 p99 max"
            ),
            "smallest_miss_mm": self.smallest_miss_mm,
            "tolerance": dataclasses.asdict(self.tolerance),
            "known_to": dataclasses.asdict(self.uncertainty),
            "uncertainty_mm": self._uncertainty_dict(),
            "effect": None if self.effect is None else self.effect.as_dict(),
            "coherence": {"min": _min_or_none(coherence)},
            "balance": {"min": _min_or_none(self.values("balance"))},
            "efficiency": {"min": _min_or_none(self.values("efficiency"))},
            "pressure_rms_pa": _run_verdict_spread(pressure),
            "force_mn": _run_verdict_spread(force_mn),
            "lateness_us": _run_verdict_percentiles(
                self.values("lateness_us"), "p50 p99 p99.9 max"
            ),
            "not_on_target": [
                _frame_in_run_verdict(f) for f in self.frames if f.status not in NOTHING_WRONG
            ],
            "cancelled": [f.number for f in self.frames if f.status is FrameStatus.CANCELLED],
            "late": [_frame_in_run_verdict(f) for f in self.frames if f.late],
            "duplicated": [_frame_in_run_verdict(f) for f in self.frames if f.latches > 1],
            "unexpected": [dataclasses.asdict(key) for key in self.unexpected],
        }

    def __str__(self) -> str:
        """Return a summary that fits a screen."""
        return "\n".join(_run_verdict_summary(self))


def _run_verdict_summary(run: RunVerdict) -> Iterator[str]:
    """Yield the lines of a run's summary for the terminal: verdict, counts, errors, faults."""
    result, counts = run.as_dict(), run.counts
    yield run.sentence
    yield (
        f"  frames    {counts['sent']} sent, {counts['latched']} latched, "
        f"{counts['verified']} verified, {counts['lost']} lost, {counts['held_up']} held up, "
        f"{counts['late']} late"
        f"{cut_run_verdict_text(counts)}"
    )
    if result["lateral_error_mm"]["max"] is not None:
        yield _run_verdict_error_line(result)
    yield from _run_verdict_uncertainty_lines(run)
    if result["balance"]["min"] is not None:
        yield _run_verdict_foci_line(result)
    if run.effect is not None:
        yield f"  effect    {run.effect}"
    if result["pressure_rms_pa"]["mean"] is not None and result["force_mn"]["mean"] is not None:
        yield _run_verdict_field_line(result)
    yield f"  evidence  {result['evidence'] or 'none: no latch was seen'}"
    groups = list(run.findings())
    yield from (f"  {line}" for line, _ in groups[:_NAMED_FRAMES])
    if left := sum(len(frames) for _, frames in groups[_NAMED_FRAMES:]):
        yield f"  ... and {left} frames more, in the JSON file"


def grouped_frame_findings(
    odd: Sequence[FrameVerdict],
) -> Iterator[tuple[str, list[FrameVerdict]]]:
    """Yield a line for each odd frame; of many, one for all with the same thing wrong."""
    if len(odd) <= _NAMED_FRAMES:
        yield from ((frame_verdict_text(frame), [frame]) for frame in odd)
        return
    groups: dict[tuple[str, ...], list[FrameVerdict]] = defaultdict(list)
    for frame in odd:
        groups[_wrong_in_run_verdict(frame)].append(frame)
    for what, frames in sorted(groups.items(), key=lambda group: -len(group[1])):
        is_group = len(frames) > 1
        line = _run_verdict_group_line(what, frames) if is_group else frame_verdict_text(frames[0])
        yield line, frames


def cut_run_verdict_text(counts: Mapping[str, int]) -> str:
    """Return the fate of the frames that a run did not reach; an empty text if there are none."""
    parts = {"cancelled": "cancelled by its MUTE", "not_sent": "not sent"}
    said = (f", {counts[name]} {text}" for name, text in parts.items() if counts[name])
    return "".join(said)


def _run_verdict_error_line(result: dict[str, Any]) -> str:
    """Return the line of position errors, and of the smallest miss that would be noticed."""
    lateral, axial = result["lateral_error_mm"], result["axial_error_mm"]
    along = "along the beam: not observable"
    if axial["max"] is not None:
        along = f"{axial['p50']:.3f} / {axial['max']:.3f} mm along the beam"
    smallest_mm = result["smallest_miss_mm"]
    shows = (
        "a miss that cannot be observed does not show"
        if smallest_mm is None
        else f"every miss from {smallest_mm:.2f} mm on shows"
    )
    return (
        f"  focus     off by {lateral['p50']:.3f} / {lateral['max']:.3f} mm across, "
        f"{along} (median / largest); {shows}"
    )


def _run_verdict_uncertainty_lines(run: RunVerdict) -> Iterator[str]:
    """Yield the tolerance, if any, and the uncertainty of the focus position, if known."""
    if not run.tolerance.is_strict:
        yield f"  tolerance {tolerance_text(run.tolerance)}, on top of what rounding makes"
    place = run.place_uncertainty
    if place is None or not place.total:
        return
    known = run.uncertainty
    yield (
        f"  known to  {place.total:.2f} mm, the place of a focus: {place.air:.2f} mm from the air "
        f"(±{known.temperature_c:g} °C, ±{known.humidity_percent:g} %), {place.positions:.2f} mm "
        f"from the positions (±{known.position_mm:g} mm) and {place.phases:.2f} mm from the phases "
        f"(±{known.phase_rad:g} rad) of the elements"
    )


def _run_verdict_field_line(result: dict[str, Any]) -> str:
    """Return the line of mean pressure, force and least coherence."""
    pressure, force = result["pressure_rms_pa"], result["force_mn"]
    return (
        f"  field     {pressure['mean']:.0f} Pa RMS on average, force {force['mean']:.2f} ± "
        f"{force['std']:.2f} mN, coherence {result['coherence']['min']:.5f} or more"
    )


def _run_verdict_foci_line(result: dict[str, Any]) -> str:
    """Return the line of balance, efficiency and pressure of several foci."""
    return (
        f"  foci      several in a frame: the weakest has {result['balance']['min']:.2f} of their "
        f"mean or more, efficiency {result['efficiency']['min']:.2f} or more (1: they share the "
        f"output without loss), {result['pressure_rms_pa']['mean']:.0f} Pa RMS at the first on "
        "average"
    )


def _wrong_in_run_verdict(frame: FrameVerdict) -> tuple[str, ...]:
    """Return status, timing errors and faults of a frame: frames with equal ones share a line."""
    times = {"late": frame.late, "early": frame.early, "latched more than once": frame.latches > 1}
    note = frame.note if frame.status is FrameStatus.NOT_VERIFIED else ""
    words = [str(frame.status), *(word for word, is_so in times.items() if is_so)]
    return tuple(filter(None, [*words, *frame.faults, note]))


def _run_verdict_group_line(what: tuple[str, ...], frames: list[FrameVerdict]) -> str:
    """Return the line on a fault that *frames* share, with its worst consequence."""
    numbers = ", ".join(str(frame.number) for frame in frames[:_NAMED_FRAMES])
    more = ", ..." if len(frames) > _NAMED_FRAMES else ""
    worst = "; ".join(frame_verdict_measures(worst_frame_of(frames)))
    at_worst = [f"at the worst {worst}"] if worst else []
    return f"{len(frames)} frames ({numbers}{more}): {'; '.join([*what, *at_worst])}"


def worst_frame_of(frames: Sequence[FrameVerdict]) -> FrameVerdict:
    """Return the frame with the farthest focus, then with the least pressure at its target."""

    def damage(frame: FrameVerdict) -> tuple[float, float]:
        effect = frame.consequence
        away_mm = (effect.focus_error_mm if effect else None) or frame.error_mm or 0.0
        return away_mm, -(frame.target_pressure_rms_pa or 0.0)

    return max(frames, key=damage)


# --- Numbers and words -------------------------------------------------------------------------


def _run_verdict_percentiles(values: np.ndarray, names: str) -> dict[str, float | None]:
    """Return percentiles by their *names*, such as "p50 max"; None for each without values."""
    if not len(values):
        return dict.fromkeys(names.split())
    ordered = np.sort(values)
    return {name: _percentile(ordered, _PERCENTILES[name]) for name in names.split()}


def _percentile(ordered: np.ndarray, percent: float) -> float:
    """Return a percentile of ascending values as numpy.percentile, without import of numpy.ma."""
    place = (len(ordered) - 1) * (percent / 100.0)
    low, high = ordered[int(place)], ordered[min(int(place) + 1, len(ordered) - 1)]
    share = place - int(place)
    return float(low + (high - low) * share if share < 0.5 else high - (high - low) * (1.0 - share))


def _run_verdict_spread(values: np.ndarray) -> dict[str, float | None]:
    """Return mean, deviation and extremes of *values*; None for each without values."""
    if not len(values):
        return dict.fromkeys(_SPREAD)
    return {name: float(getattr(values, name)()) for name in _SPREAD}


def _min_or_none(values: np.ndarray) -> float | None:
    """Return the least value; None if there are none."""
    return float(values.min()) if len(values) else None


def _frame_in_run_verdict(frame: FrameVerdict) -> dict[str, Any]:
    """Return the fields of one frame for JSON, without those that are None or empty."""
    fields = dataclasses.asdict(frame) | {"status": str(frame.status)}
    fields["evidence"] = None if frame.evidence is None else str(frame.evidence)
    fields["lateness_us"] = frame.lateness_us
    if frame.uncertainty_mm is not None:
        fields["uncertainty_mm"] = frame.uncertainty_mm.total
    return {name: value for name, value in fields.items() if value not in (None, (), {}, "")}
