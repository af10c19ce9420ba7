"""A mutant: a board with one part that is wrong in one way."""

from __future__ import annotations

import dataclasses
import inspect
import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final, Self, TypeAlias

from haptogram.records.frame import Evidence

from ..assembly import BoardAssembly

Part: TypeAlias = type[Any]
#: The part of :class:`~sim_device.assembly.BoardAssembly` that a subclass of its class replaces.
_NAMES: Final = {field.default: field.name for field in dataclasses.fields(BoardAssembly)}


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
        Bytes on the wire, the board's own report, or only a measurement.
    docstring : str
        One sentence about the error.
    parts : BoardAssembly
        The board.
    array : str
        Array of which the frames are long enough to show it; empty: any.
    """

    name: str
    clause: str
    evidence: Evidence
    docstring: str
    parts: BoardAssembly
    array: str = ""

    @classmethod
    def of(cls, part: Part, clause: str, evidence: Evidence, array: str = "") -> Self:
        """Return the mutant whose wrong part is *part*, named after it."""
        name = re.sub(r"(?<=[a-z])(?=[A-Z0-9])|(?<=[0-9])(?=[A-Z])", "-", part.__name__).lower()
        return cls(
            name, clause, evidence, inspect.getdoc(part) or "", _mutant_parts_of(part), array
        )


def mutants_by_name(mutants: Iterable[Mutant]) -> dict[str, Mutant]:
    """Return *mutants* by their names."""
    return {mutant.name: mutant for mutant in mutants}


def _mutant_parts_of(part: Part) -> BoardAssembly:
    name = next(_NAMES[kind] for kind in part.__mro__ if kind in _NAMES)
    return BoardAssembly(**{name: part})
