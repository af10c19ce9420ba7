"""The pulses of the captured pins, beside a latch."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final, TypeAlias

import numpy as np

from haptogram.acoustics.arrays import ComplexArray, FloatArray
from haptogram.records.pins import PinRecord
from haptogram.verification.pins.run_drives import fundamentals_of_run_drives

SETTLED: Final = 2.0  # periods after a latch until no pulse of the old drive is left
SHORTEST: Final = 3.0  # periods of a drive that are enough to know it
LONGEST: Final = 40.0  # periods of a drive that are looked at beside a latch
_STEADY: Final = 3.0  # samples by which the pulses of one drive may differ

_Pulses: TypeAlias = tuple[FloatArray, ComplexArray]


@dataclass
class LatchClausePulses:
    """Centre and fundamental of each pulse of a capture."""

    record: PinRecord

    @cached_property
    def _of_elements(self) -> dict[int, _Pulses]:
        """Return centres in periods and complex fundamentals of the pulses of each element."""
        return {
            element: fundamentals_of_run_drives(pin) for element, pin in self.record.pins.items()
        }

    @cached_property
    def tolerance(self) -> float:
        """By how much two pulses of one drive may differ."""
        return _STEADY * math.pi / self.record.samples

    def between(self, element: int, low: float, high: float) -> _Pulses:
        """Return centres and fundamentals of the pulses of *element* from *low* to *high*."""
        centres, vectors = self._of_elements[element]
        begin, end = np.searchsorted(centres, [low, high])
        return centres[begin:end], vectors[begin:end]

    def steady(self, element: int, low: float, high: float) -> complex | None:
        """Return the drive of *element* from *low* to *high*; None: it changes meanwhile."""
        _, vectors = self.between(element, low, high)
        if not len(vectors):
            return 0j
        if len(vectors) < math.floor(high - low) - 1:
            return None
        mean = complex(vectors.mean())
        return mean if np.abs(vectors - mean).max() <= self.tolerance else None
