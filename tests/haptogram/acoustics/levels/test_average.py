"""Time averages of a sequence, and the levels at people."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram.acoustics import AcousticModel, NumpyEngine, choose_engine, focus_phases, pressure
from haptogram.acoustics.levels.average import mean_square_pressure
from haptogram.acoustics.levels.dynamics import Resonator
from haptogram.acoustics.levels.exposure import (
    exposure_at,
    half_sphere_directions,
    worst_exposure,
)
from haptogram.errors import ConfigurationError
from strategies_acoustics import seeds

MODEL = AcousticModel.default(6, 6)
ENGINE = NumpyEngine(MODEL)
POINTS = np.array([[0.0, 0.0, 0.1], [0.01, 0.0, 0.1], [0.02, 0.03, 0.15]])
CIRCLE = np.array(
    [[0.01 * math.cos(a), 0.01 * math.sin(a), 0.1] for a in np.arange(8) * math.pi / 4]
)
PASS = np.exp(1j * focus_phases(MODEL, CIRCLE))


def random_drives(seed, frames):
    rng = np.random.default_rng(seed)
    return rng.uniform(0, 1, (frames, 36)) * np.exp(2j * np.pi * rng.uniform(0, 1, (frames, 36)))


@given(st.integers(0, 99), st.integers(1, 6))
def test_settled_frames_add_as_mean_squares(seed, frames):
    drives = random_drives(seed, frames)
    expected = 0.5 * np.mean(np.abs(pressure(MODEL, drives, POINTS)) ** 2, axis=0)
    assert mean_square_pressure(ENGINE, drives, POINTS, 1e-3) == pytest.approx(expected, rel=1e-12)


@given(st.integers(0, 99), st.integers(1, 6), st.floats(5e-5, 3e-3))
def test_the_closed_form_agrees_with_envelopes_sampled_in_time(seed, frames, tau):
    drives, resonator = random_drives(seed, frames), Resonator(tau)
    passes = np.concatenate([drives] * (2 + math.ceil(12 * tau / (1e-3 * frames))))
    start = resonator.envelope(passes, 1e-3, 1)[-1]
    samples = resonator.envelope(drives, 1e-3, 400, start)
    before = np.vstack([start, samples[:-1]])
    midpoints = before + (samples - before) / 2
    expected = 0.5 * np.mean(np.abs(pressure(MODEL, midpoints, POINTS)) ** 2, axis=0)
    found = mean_square_pressure(ENGINE, drives, POINTS, 1e-3, resonator)
    assert found == pytest.approx(expected, rel=1e-3, abs=1e-4 * expected.max())


def test_a_constant_drive_is_not_weakened_by_its_resonators():
    settled = mean_square_pressure(ENGINE, PASS[:1], POINTS, 1e-3)
    slow = mean_square_pressure(ENGINE, PASS[[0, 0, 0]], POINTS, 1e-3, Resonator(1e-3))
    assert slow == pytest.approx(settled, rel=1e-12)


def test_memory_stays_bounded_and_chunks_do_not_show(monkeypatch):
    points = np.random.default_rng(0).uniform(0.05, 0.15, (50, 3))
    whole = mean_square_pressure(ENGINE, PASS, points, 1e-3)
    monkeypatch.setattr("haptogram.acoustics.levels.average._VALUES_PER_CHUNK", 8 * 7)
    assert mean_square_pressure(ENGINE, PASS, points, 1e-3) == pytest.approx(whole, rel=1e-12)


def test_levels_at_a_place():
    (level,) = exposure_at(ENGINE, PASS, [[0.0, 0.3, 0.3]], 1e-3)
    rms = np.abs(pressure(MODEL, PASS, [[0.0, 0.3, 0.3]]))[:, 0] / math.sqrt(2)
    assert level.maximum_db_spl == pytest.approx(20 * math.log10(rms.max() / 20e-6))
    mean = math.sqrt(np.mean(rms**2))
    assert level.equivalent_db_spl == pytest.approx(20 * math.log10(mean / 20e-6))


@pytest.mark.parametrize("target", [(0.0, 0.0, 0.15), (0.02, 0.0, 0.12)])
def test_no_place_of_a_dense_scan_is_louder_than_the_worst(target):
    model = AcousticModel.default(12, 12)
    weights = np.exp(1j * focus_phases(model, target))
    engine = choose_engine(model)
    worst = worst_exposure(engine, weights[None], 0.5, 1e-3)
    dense = 0.5 * half_sphere_directions(np.array([0.0, 0.0, 1.0]), 200_000)
    loudest = np.abs(engine.pressure(weights, dense)).max() / np.sqrt(2.0)
    assert worst.equivalent_db_spl >= 20.0 * np.log10(loudest / 20e-6) - 0.01
    assert np.linalg.norm(worst.position_m) == pytest.approx(0.5)


def test_the_worst_place_is_ahead_of_a_small_array_that_looks_ahead():
    weights = np.exp(1j * focus_phases(MODEL, np.array([[0.0, 0.0, 1.0]])))
    worst = worst_exposure(ENGINE, weights, 1.0, 1e-3)
    assert worst.position_m[2] > 0.95
    (ahead,) = exposure_at(ENGINE, weights, [[0.0, 0.0, 1.0]], 1e-3)
    assert worst.equivalent_db_spl == pytest.approx(ahead.equivalent_db_spl, abs=0.5)


@given(seeds, st.integers(100, 3000))
def test_the_directions_of_a_half_sphere_are_even(seed, count):
    """Their first two moments are those of the half sphere: a half of its axis, a third of I."""
    axis = np.random.default_rng(seed).normal(size=3)
    axis /= np.linalg.norm(axis)
    directions = half_sphere_directions(axis, count)
    assert np.linalg.norm(directions, axis=1) == pytest.approx(np.ones(count))
    assert (directions @ axis).min() > 0.0
    assert directions.mean(axis=0) == pytest.approx(axis / 2, abs=2 / count)
    assert directions.T @ directions / count == pytest.approx(np.eye(3) / 3, abs=2 / count)


@pytest.mark.parametrize(
    "call",
    [
        lambda: mean_square_pressure(ENGINE, PASS[0], POINTS, 1e-3),
        lambda: mean_square_pressure(ENGINE, np.empty((0, 36)), POINTS, 1e-3),
        lambda: mean_square_pressure(ENGINE, PASS, POINTS, 0.0),
        lambda: worst_exposure(ENGINE, PASS, 1.0, 1e-3, directions=9),
        lambda: worst_exposure(ENGINE, PASS, -1.0, 1e-3),
    ],
)
def test_impossible_requests_are_refused(call):
    with pytest.raises(ConfigurationError):
        call()
