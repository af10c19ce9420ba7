"""The air that the sound goes through."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Self

from haptogram.errors import ConfigurationError
from haptogram.settings.arguments import check_number, check_positive

NEPER_PER_DB: Final = math.log(10.0) / 20.0

_KELVIN: Final = 273.15
_T_REFERENCE_K: Final = 293.15
_T_TRIPLE_K: Final = 273.16
_P_REFERENCE_PA: Final = 101_325.0
_GAS_CONSTANT_AIR: Final = 287.05  # J/(kg K), dry air
_SOUND_SPEED_20C_M_S: Final = 343.2


@dataclass(frozen=True, slots=True)
class Medium:
    """A lossy fluid.

    Attributes
    ----------
    sound_speed_m_s, density_kg_m3 : float
        Speed of sound and density.
    absorption_np_m : float
        Pure-tone attenuation of the amplitude at the carrier, in nepers per metre.

    Raises
    ------
    ConfigurationError
        A speed or density that is not above zero, an absorption below zero.

    Examples
    --------
    >>> air = Medium.air(temperature_c=25.0, relative_humidity_percent=40.0)
    >>> f"{air.sound_speed_m_s:.1f} m/s"
    '346.1 m/s'
    """

    sound_speed_m_s: float
    density_kg_m3: float
    absorption_np_m: float = 0.0

    def __post_init__(self) -> None:
        check_positive("sound_speed_m_s", self.sound_speed_m_s)
        check_positive("density_kg_m3", self.density_kg_m3)
        check_number("absorption_np_m", self.absorption_np_m, 0.0, 100.0)

    @classmethod
    def air(
        cls,
        temperature_c: float = 20.0,
        relative_humidity_percent: float = 50.0,
        pressure_pa: float = 101_325.0,
        frequency_hz: float = 40e3,
    ) -> Self:
        """Return air at the given state.

        Speed c = 343.2 sqrt(T / 293.15) m/s (ISO 9613-1:1993, 8.2), density of dry air
        p / (287.05 T), absorption of :func:`iso_9613_absorption_np_m`.

        Raises
        ------
        ConfigurationError
            Outside -20 to 50 degrees Celsius, 10 to 100 % relative humidity, 50 to 200 kPa.
        """
        absorption = iso_9613_absorption_np_m(
            temperature_c, relative_humidity_percent, pressure_pa, frequency_hz
        )
        kelvin = temperature_c + _KELVIN
        return cls(
            sound_speed_m_s=_SOUND_SPEED_20C_M_S * math.sqrt(kelvin / _T_REFERENCE_K),
            density_kg_m3=pressure_pa / (_GAS_CONSTANT_AIR * kelvin),
            absorption_np_m=absorption,
        )

    @property
    def impedance(self) -> float:
        """Characteristic impedance rho c, in Pa s/m."""
        return self.density_kg_m3 * self.sound_speed_m_s

    def wavenumber(self, frequency_hz: float) -> float:
        """Return k = 2 pi f / c, in rad/m."""
        return 2.0 * math.pi * check_positive("frequency_hz", frequency_hz) / self.sound_speed_m_s


def air_temperature_c(sound_speed_m_s: float) -> float:
    """Return the temperature of air with this speed of sound, in degrees Celsius.

    The inverse of :meth:`Medium.air` (ISO 9613-1:1993, 8.2).

    Examples
    --------
    >>> round(air_temperature_c(346.0), 1)
    24.8
    """
    kelvin = _T_REFERENCE_K * (sound_speed_m_s / _SOUND_SPEED_20C_M_S) ** 2
    return kelvin - _KELVIN


def air_speed_uncertainty(medium: Medium, temperature_c: float, humidity_percent: float) -> float:
    """Return the relative change of the speed of sound for a change of the air.

    c is in proportion to the root of the absolute temperature.  Of humidity,
    c / c_dry = sqrt((7 + h) / (5 + h) 5/7 29 / (29 - 11 h)), h the molar share of water vapour
    (D. A. Bohn, J. Audio Eng. Soc. 36(4), 1988), at standard pressure; :meth:`Medium.air` leaves it
    out, as ISO 9613-1 does.

    Parameters
    ----------
    temperature_c, humidity_percent : float
        Changes either way: degrees, below the absolute temperature, and % of relative humidity.

    Returns
    -------
    float
        The sum of both.

    Examples
    --------
    >>> round(air_speed_uncertainty(Medium.air(20.0), 1.0, 0.0), 5)
    0.00171
    """
    kelvin = _T_REFERENCE_K * (medium.sound_speed_m_s / _SOUND_SPEED_20C_M_S) ** 2
    colder = 1.0 / math.sqrt(1.0 - temperature_c / kelvin) - 1.0  # more than warmer
    water = humidity_percent / 100.0 * _air_saturation_pressure(kelvin)
    ratio = (7.0 + water) / (5.0 + water) * 5.0 / 7.0 * 29.0 / (29.0 - 11.0 * water)
    return colder + math.sqrt(ratio) - 1.0


def iso_9613_absorption_np_m(
    temperature_c: float,
    relative_humidity_percent: float,
    pressure_pa: float,
    frequency_hz: float,
) -> float:
    """Return the pure-tone attenuation coefficient of air, in nepers per metre.

    Source: ISO 9613-1:1993, equations (3) to (5), with annex B for the water vapour.

    Raises
    ------
    ConfigurationError
        Outside -20 to 50 degrees Celsius, 10 to 100 % relative humidity, 50 to 200 kPa, or a ratio
        of frequency to pressure outside 4e-4 to 10 Hz/Pa: the ranges for which the standard states
        an accuracy (10 %, or 20 % beyond a molar water content of 5 %).

    Examples
    --------
    >>> f"{iso_9613_absorption_np_m(20.0, 50.0, 101_325.0, 40e3):.3f} Np/m"
    '0.152 Np/m'
    """
    check_number("temperature_c", temperature_c, -20.0, 50.0)
    check_number("relative_humidity_percent", relative_humidity_percent, 10.0, 100.0)
    check_number("pressure_pa", pressure_pa, 50e3, 200e3)
    ratio = check_positive("frequency_hz", frequency_hz) / pressure_pa
    if not 4e-4 <= ratio <= 10.0:
        raise ConfigurationError(
            f"frequency_hz / pressure_pa is {ratio:.3g} Hz/Pa, must be 0.0004 to 10 (ISO 9613-1)"
        )
    kelvin = temperature_c + _KELVIN
    pressure = pressure_pa / _P_REFERENCE_PA
    water = relative_humidity_percent * _air_saturation_pressure(kelvin) / pressure
    return NEPER_PER_DB * _air_attenuation_db_m(kelvin, pressure, water, frequency_hz)


def _air_saturation_pressure(kelvin: float) -> float:
    """Return the saturation vapour pressure over the reference pressure.  ISO 9613-1, B.2, B.3."""
    exponent: float = -6.8346 * (_T_TRIPLE_K / kelvin) ** 1.261 + 4.6151
    return float(10.0**exponent)


def _air_attenuation_db_m(
    kelvin: float, pressure: float, water: float, frequency_hz: float
) -> float:
    """Return equation (5), in dB/m; *pressure* is relative, *water* a molar percentage."""
    warmth = kelvin / _T_REFERENCE_K
    oxygen_hz = pressure * (24.0 + 4.04e4 * water * (0.02 + water) / (0.391 + water))
    nitrogen_hz = (
        pressure
        / math.sqrt(warmth)
        * (9.0 + 280.0 * water * math.exp(-4.170 * (warmth ** (-1.0 / 3.0) - 1.0)))
    )
    square = frequency_hz**2
    classical = 1.84e-11 / pressure * math.sqrt(warmth)
    oxygen = 0.01275 * math.exp(-2239.1 / kelvin) / (oxygen_hz + square / oxygen_hz)
    nitrogen = 0.1068 * math.exp(-3352.0 / kelvin) / (nitrogen_hz + square / nitrogen_hz)
    return float(8.686 * square * (classical + warmth**-2.5 * (oxygen + nitrogen)))
