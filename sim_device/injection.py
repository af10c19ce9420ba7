"""The faults of a plan at work on one board: what they change, and how often."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from .clock import earliest
from .device_faults import Situation, faulty, place_of
from .faults import Fault, FaultPlan, is_of_transducers
from .latch import FaultsCounted, Latch
from .line_faults import Chunk
from .settings import BoardSettings


class Injection:
    """Applies a plan, and counts.

    Raises
    ------
    ConfigurationError
        If a fault is to be in a place that the array does not have.
    """

    def __init__(self, plan: FaultPlan, settings: BoardSettings) -> None:
        self.plan = plan
        self.counts = {fault.name: 0 for fault in plan.faults}
        self._places = [
            place_of(fault, settings) if is_of_transducers(fault.name) else slice(0, 0)
            for fault in plan.faults
        ]
        self._disconnects = list(plan.named("line.disconnect"))
        self._away: Fault | None = None
        self._before: Latch | None = None
        self._reached: dict[int, NDArray[np.complex128]] = {}

    def line(self, direction: str, t_ns: int, data: bytes) -> list[Chunk]:
        """Return what becomes of *data* on the line."""
        chunks, fired = self.plan.line(direction, t_ns, data)
        for name, count in fired.items():
            self.counts[name] += count
        return chunks

    # --- the port ------------------------------------------------------------------------------

    @property
    def is_away(self) -> bool:
        """Whether the port is gone, as of the last :meth:`has_left`."""
        return self._away is not None

    def has_left(self, t_ns: int) -> bool:
        """Return whether the port has gone since the last call; see ``line.disconnect``."""
        before = self._away
        self._away = next((fault for fault in self._disconnects if fault.is_there(t_ns)), None)
        left = self._away is not None and before is None
        if left:
            self.counts["line.disconnect"] += 1
        return left

    def next_change_ns(self, t_ns: int) -> int | None:
        """Return when the port next goes or comes back after *t_ns*."""
        times = [t for fault in self._disconnects for t in (fault.from_ns, fault.until_ns)]
        return earliest(*(t for t in times if t > t_ns))

    # --- transducers ---------------------------------------------------------------------------

    def radiate(self, latch: Latch, t_ns: int) -> Latch:
        """Return *latch* with what its faulty transducers radiate; what is latched stays."""
        radiated = latch.radiated
        for number, fault, source in self.plan.of_device(t_ns):
            now = Situation(
                healthy=latch.radiated,
                drive=radiated,
                before=self._before,
                t_us=latch.t_latch_us,
                place=self._places[number],
                reached=self._reached.get(number),
            )
            changed = faulty(fault, now, source)
            if now.reached is not None:
                self._reached[number] = now.reached
            if changed != radiated:
                self.counts[fault.name] += 1
                radiated = changed
        self._before = latch
        return (
            latch if radiated is latch.radiated else dataclasses.replace(latch, radiated=radiated)
        )

    def counted(self, t_us: int) -> FaultsCounted:
        """Return how often each fault has done something."""
        return FaultsCounted(t_us, dict(self.counts), self.plan.as_toml())
