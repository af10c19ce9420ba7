"""Ends of a case: a check that fails, or one of the other verdicts."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, NoReturn

from haptogram.errors import HaptogramError
from haptogram.records.frame import Evidence

from .verdict import Behaviour

#: Evidence, by the names that cases use.
WIRE: Final = Evidence.WIRE
SELF_REPORTED: Final = Evidence.SELF_REPORTED
EXTERNAL: Final = Evidence.EXTERNAL


@dataclass(slots=True)
class RuleFindings:
    """Findings of the rules that hold in every frame of a run.

    Attributes
    ----------
    judged : dict of str to int
        How many frames each clause was judged by.
    broken : dict of str to str
        What broke a clause first, in words.
    """

    judged: dict[str, int] = field(default_factory=dict)
    broken: dict[str, str] = field(default_factory=dict)


class CaseEndedError(HaptogramError):
    """Ends a case with a verdict other than OK."""

    def __init__(self, behaviour: Behaviour, text: str) -> None:
        super().__init__(text)
        self.behaviour = behaviour


def check(holds: bool, text: str) -> None:
    """End the case as FAILED unless *holds*."""
    if not holds:
        fail(text)


def fail(text: str) -> NoReturn:
    """End the case as FAILED: the board does not meet the clause."""
    raise CaseEndedError(Behaviour.FAILED, text)


def inconclusive(text: str) -> NoReturn:
    """End the case as INCONCLUSIVE: the observations decide nothing."""
    raise CaseEndedError(Behaviour.INCONCLUSIVE, text)


def not_observed(text: str) -> NoReturn:
    """End the case as NOT-OBSERVED: this board or this line cannot show the behaviour."""
    raise CaseEndedError(Behaviour.NOT_OBSERVED, text)


def unimplemented(text: str) -> NoReturn:
    """End the case as UNIMPLEMENTED: the board lacks a capability that the case needs."""
    raise CaseEndedError(Behaviour.UNIMPLEMENTED, text)


def informational(text: str) -> NoReturn:
    """End the case as INFORMATIONAL: the clause allows the behaviour, and a reader may care."""
    raise CaseEndedError(Behaviour.INFORMATIONAL, text)
