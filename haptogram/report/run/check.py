"""One check of a run, and its outcome."""

from __future__ import annotations

import enum
from dataclasses import dataclass


class CheckOutcome(enum.StrEnum):
    """Outcome of a check."""

    PASSED = "passed"
    FAILED = "failed"
    INCONCLUSIVE = "inconclusive"
    NOT_JUDGED = "not judged"  # no frame was seen that could have answered it
    NOTED = "noted"  # found, but decides nothing


@dataclass(frozen=True, slots=True)
class RunCheck:
    """One check and its outcome.

    Attributes
    ----------
    name : str
        Name of the fault, as in the counts of the run.
    statement : str
        The sentence that is true if the check passed.
    outcome : Outcome
        Whether the sentence is true.
    message : str
        The finding in one line.
    details : tuple of str
        The frames that the finding concerns, at most `NAMED_FRAMES` of them.
    """

    name: str
    statement: str
    outcome: CheckOutcome
    message: str
    details: tuple[str, ...] = ()

    @property
    def decisive(self) -> bool:
        """True if the outcome decides the verdict of the run."""
        return self.outcome in (CheckOutcome.FAILED, CheckOutcome.INCONCLUSIVE)
