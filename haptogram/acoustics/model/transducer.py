"""One transducer: how strong it is and where it radiates."""

from __future__ import annotations

import math
from typing import ClassVar, Final, Protocol

import numpy as np

from haptogram.acoustics.arrays import FloatArray
from haptogram.errors import ConfigurationError
from haptogram.settings.arguments import check_number, check_positive, shown_argument
from haptogram.settings.frozen import dataclass, field

#: 2 J1(x) / x as a power series in x^2 / 4, and how far up it is exact in float64.
_SERIES: Final = [(-1) ** m / (math.factorial(m) * math.factorial(m + 1)) for m in range(18)]
_SERIES_REACH: Final = 4.0
#: Cosine of the angle to the axis below which a point is behind: far above what rounding makes of
#: 0 for an array that is turned, in single precision too.
GRAZING: Final = -1e-6


class Directivity(Protocol):
    """The far-field pattern of a source: real, 1 on its axis.

    Examples
    --------
    >>> pattern: Directivity = CircularPiston()
    >>> pattern.baffled, round(float(pattern.gain(np.array([1.0]), model.wavenumber)[0]), 6)
    (True, 1.0)
    """

    @property
    def baffled(self) -> bool:
        """True if the directivity is undefined in the half-space behind."""

    def gain(self, cos_theta: FloatArray, wavenumber: float) -> FloatArray:
        """Return the gain at the cosine of the angle to the axis; *wavenumber* in rad/m."""


@dataclass(frozen=True, slots=True)
class PointSource:
    """An omnidirectional source: gain 1 everywhere, behind it too.

    Examples
    --------
    >>> PointSource().gain(np.array([1.0, 0.0, -1.0]), model.wavenumber)
    array([1., 1., 1.])
    """

    baffled: ClassVar[bool] = False

    def gain(self, cos_theta: FloatArray, wavenumber: float) -> FloatArray:  # noqa: ARG002  (Directivity)
        """Return ones of the shape of *cos_theta*."""
        return np.ones_like(cos_theta)


@dataclass(frozen=True, slots=True)
class CircularPiston:
    """A rigid circular piston in a baffle.

    D = 2 J1(k a sin(theta)) / (k a sin(theta)) in front (Kinsler et al., Fundamentals of Acoustics,
    4th ed., section 7.4), 0 behind: the baffle shades the rear half-space.

    Attributes
    ----------
    radius_m : float
        Effective radius a; 4.70 mm gives the 80 degree beam (-6 dB) of a 10 mm, 40 kHz transducer.

    Examples
    --------
    >>> wide, narrow = CircularPiston(radius_m=0.002), CircularPiston(radius_m=0.0047)
    >>> cosines = np.cos(np.radians([0.0, 45.0]))
    >>> wide.gain(cosines, model.wavenumber).round(2).tolist()
    [1.0, 0.87]
    >>> narrow.gain(cosines, model.wavenumber).round(2).tolist()
    [1.0, 0.42]
    """

    baffled: ClassVar[bool] = True
    radius_m: float = 4.70e-3

    def __post_init__(self) -> None:
        check_positive("radius_m", self.radius_m)

    def gain(self, cos_theta: FloatArray, wavenumber: float) -> FloatArray:
        """Return D, of the shape of *cos_theta*."""
        size = (wavenumber * self.radius_m / 2.0) ** 2
        quarter = size * np.maximum(1.0 - cos_theta * cos_theta, 0.0)
        small = quarter if size <= _SERIES_REACH else np.minimum(quarter, _SERIES_REACH)
        gain = np.full_like(quarter, _SERIES[-1])
        for coefficient in _SERIES[-2::-1]:
            gain *= small
            gain += coefficient
        if size > _SERIES_REACH:
            gain = np.where(quarter > _SERIES_REACH, _large_piston_gain(quarter), gain)
        return np.where(cos_theta >= GRAZING, gain, 0.0)


def _large_piston_gain(quarter: FloatArray) -> FloatArray:
    """Return the directivity 2 J1(x) / x; *quarter* is x^2 / 4, 1 at least."""
    from scipy.special import j1  # slow to import, and only pistons larger than usual need it

    argument = 2.0 * np.sqrt(np.maximum(quarter, 1.0))
    gain: FloatArray = 2.0 * j1(argument) / argument
    return gain


@dataclass(frozen=True, slots=True)
class Transducer:
    """A transducer of an array.

    Attributes
    ----------
    directivity : Directivity
        Radiation pattern around the element's normal.
    source_strength_pa_m : float
        RMS pressure on the axis times the distance at full drive, in Pa m.
    frequency_hz : float
        Carrier frequency.

    Raises
    ------
    ConfigurationError
        An argument that is of another type, or a number that is out of its range.

    Examples
    --------
    >>> Transducer(CircularPiston(radius_m=0.0047), source_strength_pa_m=2.5).frequency_hz
    40000.0
    """

    directivity: Directivity = field(default_factory=CircularPiston)
    source_strength_pa_m: float = 3.10
    frequency_hz: float = 40e3

    def __post_init__(self) -> None:
        pattern = self.directivity
        if isinstance(pattern, type) or not hasattr(pattern, "baffled"):
            raise ConfigurationError(
                f"directivity is {shown_argument(pattern)}, must be one such as CircularPiston()"
            )
        check_positive("source_strength_pa_m", self.source_strength_pa_m)
        check_number("frequency_hz", self.frequency_hz, 1e3, 1e6)
