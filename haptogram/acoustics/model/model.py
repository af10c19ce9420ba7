"""Array, medium and transducer together: everything that the field depends on but the drive."""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING, Self

from haptogram.acoustics.arrays import ComplexArray
from haptogram.acoustics.model.geometry import DEFAULT_PITCH_M, TransducerArray
from haptogram.acoustics.model.medium import Medium
from haptogram.acoustics.model.transducer import Transducer
from haptogram.errors import ConfigurationError
from haptogram.settings.frozen import dataclass

if TYPE_CHECKING:
    from haptogram.acoustics.model.calibration import Calibration


@dataclass(frozen=True, slots=True)
class AcousticModel:
    """The linear model of an array of transducers in a homogeneous free field.

    Time factor e^{-j w t}, outgoing wave e^{+j k r}, phasors are peak values.

    Attributes
    ----------
    array : TransducerArray
        Where the elements are.
    medium : Medium
        Fluid into which the elements radiate.
    transducer : Transducer
        The element, as a source.
    calibration : Calibration or None
        Gains and phases of the elements, see :meth:`calibrated`; None: all are equal.

    Raises
    ------
    ConfigurationError
        A calibration of another number of elements.

    Examples
    --------
    >>> f"{1e3 * model.wavelength_m:.2f} mm"
    '8.60 mm'
    """

    array: TransducerArray
    medium: Medium
    transducer: Transducer
    calibration: Calibration | None = None

    def __post_init__(self) -> None:
        if self.calibration is not None and self.calibration.count != self.array.count:
            raise ConfigurationError(
                f"calibration of {self.calibration.count}, array of {self.array.count} elements"
            )

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

    def calibrated(self, calibration: Calibration) -> Self:
        """Return the model whose elements have the places and responses of *calibration*.

        A calibration that the model already has is replaced.

        Raises
        ------
        ConfigurationError
            The calibration is not of this array (:meth:`Calibration.moved`).
        """
        array = calibration.moved(self.array)
        return dataclasses.replace(self, array=array, calibration=calibration)

    def with_sound_speed(self, speed_m_s: float) -> Self:
        """Return the model with another speed of sound, in m/s."""
        medium = dataclasses.replace(self.medium, sound_speed_m_s=speed_m_s)
        return dataclasses.replace(self, medium=medium)

    @property
    def response(self) -> ComplexArray | None:
        """(N,) factors from the weights to the radiated amplitudes; None: all are 1."""
        return None if self.calibration is None else self.calibration.response

    def radiated(self, weights: ComplexArray) -> ComplexArray:
        """Return (..., N) weights times the response of the elements."""
        response = self.response
        return weights if response is None else weights * response

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
