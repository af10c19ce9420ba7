"""Coverage of the random dialogues of a run: the next ones send something else."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

from haptogram_protocol.messages import Message


@dataclass(slots=True)
class DialogueCoverage:
    """Pairs of actions sent so far, and requests at limits still to be sent.

    Attributes
    ----------
    pairs : Counter
        Names of two actions, one after the other: how often they were sent so.
    limits : list of Message
        Requests at limits that are still to be sent.
    """

    pairs: Counter[tuple[str, str]] = field(default_factory=Counter)
    limits: list[Message] = field(default_factory=list)
