"""The sampling rate that the edges of a VCD tell, over silences and rounding to ticks."""

import numpy as np
import pytest

from haptogram.evidence.captures.capture import estimated_capture_step


@pytest.mark.parametrize("rate_hz", [4e6, 7.3e6, 12.5e6, 24e6, 48e6, 100e6])
@pytest.mark.parametrize("silence_s", [0.0, 0.1, 1.7])
@pytest.mark.parametrize("ppm", [0.0, 80.0])
def test_a_silence_in_a_capture_leaves_the_rate_alone(rate_hz, silence_s, ppm):
    random = np.random.default_rng(3)
    period = rate_hz / 40e3 * (1.0 + ppm * 1e-6)
    pulses = np.arange(8000)[:, None] * period + random.uniform(0.0, period, 8)
    samples = np.unique(np.ceil(pulses).astype(np.int64))
    half = len(samples) // 2
    samples[half:] += round(silence_s * rate_hz)
    found = 1e9 / estimated_capture_step(np.rint(samples * 1e9 / rate_hz).astype(np.int64))
    assert found == pytest.approx(rate_hz, rel=1e-5)


@pytest.mark.parametrize("rate_hz", [7.3e6, 10e6, 12.5e6, 24e6])
@pytest.mark.parametrize("finer", [1, 10, 1000])
def test_ticks_that_are_finer_than_what_is_written_tell_the_same_rate(rate_hz, finer):
    random = np.random.default_rng(1)
    samples = np.cumsum(random.integers(3, 400, 4000))
    times = finer * np.rint(samples * 1e9 / rate_hz).astype(np.int64) + 3 * finer
    assert finer * 1e9 / estimated_capture_step(times) == pytest.approx(rate_hz, rel=1e-5)


@pytest.mark.parametrize("rate_hz", [4e6, 7.3e6, 12.5e6, 24e6])
@pytest.mark.parametrize("seed", range(6))
def test_a_tick_of_a_quarter_of_a_sample_tells_the_rate(rate_hz, seed):
    random = np.random.default_rng(seed)
    drives = random.uniform(0.0, rate_hz / 40e3, (40, 6)).repeat(10, axis=0)
    pulses = np.arange(400)[:, None] * rate_hz / 40e3 + drives
    samples = np.unique(np.ceil(pulses).astype(np.int64))
    found = 1e8 / estimated_capture_step(np.rint(samples * 1e8 / rate_hz).astype(np.int64))
    assert found == pytest.approx(rate_hz, rel=1e-4)
