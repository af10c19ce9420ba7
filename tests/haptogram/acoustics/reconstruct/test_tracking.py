"""The quick fit against the reference fit, and the search without a hint."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram.acoustics import (
    AcousticModel,
    TransducerArray,
    dequantise_phase,
    fit_focus,
    focus_phases,
    quantise_phase,
)
from haptogram.acoustics.model.boards.table import LAYOUTS
from haptogram.acoustics.reconstruct.tracking import FocusTracker
from haptogram.errors import ConfigurationError
from strategies_acoustics import seeds, targets

BOARD = AcousticModel.default()


@pytest.fixture(scope="module")
def tracker():
    maker = FocusTracker(BOARD)
    maker.warm_up()
    return maker


def codes_of(model, target, bits=8):
    return quantise_phase(focus_phases(model, target), bits)


@given(target=targets(), seed=seeds)
def test_a_warm_fit_is_the_fit_of_the_reference(tracker, target, seed):
    offset = np.random.default_rng(seed).normal(size=3)
    start = target + 0.004 * offset / np.linalg.norm(offset)
    codes = codes_of(BOARD, target)
    fix = tracker.fit(codes, tuple(start.tolist()))
    expected = fit_focus(BOARD, dequantise_phase(codes, 8), start, phase_bits=8)
    assert fix.converged
    assert fix.position_m == pytest.approx(expected.position_m, abs=2e-6)
    assert fix.residual_rms_rad == pytest.approx(expected.residual_rms_rad, abs=1e-4)
    turns = (fix.phase_rad - expected.phase_rad) / (2 * np.pi)
    assert abs(turns - round(turns)) < 2e-3
    nearest = np.linalg.norm(BOARD.array.positions_m - fix.position_m, axis=1).min()
    assert fix.clearance_m == pytest.approx(nearest, rel=1e-5)


@given(target=targets(lateral=0.15, low=0.03, high=0.6))
def test_without_a_hint_the_focus_is_found(tracker, target):
    codes = codes_of(BOARD, target)
    fix = tracker.acquire(codes)
    expected = fit_focus(BOARD, dequantise_phase(codes, 8), target, phase_bits=8)
    assert fix.position_m == pytest.approx(expected.position_m, abs=2e-5)
    assert fix.residual_rms_rad < np.pi / 256


@pytest.mark.parametrize("bits", [5, 6, 8])
@pytest.mark.parametrize("shape", [(8, 8), (32, 4), (6, 5)])
def test_other_arrays_and_resolutions(shape, bits):
    model = AcousticModel.default(*shape)
    tracker = FocusTracker(model, bits)
    for target in ([0.01, -0.02, 0.12], [0.0, 0.0, 0.08]):
        codes = codes_of(model, target, bits)
        reference = fit_focus(model, dequantise_phase(codes, bits), target, phase_bits=bits)
        assert tracker.acquire(codes).position_m == pytest.approx(reference.position_m, abs=1e-4)


@pytest.mark.parametrize("name", ["tinylev", "sonicsurface-stack"])
def test_a_fit_may_start_at_the_centre_of_elements_that_face_each_other(name):
    model = AcousticModel(LAYOUTS[name].array(), BOARD.medium, BOARD.transducer)
    centre = model.array.centre_m
    for away in ([1e-3, 0.0, 0.0], [0.0, 5e-4, -1e-3]):
        codes = codes_of(model, centre + np.array(away))
        fix = FocusTracker(model).fit(codes, tuple(centre.tolist()))
        assert fix.converged
        assert fix.position_m == pytest.approx(centre + away, abs=2e-4)


def test_a_fit_that_starts_on_an_element_has_a_place():
    model = AcousticModel.default(5, 5)
    for start in model.array.positions_m.tolist():
        fix = FocusTracker(model).fit(codes_of(model, (0.0, 0.0, 0.06)), tuple(start))
        assert np.isfinite([*fix.position_m, fix.residual_rms_rad, fix.clearance_m]).all()


def test_an_array_on_a_bowl_that_lies_elsewhere():
    flat = AcousticModel.default(8, 8)
    x, y = flat.array.positions_m[:, 0], flat.array.positions_m[:, 1]
    places = np.column_stack([x + 1.0, y - 2.0, 2.0 * (x * x + y * y) + 0.5])
    array = TransducerArray.from_positions(places, [0, 0, 0.2] - (places - [1.0, -2.0, 0.5]))
    model = AcousticModel(array, flat.medium, flat.transducer)
    target = np.array([1.01, -2.01, 0.62])
    fix = FocusTracker(model).acquire(codes_of(model, target))
    assert fix.position_m == pytest.approx(target, abs=1e-3)


def test_a_line_keeps_the_coordinate_that_it_cannot_see():
    model = AcousticModel.default(64, 1, pitch_m=0.005)
    start = (0.012, 0.003, 0.098)
    fix = FocusTracker(model).fit(codes_of(model, [0.01, 0.0, 0.1]), start)
    assert fix.position_m[0] == pytest.approx(0.01, abs=2e-4)
    assert np.hypot(*fix.position_m[1:]) == pytest.approx(0.1, abs=2e-3)


@given(seeds, st.integers(0, 255))
def test_phases_that_no_point_explains_say_so(tracker, seed, element):
    rng = np.random.default_rng(seed)
    noise = tracker.acquire(rng.integers(0, 256, 256).astype(np.uint8))
    assert noise.residual_rms_rad > 1.0
    codes = codes_of(BOARD, [0.01, 0.02, 0.15])
    codes[element] ^= 128
    inverted = tracker.acquire(codes)
    assert inverted.residual_rms_rad == pytest.approx(np.pi / 16, rel=0.1)
    assert inverted.position_m == pytest.approx([0.01, 0.02, 0.15], abs=3e-3)


@pytest.mark.parametrize(
    "codes", [np.zeros(255, np.uint8), np.zeros(256), np.zeros((1, 256), np.uint8)]
)
def test_codes_of_another_kind_are_refused(tracker, codes):
    for call in (lambda: tracker.fit(codes, (0.0, 0.0, 0.1)), lambda: tracker.acquire(codes)):
        with pytest.raises(ConfigurationError, match="codes are"):
            call()


def test_a_start_that_is_not_finite_and_too_few_elements_are_refused(tracker):
    with pytest.raises(ConfigurationError, match="finite"):
        tracker.fit(np.zeros(256, np.uint8), (0.0, np.nan, 0.1))
    with pytest.raises(ConfigurationError, match="at least 4"):
        FocusTracker(AcousticModel.default(3, 1))
