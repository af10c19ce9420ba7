"""The truth of the trials against closed forms, reference values and brute force."""

import ast
import dataclasses
import functools
import itertools
import math
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.special import j1

import oracles
from trials import cases, layouts, truth
from trials.truth import Scene

HERE = Path(__file__).resolve().parent
K_20C = 2.0 * math.pi * 40e3 / 343.2


def scene_of(layout, wavenumber=K_20C, absorption=0.0):
    return Scene(layout.positions_m, layout.normals, wavenumber, absorption)


def focused(scene, target):
    return -scene.wavenumber * scene.distances(np.atleast_2d(target))[0]


def arrival(scene, phases, target, amplitudes=None, bits=8):
    levels = np.ones(len(phases)) if amplitudes is None else amplitudes
    lie = truth.lie_of(scene, levels, np.array(target), bits)
    return truth.arrival(scene, phases, levels, np.array(target), lie)


@functools.cache
def pose(number):
    """One of the layouts of all kinds, as the trials use them, with a target."""
    seeds = itertools.count(0 if number == 0 else pose(number - 1)[0].seed + 1)
    for session in (cases.session_of("honest", seed) for seed in seeds):
        wanted = session.frames[0]
        if session.elements is not None or session.layout.kind == "line":
            continue
        if session.layout.count >= 25 and len(wanted.foci) == 1:
            return session, wanted.targets_m[0]


# --- what it rests on ------------------------------------------------------------------------


def test_the_truth_takes_nothing_from_the_program():
    tree = ast.parse((HERE / "truth.py").read_text(encoding="utf-8"))
    modules = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            modules |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0
            modules.add(node.module.split(".")[0])
        elif isinstance(node, ast.Name):
            assert node.id not in ("__import__", "eval", "exec")
    assert modules - set(sys.stdlib_module_names) == {"numpy", "numba"}


def test_the_speed_of_sound_is_the_printed_one():
    assert round(truth.sound_speed_m_s(23.0), 5) == 345.86652  # IEC 61094-2:2009, table F.1
    assert round(truth.sound_speed_m_s(30.0, 60.0), 2) == 350.54


@pytest.mark.parametrize(
    ("temperature_c", "humidity", "db_m"),
    [(20, 50, 1.318), (20, 30, 1.068), (20, 70, 1.286), (20, 10, 0.456), (15, 50, 1.112),
     (25, 50, 1.392), (30, 60, 1.217)],
)  # fmt: skip
def test_the_absorption_is_that_of_iso_9613(temperature_c, humidity, db_m):
    neper = truth.absorption_np_m(temperature_c, humidity)
    assert neper * 20.0 / math.log(10.0) == pytest.approx(db_m, abs=6e-4)


def test_humid_air_is_faster():
    assert truth.humid_speed_ratio(20.0, 0.0) == 1.0
    assert truth.humid_speed_ratio(20.0, 50.0) == pytest.approx(1.00182, abs=2e-5)
    assert truth.humid_speed_ratio(50.0, 50.0) > 1.008


def test_the_piston_is_a_bessel_function():
    x = np.linspace(1e-6, 4.0, 2001)
    np.testing.assert_allclose(truth.piston(x), 2.0 * j1(x) / x, atol=1e-13)
    assert truth.piston(np.zeros(1))[0] == 1.0


REFERENCES = [c for c in oracles.reference_fields()["configs"] if c.get("a") and c["target"]]


@pytest.mark.parametrize("config", REFERENCES, ids=lambda config: config["name"])
def test_the_field_is_that_of_the_reference_in_50_digits(config):
    layout = layouts.grid(config["nx"], config["ny"], float(config["pitch"]))
    scene = scene_of(layout, float(config["k_rad_per_m"]), float(config["alpha"]))
    phases = focused(scene, [float(x) for x in config["target"]])
    if config["phase"] == "quant":
        phases = np.array(config["phase_index"]) * (2.0 * math.pi / 2 ** config["bits"])
    points = np.array([[float(x) for x in value["point"]] for value in config["values"]])
    scale = float(config["Pref"]) / (math.sqrt(2.0) * truth.SOURCE_PA_M)
    found = scale * scene.pressure(truth.turned(phases), points)
    right = np.array([value["re_f"] + 1j * value["im_f"] for value in config["values"]])
    np.testing.assert_allclose(found, right, atol=1e-9 * np.abs(right).max())


@pytest.mark.parametrize("number", range(6))
def test_the_level_that_is_searched_is_that_of_the_field(number):
    session, target = pose(number)
    scene = dataclasses.replace(session.scene, absorption=0.3)
    random = np.random.default_rng(2)
    points = target + random.normal(size=(50, 3)) * 0.05
    points = points[scene.distances(points).min(axis=1) > 0.003]
    weights = truth.turned(random.uniform(0.0, 6.0, session.layout.count))
    found = scene.levels(weights, shaded=True)(points)
    right = np.abs(scene.pressure(weights, points))
    np.testing.assert_allclose(found, right, atol=1e-8 * right.max())
    coherent = np.abs(truth.turned(scene.wavenumber * scene.distances(points)) @ weights)
    np.testing.assert_allclose(scene.levels(weights, shaded=False)(points), coherent, atol=1e-7)
    assert scene.levels(weights, shaded=True)(scene.positions_m[:1] + 1e-3)[0] == -1.0


def test_elements_radiate_alike_wherever_the_array_is_and_faces():
    layout = layouts.grid(5, 4, 0.009)
    random = np.random.default_rng(4)
    turn = layouts.rotation(layouts.direction(random), 1.3)
    points = np.array([[0.01, 0.02, 0.09], [-0.03, 0.0, 0.2]])
    shift = np.array([0.3, -0.2, 0.5])
    weights = truth.turned(random.uniform(0.0, 6.0, 20))
    here = scene_of(layout).pressure(weights, points)
    moved = Scene(layout.positions_m @ turn.T + shift, layout.normals @ turn.T, K_20C)
    np.testing.assert_allclose(moved.pressure(weights, points @ turn.T + shift), here, rtol=1e-10)


def test_an_element_shades_what_is_behind_it():
    layout = layouts.grid(1, 1, 0.01)
    points = np.array([[0.0, 0.0, 0.1], [0.0, 0.0, -0.1]])
    front, back = np.abs(scene_of(layout).pressure(np.ones(1), points))
    assert front == pytest.approx(math.sqrt(2.0) * 3.10 / 0.1)
    assert back == 0.0


# --- where the waves arrive in phase ---------------------------------------------------------


@pytest.mark.parametrize("number", range(12))
def test_ideal_phases_arrive_in_phase_at_their_target(number):
    session, target = pose(number)
    found = arrival(session.scene, focused(session.scene, target), target)
    assert found.coherence == pytest.approx(1.0, abs=1e-7)
    assert found.at_target == pytest.approx(1.0, abs=1e-12)
    lie = truth.lie_of(session.scene, np.ones(session.layout.count), target, 8)
    assert np.abs(lie.axes @ found.miss_m / lie.units_m)[~lie.flat].max() < 1e-3


@pytest.mark.parametrize("number", range(8))
def test_phases_for_a_place_nearby_are_found_there(number):
    session, target = pose(number)
    scene = session.scene
    lie = truth.lie_of(scene, np.ones(session.layout.count), target, 8)
    away = 0.4 * lie.units_m @ lie.axes * (~lie.flat).all()
    found = arrival(scene, focused(scene, target + away), target)
    np.testing.assert_allclose(lie.axes @ (found.miss_m - away) / lie.units_m, 0.0, atol=2e-3)


def test_wrong_air_moves_the_focus_of_a_grid_as_far_as_a_brute_force_search_finds():
    scene = scene_of(layouts.grid(16, 16, 0.010))
    target = np.array([0.0, 0.0, 0.15])
    phases = focused(dataclasses.replace(scene, wavenumber=K_20C / 1.01), target)
    heights = np.linspace(0.145, 0.155, 10_001)
    axis = np.stack([np.zeros_like(heights), np.zeros_like(heights), heights], axis=1)
    level = np.abs(truth.turned(scene.wavenumber * scene.distances(axis) + phases).sum(axis=1))
    found = arrival(scene, phases, target)
    assert found.place_m[2] == pytest.approx(heights[level.argmax()], abs=2e-6)
    assert np.abs(found.place_m[:2]).max() < 2e-6
    assert abs(found.miss_m[2]) > 1e-3


def test_the_search_finds_what_every_place_of_a_fine_grid_does_not_beat():
    scene = scene_of(layouts.grid(6, 9, 0.011))
    random = np.random.default_rng(1)
    target = np.array([0.01, -0.02, 0.12])
    phases = focused(scene, target) + random.normal(0.0, 0.4, 54)
    lie = truth.lie_of(scene, np.ones(54), target, 8)
    found = arrival(scene, phases, target)
    steps = np.array(list(itertools.product(np.linspace(-1.5, 1.5, 31), repeat=3)))
    points = target + steps * lie.units_m @ lie.axes
    level = np.abs(truth.turned(scene.wavenumber * scene.distances(points)) @ np.exp(1j * phases))
    assert level.max() / 54 <= found.coherence + 1e-9


@pytest.mark.parametrize(
    ("sides", "target", "flat"),
    [((1, 1), (0.01, 0.0, 0.1), 3), ((2, 2), (0.0, 0.0, 0.1), 1), ((1, 16), (0.0, 0.02, 0.1), 1),
     ((16, 1), (0.02, 0.01, 0.1), 1), ((8, 8), (0.0, 0.0, 0.2), 0), ((3, 3), (0.01, 0.0, 0.1), 0)],
)  # fmt: skip
def test_what_cannot_be_observed_is_known(sides, target, flat):
    scene = scene_of(layouts.grid(*sides, 0.010))
    lie = truth.lie_of(scene, np.ones(len(scene.positions_m)), np.array(target), 8)
    assert lie.flat.sum() == flat
    turned = focused(scene, target)
    assert arrival(scene, turned, target).coherence == pytest.approx(1.0, abs=1e-9)


# --- the loudest place -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("height_m", "shift_mm"),
    [(0.05, 0.35), (0.075, -0.02), (0.1, -0.67), (0.15, -3.15), (0.2, -7.69), (0.3, -24.4)],
)
def test_diffraction_pulls_the_loudest_place_as_far_as_was_computed_elsewhere(height_m, shift_mm):
    scene = scene_of(layouts.grid(16, 16, 0.010), 2.0 * math.pi * 40e3 / 343.2, 0.1518)
    target = np.array([0.0, 0.0, height_m])
    lie = truth.lie_of(scene, np.ones(256), target, 8)
    place = truth.loudest(scene, np.exp(1j * focused(scene, target)), target, lie)
    assert (place[2] - height_m) * 1e3 == pytest.approx(shift_mm, abs=0.06)
    assert np.abs(place[:2]).max() < 1e-5


# --- effects ---------------------------------------------------------------------------------


def test_one_silent_element_of_a_ring_takes_its_share():
    turns = 2.0 * math.pi * np.arange(40) / 40
    ring = np.stack([0.08 * np.cos(turns), 0.08 * np.sin(turns), np.zeros(40)], axis=1)
    scene = Scene(ring, np.tile([0.0, 0.0, 1.0], (40, 1)), K_20C)
    target = np.array([0.0, 0.0, 0.15])
    ideal = np.exp(1j * focused(scene, target))
    broken = ideal.copy()
    broken[7] = 0.0
    assert truth.shares(scene, broken, ideal, target[None])[0] == pytest.approx(1 - 1 / 40)
    assert truth.scattered(scene, broken, ideal, target) == pytest.approx(1 / 40)
    broken[7] = -ideal[7]
    assert truth.scattered(scene, broken, ideal, target) == pytest.approx(2 / 40)
    mirrored = ideal * (np.arange(40) < 20)
    other = ideal * (np.arange(40) >= 20)
    assert truth.shares(scene, other, mirrored, target[None])[0] == pytest.approx(1.0)
    assert truth.scattered(scene, other, mirrored, target) == pytest.approx(2.0)


@pytest.mark.parametrize("bits", [5, 6, 8])
@pytest.mark.parametrize("number", range(6))
def test_rounding_stays_within_what_is_allowed_for_it(number, bits):
    session, target = pose(number)
    scene = session.scene
    ideal = np.exp(1j * focused(scene, target))
    drive = truth.rounded(ideal, bits)
    allowed = truth.rounding_share(bits, ideal)
    assert abs(truth.shares(scene, drive, ideal, target[None])[0] - 1.0) <= allowed
    assert truth.scattered(scene, drive, ideal, target) <= allowed
    lie = truth.lie_of(scene, np.abs(ideal), target, bits)
    if not lie.flat.any():
        found = arrival(scene, np.angle(drive), target, bits=bits)
        worst = truth.rounding_mm(scene, np.abs(ideal), target, bits)
        assert np.linalg.norm(found.miss_m) * 1e3 <= worst * 1.05 + 2e-3


def test_the_worst_rounding_is_reached_by_the_signs_that_it_is_made_of():
    scene = scene_of(layouts.grid(10, 10, 0.010))
    target = np.array([0.0, 0.0, 0.12])
    rays = target - scene.positions_m
    slopes = scene.wavenumber * rays / np.linalg.norm(rays, axis=1)[:, None]
    slopes -= slopes.mean(axis=0)
    signs = np.sign(np.linalg.pinv(slopes)[0])
    wrong = focused(scene, target) + signs * math.pi / 256
    miss = arrival(scene, wrong, target).miss_m
    axes = np.eye(3)[:1]
    worst = truth.rounding_mm(scene, np.ones(100), target, 8, axes)
    assert abs(miss[0]) * 1e3 == pytest.approx(worst, rel=0.02)
    assert worst <= truth.rounding_mm(scene, np.ones(100), target, 8)


def test_what_rounding_reaches_for_several_foci_holds_for_every_common_lag():
    scene = scene_of(layouts.grid(12, 12, 0.010))
    targets = np.array([[0.02, 0.0, 0.12], [-0.02, 0.01, 0.13]])
    ideal = np.exp(1j * np.angle(np.exp(1j * focused(scene, targets[0]))
                                 + np.exp(1j * focused(scene, targets[1]))))  # fmt: skip
    reach = truth.rounding_reach(scene, ideal, targets, 5)
    for lag in np.arange(64) * (2.0 * math.pi / 32 / 64):
        drive = truth.rounded(ideal, 5, lag)
        change = np.abs(truth.shares(scene, drive, ideal, targets) - 1.0)
        assert (change <= reach + 1e-12).all()
    assert (reach < 0.03).all()
