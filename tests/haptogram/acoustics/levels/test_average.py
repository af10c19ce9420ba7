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
    a_weighting_db,
    exposure_at,
    half_sphere_directions,
    switching_level_db_a,
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


# IEC 61672-1, table 3
@pytest.mark.parametrize(
    ("frequency", "level"),
    [
        (20, -50.5),
        (100, -19.1),
        (200, -10.9),
        (1000, 0.0),
        (4000, 1.0),
        (10_000, -2.5),
        (20_000, -9.3),
    ],
)
def test_the_a_weighting_is_that_of_the_standard(frequency, level):
    # The table holds for the exact base-10 frequency behind each nominal one.
    exact = 1000 * 10 ** (round(10 * math.log10(frequency / 1000)) / 10)
    assert a_weighting_db(min(exact, 20e3)) == pytest.approx(level, abs=0.06)


@pytest.mark.parametrize("carriers", [40, 40.0625])
@pytest.mark.parametrize("drives", [PASS, random_drives(1, 8)])
def test_audible_switching_agrees_with_a_transform_of_the_waveform(drives, carriers):
    """Sampled waveform of the pressure itself, carrier and all: to 0.02 dB.

    Frames of a broken number of carrier periods give a sound that repeats after two passes only.
    """
    resonator, place, frame_s = Resonator(1e-4), (0.0, 0.2, 0.2), carriers / 40e3
    samples = round(64 * carriers)
    twice = np.concatenate([drives, drives])
    start = resonator.envelope(twice, frame_s, 1)[-1]
    envelope = resonator.envelope(twice, frame_s, samples, start) @ np.asarray(
        pressure(MODEL, np.eye(36), [place])
    )
    times = (np.arange(len(envelope)) + 1) / (64 * 40e3)
    waveform = np.real(envelope[:, 0] * np.exp(-2j * np.pi * 40e3 * times))
    lines = np.fft.rfft(waveform) / len(waveform)
    frequency = np.arange(len(lines)) / (len(twice) * frame_s)
    heard = (frequency >= 20.0) & (frequency <= 20e3)
    weights = 10 ** (a_weighting_db(frequency[heard]) / 20)
    rms = math.sqrt(2 * np.sum((np.abs(lines[heard]) * weights) ** 2))
    found = switching_level_db_a(ENGINE, drives, place, frame_s, resonator)
    assert found == pytest.approx(20 * math.log10(rms / 20e-6), abs=0.02)


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


def test_a_constant_drive_switches_nothing():
    assert switching_level_db_a(ENGINE, PASS[:1], (0, 0.2, 0.2), 1e-3, Resonator(1e-4)) == -math.inf
    still = switching_level_db_a(ENGINE, PASS[[0, 0]], (0, 0.2, 0.2), 1e-3, Resonator(1e-4))
    assert still < -150


@pytest.mark.parametrize(
    "call",
    [
        lambda: mean_square_pressure(ENGINE, PASS[0], POINTS, 1e-3),
        lambda: mean_square_pressure(ENGINE, np.empty((0, 36)), POINTS, 1e-3),
        lambda: mean_square_pressure(ENGINE, PASS, POINTS, 0.0),
        lambda: worst_exposure(ENGINE, PASS, 1.0, 1e-3, directions=9),
        lambda: worst_exposure(ENGINE, PASS, -1.0, 1e-3),
        lambda: a_weighting_db(40e3),
        lambda: a_weighting_db([100.0, 5.0]),
    ],
)
def test_impossible_requests_are_refused(call):
    with pytest.raises(ConfigurationError):
        call()
