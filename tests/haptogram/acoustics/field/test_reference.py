"""The field against a triple loop, and its shape and refusals."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import oracles
from haptogram.acoustics import (
    AcousticModel,
    Medium,
    NumpyEngine,
    Transducer,
    TransducerArray,
    pressure,
    propagators,
)
from haptogram.errors import ConfigurationError
from strategies_acoustics import grids, models, seeds, targets


def oracle_field(model, points, weights):
    wavenumber = 2.0 * math.pi * model.transducer.frequency_hz / model.medium.sound_speed_m_s
    radius_m = getattr(model.transducer.directivity, "radius_m", None)
    return oracles.field(
        points,
        model.array.positions_m,
        model.array.normals,
        weights,
        wavenumber=wavenumber,
        absorption=model.medium.absorption_np_m,
        peak_strength=math.sqrt(2.0) * model.transducer.source_strength_pa_m,
        gain=oracles.circular_piston(wavenumber * radius_m)
        if radius_m
        else oracles.omnidirectional,
    )


def assert_agrees(model, points, weights):
    expected = oracle_field(model, points, weights)
    field = pressure(model, weights, points)
    for value, (total, magnitude) in zip(field, expected, strict=True):
        assert abs(value - total) <= 1e-12 * magnitude


@given(models(grids(1, 5)), targets(lateral=0.2, low=0.005), seeds)
def test_the_field_agrees_with_a_triple_loop(model, point, seed):
    weights = np.random.default_rng(seed).normal(size=(model.array.count, 2)) @ [1, 1j]
    assert_agrees(model, [point], weights)


@given(seeds)
def test_elements_radiate_around_their_own_normals(seed):
    rng = np.random.default_rng(seed)
    array = TransducerArray.from_positions(rng.uniform(-0.1, 0.1, (9, 3)), rng.normal(size=(9, 3)))
    model = AcousticModel(array, Medium.air(), Transducer())
    assert_agrees(model, rng.uniform(0.15, 0.3, (5, 3)), rng.normal(size=9) + 1j)


def test_a_tilted_array_has_the_tilted_field():
    angle = 0.7
    turn = np.array(
        [[math.cos(angle), 0, math.sin(angle)], [0, 1, 0], [-math.sin(angle), 0, math.cos(angle)]]
    )
    flat = AcousticModel.default(4, 3)
    turned = TransducerArray.from_positions(
        flat.array.positions_m @ turn.T, flat.array.normals @ turn.T
    )
    tilted = AcousticModel(turned, flat.medium, flat.transducer)
    points = np.array([[0.01, 0.02, 0.1], [-0.05, 0, 0.08]])
    assert pressure(tilted, np.ones(12), points @ turn.T) == pytest.approx(
        pressure(flat, np.ones(12), points), rel=1e-11
    )


def test_many_drives_and_many_points_are_chunked_without_a_seam():
    model = AcousticModel.default(16, 16)
    rng = np.random.default_rng(5)
    points = rng.uniform(-0.05, 0.05, (333, 3)) + np.array([0, 0, 0.15])
    weights = rng.normal(size=(3, 256)) + 1j * rng.normal(size=(3, 256))
    whole = propagators(model, points)
    assert whole.shape == (333, 256)
    field = pressure(model, weights, points)
    assert field.shape == (3, 333)
    assert field == pytest.approx(weights @ whole.T, rel=1e-12)
    assert pressure(model, weights[1], points) == pytest.approx(field[1], rel=1e-12)
    assert NumpyEngine(model).pressure(weights, points) == pytest.approx(field, rel=0)
    assert NumpyEngine(model).model is model


def test_no_points_give_no_pressure():
    assert pressure(AcousticModel.default(2, 2), np.ones(4), np.empty((0, 3))).shape == (0,)


@given(st.sampled_from([math.nan, math.inf, -math.inf]), st.integers(0, 2))
def test_a_point_that_is_not_finite_is_refused(value, axis):
    point = [0.0, 0.0, 0.1]
    point[axis] = value
    with pytest.raises(ConfigurationError, match=r"points_m.* must be finite"):
        propagators(AcousticModel.default(2, 2), [point])


@pytest.mark.parametrize(
    ("weights", "points", "complaint"),
    [
        (
            np.ones(4),
            [[0.005, 0.005, 0.0009]],
            r"0\.9 mm from element 3.* 1 mm",
        ),
        (np.ones(4), [0.0, 0.0, 0.1], r"\(3,\), must be \(M, 3\)"),
        (np.ones(5), [[0.0, 0.0, 0.1]], r"\(5,\), must end in 4 elements"),
        (np.ones((1, 1, 4)), [[0.0, 0.0, 0.1]], r"\(1, 1, 4\)"),
        ([1, 1, 1, np.nan], [[0.0, 0.0, 0.1]], "nan"),
    ],
)
def test_bad_arguments_are_refused_with_value_and_limit(weights, points, complaint):
    with pytest.raises(ConfigurationError, match=complaint):
        pressure(AcousticModel.default(2, 2), weights, points)
