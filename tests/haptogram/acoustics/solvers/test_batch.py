"""Phase codes of many foci against the law that they follow."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram.acoustics import AcousticModel, TransducerArray, focus_phases, quantise_phase
from haptogram.acoustics.solvers.batch import FocusCodes
from haptogram.errors import ConfigurationError
from strategies_acoustics import grids, models, seeds


def assert_follows_the_law(model, bits, targets, codes):
    """Each code is the nearest one, to a hundredth of a step."""
    steps = 1 << bits
    exact = focus_phases(model, targets) * steps / (2 * np.pi)
    miss = np.mod(codes - exact + steps / 2, steps) - steps / 2
    assert np.abs(miss).max() <= 0.5 + 0.01
    assert (codes == quantise_phase(focus_phases(model, targets), bits)).mean() > 0.95


@given(models(grids(1, 10)), st.integers(1, 8), seeds, st.integers(1, 30))
def test_codes_follow_the_law(model, bits, seed, count):
    rng = np.random.default_rng(seed)
    shift = rng.uniform(-2, 2, 3)
    array = TransducerArray.from_positions(model.array.positions_m + shift)
    model = AcousticModel(array, model.medium, model.transducer)
    targets = np.column_stack([rng.uniform(-0.1, 0.1, (count, 2)), rng.uniform(0.03, 0.5, count)])
    targets += shift
    maker = FocusCodes(model, bits)
    codes = maker.codes(targets)
    assert_follows_the_law(model, bits, targets, codes)
    assert (maker.codes(targets[0]) == codes[0]).all()
    assert (maker.focus(*targets[0]) == codes[0]).all()


def test_out_is_used():
    maker = FocusCodes(AcousticModel.default(4, 4))
    maker.warm_up()
    out = np.empty((2, 16), dtype=np.uint8)
    assert maker.codes([[0, 0, 0.1], [0, 0.02, 0.2]], out) is out
    assert (out[1] == maker.focus(0.0, 0.02, 0.2)).all()
    assert maker.codes(np.empty((0, 3))).shape == (0, 16)


def test_targets_too_far_for_single_precision_are_exact():
    model = AcousticModel.default(4, 4)
    targets = np.column_stack([np.zeros((300, 2)), np.linspace(0.9, 50.0, 300)])
    expected = quantise_phase(focus_phases(model, targets), 8)
    maker = FocusCodes(model)
    assert (maker.codes(targets) == expected).all()
    assert (maker.focus(0.0, 0.0, 50.0) == expected[-1]).all()


@pytest.mark.parametrize("target", [[0, 0, np.nan], [np.inf, 0, 0.1]])
def test_targets_that_are_not_finite_are_refused(target):
    maker = FocusCodes(AcousticModel.default(2, 2))
    with pytest.raises(ConfigurationError, match="finite"):
        maker.codes([[0, 0, 0.1], target])
    with pytest.raises(ConfigurationError, match="finite"):
        maker.focus(*target)


@pytest.mark.parametrize("targets", [[0, 0], [[0, 0]], [[[0, 0, 0.1]]]])
def test_targets_of_another_shape_are_refused(targets):
    with pytest.raises(ConfigurationError, match="shape"):
        FocusCodes(AcousticModel.default(2, 2)).codes(targets)


@pytest.mark.parametrize(
    "out",
    [np.empty((1, 4)), np.empty((2, 4), np.uint8), np.empty((1, 8), np.uint8)[:, ::2]],
)
def test_out_that_does_not_fit_is_refused(out):
    with pytest.raises(ConfigurationError, match="must be C-contiguous uint8"):
        FocusCodes(AcousticModel.default(2, 2)).codes([[0, 0, 0.1]], out)


def test_codes_that_would_not_fit_are_refused_before_the_work(monkeypatch):
    maker = FocusCodes(AcousticModel.default(2, 2))
    monkeypatch.setattr("os.sysconf", lambda _: 1 << 6)
    with pytest.raises(ConfigurationError, match="half of the memory"):
        maker.codes(np.full((5000, 3), 0.1))
    with pytest.raises(ConfigurationError, match="phase_bits"):
        FocusCodes(AcousticModel.default(2, 2), 9)
