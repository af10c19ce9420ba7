"""Patterns of drives: every kind on every board, in any pose, with elements missing."""

import doctest
import json
import math
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import pattern_drives as drives
from haptogram.acoustics import (
    AcousticModel,
    Calibration,
    CircularPiston,
    Medium,
    Transducer,
    superpose_foci,
)
from haptogram.acoustics.model.boards.table import LAYOUTS
from haptogram.acoustics.reconstruct.patterns import classifier, explain
from haptogram.acoustics.reconstruct.patterns.classifier import PatternClassifier
from haptogram.acoustics.reconstruct.patterns.found import KINDS, pattern_dict
from haptogram.errors import ConfigurationError
from haptogram_protocol.dialects.table import DIALECTS

pytestmark = pytest.mark.sampled(2)

DATA = Path(__file__).parents[4] / "data" / "dialects"
EXPECTED = json.loads((DATA / "expected.json").read_text())
BOARDS = {
    "sonicsurface": 32,
    "ultraino-flat8": 10,
    "interactlab": 128,
    "autd3": 256,
    "sonicsurface-stack": 32,
    "tinylev": 10,
}
PLACED = ("one focus", "twin trap", "vortex")
K = AcousticModel.default(2, 2).wavenumber
_KEPT = {}


def model_of(array, speed=drives.SPEED_M_S):
    return AcousticModel(array, Medium(speed, 1.2), Transducer(CircularPiston(4.5e-3)))


def classifier_of(board):
    """One for each board: its search volume takes longer than a drive."""
    if board not in _KEPT:
        _KEPT[board] = PatternClassifier(model_of(LAYOUTS[board].array()), BOARDS[board])
    return _KEPT[board]


@pytest.mark.parametrize("cut_off", [False, True])
@pytest.mark.parametrize("steps", [32, 16])
def test_a_focus_of_which_outputs_come_a_step_late_is_no_vortex(steps, cut_off):
    """The axis of a vortex from afar explains a few of the late ones by chance."""
    rng, array = np.random.default_rng(steps), LAYOUTS["sonicsurface"].array()
    finder = PatternClassifier(model_of(array), steps)
    for _ in range(8):
        place = np.array([0.0, 0.0, 0.14]) + rng.uniform(-0.04, 0.04, 3)
        codes = drives.coded(drives.focus(array.positions_m, place, K), steps, cut_off)
        codes[3::8] += 1
        finder.reset()
        found = finder.classify(drives.radiated(codes, steps))
        assert found.kind == "one focus", place
        assert np.linalg.norm(np.array(found.position_m) - place) < 2e-3


@pytest.mark.parametrize("board", BOARDS)
@pytest.mark.parametrize("kind", PLACED)
def test_a_pattern_is_named_and_placed(board, kind):
    """Air that is 1 % faster moves a focus, but makes no other pattern of it."""
    rng = np.random.default_rng(len(board) + len(kind))
    positions = LAYOUTS[board].array().positions_m
    steps = BOARDS[board]
    finder = classifier_of(board)
    for speed in (drives.SPEED_M_S, 1.01 * drives.SPEED_M_S):
        phases, wanted = drives.random_pattern(rng, positions, kind, drives.k_of(speed))
        codes = drives.coded(phases, steps, cut_off=bool(rng.integers(2)))
        finder.reset()
        found = finder.classify(drives.radiated(codes, steps))
        assert found.kind == kind
        if kind == "vortex":
            assert found.charge == wanted.charge
        if speed == drives.SPEED_M_S:
            off = np.abs(np.array(found.position_m) - wanted.places_m[0])
            assert (off <= 1.1 * np.array(found.bound_m) + 1e-6).all()


@pytest.mark.sampled(1)
@pytest.mark.parametrize("board", ["sonicsurface", "interactlab"])
def test_several_foci_are_counted_and_placed(board):
    rng = np.random.default_rng(5)
    positions, steps = LAYOUTS[board].array().positions_m, BOARDS[board]
    for count in (2, 3):
        places = np.array([[-0.03, 0.0, 0.12], [0.03, 0.01, 0.12], [0.0, 0.045, 0.13]])[:count]
        phases = drives.several(positions, places, rng.uniform(0, 6, count), drives.k_of())
        found = classifier_of(board).classify(drives.radiated(drives.coded(phases, steps), steps))
        assert found.kind == "several foci"
        assert len(found.positions_m) == count
        for place in places:
            assert np.linalg.norm(np.array(found.positions_m) - place, axis=1).min() < 2e-3


@pytest.mark.parametrize("board", BOARDS)
def test_chance_makes_no_pattern(board):
    rng = np.random.default_rng(11)
    codes = rng.integers(0, BOARDS[board], LAYOUTS[board].array().count)
    assert classifier_of(board).classify(drives.radiated(codes, BOARDS[board])).kind == KINDS[-1]


@pytest.mark.parametrize("kind", PLACED)
def test_a_pattern_turns_with_its_array(kind):
    """In any pose of the array the same pattern is found, at the place that turned along."""
    rng = np.random.default_rng(2)
    array = LAYOUTS["sonicsurface"].array()
    phases, _ = drives.random_pattern(rng, array.positions_m, kind)
    weights = drives.radiated(drives.coded(phases, 32), 32)
    before = classifier_of("sonicsurface").classify(weights)
    turn, shift = Rotation.from_euler("xyz", [0.7, -1.1, 2.0]).as_matrix(), np.array([1.0, 2, -3])
    after = PatternClassifier(model_of(array.moved(turn, shift)), 32).classify(weights)
    assert after.kind == before.kind == kind
    assert np.array(after.position_m) == pytest.approx(
        turn @ np.array(before.position_m) + shift, abs=1e-6
    )


def test_silent_and_wrong_elements_are_left_out():
    positions = LAYOUTS["sonicsurface"].array().positions_m
    phases = drives.focus(positions, np.array([0.02, 0.01, 0.14]), drives.k_of())
    weights = drives.radiated(drives.coded(phases, 32), 32)
    weights[10] = np.nan
    weights[20:30] = 0.0
    weights[[40, 200]] *= -1.0
    found = classifier_of("sonicsurface").classify(weights)
    assert found.kind == "one focus"
    assert found.outliers == (40, 200)
    assert np.array(found.position_m) == pytest.approx([0.02, 0.01, 0.14], abs=3e-3)


def test_a_calibration_is_taken_out():
    array = LAYOUTS["sonicsurface"].array()
    rng = np.random.default_rng(4)
    lags = rng.uniform(-1.0, 1.0, 256)
    calibration = Calibration(np.ones(256), lags, array.positions_m)
    phases = drives.focus(array.positions_m, np.array([0.0, 0.0, 0.1]), drives.k_of()) - lags
    finder = PatternClassifier(model_of(array).calibrated(calibration), 256)
    found = finder.classify(np.exp(1j * phases))
    assert found.kind == "one focus"
    assert found.coherence == pytest.approx(1.0, abs=1e-3)


def test_several_foci_of_a_calibrated_array_are_found():
    rng, model = np.random.default_rng(1), AcousticModel.default()
    gains, lags = rng.uniform(0.7, 1.3, 256), rng.uniform(-1.0, 1.0, 256)
    calibrated = model.calibrated(Calibration(gains, lags, model.array.positions_m))
    places = np.array([[0.03, 0.0, 0.15], [-0.03, 0.01, 0.14]])
    weights = superpose_foci(calibrated, places, [1.0, 1.0], [0.0, 0.5])
    found = PatternClassifier(calibrated, 256).classify(np.exp(1j * np.angle(weights)))
    assert found.kind == "several foci"
    for place in places:
        assert np.linalg.norm(np.array(found.positions_m) - place, axis=1).min() < 2e-3


@pytest.mark.parametrize(
    ("weights", "kind"),
    [
        (np.zeros(256), "off"),
        (np.full(256, np.nan), "off"),
        (np.ones(256), "uniform"),
        (np.where(np.arange(256) == 5, 1.0, 0.0), "uniform"),
    ],
)
def test_silence_and_unison(weights, kind):
    assert classifier_of("sonicsurface").classify(weights).kind == kind


def test_bowls_in_unison_focus_on_their_middle():
    found = classifier_of("tinylev").classify(np.ones(72))
    assert found.kind == "one focus"
    assert np.array(found.position_m) == pytest.approx([0.0, 0.0, 0.0], abs=1e-6)


@pytest.mark.parametrize(
    ("name", "board", "steps", "kind", "place_mm"),
    [
        ("sonicsurface/focus_0_120_0", "sonicsurface", 32, "one focus", (0, 120, 0)),
        ("sonicsurface/focus_20_150_m15", "sonicsurface", 32, "one focus", (20, 150, -15)),
        ("sonicsurface/twin_0_150_0_rot45", "sonicsurface", 32, "twin trap", (0, 150, 0)),
        ("sonicsurface/ramp_phases", "sonicsurface", 32, "none of these", None),
        ("sonicsurface/on", "sonicsurface", 32, "uniform", None),
        ("sonicsurface/off", "sonicsurface", 32, "off", None),
        (
            "ultraino/simplefpga_ss_focus_0_120_0",
            "ultraino-sonicsurface",
            32,
            "one focus",
            (0, 120, 0),
        ),
        ("ultraino/mega_flat8x8_focus", "ultraino-flat8", 10, "one focus", (0, 50, 0)),
    ],
)
def test_what_clients_sent_is_named(name, board, steps, kind, place_mm):
    layout = LAYOUTS[board]
    codes = np.array(EXPECTED[name]["codes"])
    weights = np.where(codes < steps, drives.radiated(codes, steps), 0.0)
    found = PatternClassifier(model_of(layout.array(), 346.0), steps).classify(weights)
    assert found.kind == kind
    if place_mm is not None:
        place = layout.clients_m(np.array(found.position_m)) * 1e3
        assert np.linalg.norm(place - place_mm) < 1.0
    if kind == "twin trap":  # its client turned the plane by 45 degrees
        assert abs(found.normal[0]) == pytest.approx(math.sqrt(0.5), abs=0.05)


def test_the_same_place_again_is_found_from_the_last_one():
    finder = classifier_of("interactlab")
    positions = LAYOUTS["interactlab"].array().positions_m
    for x in np.linspace(0.0, 0.02, 9):
        phases = drives.focus(positions, np.array([x, 0.0, 0.15]), drives.k_of())
        found = finder.classify(drives.radiated(drives.coded(phases, 128), 128))
        assert found.kind == "one focus"
        assert found.position_m[0] == pytest.approx(x, abs=found.bound_m[0])


@pytest.mark.parametrize("kind", PLACED)
def test_a_pattern_that_comes_again_is_found_next_to_the_last_one(kind):
    """The warm way names what the search names, and never what the last one was."""
    finder = classifier_of("interactlab")
    positions = LAYOUTS["interactlab"].array().positions_m
    for number in range(3):
        phases, _ = drives.random_pattern(np.random.default_rng(number), positions, kind)
        weights = drives.radiated(drives.coded(phases, 128), 128)
        finder.reset()
        cold, warm = finder.classify(weights), finder.classify(weights)
        assert warm.kind == cold.kind == kind
        assert np.array(warm.position_m) == pytest.approx(np.array(cold.position_m), abs=1e-6)
        other = drives.focus(positions, np.array([0.0, 0.0, 0.1]), drives.k_of())
        found = finder.classify(drives.radiated(drives.coded(other, 128), 128))
        assert found.kind == "one focus"


@pytest.mark.parametrize("count", [30, pytest.param(120, marks=pytest.mark.nightly)])
def test_a_focus_that_moves_near_the_array_is_named_at_every_step(count):
    """The way from the last focus may lead behind the array, where no field is."""
    model = AcousticModel.default(8, 8)
    finder = PatternClassifier(model, 256)
    rng = np.random.default_rng(8)
    walk = [np.array([-0.039, -0.0274, 0.0124]), np.array([-0.034, -0.0268, 0.0264])]
    while len(walk) < count:
        step = walk[-1] + rng.uniform(-0.015, 0.015, 3)
        walk.append(np.clip(step, [-0.04, -0.04, 0.012], [0.04, 0.04, 0.05]))
    for place in walk:
        found = finder.classify(np.exp(1j * drives.focus(model.array.positions_m, place, K)))
        assert found.kind == "one focus"
        assert np.array(found.position_m) == pytest.approx(place, abs=1e-3)


def test_a_place_keeps_a_field_when_it_is_fitted_for_the_air_of_the_model():
    """In slower air a focus close to the array would be fitted at a place behind it."""
    model = AcousticModel.default(8, 8).with_sound_speed(drives.SPEED_M_S)
    place = np.array([0.03797512, -0.03351748, 0.00298786])
    phases = drives.focus(model.array.positions_m, place, drives.k_of() / 0.9856051769941331)
    found = PatternClassifier(model, 256).classify(drives.radiated(drives.coded(phases, 256), 256))
    assert found.kind == "one focus"
    assert np.array(found.position_m) == pytest.approx(place, abs=1e-3)


SIZES = sorted(
    {(dialect.channels, dialect.steps) for dialect in DIALECTS.values()}
    | {(12, 16), (12, 10), (16, 10), (24, 10), (64, 4), (64, 2)}  # parts of boards, coarse steps
)


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("count", "steps"), SIZES)
def test_few_elements_and_few_steps_name_a_focus_and_never_chance(count, steps):
    rows = max(n for n in range(1, 17) if count % n == 0)
    model = AcousticModel.default(rows, count // rows)
    finder, positions = PatternClassifier(model, steps), model.array.positions_m
    rng = np.random.default_rng(count * steps)
    for _ in range(6):
        codes = rng.integers(0, steps, count)
        finder.reset()
        assert finder.classify(drives.radiated(codes, steps)).kind == KINDS[-1]
    told = 0
    for _ in range(4):
        phases, _ = drives.random_pattern(rng, positions, "one focus")
        finder.reset()
        found = finder.classify(drives.radiated(drives.coded(phases, steps), steps))
        assert found.kind in ("one focus", KINDS[-1])
        told += found.kind == "one focus"
    assert told >= (0 if count < 12 else 2 if steps < 5 or count < 16 else 4)


def test_halves_that_alternate_split_no_twin_trap():
    """Their best plane has no slope at all: nothing is divided by it."""
    x, y = np.meshgrid(np.arange(8.0) - 3.5, np.arange(8.0) - 3.5)
    positions = np.stack([x.ravel(), y.ravel(), np.zeros(64)], axis=1)
    with np.errstate(all="raise"):
        assert explain.twin_trap_normal(positions, (x * y > 0.0).ravel()) is None


def test_patterns_are_plain_values_for_json():
    found = classifier_of("sonicsurface").classify(np.ones(256))
    assert json.loads(json.dumps(pattern_dict(found))) == {"kind": "uniform", "active": 256}


def test_wrong_arguments_are_refused():
    with pytest.raises(ConfigurationError, match=r"shape \(3,\), must be \(256,\)"):
        classifier_of("sonicsurface").classify(np.ones(3))
    with pytest.raises(ConfigurationError, match="steps is 1, must be 2 to 65536"):
        PatternClassifier(model_of(LAYOUTS["sonicsurface"].array()), 1)


def test_the_example_runs():
    assert doctest.testmod(classifier).failed == 0


def test_a_focus_anywhere_around_the_middle_of_bowls_is_found():
    """It is as small as a wavelength there: the cells of a search volume lie further apart."""
    array = LAYOUTS["tinylev"].array()
    classifier = PatternClassifier(AcousticModel(array, *model_parts()), 128)
    rng = np.random.default_rng(4)
    k = 2.0 * np.pi / AcousticModel.default().wavelength_m
    for _ in range(12):
        way = rng.normal(size=3)
        place = array.centre_m + way / np.linalg.norm(way) * rng.uniform(0.0, 0.022)
        distance_m = np.linalg.norm(array.positions_m - place, axis=1)
        codes = np.rint(-128 * (k * distance_m / (2.0 * np.pi) + rng.uniform())) % 128
        classifier.reset()
        found = classifier.classify(np.exp(2j * np.pi * codes / 128))
        assert found.kind == "one focus"
        assert np.linalg.norm(np.array(found.position_m) - place) < 1e-4


def model_parts():
    model = AcousticModel.default()
    return model.medium, model.transducer
