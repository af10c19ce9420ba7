"""Boards that are wrong in exactly one way: what a conformance suite has to find.

``MUTANTS`` names them all. Each is the healthy board with one part replaced (see
:class:`~sim_device.assembly.BoardAssembly`) and names the requirement of SPEC.md that it violates.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from haptogram.errors import ConfigurationError
from haptogram.settings.arguments import did_you_mean

from ..assembly import HEALTHY, BoardAssembly
from . import (
    effects,
    framing,
    identity,
    latching,
    output,
    points,
    ramps,
    readiness,
    repetition,
    replies,
    session,
)
from .mutant import Mutant, mutants_by_name
from .single import moments, refusals, timers, types

_PARTS: Final = (
    framing,
    session,
    repetition,
    replies,
    identity,
    latching,
    readiness,
    points,
    output,
    ramps,
    effects,
    types,
    moments,
    timers,
    refusals,
)

MUTANTS: Final[Mapping[str, Mutant]] = MappingProxyType(
    mutants_by_name(mutant for part in _PARTS for mutant in part.MUTANTS)
)


def mutant_parts(name: str | None) -> BoardAssembly:
    """Return the parts of the mutant *name*; None: of the healthy board.

    Raises
    ------
    ConfigurationError
        If there is no such mutant.
    """
    if name is None:
        return HEALTHY
    if name not in MUTANTS:
        raise ConfigurationError(
            f"mutant is {name!r}; docs/kill-matrix.md lists those known"
            f"{did_you_mean(name, MUTANTS)}"
        )
    return MUTANTS[name].parts


__all__ = ["MUTANTS", "Mutant", "mutant_parts"]
