"""Array, medium and transducer together: everything that the field depends on but the drive."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

from haptogram.acoustics.geometry import DEFAULT_PITCH_M, TransducerArray
from haptogram.acoustics.medium import Medium
from haptogram.acoustics.transducer import Transducer


@dataclass(frozen=True, slots=True)
class AcousticModel:
    """The linear model of an array of equal transducers in a homogeneous free field.

    Time factor e^{-j w t}, outgoing wave e^{+j k r}, phasors are peak values.
    """

    array: TransducerArray
    medium: Medium
    transducer: Transducer

    @classmethod
    def default(
        cls,
        nx: int = 16,
        ny: int = 16,
        pitch_m: float = DEFAULT_PITCH_M,
        temperature_c: float = 20.0,
    ) -> Self:
        """Return a grid of 4.70 mm pistons of 3.10 Pa m RMS at 40 kHz, in air of 50 % humidity."""
        transducer = Transducer()
        return cls(
            TransducerArray.grid(nx, ny, pitch_m=pitch_m),
            Medium.air(temperature_c, frequency_hz=transducer.frequency_hz),
            transducer,
        )

    @property
    def frequency_hz(self) -> float:
        """Carrier frequency."""
        return self.transducer.frequency_hz

    @property
    def wavenumber(self) -> float:
        """k, in rad/m."""
        return self.medium.wavenumber(self.transducer.frequency_hz)

    @property
    def wavelength_m(self) -> float:
        """Wavelength in the medium, in metres."""
        return 2.0 * math.pi / self.wavenumber
