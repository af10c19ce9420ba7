"""Frames of a scene, with their damage and their time."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from ..makers.stream import MadeAction


class Told(NamedTuple):
    """A frame in a scene.

    Attributes
    ----------
    made : tuple
        Name, text and body of the frame.
    damage : int
        See :class:`~..actions.DialogueAction`.
    wait_us : int
        Time between the arrival of the frame before, or the beginning of the slot, and its own.
    """

    made: MadeAction
    damage: int = 0
    wait_us: int = 0


#: What is told in one slot after the other.
ToldSlots = list[list[Told]]


def told_as_made(made: Iterable[MadeAction]) -> list[Told]:
    """Return frames without damage."""
    return [Told(one) for one in made]
