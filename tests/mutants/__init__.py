"""Boards that are wrong in exactly one way: what the conformance suite has to find.

``MUTANTS`` names them all, those of :mod:`sim_device.mutants` among them. Each names the
requirement of SPEC.md that it violates; a board loads it by its ``address``.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from sim_device.mutants import MUTANTS as SHOWN
from sim_device.mutants import Mutant

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
from .single import moments, refusals, timers, types

_MODULES: Final = (
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
    dict(SHOWN) | {mutant.name: mutant for module in _MODULES for mutant in module.MUTANTS}
)

__all__ = ["MUTANTS"]
