"""Results of watching: one latch, and a whole run."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from haptogram.acoustics.reconstruct.patterns.found import (
    Off,
    Pattern,
    Uniform,
    Unnamed,
    pattern_dict,
)

from ..frame.verdict import WRONG, FrameStatus, FrameVerdict, Verdict
from .defect import Defect, Diagnosis
from .latch import SeenLatch

_TELL_NOTHING: Final = (Off.kind, Uniform.kind, Unnamed.kind)


@dataclass(frozen=True, slots=True)
class WatchedLatch:
    """One latch with what it radiates.

    Attributes
    ----------
    latch : SeenLatch
        The latch.
    pattern : Pattern
        Its pattern.
    verdict : FrameVerdict or None
        If a frame was expected.
    defects : tuple of Defect
        The defects that its drive shows by itself.
    took_ms : float
        Time that the search for the pattern took; 0 if the drive was seen lately.
    """

    latch: SeenLatch
    pattern: Pattern
    verdict: FrameVerdict | None
    defects: tuple[Defect, ...]
    took_ms: float = 0.0

    @property
    def torn_text(self) -> str:
        """Counts of a frame that is not whole, in words; empty if they have another name."""
        return "" if Defect.AMPLITUDES_AS_PHASES in self.defects else self.latch.torn_text

    def as_dict(self) -> dict[str, object]:
        """Return plain values for JSON; times of the search are left out."""
        verdict = self.verdict
        return {
            "number": self.latch.number,
            "t_us": self.latch.t_us,
            "cause": self.latch.cause,
            "pattern": pattern_dict(self.pattern),
            "torn": dict(self.latch.torn),
            "defects": [str(defect) for defect in self.defects],
            "verdict": None if verdict is None else str(verdict.status),
            "criteria": None if verdict is None else verdict.criteria,
        }


@dataclass(frozen=True, slots=True)
class WatchResult:
    """All latches of a run in numbers.

    Attributes
    ----------
    latches : int
        Latches, that of the power-up included.
    kinds : mapping of str to int
        Latches of the client by the kind of their pattern.
    statuses : mapping of FrameStatus to int
        Verdicts, where frames were expected.
    diagnoses : tuple of Diagnosis
        Named defects.
    torn : tuple of (int, str)
        Latches that may be torn, and what was counted of each.
    hints : tuple of str
        Possible explanations of the places of foci that are not proven.
    missing : str or None
        Why latches may be missing, or frames are not judged; None: all are there, and judged.
    remarks : tuple of str
        Remarks of the board about its clients.
    search_ms : tuple of float
        Median and largest time of a search, in ms.
    expected : bool
        Whether frames were expected.
    fail_on_unknown : bool
        Whether a latch that makes no pattern fails.
    """

    latches: int
    kinds: Mapping[str, int]
    statuses: Mapping[FrameStatus, int] = field(default_factory=Counter)
    diagnoses: tuple[Diagnosis, ...] = ()
    torn: tuple[tuple[int, str], ...] = ()
    hints: tuple[str, ...] = ()
    missing: str | None = None
    remarks: tuple[str, ...] = ()
    search_ms: tuple[float, float] = (0.0, 0.0)
    expected: bool = False
    fail_on_unknown: bool = False

    @property
    def unknown(self) -> int:
        """Latches of the client that make no pattern."""
        return self.kinds.get(Unnamed.kind, 0)

    @property
    def verdict(self) -> Verdict:
        """Fail for a wrong focus or a named defect; inconclusive if something was not verified."""
        if self.fail_on_unknown and self.unknown:
            return Verdict.FAIL
        if self.diagnoses or any(self.statuses.get(status, 0) for status in WRONG):
            return Verdict.FAIL
        if not sum(self.kinds.values()) or self.missing is not None:
            return Verdict.INCONCLUSIVE
        verified = self.statuses.get(FrameStatus.ON_TARGET, 0)
        if self.expected and (not verified or verified < sum(self.statuses.values())):
            return Verdict.INCONCLUSIVE
        is_known = any(count for kind, count in self.kinds.items() if kind not in _TELL_NOTHING)
        return Verdict.PASS if is_known or not self.unknown else Verdict.INCONCLUSIVE

    def as_dict(self) -> dict[str, object]:
        """Return plain values for JSON."""
        return {
            "verdict": str(self.verdict),
            "latches": self.latches,
            "kinds": dict(self.kinds),
            "expected": self.expected,
            "statuses": {str(status): count for status, count in self.statuses.items()},
            "diagnoses": [
                {"defect": str(d.defect), "detail": d.detail, "latches": list(d.latches)}
                for d in self.diagnoses
            ],
            "torn": [{"latch": number, "counted": text} for number, text in self.torn],
            "hints": list(self.hints),
            "missing": self.missing,
            "remarks": list(self.remarks),
        }

    def __str__(self) -> str:
        """Return the summary, and how long the searches took."""
        lines, (median, most) = self.lines(), self.search_ms
        if most:
            lines.append(f"  search    {median:.1f} ms a new drive, {most:.0f} ms at most")
        return "\n".join(lines)

    @property
    def sentence(self) -> str:
        """The verdict and its reason, for every report alike."""
        count = sum(self.kinds.values())
        wrong = [f"{n} {status}" for status, n in self.statuses.items() if n and status in WRONG]
        reasons = [*wrong, *dict.fromkeys(str(found.defect) for found in self.diagnoses)]
        if self.unknown and not self.expected:
            reasons.append(f"{self.unknown} {Unnamed.kind}")
        latches = f"{count} latch{'' if count == 1 else 'es'} of the client"
        return f"{self.verdict.upper()}: {'; '.join([latches, *reasons])}"

    def lines(self) -> list[str]:
        """Return the summary in lines, the verdict first."""
        kinds = ", ".join(f"{count} {kind}" for kind, count in self.kinds.items())
        lines = [self.sentence]
        lines += [f"  patterns  {kinds}"] if kinds else []
        if self.expected:
            judged = ", ".join(f"{count} {status}" for status, count in self.statuses.items())
            lines.append(f"  expected  {judged or 'none was latched'}")
        lines += [f"  defect    {diagnosis}" for diagnosis in self.diagnoses]
        lines += [f"  torn      latch {number}: {text}" for number, text in self.torn[:8]]
        if len(self.torn) > 8:
            lines.append(f"  torn      {len(self.torn) - 8} more")
        lines += [f"  hint      {text}" for text in self.hints]
        remarks = dict.fromkeys(text for text in self.remarks if text != self.missing)
        lines += [f"  remark    {text}" for text in [*remarks][:8]]
        lines += [f"  missing   {self.missing}"] if self.missing else []
        return lines
