"""Air: sound speed, density, absorption."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import oracles
from haptogram.acoustics import Medium
from haptogram.acoustics.model.medium import NEPER_PER_DB, iso_9613_absorption_np_m
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


@given(st.floats(-20.0, 50.0), st.floats(50e3, 200e3), st.floats(20e3, 200e3))
@settings(max_examples=20)
def test_air_is_an_ideal_gas_and_absorbs_by_its_own_state(temperature, pressure, frequency):
    air = Medium.air(temperature, 40.0, pressure, frequency)
    assert air.density_kg_m3 * 287.05 * (temperature + 273.15) == pytest.approx(pressure)
    assert air.impedance == pytest.approx(air.density_kg_m3 * air.sound_speed_m_s)
    assert air.absorption_np_m == iso_9613_absorption_np_m(temperature, 40.0, pressure, frequency)


def test_air_at_20_degrees():
    air = Medium.air()
    assert air.sound_speed_m_s == pytest.approx(343.2, rel=1e-12)
    assert air.density_kg_m3 == pytest.approx(1.2041, abs=5e-5)
    assert air.impedance == pytest.approx(413.25, abs=0.01)
    assert air.wavenumber(40e3) == pytest.approx(float(SCALARS["k_343p2"]), rel=1e-14)


@given(st.floats(-20.0, 50.0))
def test_sound_speed_follows_the_ideal_gas(temperature):
    """Within 0.1 % of sqrt(1.4 R T), which the formula does not contain."""
    ideal = math.sqrt(1.4 * 287.05 * (temperature + 273.15))
    assert Medium.air(temperature).sound_speed_m_s == pytest.approx(ideal, rel=1e-3)


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
