"""Modulations sampled to frames, and the spectrum that they make."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram.acoustics import AcousticModel, Drive, NumpyEngine, pressure, radiation_pressure_pa
from haptogram.acoustics.levels.dynamics import Resonator
from haptogram.errors import ConfigurationError
from haptogram.objects.modulation import (
    MAX_FRAMES,
    Modulation,
    dwell_modulation,
    felt_signal_at,
    modulate_amplitude,
    modulate_place,
    spatio_temporal_modulation,
)

MODEL = AcousticModel.default(8, 8)
ENGINE = NumpyEngine(MODEL)
POINT = (0.0, 0.0, 0.1)
SQUARE = [(0.01, 0.01, 0.1), (-0.01, 0.01, 0.1), (-0.01, -0.01, 0.1), (0.01, -0.01, 0.1)]


def amplitude_modulation(point, *, duration_s, rate_hz, **how):
    """A standing focus, modulated."""
    return modulate_amplitude(dwell_modulation([point], dwell_s=duration_s, rate_hz=rate_hz), **how)


def line(signal, frequency):
    """Amplitude of the spectrum at a frequency that it holds."""
    (index,) = np.flatnonzero(np.isclose(signal.frequency_hz, frequency))
    return signal.amplitude_pa[index]


def test_amplitude_modulation_makes_a_pure_tone_of_the_force():
    frames = amplitude_modulation(POINT, duration_s=0.05, rate_hz=40_000.0)
    signal = felt_signal_at(ENGINE, frames, POINT, samples_per_frame=1)
    assert line(signal, 200) == pytest.approx(line(signal, 0), rel=1e-9)
    others = ~np.isclose(signal.frequency_hz, 0) & ~np.isclose(signal.frequency_hz, 200)
    assert signal.amplitude_pa[others].max() < 1e-9 * line(signal, 0)
    full = pressure(MODEL, frames.weights(MODEL)[0], [POINT])
    assert signal.pressure_pa.max() == pytest.approx(
        radiation_pressure_pa(full, MODEL.medium)[0], rel=1e-9
    )


@given(st.floats(0.0, 1.0))
def test_the_depth_is_that_of_the_force(depth):
    frames = amplitude_modulation(POINT, depth=depth, duration_s=0.01, rate_hz=8000.0)
    force = frames.amplitudes**2
    assert force.max() == pytest.approx(1.0)
    assert np.ptp(force) / (force.max() + force.min()) == pytest.approx(depth, abs=1e-9)


def test_at_the_rate_of_the_loop_a_held_frame_brings_images_of_the_tone():
    """Five frames a period: the images at 1000 -+ 200 Hz follow the sinc of the hold."""
    frames = amplitude_modulation(POINT, duration_s=0.05, rate_hz=1000.0)
    assert len(frames.amplitudes) == 50
    signal = felt_signal_at(ENGINE, frames, POINT, samples_per_frame=64)
    mean = line(signal, 0)
    for frequency in (200, 800, 1200):
        hold = abs(np.sinc(frequency / 1000))
        assert line(signal, frequency) == pytest.approx(hold * mean, rel=2e-3)


def test_a_narrow_transducer_weakens_the_images_most():
    frames = amplitude_modulation(POINT, duration_s=0.05, rate_hz=1000.0)
    sharp = felt_signal_at(ENGINE, frames, POINT)
    soft = felt_signal_at(ENGINE, frames, POINT, Resonator.from_bandwidth())
    ratios = [line(soft, f) / line(sharp, f) for f in (200, 800, 1200)]
    assert 1.0 > ratios[0] > ratios[1] > ratios[2]
    assert ratios[0] > 0.9


def test_the_signal_is_periodic_under_the_resonator():
    frames = amplitude_modulation(POINT, duration_s=0.005, rate_hz=1000.0)
    slow = Resonator(2e-3)
    once = felt_signal_at(ENGINE, frames, POINT, slow)
    twice = felt_signal_at(
        ENGINE, amplitude_modulation(POINT, duration_s=0.010, rate_hz=1000.0), POINT, slow
    )
    assert twice.pressure_pa == pytest.approx(np.tile(once.pressure_pa, 2), rel=1e-9)


def test_lateral_modulation_swings_around_its_point():
    frames = modulate_place(
        dwell_modulation([POINT], dwell_s=0.02, rate_hz=4000.0), shift_m=(0.0, 2e-3, 0.0)
    )
    offset = frames.points_m - POINT
    assert np.abs(offset[:, [0, 2]]).max() == 0.0
    assert (offset[:, 1].max(), offset[:, 1].min()) == (pytest.approx(2e-3), pytest.approx(-2e-3))
    assert (frames.amplitudes == 1.0).all()
    middle = felt_signal_at(ENGINE, frames, POINT)
    beside = felt_signal_at(ENGINE, frames, (0.0, 2e-3, 0.1))
    assert line(middle, 200) < 1e-6 * line(middle, 400)
    assert line(beside, 200) > line(beside, 400)


def test_a_path_is_run_at_constant_speed_and_closed():
    frames = spatio_temporal_modulation(SQUARE, frequency_hz=10.0, duration_s=0.2, rate_hz=800.0)
    assert len(frames.points_m) == 160
    assert frames.points_m[80:] == pytest.approx(frames.points_m[:80], abs=1e-12)
    steps = np.linalg.norm(np.diff(frames.points_m, axis=0), axis=1)
    assert steps == pytest.approx(np.full(159, 1e-3), abs=1e-12)
    for corner in SQUARE:
        assert np.linalg.norm(frames.points_m - corner, axis=1).min() < 1e-12


def test_a_point_of_a_path_feels_the_path_s_frequency():
    frames = spatio_temporal_modulation(SQUARE, frequency_hz=100.0, duration_s=0.1, rate_hz=8000.0)
    signal = felt_signal_at(ENGINE, frames, SQUARE[1])
    strongest = signal.frequency_hz[1:][np.argmax(signal.amplitude_pa[1:])]
    assert strongest == pytest.approx(100.0)


@given(st.integers(1, 5), st.integers(1, 20))
def test_dwell_holds_each_point_for_whole_frames(count, frames_each):
    points = np.array(SQUARE * 2)[:count]
    frames = dwell_modulation(points, dwell_s=frames_each / 1000.0, rate_hz=1000.0)
    assert frames.points_m.shape == (count * frames_each, 3)
    assert (frames.points_m[::frames_each] == points).all()


def test_the_frames_can_be_sent_as_drives():
    frames = amplitude_modulation(POINT, duration_s=0.005, rate_hz=1000.0)
    drives = [Drive.from_weights(weights) for weights in frames.weights(MODEL)]
    assert drives[0].amplitude_codes.min() == 255
    assert len({drive.digest() for drive in drives}) > 1


@given(st.integers(3, 40))
def test_the_spectrum_holds_the_power_of_the_signal(count):
    rng = np.random.default_rng(count)
    frames = dwell_modulation(rng.uniform(0.05, 0.1, (count, 3)), dwell_s=1e-3, rate_hz=1000.0)
    signal = felt_signal_at(ENGINE, frames, (0.07, 0.07, 0.07), samples_per_frame=1)
    lines = signal.amplitude_pa.copy()
    lines[1 : (count + 1) // 2] /= math.sqrt(2.0)
    assert np.sum(lines**2) == pytest.approx(np.mean(signal.pressure_pa**2))


@given(st.sampled_from(["am", "lm", "stm"]), st.floats(5.0, 400.0), st.integers(1, 7))
def test_a_pass_of_a_modulation_repeats_without_a_seam(kind, frequency_hz, count):
    path = np.array(SQUARE * 2)[: max(count, 2)]
    rate = 1000.0
    frames = Modulation(kind, frequency_hz).frames(path, rate)
    assert frames.count <= MAX_FRAMES
    periods = frames.count * frequency_hz / rate
    assert abs(periods - round(periods)) < 1.001e-3
    used = round(periods) * rate / frames.count
    assert used == pytest.approx(frequency_hz, rel=1e-2)
    # One frame on, it would begin again: an envelope of frame F is that of frame 0.
    turn = np.mod(np.arange(frames.count + 1) * used / rate, 1.0)
    assert min(turn[-1], 1.0 - turn[-1]) < 1e-6
    if kind == "am":
        force = (1.0 + np.cos(2.0 * np.pi * turn[:-1])) / 2.0
        assert frames.amplitudes**2 == pytest.approx(force, abs=1e-6)
    if kind != "stm":
        assert frames.count % len(path) == 0
    again = frames.repeated(2)
    assert (again.points_m[frames.count :] == frames.points_m).all()


def test_frequencies_that_divide_the_rate_take_the_shortest_pass():
    assert Modulation("am", 200.0).frames([POINT], 1000.0).count == 5
    assert Modulation("am", 70.0).frames([POINT], 1000.0).count == 100
    assert Modulation("am", 42.21).frames([POINT], 1000.0).count < 1000
    assert Modulation("stm", 50.0).frames(SQUARE, 1000.0).count == 20
    held = Modulation("am", 200.0, dwell_s=0.010).frames(SQUARE, 1000.0)
    assert held.count == 40
    assert (held.points_m[:10] == SQUARE[0]).all()
    assert held.amplitudes[:5] == pytest.approx(held.amplitudes[5:10])
    assert Modulation(None).frames(SQUARE, 1000.0).points_m == pytest.approx(np.array(SQUARE))


def test_half_the_rate_is_a_frequency_at_any_rate():
    # Of 123.4 Hz and three points, what the pass comes to is half the rate and one bit.
    frames = Modulation("am", 123.4 / 2.0).frames(np.tile(POINT, (3, 1)), 123.4)
    assert frames.amplitudes == pytest.approx([1.0, 0.0] * 3, abs=1e-6)


def test_steps_close_the_pass():
    steps = Modulation("stm", 100.0).frames(SQUARE, 1000.0).steps_m
    assert len(steps) == 10
    assert steps.max() <= 8e-3 + 1e-12
    assert Modulation("am").frames([POINT], 1000.0).steps_m.max() == 0.0


def test_a_signal_names_its_lines_and_its_swing():
    frames = Modulation("am", 200.0, depth=0.5).frames([POINT], 40_000.0)
    signal = felt_signal_at(ENGINE, frames, POINT, samples_per_frame=1)
    ((frequency, level),) = signal.lines(0.01)
    assert frequency == pytest.approx(200.0)
    assert level == pytest.approx(0.5 * signal.mean_pa, rel=1e-9)
    assert signal.swing == pytest.approx(0.5, rel=1e-9)
    assert signal.vibration_rms_pa == pytest.approx(level / math.sqrt(2.0), rel=1e-9)
    assert signal.share_above(300.0) == pytest.approx(0.0, abs=1e-12)
    assert signal.share_above(100.0) == pytest.approx(1.0)
    still = felt_signal_at(ENGINE, dwell_modulation([POINT], dwell_s=0.01, rate_hz=1000.0), POINT)
    assert still.lines(0.01) == []
    assert (still.swing, still.share_above(0.0)) == (pytest.approx(0.0, abs=1e-9), 0.0)


@pytest.mark.parametrize(
    ("modulation", "points", "message"),
    [
        (Modulation("fm"), SQUARE, "must be one of am, lm, stm"),
        (Modulation("am", 501.0), SQUARE, "501, must be at most half of 1000 .*500"),
        (Modulation("am", depth=1.5), SQUARE, "depth is 1.5, must be 0 to 1"),
        (Modulation("lm", shift_m=(0.2, 0.0, 0.0)), SQUARE, "200 mm long.* at most 100 mm"),
        (Modulation("lm", shift_m=(0.0, 0.0, 0.0)), SQUARE, "0 mm long, must be above 0"),
        (Modulation("stm", dwell_s=0.01), SQUARE, "dwell of 10 ms: stm moves on"),
        (Modulation("stm"), [POINT], "is 1, must be 2 at least"),
        (Modulation(None, dwell_s=1e-4), SQUARE, r"0.1 ms is 0.1 frames at 1000 Hz"),
        (Modulation("am", 0.001), [POINT], "more than 200000 frames"),
        (Modulation("am", 199.9977), np.tile(SQUARE, (9_999, 1)), "more than 200000 frames"),
    ],
)
def test_a_modulation_that_cannot_be_is_refused_with_value_and_limit(modulation, points, message):
    with pytest.raises(ConfigurationError, match=message):
        modulation.frames(points, 1000.0)


@pytest.mark.parametrize(
    "make",
    [
        lambda: amplitude_modulation(POINT, depth=1.1, duration_s=0.1, rate_hz=1000.0),
        lambda: amplitude_modulation(POINT, frequency_hz=501.0, duration_s=0.1, rate_hz=1000.0),
        lambda: amplitude_modulation(POINT, duration_s=0.0, rate_hz=1000.0),
        lambda: amplitude_modulation(POINT, duration_s=0.1, rate_hz=math.nan),
        lambda: amplitude_modulation(POINT, duration_s=1e6, rate_hz=1000.0),
        lambda: amplitude_modulation((0.0, 0.0), duration_s=0.1, rate_hz=1000.0),
        lambda: spatio_temporal_modulation(
            SQUARE[:1], frequency_hz=10.0, duration_s=0.1, rate_hz=1000.0
        ),
        lambda: spatio_temporal_modulation(
            [POINT, POINT], frequency_hz=10.0, duration_s=0.1, rate_hz=1000.0
        ),
        lambda: dwell_modulation(SQUARE, dwell_s=1e-5, rate_hz=1000.0),
        lambda: dwell_modulation([], dwell_s=1e-3, rate_hz=1000.0),
        lambda: dwell_modulation(np.empty((0, 3)), dwell_s=1e-3, rate_hz=1000.0),
        lambda: dwell_modulation(SQUARE, dwell_s=1e300, rate_hz=1e300),
        lambda: dwell_modulation(SQUARE, dwell_s="long", rate_hz=1000.0),
        lambda: dwell_modulation([[0.0, math.nan, 0.1]], dwell_s=1e-3, rate_hz=1000.0),
        lambda: spatio_temporal_modulation(
            [POINT, (math.nan, 0.0, 0.1)], frequency_hz=10.0, duration_s=0.1, rate_hz=1000.0
        ),
        lambda: Modulation(None).frames([["a", 0.0, 0.1]], 1000.0),
        lambda: Modulation("am", "fast").frames(SQUARE, 1000.0),
        lambda: Modulation("lm", shift_m="far").frames(SQUARE, 1000.0),
        lambda: Modulation("stm").frames(SQUARE, math.inf),
    ],
)
def test_impossible_modulations_are_refused(make):
    with pytest.raises(ConfigurationError):
        make()
