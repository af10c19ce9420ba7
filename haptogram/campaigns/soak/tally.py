"""The account: what was injected, what was found of it, and what does not add up."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, Self

if TYPE_CHECKING:
    from .excerpts import SoakExcerpt

MOST_KEPT: Final = 20  # violations that are kept word for word; all are counted

HARMLESS: Final = "harmless"
UNEXPLAINED: Final = "unexplained"


@dataclass(slots=True)
class SoakHit:
    """One fault: what it was, what was found of it, and whether its frame came through."""

    kind: str
    detected: bool = False
    delivered: bool = False


@dataclass(slots=True)
class SoakTally:
    """Counts of the events of one segment, or of many: tallies add up.

    Attributes
    ----------
    injected : Counter
        Faults by kind.
    detected : Counter
        Faults by kind of which something was found.
    harmless : Counter
        Faults by kind of which nothing was, and whose frame came through.
    outcomes : Counter
        What was found, by (kind, name).
    totals : Counter
        Everything else that is counted, by name.
    violations : Counter
        What must not happen, by name.
    examples : list of str
        The first of them, in words.
    excerpts : list of SoakExcerpt
        Of one segment: what happened around them, if that is recorded.
    """

    injected: Counter[str] = field(default_factory=Counter)
    detected: Counter[str] = field(default_factory=Counter)
    harmless: Counter[str] = field(default_factory=Counter)
    outcomes: Counter[tuple[str, str]] = field(default_factory=Counter)
    totals: Counter[str] = field(default_factory=Counter)
    violations: Counter[str] = field(default_factory=Counter)
    examples: list[str] = field(default_factory=list)
    excerpts: list[SoakExcerpt] = field(default_factory=list)

    def plus(self, other: SoakTally) -> SoakTally:
        """Return the account of both."""
        both = SoakTally(examples=(self.examples + other.examples)[:MOST_KEPT])
        for name in ("injected", "detected", "harmless", "outcomes", "totals", "violations"):
            counts = getattr(both, name)
            counts.update(getattr(self, name))
            counts.update(getattr(other, name))
        return both

    def violate(self, name: str, text: str) -> None:
        """Take down what must not happen."""
        self.violations[name] += 1
        if len(self.examples) < MOST_KEPT:
            self.examples.append(f"{name}: {text}")

    def inject(self, kind: str) -> SoakHit:
        """Take down a fault."""
        self.injected[kind] += 1
        return SoakHit(kind)

    def find(self, hit: SoakHit, name: str) -> None:
        """Take down that something was found of *hit*."""
        hit.detected = True
        self.outcomes[hit.kind, name] += 1

    def close(self, hit: SoakHit) -> None:
        """Take down that nothing more can come of *hit*."""
        if hit.detected:
            self.detected[hit.kind] += 1
        elif hit.delivered:
            self.harmless[hit.kind] += 1
        else:
            self.violate(UNEXPLAINED, f"{hit.kind}: its frame vanished and nobody noticed")

    def as_dict(self) -> dict[str, Any]:
        """Return it as JSON can hold it."""
        kinds = {
            kind: {
                "injected": count,
                "detected": self.detected[kind],
                "harmless": self.harmless[kind],
                "found": {name: n for (k, name), n in sorted(self.outcomes.items()) if k == kind},
            }
            for kind, count in sorted(self.injected.items())
        }
        return {
            "faults": kinds,
            "totals": dict(sorted(self.totals.items())),
            "violations": dict(sorted(self.violations.items())),
            "examples": self.examples,
        }

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> Self:
        """Return the object that :meth:`as_dict` has written."""
        tally = cls(
            totals=Counter(data["totals"]),
            violations=Counter(data["violations"]),
            examples=list(data["examples"]),
        )
        for kind, row in data["faults"].items():
            tally.injected[kind] = row["injected"]
            tally.detected[kind] = row["detected"]
            tally.harmless[kind] = row["harmless"]
            tally.outcomes.update({(kind, name): n for name, n in row["found"].items()})
        return tally
