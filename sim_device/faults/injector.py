"""The faults of a plan at work on one board: what they change, and how often.

The effect of a fault on a chunk follows from plan, seed, time and chunk alone, so the same traffic
meets the same faults again.
"""

from __future__ import annotations

import random
import zlib
from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from haptogram.settings.faults.kinds import is_transducer_fault
from haptogram.settings.faults.plan import Fault, FaultPlan

from ..board.clock import BoardClock, earliest_board_time
from ..board.events import AnyLatch, Counted
from ..board.settings import BoardSettings
from .clock import clock_fault_changes
from .frames import FRAME_FAULTS, REPORT_FAULTS
from .line import LINE_FAULTS, FaultChunk
from .transducers import FaultContext, FaultyPhasors, fault_place, faulty_drive

_LEAST: Final = 1e-9  # least difference of a weight that is no rounding
_ON_CHUNKS: Final = {**LINE_FAULTS, **FRAME_FAULTS, **REPORT_FAULTS}


def inject_on_line(
    plan: FaultPlan, direction: str, t_ns: int, data: bytes
) -> tuple[list[FaultChunk], dict[str, int]]:
    """Return the chunks that *data*, sent at *t_ns*, becomes, and how often each fault fired.

    Parameters
    ----------
    direction : str
        ``down`` to the board or ``up`` from it.
    """
    chunks, fired = [FaultChunk(t_ns, data)] if data else [], dict[str, int]()
    for number, fault in enumerate(plan.faults):
        act = _ON_CHUNKS.get(fault.name)
        if act is None or fault.direction not in ("both", direction):
            continue
        if fault.is_there(t_ns):
            source = _fault_random(plan, number, direction, t_ns, data)
            chunks, count = act(chunks, fault.values, source)
            chunks = [chunk for chunk in chunks if chunk.data]  # no fault acts on nothing
            fired[fault.name] = fired.get(fault.name, 0) + count
    return chunks, fired


def _faults_on_transducers(
    plan: FaultPlan, t_ns: int
) -> Iterator[tuple[int, Fault, random.Random]]:
    """Yield (number, fault, random source) of each transducer fault active at *t_ns*."""
    for number, fault in enumerate(plan.faults):
        if is_transducer_fault(fault.name) and fault.is_there(t_ns):
            yield number, fault, _fault_random(plan, number, "device", t_ns, b"")


def _fault_random(
    plan: FaultPlan, number: int, where: str, t_ns: int, data: bytes
) -> random.Random:
    """Return a random source that is the same for the same *data* at the same time.

    It differs for each fault *number* of the plan, and each *where*: the place at which it acts.
    """
    return random.Random(f"{plan.seed}/{number}/{where}/{t_ns}/{zlib.crc32(data)}")


class FaultInjector:
    """Applies a plan to one board, and counts how often each fault fires.

    Parameters
    ----------
    plan : FaultPlan
        Plan of the faults.
    settings : BoardSettings
        The board.
    clock : BoardClock
        Its clock, with the faults of *plan*.

    Raises
    ------
    ConfigurationError
        If a fault is to be in a place that the array does not have.
    """

    def __init__(self, plan: FaultPlan, settings: BoardSettings, clock: BoardClock) -> None:
        self.plan = plan
        self._counts = {fault.name: 0 for fault in plan.faults}
        self._on_clock = list(clock_fault_changes(plan, clock))
        self._places = [
            fault_place(fault, settings) if is_transducer_fault(fault.name) else slice(0, 0)
            for fault in plan.faults
        ]
        self._disconnects = list(plan.named("line.disconnect"))
        self._away: Fault | None = None
        self._acts_on_transducers = any(is_transducer_fault(fault.name) for fault in plan.faults)
        self._before: FaultyPhasors | None = None
        self._before_us = 0
        self._reached: dict[int, NDArray[np.complex128]] = {}

    def line(self, direction: str, t_ns: int, data: bytes) -> list[FaultChunk]:
        """Return the chunks that *data* becomes on the line, and count the faults."""
        chunks, fired = inject_on_line(self.plan, direction, t_ns, data)
        for name, count in fired.items():
            self._counts[name] += count
        return chunks

    # --- the port ------------------------------------------------------------------------------

    @property
    def is_away(self) -> bool:
        """True if the port was gone at the last :meth:`has_left`."""
        return self._away is not None

    def has_left(self, t_ns: int) -> bool:
        """Return True if the port has gone since the last call; see ``line.disconnect``."""
        before = self._away
        if before is None or not before.is_there(t_ns):
            self._away = next((fault for fault in self._disconnects if fault.is_there(t_ns)), None)
        if self._away is not None and self._away is not before:
            self._counts["line.disconnect"] += 1
        return self._away is not None and before is None

    def next_change_ns(self, t_ns: int) -> int | None:
        """Return when the port next goes or comes back after *t_ns*."""
        times = [t for fault in self._disconnects for t in (fault.from_ns, fault.until_ns)]
        return earliest_board_time(*(t for t in times if t > t_ns))

    # --- transducers ---------------------------------------------------------------------------

    def radiate(self, latch: AnyLatch, t_ns: int) -> AnyLatch:
        """Return *latch* with the drive that its faulty transducers radiate."""
        if not self._acts_on_transducers:
            return latch
        healthy = radiated = FaultyPhasors.of_latch(latch)
        for number, fault, source in _faults_on_transducers(self.plan, t_ns):
            now = FaultContext(
                healthy=healthy,
                drive=radiated,
                before=self._before,
                since_us=latch.t_latch_us - self._before_us,
                place=self._places[number],
                reached=self._reached.get(number),
            )
            changed = faulty_drive(fault, now, source)
            if now.reached is not None:
                self._reached[number] = now.reached
            # In the latch's own codes; the phase of what is silent is no difference.
            changed = FaultyPhasors.of_latch(changed.on(latch))
            if not np.allclose(changed.weights(), radiated.weights(), rtol=0.0, atol=_LEAST):
                self._counts[fault.name] += 1
                radiated = changed
        self._before, self._before_us = healthy, latch.t_latch_us
        return latch if radiated is healthy else radiated.on(latch)

    def counts(self, t_ns: int) -> dict[str, int]:
        """Return the counts of the faults that fired up to *t_ns*."""
        counts = dict(self._counts)
        for name, at_ns in self._on_clock:
            counts[name] += at_ns <= t_ns
        return counts

    def counted(self, t_us: int, t_ns: int) -> Counted:
        """Return the counts up to *t_ns*, at which the board's time is *t_us*."""
        return Counted(t_us, "faults", self.counts(t_ns), self.plan.as_toml())
