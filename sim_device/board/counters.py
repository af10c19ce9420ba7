"""Counters of a board's stream, and the arrival margins of its frames.  Chapter 9."""

from __future__ import annotations

import enum
from dataclasses import dataclass


class Drop(enum.StrEnum):
    """Why a stream frame was not queued: the name of its counter.  HG-9.2."""

    LATE = "dropped_late"
    FUTURE = "dropped_future"
    ORDER = "dropped_order"
    FULL = "dropped_full"
    STATE = "dropped_state"


@dataclass(slots=True)
class BoardCounters:
    """The counters that the board itself keeps; the others belong to the link."""

    accepted: int = 0
    latched: int = 0
    late: int = 0
    dropped_late: int = 0
    dropped_future: int = 0
    dropped_order: int = 0
    dropped_full: int = 0
    dropped_state: int = 0
    flushed: int = 0
    timeouts: int = 0

    def drop(self, reason: Drop) -> None:
        """Count a stream frame that was not queued."""
        setattr(self, reason.value, getattr(self, reason.value) + 1)


@dataclass(slots=True)
class BoardArrivalMargins:
    """Arrival margin, t_apply - ready, since it was last read."""

    count: int = 0
    least_us: int = 0
    total_us: int = 0

    def add(self, margin_us: int) -> None:
        """Take one frame into account."""
        self.least_us = min(self.least_us, margin_us) if self.count else margin_us
        self.total_us += margin_us
        self.count += 1

    def take(self) -> tuple[int, int, int]:
        """Return count, least and mean, and reset them."""
        taken = self.count, self.least_us, self.total_us // self.count if self.count else 0
        self.count = self.least_us = self.total_us = 0
        return taken
