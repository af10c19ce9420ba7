"""The account of faults: what was injected, what was found of it, and what does not add up."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any, Final, Self

from .course import SoakCourse, SoakCourseInterval, joined_course

if TYPE_CHECKING:
    from ..excerpts import SoakExcerpt

MOST_KEPT: Final = 20  # violations that are kept word for word; all are counted

UNEXPLAINED: Final = "unexplained"
MEMORY_GREW: Final = "memory grew"
DAMAGE: Final = ("crc", "cobs", "oversize", "short")  # what a run of bytes that is damage is

#: What must not happen, and the sentence that is true while it does not.
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
    course : SoakCourse
        What was counted in each interval of virtual time.
    latest_us : int
        Of the open interval: by which the latest frame came after its time.
    excerpts : list of SoakExcerpt
        Of one segment: what happened around the violations, if that is recorded.
    """

    injected: Counter[str] = field(default_factory=Counter)
    detected: Counter[str] = field(default_factory=Counter)
    harmless: Counter[str] = field(default_factory=Counter)
    outcomes: Counter[tuple[str, str]] = field(default_factory=Counter)
    totals: Counter[str] = field(default_factory=Counter)
    violations: Counter[str] = field(default_factory=Counter)
    examples: list[str] = field(default_factory=list)
    course: SoakCourse = field(default_factory=dict)
    latest_us: int = 0
    excerpts: list[SoakExcerpt] = field(default_factory=list)

    def plus(self, other: SoakTally) -> SoakTally:
        """Return the account of both."""
        both = SoakTally(
            examples=(self.examples + other.examples)[:MOST_KEPT],
            course=joined_course(self.course, other.course),
        )
        for name in ("injected", "detected", "harmless", "outcomes", "totals", "violations"):
            counts = getattr(both, name)
            counts.update(getattr(self, name))
            counts.update(getattr(other, name))
        return both

    def violate(self, name: str, text: str) -> None:
        """Take down what must not happen; *name* is one of :data:`VIOLATIONS`."""
        if name not in VIOLATIONS:
            raise KeyError(name)
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

    def take_counts(self) -> SoakCourseInterval:
        """Return the counts until now, and begin anew with the latest frame."""
        ends = ("the board", "the host")
        latest_us, self.latest_us = self.latest_us, 0
        return SoakCourseInterval(
            frames=self.totals["frames"],
            damaged=sum(self.totals[f"{end}: {found}"] for end in ends for found in DAMAGE),
            lost=self.totals["gap"],
            late=self.totals["late"] + self.totals["dropped_late"],
            latest_us=latest_us,
            violations=self.violations.total(),
        )

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
            "course": [{"interval": n} | asdict(one) for n, one in self.course.items()],
        }

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> Self:
        """Return the object that :meth:`as_dict` has written."""
        tally = cls(
            totals=Counter(data["totals"]),
            violations=Counter(data["violations"]),
            examples=list(data["examples"]),
            course={
                one.pop("interval"): SoakCourseInterval(**one) for one in map(dict, data["course"])
            },
        )
        for kind, row in data["faults"].items():
            tally.injected[kind] = row["injected"]
            tally.detected[kind] = row["detected"]
            tally.harmless[kind] = row["harmless"]
            tally.outcomes.update({(kind, name): n for name, n in row["found"].items()})
        return tally
