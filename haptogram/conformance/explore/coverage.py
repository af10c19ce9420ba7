"""Coverage of the random dialogues of a run: the next ones send something else."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

from haptogram_protocol.messages import Message


@dataclass(slots=True)
class DialogueCoverage:
    """Pairs of actions sent so far; requests at limits and scenes that are still to come.

    Attributes
    ----------
    pairs : Counter
        Names of two actions, one after the other: how often they were sent so.
    limits : list of Message
        Requests at limits that are still to be sent.
    scenes : dict of str to list of tuple
        Scenes of each kind that are still to be played, by the names of their parts.
    """

    pairs: Counter[tuple[str, str]] = field(default_factory=Counter)
    limits: list[Message] = field(default_factory=list)
    scenes: dict[str, list[tuple[Any, ...]]] = field(default_factory=dict)

    def next(
        self, kind: str, names: Callable[[], Iterable[tuple[Any, ...]]], source: random.Random
    ) -> tuple[Any, ...]:
        """Return one of *names*, by chance: each once before any twice."""
        due = self.scenes.setdefault(kind, [])
        if not due:
            due += names()
            source.shuffle(due)
        return due.pop()
