"""Verdicts on a board, and their meaning for CI: one table for all reports."""

from __future__ import annotations

import enum
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, NamedTuple

if TYPE_CHECKING:
    from haptogram.records.frame import Evidence

PASS: Final = 0
FAIL: Final = 1
USAGE: Final = 2
INCONCLUSIVE_STATUS: Final = 3
#: Reason of a case that needs a restart, where nothing can restart the board.
NO_RESET: Final = "no way to restart the board (--spawn, --reset-cmd, --dtr)"
INTERRUPTED: Final = 130  # as every shell has it


class Behaviour(enum.StrEnum):
    """Verdict on the behaviour of the board."""

    OK = "OK"
    NON_STRICT = "NON-STRICT"
    INFORMATIONAL = "INFORMATIONAL"
    UNIMPLEMENTED = "UNIMPLEMENTED"
    NOT_OBSERVED = "NOT-OBSERVED"
    INCONCLUSIVE = "INCONCLUSIVE"
    FLAKY = "FLAKY"
    FAILED = "FAILED"


class Meaning(NamedTuple):
    """One row of the table verdict -> JUnit -> exit status."""

    text: str
    junit: str | None  # element inside <testcase>; None: the test passes
    exit_status: int


MEANINGS: Final[dict[Behaviour, Meaning]] = {
    Behaviour.OK: Meaning("as the clause demands", None, PASS),
    Behaviour.NON_STRICT: Meaning("a SHOULD that is not met (--strict: FAILED)", None, PASS),
    Behaviour.INFORMATIONAL: Meaning("allowed either way; reported for information", None, PASS),
    Behaviour.UNIMPLEMENTED: Meaning(
        "needs a capability that the board does not advertise", "skipped", PASS
    ),
    Behaviour.NOT_OBSERVED: Meaning(
        "nothing on this line can show it; never counted as passed", "skipped", PASS
    ),
    Behaviour.INCONCLUSIVE: Meaning(
        "could not be judged: the board or the host was held up, or the case itself has an error",
        "error",
        INCONCLUSIVE_STATUS,
    ),
    Behaviour.FLAKY: Meaning("different verdicts when repeated", "failure", FAIL),
    Behaviour.FAILED: Meaning("not as the clause demands", "failure", FAIL),
}


@dataclass(frozen=True, slots=True)
class Recovery:
    """Second verdict: requests and stream work again after a case.

    Attributes
    ----------
    frames : int or None
        Number of requests up to the first answered one; None: no request was answered.
    text : str
        Description of the failure; empty if there is none.
    """

    frames: int | None = None
    text: str = ""

    @property
    def clean(self) -> bool:
        """True if requests and stream work again."""
        return self.frames is not None and not self.text

    def __str__(self) -> str:
        if self.clean:
            return f"clean after {self.frames} frame{'s' if self.frames != 1 else ''}"
        return f"not clean: {self.text or 'no request is answered any more'}"


@dataclass(frozen=True, slots=True)
class CaseResult:
    """Result of one case.

    Attributes
    ----------
    case : str
        Id: the clause's number, and a word where a clause has several cases.
    clause : str
        Number of the clause.
    requirement : str
        Text of the clause, one line.
    summary : str
        Experiment and expected result, one line.
    behaviour : Behaviour
        First verdict.
    evidence : Evidence
        Source of the verdict.
    detail : str
        Reason of the verdict; may be empty.
    recovery : Recovery or None
        Second verdict; None if nothing was sent.
    transcript : tuple of str
        The bytes exchanged, decoded; of a case that is not OK.
    expected : str or None
        Verdict in the baseline.
    seen : tuple of Behaviour
        Verdicts of the repetitions, and of attempts that differ; empty if there is one verdict.
    traceback : str
        Traceback of an error in the case itself.
    seconds : float or None
        How long it took, on the clock of the port; None: it was not run, or was read from JSON,
        which holds no duration.  Results are the same whatever it is.
    """

    case: str
    clause: str
    requirement: str
    summary: str
    behaviour: Behaviour
    evidence: Evidence
    detail: str = ""
    recovery: Recovery | None = None
    transcript: tuple[str, ...] = ()
    expected: str | None = None
    seen: tuple[Behaviour, ...] = ()
    traceback: str = ""
    seconds: float | None = field(default=None, compare=False)

    @property
    def recovers(self) -> bool:
        """True if the board recovered, or if recovery was not tried."""
        return self.recovery is None or self.recovery.clean

    @property
    def is_failure(self) -> bool:
        """True if the case fails, expected or not."""
        return MEANINGS[self.behaviour].exit_status == FAIL or not self.recovers

    @property
    def is_new_failure(self) -> bool:
        """True if the case fails and the baseline does not expect that."""
        return self.is_failure and self.expected is None

    @property
    def is_unexpected_pass(self) -> bool:
        """True if the case does not fail and the baseline expects a failure."""
        return self.expected is not None and not self.is_failure


@dataclass(frozen=True, slots=True)
class SuiteResult:
    """Result of a run.

    Attributes
    ----------
    results : tuple of Result
        In the order in which the cases ran.
    device : dict
        Description of the board, from HELLO_REPLY.
    settings : dict
        Settings of the run: port, seed, strict, ...
    cut_short : str
        Why some cases were not run; empty if all were.
    is_interrupted : bool
        Whether Ctrl-C ended the run.
    nonces : frozenset of int
        Nonces of the sessions that the run asked for; empty for a result that was read from JSON.
    """

    results: tuple[CaseResult, ...]
    device: dict[str, object] = field(default_factory=dict)
    settings: dict[str, object] = field(default_factory=dict)
    cut_short: str = ""
    is_interrupted: bool = False
    nonces: frozenset[int] = field(default=frozenset(), compare=False)

    @property
    def exit_status(self) -> int:
        """0, 1 or 3 by the table; 1 beats 3, which is 130 if the run was interrupted."""
        status = suite_exit_status(self.results)
        return INTERRUPTED if self.is_interrupted and status == INCONCLUSIVE_STATUS else status

    @property
    def unseen_without_reset(self) -> list[str]:
        """Ids of the cases that a way to restart the board would add."""
        return [result.case for result in self.results if result.detail == NO_RESET]

    def count(self, behaviour: Behaviour) -> int:
        """Return the number of cases with this verdict."""
        return sum(result.behaviour is behaviour for result in self.results)


def suite_exit_status(results: Iterable[CaseResult]) -> int:
    """Return the exit status of a run: :data:`FAIL` beats :data:`INCONCLUSIVE_STATUS`."""
    status = PASS
    for result in results:
        if result.is_new_failure:
            return FAIL
        if MEANINGS[result.behaviour].exit_status == INCONCLUSIVE_STATUS:
            status = INCONCLUSIVE_STATUS
    return status


def suite_verdict_meaning_table() -> str:
    """Return the table verdict -> JUnit -> exit status, as text."""
    rows = [
        f"  {behaviour.value:<14} {meaning.junit or 'passes':<8} {meaning.exit_status}   "
        f"{meaning.text}"
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
