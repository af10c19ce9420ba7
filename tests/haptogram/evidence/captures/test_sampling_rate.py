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


@pytest.mark.parametrize("rate_hz", [7.3e6, 12.5e6, 16e6, 24e6])
@pytest.mark.parametrize("seed", range(6))
def test_a_few_long_pulses_tell_no_finer_rate_than_that_of_their_samples(rate_hz, seed):
    # Two pins whose drives hardly move in five frames: no two edges are near each other.
    random = np.random.default_rng(seed)
    period = rate_hz / 40e3
    drives = np.array([0.1, 0.22]) + np.cumsum(random.integers(-3, 4, (5, 2)), axis=0) / 256.0
    begins = (np.arange(100)[:, None] + drives.repeat(20, axis=0)) * period
    edges = np.concatenate([begins, begins + period / 2.0])
    samples = np.unique(np.ceil(edges + random.normal(0.0, 0.05, edges.shape)).astype(np.int64))
    found = 1e9 / estimated_capture_step(np.rint(samples * 1e9 / rate_hz).astype(np.int64))
    assert found <= 1.001 * rate_hz
    assert found >= 0.05 * rate_hz


@pytest.mark.parametrize("rate_hz", [4e6, 7.3e6, 12.5e6, 24e6])
@pytest.mark.parametrize("seed", range(6))
def test_a_few_edges_off_the_grid_tell_no_finer_rate(rate_hz, seed):
    random = np.random.default_rng(seed)
    samples = np.cumsum(random.integers(3, 400, 4000))
    times = np.rint(samples * 1e9 / rate_hz).astype(np.int64)
    times[random.choice(len(times), 15, replace=False)] += random.integers(-30, 31, 15)
    found = 1e9 / estimated_capture_step(np.unique(times))
    assert found == pytest.approx(rate_hz, rel=1e-4)


@pytest.mark.parametrize("seed", range(6))
def test_edges_that_are_mostly_on_no_grid_tell_the_ticks_alone(seed):
    random = np.random.default_rng(seed)
    samples = np.cumsum(random.integers(3, 400, 4000))
    times = np.rint(samples * 1e9 / 24e6 + random.normal(0.0, 20.0, 4000)).astype(np.int64)
    assert estimated_capture_step(np.unique(times)) == 1.0


def test_far_distances_that_share_no_step_are_those_of_single_ticks():
    times = np.cumsum([0, 1_375_000, 1_375_005, 2_250_009, 1_391_017, 3_000_001])
    assert estimated_capture_step(times) == 1.0
