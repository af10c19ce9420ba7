"""Operations of a chain of Ultraino's Arduino boards, and the capacities of its firmware."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from ...codec import Operation, Reply

MAX_BOARDS: Final = 14  # ArduinoMEGA64.java: 15 boards and more are refused


@dataclass(frozen=True, slots=True)
class SetPattern(Operation):
    """Slot bytes for a pattern of the buffer that does not radiate.

    Attributes
    ----------
    board : int
        Number in the chain.
    pattern : int
        Number of the pattern.
    slots : bytes
        For each slot of the period the outputs of each port; fewer than a pattern's if the swap
        came before. The low half of an odd last one is 0, as the firmware leaves it.
    """

    board: int
    pattern: int
    slots: bytes


@dataclass(frozen=True, slots=True)
class SetDurations(Operation):
    """Durations of patterns 0, 1, ... in periods, for the next commit; the others stay.

    The animation firmware takes the first as the number of the pattern to show.
    """

    periods: bytes


@dataclass(frozen=True, slots=True)
class CommitDurations(Operation):
    """Every board takes the durations that were set."""


@dataclass(frozen=True, slots=True)
class Restart(Operation):
    """Every board writes slot 0 next."""


@dataclass(frozen=True, slots=True)
class Swap(Operation):
    """Every board swaps its two buffers and writes slot 0 next."""


@dataclass(frozen=True, slots=True)
class Forward(Operation, Reply):
    """The last board of the chain sends *byte* to the host.  Only a board's end makes it."""

    byte: int
