"""Weights of pulses against the fundamental of the square wave, by a sum over time."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram.acoustics.model.pulses import PulseDrive
from haptogram.errors import ConfigurationError


@st.composite
def pulses(draw):
    steps = draw(st.sampled_from([8, 10, 16, 24, 32, 128, 256]))
    count = draw(st.integers(1, 12))
    rises = draw(st.lists(st.integers(0, steps - 1), min_size=count, max_size=count))
    widths = draw(st.lists(st.integers(0, steps), min_size=count, max_size=count))
    return PulseDrive(rises, widths, steps)


def fundamental(levels):
    """Return the weight A e^{j phi} of a voltage, by sampling cos(w t - phi) over a period."""
    fine = 64
    t = (np.arange(len(levels) * fine) + 0.5) / (len(levels) * fine)
    voltage = np.repeat(levels, fine)
    in_phase = np.mean(voltage * np.cos(2 * np.pi * t))
    quadrature = np.mean(voltage * np.sin(2 * np.pi * t))
    return np.pi * (in_phase + 1j * quadrature)  # half a period of 1 gives 1


@given(pulses())
def test_weights_are_the_fundamental_of_the_square_wave(found):
    for channel, weight in enumerate(found.weights()):
        levels = np.zeros(found.steps)
        high = int(found.rises[channel]) + np.arange(int(found.widths[channel]))
        levels[high % found.steps] = 1
        assert weight == pytest.approx(fundamental(levels), abs=1e-3)


def test_several_pulses_in_a_period_add_up():
    levels = bytes([1, 0, 0, 1, 1, 0, 0, 0])
    found = PulseDrive([0], [3], 8, {0: levels})
    assert found.weights()[0] == pytest.approx(fundamental(list(levels)), abs=1e-3)
    assert found != PulseDrive([0], [3], 8)
    assert len({found, PulseDrive([0], [3], 8, {0: levels})}) == 1


def test_what_is_always_high_or_low_is_silent():
    assert not PulseDrive([0, 3], [32, 0], 32).weights().any()
    assert PulseDrive.off(3, 10).count == 3


@pytest.mark.parametrize(
    ("rises", "widths", "steps"),
    [
        ([32], [1], 32),
        ([0], [33], 32),
        ([0, 1], [1], 32),
        ([0.5], [1], 32),
        ([], [], 32),
        ([0], [0], 1),
    ],
)
def test_values_out_of_range_are_refused(rises, widths, steps):
    with pytest.raises(ConfigurationError, match=r"must be|rises and"):
        PulseDrive(rises, widths, steps)
