"""Bandwidth, and what a dwell of one millisecond delivers."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram.acoustics.levels.dynamics import Resonator
from haptogram.errors import ConfigurationError


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


@pytest.mark.parametrize(
    "make",
    [
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
