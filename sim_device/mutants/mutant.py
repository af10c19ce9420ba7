"""What a mutant is: one part of a board, wrong in one way."""

from __future__ import annotations

import enum
import inspect
import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Self, TypeAlias

from haptogram_protocol.connection import BoardConnection
from haptogram_protocol.framing import FrameDecoder

from ..assembly import Parts
from ..board.board import Board
from ..board.clock import DeviceClock
from ..dialects.haptogram import BoardDialect

Part: TypeAlias = (
    type[Board]
    | type[BoardDialect]
    | type[BoardConnection]
    | type[FrameDecoder]
    | type[DeviceClock]
)


class Evidence(enum.StrEnum):
    """What it takes to see that a board is wrong."""

    WIRE = "wire"
    SELF_REPORTED = "self-reported"
    EXTERNAL = "external"


@dataclass(frozen=True, slots=True)
class Mutant:
    """A board that is wrong in exactly one way.

    Attributes
    ----------
    name : str
        As it is given on a command line or in a URL.
    clause : str
        Requirement of SPEC.md that it violates.
    evidence : Evidence
        What shows it: bytes on the wire, the board's own report, or nothing but a measurement.
    docstring : str
        What it does wrong.
    parts : Parts
        The board.
    """

    name: str
    clause: str
    evidence: Evidence
    docstring: str
    parts: Parts

    @classmethod
    def of(cls, part: Part, clause: str, evidence: Evidence) -> Self:
        """Return the mutant whose wrong part is *part*, named after it."""
        name = re.sub(r"(?<=[a-z])(?=[A-Z0-9])|(?<=[0-9])(?=[A-Z])", "-", part.__name__).lower()
        return cls(name, clause, evidence, inspect.getdoc(part) or "", _parts(part))


def by_name(mutants: Iterable[Mutant]) -> dict[str, Mutant]:
    """Return *mutants* by their names."""
    return {mutant.name: mutant for mutant in mutants}


def _parts(part: Part) -> Parts:
    if issubclass(part, Board):
        return Parts(board=part)
    if issubclass(part, BoardDialect):
        return Parts(dialect=part)
    if issubclass(part, BoardConnection):
        return Parts(connection=part)
    return Parts(decoder=part) if issubclass(part, FrameDecoder) else Parts(clock=part)
