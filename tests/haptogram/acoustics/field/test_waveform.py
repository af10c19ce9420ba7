"""The sound as it oscillates, against a sum of cosines, and what is left on average."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram.acoustics import (
    AcousticModel,
    Medium,
    PointSource,
    Transducer,
    TransducerArray,
    instantaneous_pressure,
    pressure,
    rms_pressure,
)
from haptogram.errors import ConfigurationError

phasors = st.complex_numbers(max_magnitude=1e6, allow_nan=False, allow_infinity=False)


def test_one_source_is_a_cosine_that_lags_with_distance():
    source = Transducer(PointSource(), source_strength_pa_m=1.0)
    model = AcousticModel(TransducerArray.grid(1, 1), Medium(340.0, 1.2), source)
    times = np.linspace(0.0, 1e-4, 41)
    found = instantaneous_pressure(pressure(model, [1.0], [[0.0, 0.3, 0.4]]), 40e3, times)
    expected = np.sqrt(2.0) / 0.5 * np.cos(2.0 * np.pi * 40e3 * (times - 0.5 / 340.0))
    assert found == pytest.approx(expected[None], abs=1e-9)


@given(st.lists(phasors, min_size=1, max_size=4), st.integers(3, 9), st.floats(0.0, 1.0))
def test_the_mean_square_over_a_period_is_that_of_the_rms_value(values, samples, start_s):
    times = start_s + np.arange(samples) / samples / 40e3
    mean = (instantaneous_pressure(values, 40e3, times) ** 2).mean(axis=-1)
    largest = np.abs(values).max() ** 2
    assert mean == pytest.approx(rms_pressure(values) ** 2, rel=1e-6, abs=1e-6 * largest)


def test_shapes_are_kept_and_bad_input_is_refused():
    assert instantaneous_pressure(np.ones((2, 3)), 40e3, np.zeros(5)).shape == (2, 3, 5)
    assert instantaneous_pressure(2.0 + 1.0j, 40e3, 0.0).tolist() == [2.0]
    for call, message in (
        (lambda: rms_pressure([np.nan]), "pressure_peak.* must be finite"),
        (lambda: rms_pressure("loud"), "not an array of numbers"),
        (lambda: instantaneous_pressure([1.0], 0.0, [0.0]), "frequency_hz is 0"),
        (lambda: instantaneous_pressure([1.0], 40e3, [np.inf]), "times_s"),
    ):
        with pytest.raises(ConfigurationError, match=message):
            call()
