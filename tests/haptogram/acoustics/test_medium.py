"""Air: sound speed, density, absorption."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

import oracles
from haptogram.acoustics import Medium
from haptogram.acoustics.medium import NEPER_PER_DB, iso_9613_absorption_np_m
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
