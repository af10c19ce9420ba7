"""The air that the sound goes through."""

from __future__ import annotations

import functools
import math
from typing import Final, Self

from haptogram.errors import ConfigurationError
from haptogram.settings.arguments import check_number, check_positive
from haptogram.settings.frozen import dataclass

NEPER_PER_DB: Final = math.log(10.0) / 20.0

_KELVIN: Final = 273.15
_T_REFERENCE_K: Final = 293.15
_T_TRIPLE_K: Final = 273.16
_P_REFERENCE_PA: Final = 101_325.0
_GAS_CONSTANT_AIR: Final = 287.05  # J/(kg K), dry air
_LIGHTER_WATER: Final = 0.378  # 1 less the molar mass of water over that of dry air
#: Molar share of carbon dioxide that IEC 61094-2:2009, annex F, recommends for a laboratory.
_CARBON_DIOXIDE: Final = 4e-4
#: Up to this molar share of water Cramer's equation is within 0.15 m/s of the real gas.
_MOST_WATER: Final = 0.08
_HUMIDITY_PERCENT: Final = 50.0  # default humidity of air
#: Air that :func:`air_temperature_c` can name.
_COLDEST_C: Final = -90.0
_HOTTEST_C: Final = 90.0


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
    '347.0 m/s'
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
        relative_humidity_percent: float = _HUMIDITY_PERCENT,
        pressure_pa: float = 101_325.0,
        frequency_hz: float = 40e3,
    ) -> Self:
        """Return air at the given state.

        Speed of sound: O. Cramer, J. Acoust. Soc. Am. 93(5), 2510, 1993, equation (15), with the
        water vapour and the 0.04 % of carbon dioxide of IEC 61094-2:2009, annex F.  Stated for 0 to
        30 degrees, 75 to 102 kPa and 6 % of water; beyond, within 0.15 m/s of the real gas.
        Density: ideal gas p (1 - 0.378 x) / (287.05 T), x the molar share of water.  Absorption:
        :func:`iso_9613_absorption_np_m`.

        Raises
        ------
        ConfigurationError
            Outside -20 to 50 degrees Celsius, 10 to 100 % relative humidity, 50 to 200 kPa, or more
            than 8 % of the molecules are water.
        """
        absorption = iso_9613_absorption_np_m(
            temperature_c, relative_humidity_percent, pressure_pa, frequency_hz
        )
        water = _air_water_share(temperature_c, relative_humidity_percent, pressure_pa)
        if water > _MOST_WATER:
            most = relative_humidity_percent * _MOST_WATER / water
            raise ConfigurationError(
                f"relative_humidity_percent is {relative_humidity_percent:g}, must be at most "
                f"{most:.0f} at {temperature_c:g} degrees Celsius and {pressure_pa:g} Pa: the "
                f"speed of sound is known up to {_MOST_WATER:.0%} of water"
            )
        dry = pressure_pa / (_GAS_CONSTANT_AIR * (temperature_c + _KELVIN))
        return cls(
            sound_speed_m_s=_cramer_speed_m_s(temperature_c, pressure_pa, water),
            density_kg_m3=dry * (1.0 - _LIGHTER_WATER * water),
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
    """Return the temperature of air of 50 % humidity with this speed of sound, in degrees Celsius.

    The inverse of :meth:`Medium.air`; -90 to 90 degrees, the nearer end for other speeds.

    Examples
    --------
    >>> round(air_temperature_c(346.0), 1)
    23.2
    """
    low, high = _COLDEST_C, _HOTTEST_C
    for _ in range(40):
        middle = 0.5 * (low + high)
        if _humid_speed_m_s(middle, _HUMIDITY_PERCENT) < sound_speed_m_s:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@functools.lru_cache(maxsize=64)
def air_speed_uncertainty(medium: Medium, temperature_c: float, humidity_percent: float) -> float:
    """Return the relative change of the speed of sound for a change of the air.

    Parameters
    ----------
    medium : Medium
        Taken for air of 50 % humidity at standard pressure.
    temperature_c, humidity_percent : float
        Changes either way: degrees, and % of relative humidity.

    Returns
    -------
    float
        The largest over both, by :meth:`Medium.air`.

    Examples
    --------
    >>> round(air_speed_uncertainty(Medium.air(20.0), 1.0, 0.0), 5)
    0.00182
    """
    here_c = air_temperature_c(medium.sound_speed_m_s)
    here = _humid_speed_m_s(here_c, _HUMIDITY_PERCENT)
    colder, warmer = (here_c + way * temperature_c for way in (-1.0, 1.0))
    least = _humid_speed_m_s(colder, _HUMIDITY_PERCENT - humidity_percent)
    most = _humid_speed_m_s(warmer, _HUMIDITY_PERCENT + humidity_percent)
    return max(here / least, most / here) - 1.0


def _humid_speed_m_s(temperature_c: float, humidity_percent: float) -> float:
    """Return the speed of sound at standard pressure; temperature and humidity are not checked."""
    water = _air_water_share(temperature_c, humidity_percent, _P_REFERENCE_PA)
    return _cramer_speed_m_s(temperature_c, _P_REFERENCE_PA, water)


def _air_water_share(temperature_c: float, humidity_percent: float, pressure_pa: float) -> float:
    """Return the molar share of water vapour.  IEC 61094-2:2009, annex F (R. S. Davis, 1992)."""
    kelvin = temperature_c + _KELVIN
    saturated_pa = math.exp(
        1.2378847e-5 * kelvin**2 - 1.9121316e-2 * kelvin + 33.93711047 - 6343.1645 / kelvin
    )
    enhancement = 1.00062 + 3.14e-8 * pressure_pa + 5.6e-7 * temperature_c**2
    return humidity_percent / 100.0 * enhancement * saturated_pa / pressure_pa


def _cramer_speed_m_s(
    temperature_c: float, pressure_pa: float, water: float, carbon: float = _CARBON_DIOXIDE
) -> float:
    """Return the speed of sound by Cramer's equation (15); *water*, *carbon*: molar shares."""
    t, p = temperature_c, pressure_pa
    return (
        (331.5024 + 0.603055 * t - 0.000528 * t**2)
        + (51.471935 + 0.1495874 * t - 0.000782 * t**2) * water
        + (-1.82e-7 + 3.73e-8 * t - 2.93e-10 * t**2) * p
        + (-85.20931 - 0.228525 * t + 5.91e-5 * t**2) * carbon
        + (-2.835149 * water**2 - 2.15e-13 * p**2 + 29.179762 * carbon**2)
        + 0.000486 * water * p * carbon
    )


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
    """Return the attenuation of ISO 9613-1, (5); *pressure* is relative, *water* in percent."""
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
