"""The account of a soak: every fault, everything that was done, and their course over time."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, Self

if TYPE_CHECKING:
    from .excerpts import SoakExcerpt

MOST_KEPT: Final = 20  # violations that are kept word for word, and excerpts; all are counted

UNEXPLAINED: Final = "unexplained"
MEMORY_GREW: Final = "memory grew"
DAMAGE: Final = ("crc", "cobs", "oversize", "short")  # counters of damaged runs of bytes

STATES: Final = ("injected", "detected", "harmless")  # outcomes of a fault

#: Stream frames that were sent; damaged frames that either end found; stream frames that never came
#: to the board; those that came after their time, and by how much at most; what must not happen.
_COUNTED: Final = ("frames", "damaged", "lost", "late", "latest_us", "violations")

#: Violations, each with the sentence that holds without it.
VIOLATIONS: Final = {
    "damaged frame taken": "no damaged frame is taken for one that was sent",
    "undamaged frame dropped": "no undamaged frame is dropped",
    "copy taken": "no copy of a frame is taken for another frame",
    "torn latch": "every latched drive is the one that was sent",
    "wrong frame latched": "the frame that is latched is the next one that is due",
    "not latched": "every frame that came in time is latched",
    "latched at a wrong time": "every latch is on the first carrier period after time and arrival",
    "late without a cause": "no frame is late that nothing held up",
    "muted too early": "the output is not off before hold or lease, and ramp",
    "muted too late": "the output is off after hold or lease, and ramp",
    "sounds when it is off": "nothing sounds after MUTE, a new session or a mute by a timer",
    "not in order again": "both ends are in order again after every burst of faults",
    "no answer": "every request is answered",
    "given up": "every segment goes on to its end",
    "memory leak": "board and host keep no more memory than after the first burst",
    MEMORY_GREW: "no process takes more memory than after its first segment",
    "clock step unseen": "the host notices every step of the board's clock",
    "clock stepped by itself": "the host notices no step of the board's clock that was not made",
    "counter unexplained": "every counter of the board is the sum of what was found",
    UNEXPLAINED: "every fault is found or harmless, and nothing is found without a fault",
}


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
    faults : dict of str to Counter
        By kind: how many were injected, detected (something was found of them) and harmless
        (nothing was, and the frame came through), and what was found of them, by name.
    totals : Counter
        Everything else that is counted, by name.
    violations : Counter
        Count of each kind of violation, by name.
    examples : list of str
        The first of them, in words.
    course : dict of int to dict of str to int
        Counts of each interval of virtual time with at least one count, by number.
    interval : float
        Number of the interval that counts, which a rig keeps up to date; its whole part.
    hits : list of SoakHit
        Faults that are not closed.
    request_hits : list of SoakHit
        Those that may make the host ask for its last request again.
    excerpts : list of SoakExcerpt
        Of one segment: what happened around the violations, if that is recorded.
    """

    faults: dict[str, Counter[str]] = field(default_factory=dict)
    totals: Counter[str] = field(default_factory=Counter)
    violations: Counter[str] = field(default_factory=Counter)
    examples: list[str] = field(default_factory=list)
    course: dict[int, dict[str, int]] = field(default_factory=dict)
    interval: float = field(default=0.0, compare=False)
    hits: list[SoakHit] = field(default_factory=list, compare=False)
    request_hits: list[SoakHit] = field(default_factory=list, compare=False)
    excerpts: list[SoakExcerpt] = field(default_factory=list, compare=False)

    def plus(self, other: SoakTally) -> SoakTally:
        """Return the account of both."""
        both = SoakTally(examples=(self.examples + other.examples)[:MOST_KEPT])
        for one in (self, other):
            both.totals.update(one.totals)
            both.violations.update(one.violations)
            for kind, counts in one.faults.items():
                both.faults.setdefault(kind, Counter()).update(counts)
            for number, row in one.course.items():  # two segments may share an interval
                joined = both.course.setdefault(number, dict.fromkeys(_COUNTED, 0))
                latest_us = max(joined["latest_us"], row["latest_us"])
                joined.update({name: joined[name] + row[name] for name in _COUNTED})
                joined["latest_us"] = latest_us
        return both

    def violate(self, name: str, text: str) -> None:
        """Take down what must not happen; *name* is one of :data:`VIOLATIONS`."""
        if name not in VIOLATIONS:
            raise KeyError(name)
        self.violations[name] += 1
        self._row["violations"] += 1
        if len(self.examples) < MOST_KEPT:
            self.examples.append(f"{name}: {text}")

    def inject(self, kind: str) -> SoakHit:
        """Take down a fault."""
        self.faults.setdefault(kind, Counter(dict.fromkeys(STATES, 0)))["injected"] += 1
        self.hits.append(SoakHit(kind))
        return self.hits[-1]

    def find(self, hit: SoakHit, name: str) -> None:
        """Take down that something was found of *hit*."""
        hit.detected = True
        self.faults[hit.kind][name] += 1

    def close(self) -> None:
        """Take down that nothing more can come of the faults up to now."""
        for hit in self.hits:
            if hit.detected or hit.delivered:
                self.faults[hit.kind]["detected" if hit.detected else "harmless"] += 1
            else:
                self.violate(UNEXPLAINED, f"{hit.kind}: its frame vanished and nobody noticed")
        self.hits.clear()

    def count(self, name: str, number: int = 1, *, column: str) -> None:
        """Take down that something came *number* times, in a column of the course as well."""
        self.totals[name] += number
        if number:
            self._row[column] += number

    def note_lateness(self, late_us: int) -> None:
        """Take down by how much a frame came after its time."""
        self._row["latest_us"] = max(self._row["latest_us"], late_us)

    @property
    def _row(self) -> dict[str, int]:
        """Return the counters of the present interval of time, 0 at first."""
        return self.course.setdefault(int(self.interval), dict.fromkeys(_COUNTED, 0))

    def found(self) -> dict[str, dict[str, int]]:
        """Return the faults that were found, by kind."""
        return {
            kind: {name: n for name, n in sorted(counts.items()) if name not in STATES}
            for kind, counts in sorted(self.faults.items())
        }

    def as_dict(self) -> dict[str, Any]:
        """Return it as JSON can hold it."""
        states = {kind: {n: self.faults[kind][n] for n in STATES} for kind in self.faults}
        return {
            "faults": {k: states[k] | {"found": found} for k, found in self.found().items()},
            "totals": dict(sorted(self.totals.items())),
            "violations": dict(sorted(self.violations.items())),
            "examples": self.examples,
            "course": [{"interval": number} | one for number, one in self.course.items()],
        }

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> Self:
        """Return the object that :meth:`as_dict` has written."""
        return cls(
            faults={k: Counter(row | row.pop("found")) for k, row in data["faults"].items()},
            totals=Counter(data["totals"]),
            violations=Counter(data["violations"]),
            examples=list(data["examples"]),
            course={one.pop("interval"): one for one in data["course"]},
        )
