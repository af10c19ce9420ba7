"""A rigid motion of array, target and drive changes nothing but the places.

Arrays of every kind, turned in any direction and moved; the oracles know nothing of own axes.
"""

import math
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptogram.acoustics import (
    AcousticModel,
    Drive,
    NumpyEngine,
    PointSource,
    Reconstructor,
    SingleFocus,
    Transducer,
    TransducerArray,
    check_focus_target,
    choose_engine,
    find_pressure_peak,
    focus_phases,
    force_on_disc_n,
    largest_secondary_lobe,
    measure_spot,
    predict_focal_shift,
    solve_foci,
    worst_exposure,
)
from haptogram.acoustics.model.own_axes import array_axes
from haptogram.acoustics.reconstruct.acquisition import FocusAcquisition
from haptogram.acoustics.reconstruct.cells import cell_phasors, search_cells, search_volume
from haptogram.acoustics.reconstruct.tracking import FocusTracker
from haptogram.acoustics.solvers.focus import focus_steering_reach_m
from haptogram.errors import ConfigurationError
from haptogram.published import PRESETS
from haptogram_paper.figure4 import figure_4_model
from strategies_acoustics import Pose, poses, seeds, targets

pytestmark = pytest.mark.sampled(3)

GRID = AcousticModel.default(8, 7)


def model_of(array):
    return AcousticModel(array, GRID.medium, GRID.transducer)


def bowl():
    """Rings that look at one point."""
    angles = [(n, ring) for ring in (1, 2, 3) for n in range(6 * ring)]
    places = np.array(
        [
            [0.012 * r * math.cos(n * math.pi / 3 / r), 0.012 * r * math.sin(n * math.pi / 3 / r)]
            for n, r in angles
        ]
    )
    z = 0.15 - np.sqrt(0.15**2 - (places**2).sum(axis=1))
    positions = np.column_stack([places, z])
    return TransducerArray.from_positions(positions, np.array([0.0, 0.0, 0.15]) - positions)


def scattered():
    rng = np.random.default_rng(3)
    places = GRID.array.positions_m + rng.uniform(-2e-3, 2e-3, (56, 3))
    return TransducerArray.from_positions(
        places, np.array([0.0, 0.0, 1.0]) + rng.normal(0, 0.1, (56, 3))
    )


ARRAYS = {
    "grid": GRID.array,
    "5x5": TransducerArray.grid(5, 5),
    "line": TransducerArray.grid(12, 1),
    "holes": TransducerArray.from_positions(np.delete(GRID.array.positions_m, [9, 20, 33], axis=0)),
    "bent": figure_4_model("y").array,
    "bowl": bowl(),
    "scattered": scattered(),
    "one": TransducerArray.grid(1, 1),
}
ROOMY = sorted(ARRAYS.keys() - {"one", "line", "bent"})  # every coordinate is observable
NAMES = st.sampled_from(sorted(ARRAYS))
FEW = settings(max_examples=6)
near = targets(lateral=0.03, low=0.06, high=0.15)
TURNS = {
    "down": Pose.about(0, math.pi, (0.3, -0.2, 0.5)),
    "sideways": Pose.about(1, math.pi / 2, (0.3, -0.2, 0.5)),
    "backwards": Pose.about(0, -math.pi / 2, (0.0, 0.0, -0.7)),
    "around z": Pose.about(2, 0.5, (1.0, 0.0, 0.0)),
    "moved": Pose(np.eye(3), np.array([0.3, -0.2, 0.5])),
    "any": Pose.any(np.random.default_rng(8)),
}


# --- own axes


@pytest.mark.parametrize("name", sorted(ARRAYS))
def test_what_faces_up_has_exactly_the_axes_of_the_world(name):
    array = ARRAYS[name]
    assert array.is_upright or name == "scattered"
    moved = array.moved(np.eye(3), [0.3, -0.2, 0.5])
    assert np.array_equal(moved.axes, array.axes)


@pytest.mark.parametrize("preset", PRESETS, ids=lambda preset: preset.name)
def test_the_known_systems_have_the_axes_of_the_world(preset):
    array = preset.build().array
    assert array.is_upright
    assert np.array_equal(array.half_extent_m, np.ptp(array.bounds_m, axis=0) / 2)


@given(NAMES, poses())
def test_the_axes_turn_with_the_array(name, pose):
    array = ARRAYS[name]
    moved = array.moved(pose.turn, pose.shift_m)
    assert moved.axes == pytest.approx(array.axes @ pose.turn.T, abs=1e-12)
    assert moved.half_extent_m == pytest.approx(array.half_extent_m, abs=1e-12)
    found = array_axes(moved.positions_m, moved.normals, moved.grid_shape)
    assert found @ found.T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(found) == pytest.approx(1.0)
    assert found[2] == pytest.approx(moved.axes[2], abs=1e-9)
    if array.grid_shape is not None and array.count > 1:
        assert found == pytest.approx(moved.axes, abs=1e-9)


@given(st.sampled_from(["grid", "5x5", "line", "holes"]), poses())
def test_rows_are_found_without_numbers_up_to_quarter_turns(name, pose):
    array = ARRAYS[name]
    bare = TransducerArray.from_positions(
        pose.points(array.positions_m), array.normals @ pose.turn.T
    )
    quarter = np.abs(bare.axes @ pose.turn)
    assert np.sort(quarter, axis=1)[:, -1] == pytest.approx(1.0, abs=1e-9)


def test_points_along_the_own_axes_come_back():
    pose = TURNS["any"]
    array = GRID.array.moved(pose.turn, pose.shift_m)
    points = np.random.default_rng(0).normal(size=(5, 3))
    assert array.local_m(pose.points(points)) == pytest.approx(points, abs=1e-12)
    assert array.world_m(points) == pytest.approx(pose.points(points), abs=1e-12)


def test_elements_that_lean_within_their_plane_keep_the_face_of_the_plane():
    lean = TransducerArray.from_positions(
        GRID.array.positions_m, GRID.array.normals + np.array([0.5, 0, 0])
    )
    assert lean.is_upright
    assert lean.facing[0] > 0.4
    along = TransducerArray.from_positions(
        GRID.array.positions_m, GRID.array.normals + np.array([9.0, 0, 0])
    )
    assert along.axes[2] == pytest.approx(along.facing)


@pytest.mark.parametrize(
    ("rotation", "shift", "message"),
    [
        (np.eye(3) * 1.1, [0, 0, 0], r"rotation R is none: R R\^T is off 1 by 0.21, must be 1e-09"),
        (np.ones((3, 3)), [0, 0, 0], "rotation R is none"),
        (np.diag([1.0, 1.0, -1.0]), [0, 0, 0], "rotation mirrors: its determinant is -1"),
        (np.full((3, 3), math.nan), [0, 0, 0], r"rotation\[0, 0\] is nan, must be finite"),
        (np.eye(3) * 1e200, [0, 0, 0], r"rotation\[0, 0\] is 1e\+200, must be 2 at most"),
        (np.eye(2), [0, 0, 0], r"rotation has shape \(2, 2\), must be \(3, 3\)"),
        ("upright", [0, 0, 0], "rotation is not an array of numbers"),
        (np.eye(3), [0, 0, math.nan], r"shift_m\[2\] is nan, must be finite"),
        (np.eye(3), [0, 0], r"shift_m has shape \(2,\)"),
        (np.eye(3), [0, 0, 101], "a coordinate is 101 m, at most 100 m"),
    ],
)
def test_a_pose_that_is_no_rigid_motion_is_refused(rotation, shift, message):
    with pytest.raises(ConfigurationError, match=message):
        GRID.array.moved(rotation, shift)


# --- limits and searches


def refusal(model, target):
    """What of a target is refused, and its value; None if it is in reach."""
    try:
        check_focus_target(model, target)
    except ConfigurationError as error:
        return re.sub(r" along the array's \(.*?\)", "", str(error))
    return None


@given(NAMES, poses(), seeds)
def test_a_target_is_in_reach_or_not_wherever_the_array_is(name, pose, seed):
    array = ARRAYS[name]
    here, there = model_of(array), model_of(array.moved(pose.turn, pose.shift_m))
    for target in np.random.default_rng(seed).uniform([-0.3, -0.3, -0.1], [0.3, 0.3, 1.1], (20, 3)):
        assert refusal(there, pose.points(target)) == refusal(here, target)


def two_boards(tilt_rad, apart_m, counts=(5, 5)):
    """Two boards that look at the origin, each by *tilt_rad* off the way of the other one's."""
    places, normals = [], []
    for sign, count in zip((1, -1), counts, strict=True):
        pose = Pose.about(0, sign * (math.pi / 2 - tilt_rad))
        board = TransducerArray.grid(count, 5, pitch_m=0.006)
        places.append(pose.points(board.positions_m - [0.0, 0.0, apart_m / 2]))
        normals.append(board.normals @ pose.turn.T)
    return TransducerArray.from_positions(np.vstack(places), np.vstack(normals))


def ring_that_looks_inwards(count, radius_m):
    turns = 2 * math.pi * np.arange(count) / count
    outwards = np.column_stack([np.cos(turns), np.sin(turns), 0 * turns])
    return TransducerArray.from_positions(radius_m * outwards, -outwards)


@settings(max_examples=40)
@given(
    st.one_of(
        st.builds(
            two_boards,
            st.floats(-0.1, 0.1),
            st.floats(0.07, 0.2),
            st.tuples(st.integers(3, 6), st.integers(3, 6)),
        ),
        st.builds(ring_that_looks_inwards, st.integers(12, 60), st.floats(0.04, 0.1)),
    ),
    poses(),
    seeds,
)
def test_what_elements_look_at_from_all_sides_is_in_reach(array, pose, seed):
    """Between boards that are nearly face to face, inside a ring: wherever it is, up or aside."""
    there = model_of(pose.array(array))
    for target in np.random.default_rng(seed).uniform(-0.008, 0.008, (5, 3)):
        assert refusal(there, pose.points(target)) is None


def test_a_refusal_names_the_axes_of_a_turned_array():
    array = GRID.array.moved(TURNS["sideways"].turn)
    message = r"^target: height z along the array's \(1, 0, 0\) is 10 mm, must be at least 20 mm$"
    with pytest.raises(ConfigurationError, match=message):
        check_focus_target(model_of(array), [0.01, 0.0, 0.0])
    message = r"offset \|x\| along the array's \(0, 0, -1\) is 240 mm, must be at most 190 mm"
    with pytest.raises(ConfigurationError, match=message):
        check_focus_target(model_of(array), [0.3, 0.0, -0.24])


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("name", sorted(ARRAYS))
def test_the_same_cells_are_searched(name, turn):
    pose, array = TURNS[turn], ARRAYS[name]
    moved = model_of(array.moved(pose.turn, pose.shift_m))
    here, there = (search_cells(m, m.array.positions_m) for m in (model_of(array), moved))
    assert focus_steering_reach_m(moved) == pytest.approx(focus_steering_reach_m(model_of(array)))
    assert abs(len(here) - len(there)) <= 0.01 * len(here)  # rounding at a limit
    if len(here) == len(there):
        assert np.median(np.linalg.norm(pose.points(here) - there, axis=1)) < 1e-9


def test_a_search_volume_that_was_kept_is_that_of_this_model():
    """Neighbours in this list differ in one thing."""
    grid = TransducerArray.grid(4, 4)
    loose = TransducerArray.from_positions(grid.positions_m)  # no pitch
    tilted = TransducerArray.from_positions(
        grid.positions_m, np.tile((0.6, 0.0, 0.8), (grid.count, 1))
    )
    air, piston = GRID.medium, GRID.transducer
    models = [AcousticModel(array, air, piston) for array in (grid, loose, tilted)]
    models += [AcousticModel(tilted, air, Transducer(PointSource()))]
    models += [models[-1].with_sound_speed(400.0)]
    for model in models:
        for positions in (model.array.positions_m, model.array.positions_m[:9]):
            kept, phasors = volume = search_volume(model, positions)
            cells = search_cells(model, positions)
            assert np.array_equal(kept, cells)
            assert np.array_equal(phasors, cell_phasors(model, cells, positions))
            assert not any(part.flags.writeable for part in volume)
            assert search_volume(model, positions) is volume


@given(st.sampled_from(ROOMY), poses(), near, st.sampled_from([None, 0.4]))
def test_what_is_reconstructed_moves_with_the_array(name, pose, target, silent):
    """By the compiled search, by that of the reference, and as it comes from a bare file."""
    array = ARRAYS[name]
    here, there = model_of(array), model_of(array.moved(pose.turn, pose.shift_m))
    bare = model_of(pose.array(array))
    codes = Drive.from_weights(np.exp(1j * focus_phases(here, target)))
    amplitudes = np.full(array.count, 255)
    if silent is not None and name != "bowl":  # the rest of a ring would suit several points
        amplitudes[: int(silent * array.count)] = 0  # without the compiled search
    drive = Drive(codes.phase_codes, amplitudes)
    expected = Reconstructor(here).reconstruct(drive)
    assert isinstance(expected, SingleFocus)
    place = pose.points(expected.position_m)
    for model in (there, bare):
        found = Reconstructor(model).reconstruct(drive)
        assert isinstance(found, SingleFocus)
        assert found.position_m == pytest.approx(place, abs=1e-7)
        assert found.pressure_rms_pa == pytest.approx(expected.pressure_rms_pa, rel=1e-6)
        assert found.force_n == pytest.approx(expected.force_n, rel=2e-3)
    active = amplitudes > 0
    phases = np.angle(drive.weights())
    fits = list(FocusAcquisition(there, active).fits(phases, active, math.tau / 256, 12))
    best = min(fits, key=lambda fit: fit.residual_rms_rad)
    assert best.position_m == pytest.approx(place, abs=1e-6)
    if active.all():
        tracker = FocusTracker(there)
        fix = tracker.acquire(drive.phase_codes)
        assert tracker.explains(fix)
        assert fix.position_m == pytest.approx(place, abs=5e-5)


@pytest.mark.parametrize("turn", TURNS)
def test_foci_are_solved_for_an_array_that_faces_anywhere(turn):
    pose, foci = TURNS[turn], np.array([[0.02, 0.01, 0.12], [-0.03, 0.0, 0.1]])
    there = model_of(GRID.array.moved(pose.turn, pose.shift_m))
    expected = solve_foci(GRID, foci, method="gs")
    found = solve_foci(there, pose.points(foci), method="gs")
    assert found == pytest.approx(expected, abs=1e-6)


# --- what a drive makes


def focus(model, target):
    return np.exp(1j * focus_phases(model, target))


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("name", ["grid", "5x5", "line", "holes", "bowl", "scattered"])
def test_the_largest_secondary_lobe_moves_with_the_array(name, turn):
    pose, array, target = TURNS[turn], ARRAYS[name], np.array([0.03, 0.02, 0.12])
    here, there = model_of(array), model_of(array.moved(pose.turn, pose.shift_m))
    weights = focus(here, target)
    expected = largest_secondary_lobe(NumpyEngine(here), weights, target)
    found = largest_secondary_lobe(NumpyEngine(there), weights, pose.points(target))
    assert found.level_db == pytest.approx(expected.level_db, abs=1e-6)
    assert found.position_m == pytest.approx(pose.points(expected.position_m), abs=1e-8)


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("name", ["grid", "5x5", "bowl", "scattered"])
def test_spot_shift_force_and_loudest_place_move_with_the_array(name, turn):
    pose, array, target = TURNS[turn], ARRAYS[name], np.array([0.01, 0.02, 0.1])
    here, there = model_of(array), model_of(array.moved(pose.turn, pose.shift_m))
    weights, place = focus(here, target), pose.points(target)
    spots = [measure_spot(NumpyEngine(m), weights, x) for m, x in ((here, target), (there, place))]
    assert spots[1].width_6db_m == pytest.approx(spots[0].width_6db_m, rel=1e-6)
    assert spots[1].depth_3db_m == pytest.approx(spots[0].depth_3db_m, rel=1e-6, nan_ok=True)
    assert force_on_disc_n(there, weights, place) == pytest.approx(
        force_on_disc_n(here, weights, target), rel=1e-9
    )
    assert force_on_disc_n(choose_engine(there), weights, place) == pytest.approx(
        force_on_disc_n(here, weights, target), rel=1e-4
    )
    loudest = [worst_exposure(NumpyEngine(m), weights[None], 0.5, 1e-3, 600) for m in (here, there)]
    assert loudest[1].position_m == pytest.approx(pose.points(loudest[0].position_m), abs=1e-6)


# --- searches and elements


def peak_or_none(engine, weights, target):
    """Where the maximum is; None if it is said that there is none, and no other error."""
    message = None
    try:
        return find_pressure_peak(engine, weights, target)
    except ConfigurationError as error:
        message = str(error)
    assert message.startswith("no maximum of |p|")
    return None


@pytest.mark.parametrize("shape", [(5, 5), (3, 5), (1, 7), (5, 1), (7, 7), (1, 1), (3, 3), (2, 2)])
@pytest.mark.parametrize("z_m", [0.02, 0.05, 0.1, 0.22, 0.4])
def test_an_ascent_says_that_there_is_no_maximum_instead_of_an_element(shape, z_m):
    model = AcousticModel.default(*shape)
    engine = NumpyEngine(model)
    for x_m in (0.0, 0.004, 0.03):
        target = np.array([x_m, 0.0, z_m])
        weights = focus(model, target)
        found = peak_or_none(engine, weights, target)
        if found is not None:
            assert np.linalg.norm(model.array.positions_m - found, axis=1).min() >= 1e-3
        largest_secondary_lobe(engine, weights, target)
        measure_spot(engine, weights, target)
        predict_focal_shift(model, target)


@pytest.mark.parametrize("offset_m", [1.05e-3, 1.2e-3, 1.5e-3])
def test_an_ascent_that_starts_beside_an_element_has_no_maximum(offset_m):
    model = AcousticModel.default(5, 5)
    with pytest.raises(ConfigurationError, match=r"no maximum .* rises up to the array"):
        find_pressure_peak(NumpyEngine(model), np.ones(25), [0.0, 0.0, offset_m])


def test_searches_leave_out_what_is_within_a_millimetre_of_an_element():
    """A plane through the elements of a bowl; a sphere through the last element of a line."""
    model = model_of(bowl())
    rim = model.array.positions_m[-1]
    target = np.array([0.0, 0.0, rim[2]])
    lobe = largest_secondary_lobe(NumpyEngine(model), np.ones(36), target, 0.05)
    assert lobe is None or math.isfinite(lobe.level_db)
    line = AcousticModel.default(101, 1)
    place = worst_exposure(NumpyEngine(line), np.ones((1, 101)), 0.5, 1e-3, 3000)
    assert math.isfinite(place.equivalent_db_spl)


# --- how far a prediction of the focal shift holds


def test_the_shift_of_a_small_array_far_away_is_not_predicted():
    shift = predict_focal_shift(AcousticModel.default(6, 6), (0.0, 0.0, 0.4))
    assert not shift.valid
    assert shift.size_rad > 1.0
    assert np.isnan(shift.offset_m).all()
    assert math.isnan(shift.gain)
    assert not predict_focal_shift(AcousticModel.default(1, 1), (0.0, 0.0, 0.1)).valid


@given(st.integers(8, 20), st.integers(8, 20), st.floats(0.03, 0.5), seeds, poses())
def test_a_shift_that_is_predicted_is_found(nx, ny, z_m, seed, pose):
    """To a third of its size, in the metric in which the limit is stated."""
    rng = np.random.default_rng(seed)
    array = TransducerArray.grid(nx, ny, pitch_m=rng.uniform(0.006, 0.012))
    model = model_of(array.moved(pose.turn, pose.shift_m))
    target = pose.points([*rng.uniform(-0.05, 0.05, 2), z_m])
    radius_m = rng.uniform(0.5, 1.5) * array.half_extent_m.max()
    taper = np.exp(-(((array.positions_m / radius_m) ** 2).sum(axis=1)))
    shift = predict_focal_shift(model, target, taper)
    if not shift.valid:
        return
    found = find_pressure_peak(NumpyEngine(model), taper * focus(model, target), target) - target
    miss = np.linalg.norm(found - shift.offset_m)
    assert miss <= 0.35 * max(np.linalg.norm(shift.offset_m), np.linalg.norm(found)) + 0.03e-3
