"""Conditions of a random dialogue, and what its makers make."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple

from haptogram_protocol.messages import Feature, HelloReply

from ..coverage import DialogueCoverage
from ..host import DialogueHost


class Told(NamedTuple):
    """A frame that a board is told.

    Attributes
    ----------
    name, text : str
        What dialogues tell apart, and the description.
    body : callable
        Given the host, returns header and payload.
    damage : int
        See :class:`~..actions.DialogueAction`.
    wait_us : int
        Time between the arrival of the frame before, or the beginning of the slot, and its own.
    ends_slot : bool
        Whether the frame may be latched right after its arrival.
    """

    name: str
    text: str
    body: Callable[[DialogueHost], bytes]
    damage: int = 0
    wait_us: int = 0
    ends_slot: bool = False


#: What is told in one slot after the other.
ToldSlots = list[list[Told]]


@dataclass(frozen=True, slots=True)
class DialogueConditions:
    """Conditions that the makers of one random dialogue share.

    Attributes
    ----------
    identity : HelloReply
        The board, with its capabilities and limits.
    random : random.Random
        Chance.
    coverage : DialogueCoverage
        What dialogues before have sent.
    timed : bool
        Whether slots are waited for, so that timers end and frames may be queued for some slots.
    exact : bool
        Whether bytes arrive to the microsecond, so that limits of times are met as they are.
    fast : bool
        Whether many frames of a sequence are played within a slot.
    drives : bool
        Whether drives may be traced.
    """

    identity: HelloReply
    random: random.Random
    coverage: DialogueCoverage
    timed: bool
    exact: bool = False
    fast: bool = True
    drives: bool = False

    @property
    def can(self) -> Feature:
        """The capabilities of the board that this text knows."""
        return Feature(self.identity.features & sum(Feature))

    def next(self, kind: str, names: Callable[[], Iterable[tuple[Any, ...]]]) -> tuple[Any, ...]:
        """Return one of *names*, by chance: each once in the run before any twice."""
        return self.coverage.next(kind, names, self.random)


class DialogueMaker:
    """Makes some of what a random host sends in one dialogue.

    Parameters
    ----------
    conditions : DialogueConditions
        Conditions of the dialogue.
    """

    def __init__(self, conditions: DialogueConditions) -> None:
        self.conditions = conditions
        self._identity = conditions.identity
        self._can = conditions.can
        self._random = conditions.random
        self._pick, self._across = conditions.random.choice, conditions.random.randrange
