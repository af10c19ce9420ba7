"""Duty, bandwidth, and what a dwell of one millisecond delivers."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram.acoustics import AcousticModel, focus_phases, pressure
from haptogram.acoustics.levels.dynamics import (
    Resonator,
    amplitude_to_duty,
    duty_to_amplitude,
    pressure_after_hop,
)
from haptogram.errors import ConfigurationError
from strategies_acoustics import seeds, targets

HOP = ((-0.02, 0.0, 0.1), (0.02, 0.0, 0.1))


@given(st.floats(0.0, 0.5))
def test_the_amplitude_is_the_fundamental_of_the_pulse_train(duty):
    """Against a sum over one sampled period, relative to that of a square wave."""
    samples = 20_000
    phases = 2j * np.pi * (np.arange(samples) + 0.5) / samples
    high = np.arange(samples) < round(duty * samples)
    square = np.arange(samples) < samples // 2
    fundamental = abs(np.exp(phases) @ high) / abs(np.exp(phases) @ square)
    assert duty_to_amplitude(duty) == pytest.approx(fundamental, abs=2e-4)


@given(st.floats(0.0, 1.0))
def test_duty_and_amplitude_are_inverse(amplitude):
    assert duty_to_amplitude(amplitude_to_duty(amplitude)) == pytest.approx(amplitude, abs=1e-12)


@pytest.mark.parametrize(
    ("bits", "expected"), [(3, 0.0975), (4, 0.0490), (5, 0.0245), (6, 0.0123), (8, 0.00307)]
)
def test_a_counted_duty_errs_by_half_its_largest_step(bits, expected):
    """2^b steps in half a period: the first step of the sine is the largest."""
    table = duty_to_amplitude(np.arange(2**bits + 1) / 2 ** (bits + 1))
    assert np.diff(table).max() / 2 == pytest.approx(expected, abs=6e-5)
    wanted = np.append(np.linspace(0.0, 1.0, 14_000), (table[:-1] + table[1:]) / 2)
    errors = np.abs(table[:, None] - wanted).min(axis=0)
    assert errors.max() == pytest.approx(np.diff(table).max() / 2, rel=1e-12)


# tau, residual after 1 ms, mean square over 1 ms from rest, 200 Hz sideband
@pytest.mark.parametrize(
    ("bandwidth", "quality", "left", "mean", "sideband"),
    [
        (2000.0, 34.6, 0.027, 0.601, 0.945),
        (1200.0, 57.7, 0.113, 0.412, 0.866),
        (1000.0, 69.3, 0.163, 0.345, 0.822),
    ],
)
def test_a_narrow_transducer_delivers_part_of_a_dwell(bandwidth, quality, left, mean, sideband):
    resonator = Resonator.from_bandwidth(bandwidth)
    assert math.pi * 40e3 * resonator.time_constant_s == pytest.approx(quality, abs=0.1)
    assert resonator.decay(1e-3) == pytest.approx(left, abs=1e-3)
    assert resonator.dwell_mean_square(1e-3) == pytest.approx(mean, abs=1e-3)
    assert resonator.modulation_response(200.0) == pytest.approx(sideband, abs=1e-3)


def test_a_resonance_of_that_quality_is_6_db_down_at_the_edges_of_its_band():
    """The response of an RLC resonator itself, not of the first-order lag."""
    quality = math.pi * 40e3 * Resonator.from_bandwidth(2000.0).time_constant_s
    detuning = 41e3 / 40e3 - 40e3 / 41e3
    assert 1.0 / math.hypot(1.0, quality * detuning) == pytest.approx(0.5, abs=0.01)


@given(st.floats(1e-5, 1e-2), st.floats(1e-5, 5e-3))
def test_the_dwell_integral_agrees_with_a_sum(dwell, tau):
    times = dwell * (np.arange(20_000) + 0.5) / 20_000
    expected = np.mean((1.0 - np.exp(-times / tau)) ** 2)
    assert Resonator(tau).dwell_mean_square(dwell) == pytest.approx(expected, rel=1e-5, abs=1e-12)


@given(st.integers(1, 7), st.integers(0, 100))
def test_the_envelope_does_not_depend_on_the_sampling(samples, seed):
    rng = np.random.default_rng(seed)
    commands = rng.normal(size=(5, 3)) + 1j * rng.normal(size=(5, 3))
    resonator = Resonator.from_bandwidth()
    coarse = resonator.envelope(commands, 1e-3, 1)
    fine = resonator.envelope(commands, 1e-3, samples)
    assert fine[samples - 1 :: samples] == pytest.approx(coarse, abs=1e-12)


def test_the_envelope_obeys_its_equation():
    commands, resonator = np.array([1.0, 1j, 0.0]), Resonator(3e-4)
    fine = resonator.envelope(commands, 1e-3, 1000)
    slope = np.diff(fine) / 1e-6
    held = np.repeat(commands, 1000)[1:]
    inside = np.arange(1, 3000) % 1000 != 0  # not across the end of a frame
    middle = (fine[1:] + fine[:-1]) / 2
    assert (3e-4 * slope)[inside] == pytest.approx((held - middle)[inside], abs=1e-5)


def test_an_immediate_transducer_follows_at_once():
    still = Resonator(0.0)
    assert (still.envelope([1.0, 0.0], 1e-3, 2) == [1.0, 1.0, 0.0, 0.0]).all()
    assert still.dwell_mean_square(1e-3) == 1.0
    assert (still.decay(0.0), still.decay(1e-9)) == (1.0, 0.0)


def test_a_hop_takes_its_travel_time_and_then_its_rise_time():
    model, resonator = AcousticModel.default(), Resonator.from_bandwidth()
    times = np.arange(0.0, 3e-3, 1e-6)
    response = pressure_after_hop(model, resonator, HOP, times)
    assert times[np.argmax(response > 0.5)] == pytest.approx(0.545e-3, abs=5e-6)
    assert times[np.argmax(response > 0.9)] == pytest.approx(0.990e-3, abs=5e-6)
    assert response[-1] == pytest.approx(1.0, abs=2e-3)


def test_one_millisecond_after_a_hop_delivers_a_third_to_a_half_of_the_force():
    model, resonator = AcousticModel.default(), Resonator.from_bandwidth()
    dwell = 1e-3 * (np.arange(4000) + 0.5) / 4000
    nearest = np.linalg.norm(np.array(HOP[1]) - model.array.positions_m, axis=1).min()
    for start, share in ((0.0, 0.283), (nearest / model.medium.sound_speed_m_s, 0.543)):
        pressures = pressure_after_hop(model, resonator, HOP, start + dwell)
        assert np.mean(pressures**2) == pytest.approx(share, abs=4e-3)


@given(targets(), targets(), st.sampled_from([0.0, 2.8e-4]), seeds)
def test_nothing_is_heard_before_the_first_sound_arrives(old, new, tau, seed):
    """Causality: until the nearest element is heard nothing changes, not by a bit."""
    model = AcousticModel.default(6, 5)
    nearest = np.linalg.norm(new - model.array.positions_m, axis=1).min()
    arrival = nearest / model.medium.sound_speed_m_s
    before = np.random.default_rng(seed).uniform(-1e-3, arrival, 10)
    response = pressure_after_hop(model, Resonator(tau), (old, new), before)
    assert np.ptp(response) == 0.0
    fields = [np.exp(1j * focus_phases(model, place)) for place in (old, new)]
    still, settled = np.abs(pressure(model, np.array(fields), [new]))[:, 0]
    assert response[0] == pytest.approx(still / settled, rel=1e-9, abs=1e-12)
    if np.linalg.norm(old - new) > 0.02:
        later = pressure_after_hop(model, Resonator(tau), (old, new), [arrival + 5e-5])
        assert later[0] != response[0]


@pytest.mark.parametrize(
    "make",
    [
        lambda: duty_to_amplitude(0.51),
        lambda: duty_to_amplitude(-0.01),
        lambda: amplitude_to_duty([0.2, 1.1]),
        lambda: amplitude_to_duty(math.nan),
        lambda: Resonator(-1e-3),
        lambda: Resonator.from_bandwidth(0.0),
        lambda: Resonator(1e-3).envelope([1.0], 0.0, 1),
        lambda: Resonator(1e-3).envelope([1.0], 1e-3, 0),
        lambda: Resonator(1e-3).dwell_mean_square(0.0),
    ],
)
def test_impossible_values_are_refused(make):
    with pytest.raises(ConfigurationError):
        make()
