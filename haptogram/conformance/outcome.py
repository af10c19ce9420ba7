"""The ways in which a case can end."""

from __future__ import annotations

from typing import Final, NoReturn

from haptogram.errors import HaptogramError

from .verdict import Behaviour, Evidence

#: Evidence classes under the names that cases use.
WIRE: Final = Evidence.WIRE
SELF_REPORTED: Final = Evidence.SELF_REPORTED
EXTERNAL: Final = Evidence.EXTERNAL


class CaseEndedError(HaptogramError):
    """A case knows its verdict."""

    def __init__(self, behaviour: Behaviour, text: str) -> None:
        super().__init__(text)
        self.behaviour = behaviour


def check(holds: bool, text: str) -> None:
    """End the case as FAILED unless *holds*."""
    if not holds:
        fail(text)


def fail(text: str) -> NoReturn:
    """End the case: the board did not do what the clause demands."""
    raise CaseEndedError(Behaviour.FAILED, text)


def inconclusive(text: str) -> NoReturn:
    """End the case: what was seen does not decide it."""
    raise CaseEndedError(Behaviour.INCONCLUSIVE, text)


def not_observed(text: str) -> NoReturn:
    """End the case: there is nothing to see on this board, on this line."""
    raise CaseEndedError(Behaviour.NOT_OBSERVED, text)


def unimplemented(text: str) -> NoReturn:
    """End the case: the board does not advertise what it needs."""
    raise CaseEndedError(Behaviour.UNIMPLEMENTED, text)


def informational(text: str) -> NoReturn:
    """End the case with something worth knowing that the clause allows."""
    raise CaseEndedError(Behaviour.INFORMATIONAL, text)
