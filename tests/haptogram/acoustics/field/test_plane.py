"""Planes by convolution against the reference, and their refusals."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram.acoustics import AcousticModel, Medium, Transducer, TransducerArray, propagators
from haptogram.acoustics.field.plane import PlaneField
from haptogram.errors import ConfigurationError
from strategies_acoustics import grids, models, seeds


def assert_agrees(plane, model, weights):
    field = plane.pressure(weights)
    assert field.shape == plane.shape
    points = plane.points_m.reshape(-1, 3)
    chosen = np.random.default_rng(0).choice(len(points), min(60, len(points)), replace=False)
    matrix = propagators(model, points[chosen])
    # An FFT spreads its rounding error evenly: the largest field there is sets the scale.
    scale = (np.abs(matrix) @ np.abs(weights)).max()
    error = np.abs(field.ravel()[chosen] - matrix @ weights)
    assert error.max() <= 1e-6 * scale


@given(models(grids(1, 7)), st.integers(1, 5), st.floats(0.02, 0.06), st.floats(0.02, 0.25), seeds)
def test_a_plane_agrees_with_the_reference(model, oversampling, half_width, height, seed):
    rng = np.random.default_rng(seed)
    plane = PlaneField(model, height, half_width_m=half_width, oversampling=oversampling)
    assert plane.x_m[0] <= -half_width + 1e-9
    assert plane.y_m[-1] >= half_width - 1e-9
    for _ in range(2):  # the buffer is used again
        assert_agrees(plane, model, rng.normal(size=(model.array.count, 2)) @ [1, 1j])


def test_a_plane_too_wide_for_matrix_products_takes_fast_transforms():
    model = AcousticModel.default(3, 2)
    plane = PlaneField(model, 0.15, half_width_m=0.2, oversampling=2)
    for _ in range(2):
        assert_agrees(plane, model, np.exp(1j * np.arange(6)))


def test_a_plane_smaller_than_the_array_is_cut_from_the_middle():
    model = AcousticModel.default(9, 9)
    plane = PlaneField(model, 0.1, half_width_m=0.01, oversampling=4)
    assert len(plane.x_m) == 9
    assert_agrees(plane, model, np.exp(1j * np.arange(81)))


def test_the_plane_of_a_tilted_array_with_holes_is_parallel_to_it():
    grid = AcousticModel.default(6, 5)
    keep = np.delete(np.arange(30), [4, 11])
    c, s = np.cos(0.4), np.sin(0.4)
    turn = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    array = TransducerArray.from_positions(
        grid.array.positions_m[keep] @ turn.T + [1, 2, 3], grid.array.normals[keep] @ turn.T
    )
    model = AcousticModel(array, grid.medium, grid.transducer)
    plane = PlaneField(model, 0.12, half_width_m=0.04, oversampling=3)
    assert (plane.points_m - array.centre_m) @ array.normals[0] == pytest.approx(0.12)
    assert_agrees(plane, model, np.exp(1j * np.arange(28)))


def uneven():
    x = np.array([0.0, 0.01, 0.03])
    places = np.array([[a, b, 0.0] for a in x for b in x])
    return AcousticModel(TransducerArray.from_positions(places), Medium.air(), Transducer())


@pytest.mark.parametrize(
    ("model", "height", "half_width", "oversampling", "message"),
    [
        (uneven(), 0.1, 0.05, 4, "must be equal"),
        (AcousticModel.default(3, 3), 0.1, 0.05, 0, "oversampling is 0"),
        (AcousticModel.default(3, 3), 0.1, 0.05, 65, "oversampling is 65"),
        (AcousticModel.default(3, 3), 0.1, -1.0, 4, "half_width_m is -1"),
        (AcousticModel.default(3, 3), 0.1, np.nan, 4, "half_width_m is nan"),
        (AcousticModel.default(3, 3), np.nan, 0.05, 4, "height_m is nan"),
        (AcousticModel.default(3, 3), 0.0005, 0.05, 4, "mm from element"),
        (AcousticModel.default(3, 3), 0.1, 1e3, 64, "half of the memory"),
        (AcousticModel.default(3, 3), 0.1, 1e6, 64, "half of the memory"),
    ],
)
def test_bad_input_is_refused(model, height, half_width, oversampling, message):
    with pytest.raises(ConfigurationError, match=message):
        PlaneField(model, height, half_width_m=half_width, oversampling=oversampling)


def test_an_array_that_is_no_lattice_is_refused():
    array = TransducerArray.from_positions([[0, 0, 0], [0.01, 0, 0.001], [0, 0.012, 0]])
    with pytest.raises(ConfigurationError, match="lattice"):
        PlaneField(AcousticModel(array, Medium.air(), Transducer()), 0.1, half_width_m=0.05)


def test_weights_must_fit_the_array():
    plane = PlaneField(AcousticModel.default(3, 3), 0.1, half_width_m=0.02, oversampling=2)
    with pytest.raises(ConfigurationError, match=r"must be \(9,\)"):
        plane.pressure(np.ones(8))
