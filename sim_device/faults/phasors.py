"""Phases and amplitudes of the transducers, as faults change them."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from haptogram.acoustics import Drive
from haptogram.acoustics.arrays import ComplexArray, FloatArray
from haptogram.acoustics.model.drive import FULL_AMPLITUDE

from ..board.events import AnyLatch, Latch

_CODES: Final = 256  # phase codes of a register


@dataclass(frozen=True, slots=True)
class FaultyPhasors:
    """Phases and amplitudes of all transducers.

    Attributes
    ----------
    turns : (N,) numpy.ndarray
        Lag in periods, 0 to 1; of what is silent as well.
    amplitudes : (N,) numpy.ndarray
        Share of the full amplitude.
    """

    turns: FloatArray
    amplitudes: FloatArray

    @classmethod
    def of_weights(cls, weights: ComplexArray) -> FaultyPhasors:
        """Return the phasors of complex weights."""
        return cls(np.angle(weights) / math.tau % 1.0, np.abs(weights))

    @classmethod
    def of_latch(cls, latch: AnyLatch) -> FaultyPhasors:
        """Return the phasors that *latch* radiates."""
        if isinstance(latch, Latch):
            drive = latch.radiated
            return cls(drive.phase_codes / _CODES, drive.amplitude_codes / FULL_AMPLITUDE)
        return cls.of_weights(latch.weights())

    def weights(self) -> ComplexArray:
        """Return the (N,) complex weights."""
        weights: ComplexArray = self.amplitudes * np.exp(1j * math.tau * self.turns)
        return weights

    def as_drive(self) -> Drive:
        """Return the drive in the 8 bits of the registers that is nearest."""
        phases = np.floor(self.turns * _CODES + 0.5) % _CODES
        amplitudes = np.floor(self.amplitudes * FULL_AMPLITUDE + 0.5)
        return Drive(phases.astype(np.uint8), amplitudes.astype(np.uint8))

    def on(self, latch: AnyLatch) -> AnyLatch:
        """Return *latch* as one that radiates this."""
        if isinstance(latch, Latch):
            return dataclasses.replace(latch, radiated=self.as_drive())
        return dataclasses.replace(latch, radiated=self.weights(), is_faulty=True)
