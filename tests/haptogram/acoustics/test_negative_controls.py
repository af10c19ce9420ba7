"""What each measure of a focus sees of a wrong drive, and what it does not.

Coherence is |sum w_n g_n| / sum |w_n g_n| at the target; S1, S2 and S4 are the criteria of a
verdict. The figures are those that were measured over hundreds of targets.
"""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from haptogram.acoustics import (
    AcousticModel,
    Medium,
    NumpyEngine,
    dequantise_phase,
    find_pressure_peak,
    fit_focus,
    focus_phases,
    predict_focal_shift,
    pressure,
    propagators,
    quantise_phase,
)
from haptogram.acoustics.levels.shift import focal_shift_covariance
from strategies_acoustics import hemisphere_targets, seeds, targets

MODEL = AcousticModel.default()
volume = targets(low=0.05, high=0.2)


def codes(target, model=MODEL, bits=8):
    return quantise_phase(focus_phases(model, target), bits).reshape(16, 16)


def weights_of(phase_codes, bits=8):
    return np.exp(1j * dequantise_phase(np.asarray(phase_codes).ravel(), bits))


def coherence(weights, target):
    arrivals = weights * propagators(MODEL, [target])[0]
    return abs(arrivals.sum()) / np.abs(arrivals).sum()


# How far the target must lie from the plane on which the mistake cannot be seen.
MISTAKES = {
    "sign": (lambda c: -c.astype(int) % 256, lambda _: 1.0, 0.25),
    "transposed": (lambda c: c.T, lambda t: abs(t[0] - t[1]) / math.sqrt(2.0), 0.34),
    "mirrored in x": (lambda c: c[::-1], lambda t: abs(t[0]), 0.42),
    "mirrored in y": (lambda c: c[:, ::-1], lambda t: abs(t[1]), 0.42),
    "rolled along x": (lambda c: np.roll(c, 1, axis=0), lambda _: 1.0, 0.30),
    "rolled along y": (lambda c: np.roll(c, 1, axis=1), lambda _: 1.0, 0.30),
}


@pytest.mark.parametrize("mistake", MISTAKES)
@given(target=hemisphere_targets())
def test_a_wrong_order_or_sign_leaves_no_coherence(mistake, target):
    wrong, distance, limit = MISTAKES[mistake]
    assume(distance(target) >= 5e-3)
    assert coherence(weights_of(wrong(codes(target)).astype(np.uint8)), target) <= limit
    assert coherence(weights_of(codes(target)), target) >= math.cos(math.pi / 256)


@given(volume, st.floats(0.0, 2.0 * math.pi), st.integers(0, 255))
def test_coherence_alone_would_pass_what_the_phases_show(target, angle, element):
    """1 mm aside, other air, one inverted element: 0.94 to 0.999, and S1 or S2 sees each."""
    aside = target + 1e-3 * np.array([math.cos(angle), math.sin(angle), 0.0])
    cold = AcousticModel(MODEL.array, Medium(340.0, 1.2), MODEL.transducer)
    for wrong in (codes(aside), codes(target, cold)):
        assert 0.94 <= coherence(weights_of(wrong), target) < 0.9999
        fit = fit_focus(MODEL, dequantise_phase(wrong.ravel(), 8), target, phase_bits=8)
        assert (np.abs(fit.position_m - target) > fit.bound_m).any()
    inverted = codes(target).ravel().copy()
    inverted[element] ^= 128
    assert 0.96 <= coherence(weights_of(inverted), target) < 0.999
    fit = fit_focus(MODEL, dequantise_phase(inverted, 8), target, phase_bits=8)
    assert np.abs(fit.residual_rad).max() > 3.0


def noisy(target, seed):
    """10 % of amplitude and 0.2 rad of phase, at random."""
    rng = np.random.default_rng(seed)
    phases = focus_phases(MODEL, target) + 0.2 * rng.normal(size=256)
    return (1.0 + 0.1 * rng.normal(size=256)) * np.exp(1j * phases)


@given(volume, seeds)
def test_the_peak_is_the_shifted_focus(target, seed):
    """S4: in the metric k sqrt(e C e), 0.03 to 0.07 rad from the prediction; at most 2.5 % louder.

    Across, where the metric is strong, rounding and noise move it by less than 0.35 mm.
    """
    expected = target + predict_focal_shift(MODEL, target).offset_m
    shares = np.abs(propagators(MODEL, [target]))[0]
    metric = MODEL.wavenumber**2 * focal_shift_covariance(MODEL, target, shares)
    for weights, limit in (
        (weights_of(codes(target)), 0.03),
        (weights_of(codes(target, bits=4), 4), 0.05),
        (noisy(target, seed), 0.07),
    ):
        found = find_pressure_peak(NumpyEngine(MODEL), weights, target)
        miss = found - expected
        assert math.sqrt(miss @ metric @ miss) <= limit
        level = np.abs(pressure(MODEL, weights, [target, found]))
        assert level[1] <= 1.025 * level[0]
        ray = target / np.linalg.norm(target)
        assert np.linalg.norm(miss - (miss @ ray) * ray) <= 0.35e-3


@pytest.mark.parametrize(("distance_m", "share"), [(4e-3, 1.0), (5e-3, 0.95), (6e-3, 0.85)])
def test_fits_from_nearby_converge_and_few_from_far(distance_m, share):
    """All from 4 mm; 99.5, 95 and 81 % were measured from 5, 6 and 8 mm."""
    rng = np.random.default_rng(1)
    found = 0
    for target in rng.uniform([-0.06, -0.06, 0.05], [0.06, 0.06, 0.25], (60, 3)):
        step = rng.normal(size=3)
        start = target + distance_m * step / np.linalg.norm(step)
        fit = fit_focus(MODEL, focus_phases(MODEL, target), start, phase_bits=8)
        found += bool(np.linalg.norm(fit.position_m - target) < 1e-6)
    assert found >= share * 60
