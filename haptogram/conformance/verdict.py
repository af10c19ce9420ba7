"""What a case can come to, and what that means for CI: one table for all reports."""

from __future__ import annotations

import enum
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Final, NamedTuple

PASS: Final = 0
FAIL: Final = 1
USAGE: Final = 2
INCONCLUSIVE_STATUS: Final = 3


class Behaviour(enum.StrEnum):
    """What the board did, measured by the clause."""

    OK = "OK"
    NON_STRICT = "NON-STRICT"
    INFORMATIONAL = "INFORMATIONAL"
    UNIMPLEMENTED = "UNIMPLEMENTED"
    NOT_OBSERVED = "NOT-OBSERVED"
    INCONCLUSIVE = "INCONCLUSIVE"
    FLAKY = "FLAKY"
    FAILED = "FAILED"


class Evidence(enum.StrEnum):
    """What a verdict rests on."""

    WIRE = "WIRE"  # the bytes on the line and their times
    SELF_REPORTED = "SELF-REPORTED"  # the firmware's own word: read-back, trace, counters
    EXTERNAL = "EXTERNAL"  # only a measurement shows it; nothing here has that


class Meaning(NamedTuple):
    """One row of the table verdict -> JUnit -> exit status."""

    what: str
    junit: str | None  # element inside <testcase>; None: it passes
    exit_status: int


MEANINGS: Final[dict[Behaviour, Meaning]] = {
    Behaviour.OK: Meaning("as the clause demands", None, PASS),
    Behaviour.NON_STRICT: Meaning("a SHOULD that is not met (--strict: FAILED)", None, PASS),
    Behaviour.INFORMATIONAL: Meaning("allowed either way; told for information", None, PASS),
    Behaviour.UNIMPLEMENTED: Meaning(
        "needs a capability that the board does not advertise", "skipped", PASS
    ),
    Behaviour.NOT_OBSERVED: Meaning(
        "nothing on this line can show it; never counted as passed", "skipped", PASS
    ),
    Behaviour.INCONCLUSIVE: Meaning(
        "could not be judged: no board, a host held up, or an error in the case itself",
        "error",
        INCONCLUSIVE_STATUS,
    ),
    Behaviour.FLAKY: Meaning("different verdicts when repeated", "failure", FAIL),
    Behaviour.FAILED: Meaning("not as the clause demands", "failure", FAIL),
}


@dataclass(frozen=True, slots=True)
class Recovery:
    """Whether requests and stream were clean again after a case.

    Attributes
    ----------
    frames : int or None
        How many requests it took until one was answered; None: none was.
    text : str
        What was not clean, empty if everything was.
    """

    frames: int | None = None
    text: str = ""

    @property
    def clean(self) -> bool:
        """Whether the line and the board work again."""
        return self.frames is not None and not self.text

    def __str__(self) -> str:
        if self.clean:
            return f"clean after {self.frames} frame{'s' if self.frames != 1 else ''}"
        return f"not clean: {self.text or 'no request is answered any more'}"


@dataclass(frozen=True, slots=True)
class Result:
    """What one case came to.

    Attributes
    ----------
    case : str
        Its id: the clause's number, and a word where a clause has several cases.
    clause : str
        Number of the clause.
    requirement : str
        Text of the clause, one line.
    what : str
        What the case does and expects, one line.
    behaviour : Behaviour
        First verdict.
    evidence : Evidence
        What it rests on.
    detail : str
        Why, in words; empty where there is nothing to say.
    recovery : Recovery or None
        Second verdict; None where nothing was sent.
    transcript : tuple of str
        The bytes exchanged, with what they mean; of a case that is not OK.
    expected : str or None
        What the baseline expects here.
    seen : tuple of Behaviour
        Verdicts of the repetitions.
    traceback : str
        Where the case broke off, if an error in the case itself did it and not the board.
    """

    case: str
    clause: str
    requirement: str
    what: str
    behaviour: Behaviour
    evidence: Evidence
    detail: str = ""
    recovery: Recovery | None = None
    transcript: tuple[str, ...] = ()
    expected: str | None = None
    seen: tuple[Behaviour, ...] = ()
    traceback: str = ""

    @property
    def recovers(self) -> bool:
        """Whether the board was clean again afterwards, as far as that was tried."""
        return self.recovery is None or self.recovery.clean

    @property
    def is_failure(self) -> bool:
        """Whether CI has to hear of it, were it not for a baseline."""
        return MEANINGS[self.behaviour].exit_status == FAIL or not self.recovers

    @property
    def is_new_failure(self) -> bool:
        """Whether it fails and nobody expected that."""
        return self.is_failure and self.expected is None

    @property
    def is_unexpected_pass(self) -> bool:
        """Whether the baseline expects a failure that did not come."""
        return self.expected is not None and not self.is_failure


@dataclass(frozen=True, slots=True)
class SuiteResult:
    """What a run came to.

    Attributes
    ----------
    results : tuple of Result
        In the order in which the cases ran.
    device : dict
        What the board said of itself.
    settings : dict
        How the suite was run: port, seed, strict, ...
    cut_short : str
        Why not every case was run, empty if every one was.
    """

    results: tuple[Result, ...]
    device: dict[str, object] = field(default_factory=dict)
    settings: dict[str, object] = field(default_factory=dict)
    cut_short: str = ""

    @property
    def exit_status(self) -> int:
        """0, 1 or 3 by the table; 1 beats 3."""
        return exit_status(self.results)

    def count(self, behaviour: Behaviour) -> int:
        """Return how many cases came to *behaviour*."""
        return sum(result.behaviour is behaviour for result in self.results)


def exit_status(results: Iterable[Result]) -> int:
    """Return the exit status of a run: :data:`FAIL` beats :data:`INCONCLUSIVE_STATUS`."""
    status = PASS
    for result in results:
        if result.is_new_failure:
            return FAIL
        if MEANINGS[result.behaviour].exit_status == INCONCLUSIVE_STATUS:
            status = INCONCLUSIVE_STATUS
    return status


def meaning_table() -> str:
    """Return the table verdict -> JUnit -> exit status, as text."""
    rows = [
        f"  {behaviour.value:<14} {meaning.junit or 'passes':<8} {meaning.exit_status}   "
        f"{meaning.what}"
        for behaviour, meaning in MEANINGS.items()
    ]
    head = f"  {'verdict':<14} {'JUnit':<8} exit"
    rest = [
        f"  {'not recovered':<14} {'failure':<8} {FAIL}   "
        "the board was not clean again after a case",
        f"  {'(no verdict)':<14} {'-':<8} {USAGE}   "
        "usage or environment: the port does not open, a file is wrong",
    ]
    return "\n".join([head, *rows, *rest])
