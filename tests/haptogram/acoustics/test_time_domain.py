"""The sign of a phase code, in the time domain: a positive code delays.

The expected sound is summed by `oracles.delayed_sum`, which knows delays and distances but neither
complex numbers nor this package.
"""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import oracles
from haptogram.acoustics import (
    AcousticModel,
    Drive,
    Medium,
    PointSource,
    Transducer,
    TransducerArray,
    focus_phases,
    pressure,
    quantise_phase,
)
from strategies_acoustics import hemisphere_targets, seeds

MODEL = AcousticModel(
    TransducerArray.grid(6, 6), Medium(343.2, 1.204), Transducer(PointSource(), math.sqrt(0.5))
)
SETTING = {"frequency": 40e3, "sound_speed": 343.2}


def peak(point, codes):
    return oracles.delayed_peak(point, MODEL.array.positions_m, codes, 8, **SETTING)


@given(hemisphere_targets())
def test_the_delays_of_a_focus_meet_at_the_target(target):
    codes = quantise_phase(focus_phases(MODEL, target), 8)
    largest = sum(1.0 / math.dist(target, position) for position in MODEL.array.positions_m)
    # Samples every 1/48 period miss the crest by cos(pi / 48) at worst, the codes by cos(pi / 256).
    assert peak(target, codes) >= 0.997 * largest
    assert peak(target, codes) > peak(target + np.array([0.015, 0.0, 0.0]), codes)
    assert peak(target, codes) > peak(target - np.array([0.0, 0.015, 0.0]), codes)


def test_the_opposite_sign_does_not_meet_there():
    target = np.array([0.02, 0.01, 0.08])
    codes = quantise_phase(focus_phases(MODEL, target), 8)
    mirrored = (-codes.astype(int)) % 256
    assert peak(target, mirrored) < 0.5 * peak(target, codes)


@given(seeds, hemisphere_targets(), st.integers(3, 12))
def test_the_phasor_describes_the_sound_of_the_delays(seed, point, samples):
    """p(t) = Re(p e^{-jwt}) at every instant, and its mean square is |p|^2 / 2.

    The mean is exact from three samples of a period on.
    """
    codes = np.random.default_rng(seed).integers(0, 256, MODEL.array.count)
    phasor = pressure(MODEL, Drive(codes, np.full(codes.shape, 255)).weights(), [point])[0]
    times = [i / samples / 40e3 for i in range(samples)]
    heard = [
        oracles.delayed_sum(point, MODEL.array.positions_m, codes, 8, **SETTING, time=time)
        for time in times
    ]
    scale = sum(1.0 / math.dist(point, position) for position in MODEL.array.positions_m)
    for time, value in zip(times, heard, strict=True):
        turned = phasor * np.exp(-2j * math.pi * 40e3 * time)
        assert turned.real == pytest.approx(value, abs=1e-12 * scale)
    mean_square = sum(value**2 for value in heard) / len(heard)
    assert mean_square == pytest.approx(abs(phasor) ** 2 / 2, abs=1e-12 * scale**2)
