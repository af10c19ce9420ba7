"""Air: sound speed, density, absorption."""

import math

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import oracles
from haptogram.acoustics import Medium
from haptogram.acoustics.model.medium import (
    NEPER_PER_DB,
    _air_water_share,
    _cramer_speed_m_s,
    air_temperature_c,
    iso_9613_absorption_np_m,
)
from haptogram.errors import ConfigurationError

SCALARS = oracles.reference_fields()["scalars"]


@pytest.mark.parametrize("case", SCALARS["iso9613_dB_per_m_40kHz"])
def test_absorption_at_40_khz_agrees_with_the_reference(case):
    air = Medium.air(float(case["T_C"]), float(case["RH"]), float(case["p_kPa"]) * 1e3)
    assert air.absorption_np_m == pytest.approx(float(case["Np_per_m"]), rel=1e-12)


@pytest.mark.parametrize("case", SCALARS["iso9613_check_table"])
def test_absorption_agrees_with_the_table_of_the_standard(case):
    value = iso_9613_absorption_np_m(
        float(case["T_C"]), float(case["RH"]), 101_325.0, float(case["f"])
    )
    assert value / NEPER_PER_DB * 1e3 == pytest.approx(float(case["dB_per_km"]), rel=1e-7)


def test_the_printed_value_of_the_standard():
    """ISO 9613-1 table 1: 4.66 dB/km at 1 kHz, 20 degrees, 50 %."""
    value = iso_9613_absorption_np_m(20.0, 50.0, 101_325.0, 1000.0)
    assert round(value / NEPER_PER_DB * 1e3, 2) == 4.66


# ISO 9613-2:1996, table 2, which was computed by ISO 9613-1: dB/km at one atmosphere, in the octave
# bands around 63 Hz to 8 kHz; by temperature and relative humidity.
OCTAVES = {
    (10, 70): (0.1, 0.4, 1.0, 1.9, 3.7, 9.7, 32.8, 117),
    (20, 70): (0.1, 0.3, 1.1, 2.8, 5.0, 9.0, 22.9, 76.6),
    (30, 70): (0.1, 0.3, 1.0, 3.1, 7.4, 12.7, 23.1, 59.3),
    (15, 20): (0.3, 0.6, 1.2, 2.7, 8.2, 28.2, 88.8, 202),
    (15, 50): (0.1, 0.5, 1.2, 2.2, 4.2, 10.8, 36.2, 129),
    (15, 80): (0.1, 0.3, 1.1, 2.4, 4.1, 8.3, 23.7, 82.8),
}


@pytest.mark.parametrize(("state", "printed"), OCTAVES.items())
def test_the_printed_table_of_the_octave_bands(state, printed):
    """To the last digit that is printed, at the exact middle of each band, 10^(3 n / 10) kHz."""
    for n, expected in enumerate(printed, start=-4):
        value = iso_9613_absorption_np_m(*state, 101_325.0, 1000.0 * 10.0 ** (0.3 * n))
        digit = 1.0 if expected > 100 else 0.1
        assert value / NEPER_PER_DB * 1e3 == pytest.approx(expected, abs=0.52 * digit)


# Temperature, relative humidity, pressure; the speed of sound as printed.
PRINTED = [
    (23.0, 50.0, 101_325.0, "345.86652"),  # IEC 61094-2:2009, table F.1
    (20.0, 65.0, 80_000.0, "344.38267"),
    (20.0, 50.0, 101_325.0, "343.99"),  # Cramer's equation, computed by others
    (25.0, 50.0, 101_325.0, "347.13"),
    (30.0, 60.0, 101_325.0, "350.54"),
    (45.0, 50.0, 101_325.0, "360.31"),
]


@pytest.mark.parametrize(("celsius", "humidity", "pressure_pa", "printed"), PRINTED)
def test_the_speed_of_sound_of_humid_air_is_the_printed_one(
    celsius, humidity, pressure_pa, printed
):
    speed = Medium.air(celsius, humidity, pressure_pa).sound_speed_m_s
    assert f"{speed:.{len(printed.partition('.')[2])}f}" == printed


def test_dry_air_of_0_degrees_has_cramers_own_speed_of_sound():
    assert round(_cramer_speed_m_s(0.0, 101_325.0, 0.0, carbon=0.000314), 2) == 331.45


@given(st.floats(-20.0, 50.0), st.floats(10.0, 100.0), st.floats(50e3, 200e3))
def test_the_speed_of_sound_is_that_of_the_real_gas(celsius, humidity, pressure_pa):
    """Heat capacities of the molecules and second virial coefficients, nothing fitted."""
    assume(_air_water_share(celsius, humidity, pressure_pa) <= 0.08)
    speed = Medium.air(celsius, humidity, pressure_pa).sound_speed_m_s
    published = 0.0 <= celsius <= 30.0 and 75e3 <= pressure_pa <= 102e3
    expected = oracles.real_gas_speed_m_s(celsius, humidity, pressure_pa)
    assert speed == pytest.approx(expected, abs=0.04 if published else 0.15)


@pytest.mark.parametrize(
    ("celsius", "humidity", "pressure_pa", "printed"),
    [(23.0, 50.0, 101_325.0, 1.1860848), (20.0, 65.0, 80_000.0, 0.9441589)],  # table F.1
)
def test_the_density_is_that_of_humid_air(celsius, humidity, pressure_pa, printed):
    """An ideal gas: the real one is denser by 0.04 %."""
    air = Medium.air(celsius, humidity, pressure_pa)
    assert air.density_kg_m3 == pytest.approx(printed, rel=5e-4)


@given(st.floats(-20.0, 50.0))
def test_the_temperature_of_air_is_found_from_its_speed_of_sound(celsius):
    assert air_temperature_c(Medium.air(celsius).sound_speed_m_s) == pytest.approx(
        celsius, abs=1e-6
    )


def test_air_at_20_degrees():
    air = Medium.air()
    assert air == Medium.air(20.0, 50.0, 101_325.0, 40e3)
    assert air.impedance == pytest.approx(412.4, abs=0.05)
    assert Medium(343.2, 1.2).wavenumber(40e3) == pytest.approx(
        float(SCALARS["k_343p2"]), rel=1e-14
    )


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ({"temperature_c": -20.1}, "temperature_c is -20.1, must be -20 to 50"),
        ({"temperature_c": float("nan")}, "temperature_c is nan"),
        ({"relative_humidity_percent": 9.9}, "relative_humidity_percent is 9.9, must be 10 to 100"),
        ({"relative_humidity_percent": 101}, "must be 10 to 100"),
        ({"pressure_pa": 1013.0}, "pressure_pa is 1013, must be 50000 to 200000"),
        ({"frequency_hz": 5e6}, "must be 0.0004 to 10"),
        ({"frequency_hz": 0.0}, "frequency_hz is 0"),
        (
            {"temperature_c": 50.0, "relative_humidity_percent": 100.0},
            "percent is 100, must be at most 65 at 50 degrees Celsius and 101325 Pa",
        ),
    ],
)
def test_air_outside_the_range_of_the_formula_is_refused(arguments, complaint):
    with pytest.raises(ConfigurationError, match=complaint):
        Medium.air(**arguments)


@pytest.mark.parametrize("values", [(0.0, 1.2), (343.0, -1.0), (343.0, 1.2, -0.1), (math.inf, 1.2)])
def test_an_impossible_medium_is_refused(values):
    with pytest.raises(ConfigurationError):
        Medium(*values)


def test_a_wavenumber_needs_a_frequency():
    with pytest.raises(ConfigurationError, match="frequency_hz is -1"):
        Medium.air().wavenumber(-1.0)
