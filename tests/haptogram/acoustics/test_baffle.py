"""Behind a baffle there is no field: every engine refuses to say one, before any work."""

import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram.acoustics import (
    AcousticModel,
    Medium,
    NumbaEngine,
    NumpyEngine,
    PointSource,
    Reconstructor,
    RectangularPiston,
    Transducer,
    TransducerArray,
    check_focus_target,
    focus_phases,
    largest_secondary_lobe,
    measure_spot,
    points_in_front,
    pressure,
    propagators,
    worst_exposure,
)
from haptogram.acoustics.field import reference as field_module
from haptogram.acoustics.field.reference import points_clear_of_elements
from haptogram.errors import ConfigurationError
from strategies_acoustics import Pose, seeds

ENGINES = [NumpyEngine, NumbaEngine]
FLAT = AcousticModel.default(5, 4)


def bowl(angle_deg=60.0):
    """Elements on a part of a sphere of 100 mm, that all face its centre at z = 100 mm."""
    polar, azimuth = np.meshgrid(
        np.radians([0.5 * angle_deg, angle_deg]), np.arange(8) * np.pi / 4, indexing="ij"
    )
    inward = -np.stack(
        [np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), -np.cos(polar)], axis=-1
    ).reshape(-1, 3)
    array = TransducerArray.from_positions([0.0, 0.0, 0.1] - 0.1 * inward, inward)
    return AcousticModel(array, Medium.air(), Transducer())


@pytest.mark.parametrize("kind", ENGINES)
@given(seed=seeds, depth_m=st.floats(1e-6, 10.0))
def test_what_is_behind_is_refused_wherever_the_array_lies(kind, seed, depth_m):
    pose = Pose.any(np.random.default_rng(seed), reach_m=3.0)
    points = np.array([[0.03, 0.02, 0.1], [0.1, -0.2, 0.05], [0.02, 0.01, -depth_m]])
    engine = kind(pose.model(FLAT))
    for weights in (np.ones(20), np.ones((2, 20))):
        with pytest.raises(ConfigurationError, match="mm behind the baffle") as refused:
            engine.pressure(weights, pose.points(points))
        stated = re.fullmatch(
            r"point 2 is (\S+) mm behind .* in front of an element", str(refused.value)
        )
        assert float(stated[1]) == pytest.approx(depth_m * 1e3, rel=0.01)
    assert np.abs(engine.pressure(np.ones(20), pose.points(points[:2]))).min() > 0.0


@pytest.mark.parametrize("kind", ENGINES)
@given(seed=seeds)
def test_the_plane_of_a_turned_array_is_in_front_of_it(kind, seed):
    """Rounding puts half of its points on the far side, by less than a nanometre."""
    rng = np.random.default_rng(seed)
    points = np.column_stack([rng.uniform(0.05, 0.2, (30, 2)), np.zeros(30)])
    pose = Pose.any(rng, reach_m=3.0)
    weights = np.exp(2j * np.pi * rng.random(20))
    found = kind(pose.model(FLAT)).pressure(weights, pose.points(points))
    matrix = propagators(FLAT, points)
    assert (np.abs(found - matrix @ weights) <= 2e-5 * np.abs(matrix).sum(axis=1)).all()


@pytest.mark.parametrize("kind", ENGINES)
def test_a_point_behind_some_elements_hears_the_others(kind):
    model = bowl()
    engine = kind(model)
    rim = np.array([[0.0, 0.13, 0.06]])  # behind the elements beside it
    ahead = ((rim - model.array.positions_m) * model.array.normals).sum(axis=1)
    assert (ahead < 0.0).any()
    assert (ahead > 0.0).any()
    assert engine.pressure(np.ones(16), rim) == pytest.approx(
        propagators(model, rim)[:, ahead > 0.0].sum(axis=1), rel=1e-4
    )
    with pytest.raises(ConfigurationError, match="point 0 is 100 mm behind"):
        engine.pressure(np.ones(16), [[0.0, 0.0, -0.3]])


@given(seed=seeds, count=st.integers(1, 12))
def test_in_front_is_in_front_of_any_element(seed, count):
    rng = np.random.default_rng(seed)
    few = rng.normal(size=(rng.integers(1, count + 1), 3))  # several face the same way
    array = TransducerArray.from_positions(
        rng.uniform(-0.1, 0.1, (count, 3)), rng.choice(few, count)
    )
    model = AcousticModel(array, Medium.air(), Transducer())
    points = rng.uniform(-0.5, 0.5, (50, 3))
    expected = [
        any((point - s) @ n >= 0.0 for s, n in zip(array.positions_m, array.normals, strict=True))
        for point in points
    ]
    assert points_in_front(model, points).tolist() == expected


@pytest.mark.parametrize(
    ("directivity", "baffled"),
    [
        (PointSource(), False),
        (RectangularPiston(5e-3, 8e-3), True),
    ],
)
def test_the_directivity_tells_whether_there_is_a_baffle(directivity, baffled):
    model = AcousticModel(TransducerArray.grid(3, 3), Medium.air(), Transducer(directivity))
    behind, plane = [[0.05, 0.0, -0.02]], [[0.05, 0.0, 0.0]]
    assert points_in_front(model, behind).tolist() == [not baffled]
    assert np.abs(propagators(model, plane)).min() > 0.0
    if baffled:
        with pytest.raises(ConfigurationError, match="point 0 is 20 mm behind the baffle"):
            pressure(model, np.ones(9), behind)
    else:
        assert np.abs(pressure(model, np.ones(9), behind)) > 0.0


def test_nothing_is_computed_before_every_point_was_looked_at(monkeypatch):
    def too_early(*_):
        raise AssertionError("work began")

    monkeypatch.setattr(field_module, "_field_propagators", too_early)
    points = np.tile([0.0, 0.0, 0.1], (5000, 1))
    for last in ([0.0, 0.0, -0.1], [0.005, 0.005, 0.0002]):
        points[-1] = last
        with pytest.raises(ConfigurationError, match="point 4999 is"):
            pressure(AcousticModel.default(), np.ones(256), points)


def test_points_near_an_element_are_found_among_many():
    rng = np.random.default_rng(1)
    points = rng.uniform(-0.04, 0.04, (40_000, 3))
    distance = np.array([np.linalg.norm(points - s, axis=1) for s in FLAT.array.positions_m])
    assert (points_clear_of_elements(FLAT, points, 2e-3) == (distance.min(axis=0) >= 2e-3)).all()
    assert (points_clear_of_elements(FLAT, points, 50e-3) == (distance.min(axis=0) >= 50e-3)).all()


def test_matrices_are_refused_too():
    for make in (
        lambda: NumbaEngine(FLAT).propagators([[0.0, 0.0, -0.1]]),
        lambda: propagators(FLAT, [[0.0, 0.0, -0.1]]),
    ):
        with pytest.raises(ConfigurationError, match="100 mm behind the baffle"):
            make()


def test_searches_around_a_focus_of_a_steep_array_leave_out_what_is_behind():
    model = Pose.about(0, math.radians(50.0)).model(AcousticModel.default(8, 8))
    target = model.array.centre_m + 0.12 * model.array.facing
    weights = np.exp(1j * focus_phases(model, target))
    corner = [target[0], 0.3, target[2]]
    assert points_in_front(model, [target, corner]).tolist() == [True, False]
    assert largest_secondary_lobe(NumpyEngine(model), weights, target, 0.3).level_db < 0.0
    assert np.isfinite(measure_spot(NumpyEngine(model), weights, target).width_3db_m).all()


def test_the_loudest_place_is_looked_for_where_the_array_faces():
    flat = AcousticModel.default(8, 8)
    target = np.array([0.02, 0.0, 0.15])
    weights = np.exp(1j * focus_phases(flat, target))[None]
    upright = worst_exposure(NumpyEngine(flat), weights, 0.5, 1e-3, directions=600)
    model = Pose.about(0, math.radians(90.0)).model(flat)
    tilted = worst_exposure(NumpyEngine(model), weights, 0.5, 1e-3, directions=600)
    assert np.array(tilted.position_m) @ model.array.facing > 0.0
    assert tilted.equivalent_db_spl == pytest.approx(upright.equivalent_db_spl, abs=1.0)


def test_an_array_that_faces_down_has_its_targets_below():
    model = Pose.about(0, math.radians(180.0)).model(AcousticModel.default(4, 4))
    message = r"height z along the array's \(0, 0, -1\) is -100 mm, must be at least 20 mm"
    with pytest.raises(ConfigurationError, match=message):
        check_focus_target(model, [0.0, 0.0, 0.1])
    check_focus_target(model, [0.0, 0.0, -0.1])


def test_elements_that_look_away_from_each_other_have_no_targets_between_them():
    positions = [[x, y, z] for z, x, y in ((3, 0, 0), (3, 0.1, 0), (3, 0, 0.1), (-9, 0, 0))]
    normals = [[0.0, 0.0, z] for z in (1.0, 1.0, 1.0, -1.0)]
    array = TransducerArray.from_positions(positions, normals)
    model = AcousticModel(array, FLAT.medium, FLAT.transducer)
    with pytest.raises(ConfigurationError, match=r"face \[0.0, 0.0, 1.0\] on the whole: nothing"):
        Reconstructor(model).reconstruct_weights(np.ones(4))
