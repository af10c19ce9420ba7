"""Conditions of a random dialogue, and what the dialogues before it have met."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

from haptogram_protocol import messages as m


@dataclass(slots=True)
class DialogueCoverage:
    """Coverage of the dialogues of a run: the next ones send something else.

    Attributes
    ----------
    pairs : Counter
        Names of two actions, one after the other: how often they were sent so.
    due : dict of str to list of tuple
        Inputs of each kind that were not sent yet: parts of scenes, values of fields.
    """

    pairs: Counter[tuple[str, str]] = field(default_factory=Counter)
    due: dict[str, list[tuple[Any, ...]]] = field(default_factory=dict)


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
        Inputs that earlier dialogues have sent.
    timed : bool
        Whether slots are waited for, so that timers end and frames may be queued for some slots.
    exact : bool
        Whether bytes arrive to the microsecond, so that limits of times are met as they are.
    fast : bool
        Whether many frames of a sequence are played within a slot.
    drives : bool
        Whether drives may be traced.
    """

    identity: m.HelloReply
    random: random.Random
    coverage: DialogueCoverage
    timed: bool
    exact: bool = False
    fast: bool = True
    drives: bool = False

    @property
    def can(self) -> m.Feature:
        """The capabilities of the board that this text knows."""
        return m.Feature(self.identity.features & sum(m.Feature))

    def next(self, kind: str, names: Callable[[], Iterable[tuple[Any, ...]]]) -> tuple[Any, ...]:
        """Return one of *names*, by chance: each once in the run before any twice."""
        due = self.coverage.due.setdefault(kind, [])
        if not due:
            due += names()
            self.random.shuffle(due)
        return due.pop()


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
