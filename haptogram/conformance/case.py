"""A case: one experiment with a board, for one clause."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, TypeAlias

from haptogram_protocol.messages import Feature

from .client.board_client import BoardClient
from .verdict import Evidence

Body: TypeAlias = Callable[[BoardClient], None]

#: No capability is needed.
NOTHING: Final = Feature(0)


@dataclass(frozen=True, slots=True)
class Case:
    """One experiment with a board.

    Attributes
    ----------
    clause : str
        Number of the clause that it judges.
    what : str
        What it does and expects, one line.
    body : callable or None
        Runs it; returns if the board did as the clause demands.  None: it cannot be observed.
    variant : str
        Tells several cases of a clause apart.
    needs : Feature
        Capabilities without all of which it is UNIMPLEMENTED.
    evidence : Evidence
        What its verdict rests on.
    needs_reset : bool
        Whether it begins with a board that has just started.
    needs_session : bool
        Whether a session is opened for it; else it talks to a board of which nothing is known.
    """

    clause: str
    what: str
    body: Body | None
    variant: str = ""
    needs: Feature = NOTHING
    evidence: Evidence = Evidence.WIRE
    needs_reset: bool = False
    needs_session: bool = True

    @property
    def id(self) -> str:
        """The clause's number, and the variant where there is one."""
        return f"{self.clause}-{self.variant}" if self.variant else self.clause


def case(
    clause: str,
    what: str,
    *,
    variant: str = "",
    needs: Feature = NOTHING,
    evidence: Evidence = Evidence.WIRE,
    needs_reset: bool = False,
    needs_session: bool = True,
) -> Callable[[Body], Case]:
    """Make a case of a function; see :class:`Case`."""

    def make(body: Body) -> Case:
        return Case(clause, what, body, variant, needs, evidence, needs_reset, needs_session)

    return make


def unobservable(clause: str, reason: str, evidence: Evidence = Evidence.WIRE) -> Case:
    """Register a clause that no case can judge, and why."""
    return Case(clause, reason, None, evidence=evidence)


def about_host(clause: str) -> Case:
    """Register a clause about the host."""
    return unobservable(clause, "about the host: nothing that a board sends shows it")


def about_text(clause: str) -> Case:
    """Register a clause about SPEC.md itself."""
    return unobservable(clause, "about how this text may change, not about a board")
