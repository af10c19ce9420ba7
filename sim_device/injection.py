"""The faults of a plan at work on one board: what they change, and how often."""

from __future__ import annotations

import dataclasses
import random

import numpy as np

from haptogram.acoustics import Drive
from haptogram.errors import ConfigurationError

from .faults import Fault, FaultPlan
from .latch import FaultsCounted, Latch
from .line_faults import Chunk
from .settings import BoardSettings


class Injection:
    """Applies a plan, and counts.

    Raises
    ------
    ConfigurationError
        If a fault is to be in a transducer or column that the array does not have.
    """

    def __init__(self, plan: FaultPlan, settings: BoardSettings) -> None:
        self.plan = plan
        self._settings = settings
        self.counts = {fault.name: 0 for fault in plan.faults}
        for fault in plan.faults:
            if fault.name.startswith("device."):
                self._place(fault)  # found out now, not at the first latch

    def line(self, direction: str, t_ns: int, data: bytes) -> list[Chunk]:
        """Return what becomes of *data* on the line."""
        chunks, fired = self.plan.line(direction, t_ns, data)
        for name, count in fired.items():
            self.counts[name] += count
        return chunks

    def radiate(self, latch: Latch, t_ns: int) -> Latch:
        """Return *latch* with what its faulty transducers radiate; what is latched stays."""
        radiated = latch.radiated
        for fault, source in self.plan.of_device(t_ns):
            faulty = self._faulty(radiated, fault, source)
            self.counts[fault.name] += faulty != radiated
            radiated = faulty
        return (
            latch if radiated is latch.radiated else dataclasses.replace(latch, radiated=radiated)
        )

    def counted(self, t_us: int) -> FaultsCounted:
        """Return how often each fault has done something."""
        return FaultsCounted(t_us, dict(self.counts))

    def _faulty(self, drive: Drive, fault: Fault, source: random.Random) -> Drive:
        place = self._place(fault)
        phases, amplitudes = drive.phase_codes.copy(), drive.amplitude_codes.copy()
        if fault.name == "device.stuck":
            phases[place] = round(fault.values["code"]) % 256
        elif fault.name == "device.delayed":
            phases[place] += np.uint8(round(fault.values["code"]) % 256)
        elif fault.name == "device.dead" or source.random() < fault.values["p"]:
            amplitudes[place] = 0
        return Drive(phases, amplitudes)

    def _place(self, fault: Fault) -> slice:
        count = self._settings.count
        columns, rows = self._settings.model.array.grid_shape or (0, 0)
        column, transducer = (round(fault.values[key]) for key in ("column", "transducer"))
        first, width, limit = (
            (transducer, 1, count) if transducer >= 0 else (column * rows, rows, columns * rows)
        )
        if first >= limit:
            has = f"{count} transducers in {columns} columns"
            raise ConfigurationError(f"{fault.name}: no such place; the array has {has}")
        return slice(first, first + width)
