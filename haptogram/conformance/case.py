"""A case: one experiment with a board, for one clause."""

from __future__ import annotations

import enum
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, TypeAlias

from haptogram.records.frame import Evidence
from haptogram_protocol import messages as m

from .client.board_client import BoardClient

Body: TypeAlias = Callable[[BoardClient], None]


class Depth(enum.IntEnum):
    """Depth of a run: each holds the cases of those before it, and more."""

    QUICK = 0
    DEFAULT = 1
    FULL = 2


#: The case needs no capability.
NOTHING: Final = m.Feature(0)


@dataclass(frozen=True, slots=True)
class Case:
    """One experiment with a board.

    Attributes
    ----------
    clause : str
        Number of the clause that the case judges.
    summary : str
        Experiment and expected result, one line.
    body : callable or None
        The experiment; returns if the board meets the clause.  None: nothing can be observed.
    variant : str
        Distinguishes the cases of one clause.
    needs : Feature
        Capabilities that the board must advertise; without them the case is UNIMPLEMENTED.
    evidence : Evidence
        Source of the verdict.
    needs_reset : bool
        Whether the case begins with a board that has just started.
    before_wrap_us : int
        For a case that waits until the clock passes 2^32 µs, 10 s after a reset: how long before
        that it has to begin.  Other cases may run between the reset and then.
    needs_session : bool
        Whether a session is opened before the case; else the board's state is unknown.
    judges_all : bool
        Whether the case judges what came in all others: it runs behind them.
    depth : Depth
        The least depth of a run that holds the case.
    wall_depth : Depth or None
        The same for a board at a wall clock, where a long wait takes its time; None: ``depth``.
    """

    clause: str
    summary: str
    body: Body | None
    variant: str = ""
    needs: m.Feature = NOTHING
    evidence: Evidence = Evidence.WIRE
    needs_reset: bool = False
    before_wrap_us: int = 0
    needs_session: bool = True
    judges_all: bool = False
    depth: Depth = Depth.QUICK
    wall_depth: Depth | None = None

    def least_depth(self, *, virtual: bool) -> Depth:
        """Return the least depth of a run, in virtual time or at a wall clock, with the case."""
        return self.depth if virtual or self.wall_depth is None else self.wall_depth

    @property
    def id(self) -> str:
        """The clause's number, and the variant where there is one."""
        return f"{self.clause}-{self.variant}" if self.variant else self.clause


def case(
    name: str,
    summary: str = "",
    *,
    variant: str = "",
    needs: m.Feature = NOTHING,
    evidence: Evidence = Evidence.WIRE,
    needs_reset: bool = False,
    before_wrap_us: int = 0,
    needs_session: bool = True,
    depth: Depth | None = None,
    wall_depth: Depth | None = None,
) -> Callable[[Body], Case]:
    """Return a decorator that makes a function the :class:`Case` of that id.

    Its docstring is the summary, unless one is given.  A case with a depth of its own at a wall
    clock waits long: in virtual time it is of the default depth.
    """
    if depth is None:
        depth = Depth.QUICK if wall_depth is None else Depth.DEFAULT
    section, _, rest = name.partition("/")
    number, _, own_variant = rest.partition("-")

    def make(body: Body) -> Case:
        return Case(
            f"{section}/{number}",
            summary or " ".join((body.__doc__ or "").split()),
            body,
            variant or own_variant,
            needs,
            evidence,
            needs_reset,
            before_wrap_us,
            needs_session,
            depth=depth,
            wall_depth=wall_depth,
        )

    return make


def unobservable_case(clause: str, reason: str, evidence: Evidence = Evidence.WIRE) -> Case:
    """Return the case of a clause that nothing on the line can show, with the reason."""
    return Case(clause, reason, None, evidence=evidence)


def case_about_host(clause: str) -> Case:
    """Return the case of a clause about the host."""
    return unobservable_case(clause, "about the host: no frame of a board shows it")


def case_about_text(clause: str) -> Case:
    """Return the case of a clause about SPEC.md itself."""
    return unobservable_case(clause, "about changes of SPEC.md, not about a board")
