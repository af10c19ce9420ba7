"""Fixed points: one matrix for many drives."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram.acoustics import (
    AcousticModel,
    CircularPiston,
    Medium,
    Transducer,
    TransducerArray,
    pressure,
    propagators,
)
from haptogram.acoustics.field.grid import GridField, box_points_m
from haptogram.errors import ConfigurationError
from strategies_acoustics import grids, models, seeds


@given(models(grids(1, 8)), seeds, st.integers(0, 20))
def test_a_batch_agrees_with_the_reference(model, seed, frames):
    rng = np.random.default_rng(seed)
    points = np.column_stack([rng.uniform(-0.1, 0.1, (50, 2)), rng.uniform(0.02, 0.4, 50)])
    drives = rng.normal(size=(frames, model.array.count, 2)) @ [1, 1j]
    grid = GridField(model, points)
    error = np.abs(grid.pressure(drives) - pressure(model, drives, points))
    assert (error <= 3e-5 * (np.abs(drives) @ np.abs(propagators(model, points)).T)).all()


def test_a_directivity_without_a_polynomial_is_served_too():
    model = AcousticModel(
        TransducerArray.grid(3, 3), Medium.air(), Transducer(CircularPiston(9e-3))
    )
    points = np.column_stack([np.linspace(-0.1, 0.1, 300)] * 2 + [np.full(300, 0.1)])
    expected = pressure(model, np.ones(9), points)
    scale = np.abs(expected).max()
    assert np.abs(GridField(model, points).pressure(np.ones(9)) - expected).max() < 1e-5 * scale


def test_out_is_used_and_single_precision_weights_are_taken():
    grid = GridField(AcousticModel.default(2, 2), [[0, 0, 0.1], [0, 0.01, 0.1], [0.02, 0, 0.2]])
    drives = np.exp(1j * np.arange(20.0)).reshape(5, 4).astype(np.complex64)
    out = np.empty((5, 3), dtype=np.complex64)
    assert grid.pressure(drives, out) is out
    assert out == pytest.approx(grid.pressure(drives.astype(complex)), rel=1e-5)
    assert grid.pressure(drives[0]).shape == (3,)
    assert grid.matrix.shape == (3, 4)


@pytest.mark.parametrize(
    ("weights", "out", "message"),
    [
        (np.ones(3), None, "must end in 4"),
        (np.full((2, 4), np.nan, dtype=np.complex64), None, "finite"),
        (np.full(4, np.inf), None, "finite"),
        (np.ones((2, 4)), np.empty((3, 1), np.complex64), "must be complex64 of shape"),
        (np.ones((2, 4)), np.empty((2, 1)), "must be complex64 of shape"),
    ],
)
def test_bad_weights_are_refused(weights, out, message):
    with pytest.raises(ConfigurationError, match=message):
        GridField(AcousticModel.default(2, 2), [[0, 0, 0.1]]).pressure(weights, out)


@pytest.mark.parametrize("point", [[0, 0, np.nan], [0.005, 0.005, 0.0]])
def test_bad_points_are_refused(point):
    with pytest.raises(ConfigurationError):
        GridField(AcousticModel.default(2, 2), [[0, 0, 0.1], point])


def test_a_matrix_that_would_not_fit_is_refused_before_the_work(monkeypatch):
    monkeypatch.setattr("os.sysconf", lambda _: 1 << 8)
    with pytest.raises(ConfigurationError, match="a matrix of 2000 x 4"):
        GridField(AcousticModel.default(2, 2), np.full((2000, 3), 0.1))


def test_the_points_of_a_box_reach_both_faces():
    points = box_points_m([0, 0, 0.1], [0.01, 0.02, 0.1], 0.003)
    assert points.shape == (5 * 8 * 1, 3)
    assert points.min(axis=0) == pytest.approx([0, 0, 0.1])
    assert points.max(axis=0) == pytest.approx([0.01, 0.02, 0.1])
    assert (np.diff(points[:8, 1]) <= 0.003).all()


@pytest.mark.parametrize(
    ("low", "high", "step", "message"),
    [
        ([0, 0, 0], [1, 1, 1], 1e-6, "half of the memory"),
        ([0, 0, 0], [1, 1, 1], 0.0, "step_m is 0"),
        ([0, 0, 0], [1, 1, -1], 0.1, "the box ends"),
        ([0, 0, np.nan], [1, 1, 1], 0.1, "low_m"),
        ([0, 0], [1, 1, 1], 0.1, "low_m has shape"),
    ],
)
def test_a_bad_box_is_refused(low, high, step, message):
    with pytest.raises(ConfigurationError, match=message):
        box_points_m(low, high, step)
