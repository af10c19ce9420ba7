"""From a drive to its focus, with and without a hint."""

import dataclasses
import json
import math
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptogram.acoustics import (
    AcousticModel,
    CircularPiston,
    Drive,
    Medium,
    NoFocus,
    NotSingle,
    NumpyEngine,
    Reconstructor,
    SingleFocus,
    Transducer,
    TransducerArray,
    check_focus_target,
    focus_phases,
    force_on_disc_n,
    pressure,
    superpose_foci,
)
from haptogram.acoustics.field.engines.compiled import load_kernels
from haptogram.acoustics.model.boards.table import LAYOUTS
from haptogram.acoustics.solvers.focus import focus_steering_reach_m
from haptogram.errors import ConfigurationError
from strategies_acoustics import hemisphere_targets, seeds

MODEL = AcousticModel.default()
TARGET = np.array([0.03, 0.02, 0.12])


@pytest.fixture(scope="module")
def shared():
    """One search volume for the whole file: it takes half a second to lay out."""
    return Reconstructor(MODEL)


@pytest.fixture
def cold(shared):
    shared.reset()
    return shared


def drive_for(model, target, bits=8):
    return Drive.from_weights(np.exp(1j * focus_phases(model, target)), bits)


def residual_rms(model, drive, place):
    """RMS phase error of the arrivals at a place, in steps of the drive."""
    steps, count = 2**drive.phase_bits, len(drive.phase_codes)
    far = np.linalg.norm(np.asarray(place) - model.array.positions_m, axis=1)
    turns = drive.phase_codes / steps + far / model.wavelength_m
    error = turns - np.angle(np.exp(2j * np.pi * turns).sum()) / (2 * np.pi)
    error -= np.rint(error)
    return steps * math.sqrt(((error - error.mean()) ** 2).sum() / count)


TINYLEV = dataclasses.replace(MODEL, array=LAYOUTS["tinylev"].array())


@pytest.mark.sampled(1)
@pytest.mark.parametrize("model", [AcousticModel.default(8, 8), TINYLEV], ids=["8x8", "tinylev"])
@given(bits=st.integers(1, 3), seed=seeds)
@settings(max_examples=6)
def test_places_that_explain_few_steps_equally_are_all_told(model, bits, seed):
    """The target is the place or one of its rivals, and each of them fits as well as rounding."""
    rng = np.random.default_rng(seed)
    low, high = ([-0.03, -0.03, 0.06], [0.03, 0.03, 0.15])
    target = rng.uniform(-0.015, 0.015, 3) if model is TINYLEV else rng.uniform(low, high)
    drive = drive_for(model, target, bits)
    found = Reconstructor(model).reconstruct(drive)
    places = np.array([found.position_m, *found.rivals_m])
    bound = 1.5 * np.array(found.bound_m)
    assert (np.abs(places - target) <= bound).all(axis=1).any()
    worst = math.sqrt(1 / 12 + 3 / math.sqrt(180 * model.array.count)) + 1e-6
    assert max(residual_rms(model, drive, place) for place in places[1:].tolist() or [target]) <= (
        worst
    )
    assert bool(found.rivals_m) == ("places explain these phases equally" in found.ambiguity_text)


def test_a_twin_of_a_real_drive_is_told():
    """Phases of 0 and half a turn are their own conjugate: the twin lies across the centre."""
    target = np.array([0.006, -0.001, 0.004])
    found = Reconstructor(TINYLEV).reconstruct(drive_for(TINYLEV, target, 1))
    places = np.array([found.position_m, *found.rivals_m])
    for image in (target, -target):
        assert np.linalg.norm(places - image, axis=1).min() < 2e-3


def assert_on_target(result, target):
    """The linear bound holds to 5 % where few elements see a distant target."""
    assert isinstance(result, SingleFocus), result
    seen = np.array(result.observable)
    miss = np.abs(np.array(result.position_m) - target)
    assert (miss[seen] <= 1.05 * np.array(result.bound_m)[seen] + 1e-9).all()


# --- acquisition


@pytest.mark.sampled(1)
@pytest.mark.parametrize("bits", [3, 5, 8])
@given(target=hemisphere_targets())
def test_any_point_of_the_papers_hemisphere_is_found_without_a_hint(shared, bits, target):
    shared.reset()
    result = shared.reconstruct(drive_for(MODEL, target, bits))
    assert_on_target(result, target)
    assert result.acquired == "global"


@pytest.mark.parametrize("shape", [(8, 8), (32, 4), (128, 1), (1, 128), (5, 7), (20, 20)])
def test_every_array_finds_every_legal_target(shape):
    model = AcousticModel.default(*shape)
    reconstructor = Reconstructor(model)
    rng = np.random.default_rng(7)
    x, y = focus_steering_reach_m(model)
    found = 0
    while found < 25:
        target = rng.uniform([-x, -y, 0.02], [x, y, 0.5])
        try:
            check_focus_target(model, target)
        except ConfigurationError:
            continue
        reconstructor.reset()
        assert_on_target(reconstructor.reconstruct(drive_for(model, target)), target)
        found += 1


def test_a_line_array_is_reported_as_not_observing_height():
    line = Reconstructor(AcousticModel.default(128, 1))
    result = line.reconstruct(drive_for(AcousticModel.default(128, 1), [0.01, 0.03, 0.1]))
    assert isinstance(result, SingleFocus)
    assert result.observable == (True, False, False)
    assert result.position_m[0] == pytest.approx(0.01, abs=result.bound_m[0])
    assert result.as_dict()["std_m"][1] is None


def bowl():
    """60 elements on a sphere of 120 mm radius around (0, 0, 120 mm), facing its centre."""
    n = np.arange(60)
    height = 0.120 * (1 - (n + 0.5) / 75)
    around = n * math.pi * (3 - math.sqrt(5))
    lateral = np.sqrt(0.120**2 - height**2)
    inward = -np.stack([lateral * np.cos(around), lateral * np.sin(around), -height], axis=1)
    centre = np.array([0, 0, 0.120])
    array = TransducerArray.from_positions(centre - inward, inward)
    return AcousticModel(array, Medium.air(), Transducer(CircularPiston()))


def test_a_bowl_finds_a_focus_near_its_centre():
    model = bowl()
    reconstructor = Reconstructor(model)
    for offset in ([0, 0, 0], [0.01, -0.005, 0.01], [-0.02, 0.02, 0.02]):
        target = np.array([0, 0, 0.12]) + offset
        reconstructor.reset()
        assert_on_target(reconstructor.reconstruct(drive_for(model, target)), target)


def test_an_array_that_is_not_at_the_origin_is_searched_around_itself():
    shift = np.array([0.5, -0.3, 0.2])
    array = TransducerArray.from_positions(MODEL.array.positions_m + shift)
    model = AcousticModel(array, MODEL.medium, MODEL.transducer)
    result = Reconstructor(model).reconstruct(drive_for(model, TARGET + shift))
    assert_on_target(result, TARGET + shift)


def test_a_drive_that_leaves_the_middle_silent_is_found():
    ring = np.ones((16, 16))
    ring[3:13, 3:13] = 0.0
    for mask in (ring, np.kron([[1, 0], [0, 0]], np.ones((8, 8)))):
        reconstructor = Reconstructor(MODEL)
        weights = mask.ravel() * np.exp(1j * focus_phases(MODEL, TARGET))
        assert_on_target(reconstructor.reconstruct(Drive.from_weights(weights)), TARGET)


# --- tracking

PATH = [(0, 0, 0), (0, 0.001, 0), (0, 0.002, 0), (0.001, 0.002, 0.001), (-0.05, 0, 0.03)]


def test_small_steps_are_followed_and_jumps_are_searched(cold):
    path = [TARGET + np.array(step) for step in PATH]
    ways = []
    for target in path:
        result = cold.reconstruct(drive_for(MODEL, target))
        assert_on_target(result, target)
        ways.append(result.acquired)
    assert ways == ["global", "warm", "warm", "warm", "global"]


@given(hemisphere_targets(), hemisphere_targets())
def test_history_does_not_change_the_answer(shared, first, second):
    shared.reset()
    alone = shared.reconstruct(drive_for(MODEL, second))
    shared.reset()
    shared.reconstruct(drive_for(MODEL, first))
    after = shared.reconstruct(drive_for(MODEL, second))
    assert after.position_m == pytest.approx(alone.position_m, abs=1e-8)
    assert after.pressure_rms_pa == pytest.approx(alone.pressure_rms_pa, rel=1e-5)


# --- what is reported


def test_the_figures_are_those_of_the_field_at_the_focus(cold):
    drive = drive_for(MODEL, TARGET)
    result = cold.reconstruct(drive)
    peak = pressure(MODEL, drive.weights(), [result.position_m])[0]
    assert result.pressure_rms_pa == pytest.approx(abs(peak) / math.sqrt(2), rel=1e-12)
    assert result.level_db_spl == pytest.approx(20 * math.log10(result.pressure_rms_pa / 20e-6))
    force_n = force_on_disc_n(MODEL, drive.weights(), result.position_m)
    assert result.force_n == pytest.approx(force_n, rel=1e-4)
    assert math.cos(math.pi / 256) <= result.coherence <= 1.0 + 1e-12
    assert result.residual_rms_rad == pytest.approx(2 * math.pi / 256 / math.sqrt(12), rel=0.3)


def test_position_is_the_target_and_not_the_pressure_maximum(cold):
    """Focal shift: at 200 mm the maximum of |p| is 7.7 mm nearer; the fit stays on the target."""
    target = np.array([0, 0, 0.2])
    drive = drive_for(MODEL, target)
    heights = np.arange(0.180, 0.205, 0.0005)
    axis = np.stack([0 * heights, 0 * heights, heights], axis=1)
    loudest = heights[np.abs(pressure(MODEL, drive.weights(), axis)).argmax()]
    assert 0.2 - loudest == pytest.approx(7.7e-3, abs=1e-3)
    assert_on_target(cold.reconstruct(drive), target)


def test_amplitude_scales_pressure_and_force_and_moves_nothing(cold):
    full = drive_for(MODEL, TARGET)
    fifth = Drive(full.phase_codes, np.full(256, 51), 8)
    loud, soft = cold.reconstruct(full), cold.reconstruct(fifth)
    assert soft.pressure_rms_pa == pytest.approx(loud.pressure_rms_pa / 5, rel=1e-6)
    assert soft.force_n == pytest.approx(loud.force_n / 25, rel=1e-6)
    assert soft.position_m == pytest.approx(loud.position_m, abs=1e-8)


def test_an_engine_computes_the_force():
    class Counting(NumpyEngine):
        calls = 0

        def pressure(self, weights, points_m):
            self.calls += 1
            return super().pressure(weights, points_m)

    small = AcousticModel.default(6, 6)
    engine = Counting(small)
    Reconstructor(small, engine=engine).reconstruct(drive_for(small, [0, 0, 0.08]))
    assert engine.calls == 1


def test_results_are_json_and_pickle(cold):
    drive = drive_for(MODEL, TARGET)
    noise = Drive(np.random.default_rng(3).integers(0, 256, 256), np.full(256, 255))
    for result in (cold.reconstruct(drive), cold.reconstruct(noise), NoFocus("muted")):
        assert pickle.loads(pickle.dumps(result)) == result
        fields = json.loads(json.dumps(result.as_dict(), allow_nan=False))
        kinds = {SingleFocus: "single_focus", NotSingle: "not_single", NoFocus: "no_focus"}
        assert fields.pop("kind") == kinds[type(result)]
        assert set(fields) == set(type(result).__dataclass_fields__)


# --- nothing to find


def test_silence_has_no_focus(cold):
    assert cold.reconstruct(Drive.muted(256)) == NoFocus("muted")
    assert cold.reconstruct_weights(np.zeros(256)) == NoFocus("zero amplitude")


@given(seeds)
@settings(max_examples=8)
def test_random_phases_are_not_a_focus(shared, seed):
    codes = np.random.default_rng(seed).integers(0, 256, 256)
    result = shared.reconstruct(Drive(codes, np.full(256, 255)))
    assert isinstance(result, NotSingle)
    assert result.outliers == ()
    assert result.residual_rms_rad > 1.0
    assert result.coherence < 0.5


def test_two_foci_are_not_one_and_the_louder_is_named(cold):
    points = [[0.03, 0.0, 0.12], [-0.03, 0.0, 0.12]]
    result = cold.reconstruct_weights(superpose_foci(MODEL, points, [0.7, 0.3], [0.0, 0.0]))
    assert isinstance(result, NotSingle)
    assert np.linalg.norm(np.array(result.position_m) - points[0]) < 5e-3
    peak = pressure(
        MODEL, superpose_foci(MODEL, points, [0.7, 0.3], [0.0, 0.0]), [result.position_m]
    )
    assert result.pressure_rms_pa == pytest.approx(abs(peak[0]) / math.sqrt(2))


def test_conjugated_phases_are_not_a_focus(cold):
    weights = np.conj(drive_for(MODEL, TARGET).weights())
    assert isinstance(cold.reconstruct_weights(weights), NotSingle)


@pytest.mark.parametrize("count", [1, 255, 257])
def test_a_drive_of_another_array_is_refused(cold, count):
    with pytest.raises(ConfigurationError, match=r"256 elements"):
        cold.reconstruct(drive_for(AcousticModel.default(count, 1), [0, 0, 0.1]))
    with pytest.raises(ConfigurationError):
        cold.reconstruct_weights(np.full(256, np.nan))


def test_a_reconstructor_of_nine_bits_is_refused():
    with pytest.raises(ConfigurationError, match="phase_bits is 17"):
        Reconstructor(AcousticModel.default(2, 2), 17)


# --- faulty drives


@pytest.mark.parametrize("warm", [False, True])
@pytest.mark.parametrize("elements", [(17,), (0, 255), tuple(range(0, 60, 3))])
def test_inverted_elements_are_named_and_the_focus_of_the_others_is_found(cold, elements, warm):
    drive = drive_for(MODEL, TARGET)
    if warm:
        cold.reconstruct(drive)
    weights = drive.weights()
    weights[list(elements)] *= -1.0
    result = cold.reconstruct_weights(weights)
    assert isinstance(result, NotSingle)
    assert result.outliers == elements
    assert np.linalg.norm(np.array(result.position_m) - TARGET) < 1e-4
    expected = math.sqrt(math.pi**2 * len(elements) / 256)
    assert result.residual_rms_rad == pytest.approx(expected, rel=0.05)


SLIPPED = [3, 40, 77, 123, 130, 200, 251]  # together they show slips of 1.5 to 2.5 steps


def test_a_slip_of_two_steps_is_named_beside_a_greater_fault(cold):
    codes = drive_for(MODEL, TARGET).phase_codes.astype(int)
    codes[17] = (codes[17] + 128) % 256
    codes[SLIPPED] = (codes[SLIPPED] + 2) % 256
    result = cold.reconstruct(Drive(codes, np.full(256, 255)))
    assert isinstance(result, NotSingle)
    assert result.outliers == tuple(sorted([17, *SLIPPED]))


def test_two_halves_with_a_focus_each_have_no_outliers(cold):
    """Neither half is in the majority, so neither can be called wrong."""
    points = [TARGET, TARGET + np.array([-0.05, -0.03, 0.02])]
    halves = focus_phases(MODEL, points)
    phases = np.where(np.arange(256) < 128, halves[0], halves[1])
    result = cold.reconstruct(Drive.from_weights(np.exp(1j * phases)))
    assert isinstance(result, NotSingle)
    assert result.outliers == ()


def test_seven_elements_are_too_few_to_outvote_one():
    small = AcousticModel.default(2, 4)
    reconstructor = Reconstructor(small)
    for element in range(8):
        phases = focus_phases(small, [0.01, 0.02, 0.06])
        phases[element] += 1.0
        reconstructor.reset()
        result = reconstructor.reconstruct(Drive.from_weights(np.exp(1j * phases)))
        assert isinstance(result, SingleFocus) or result.outliers == ()


def test_noise_beyond_half_a_step_blames_no_element(cold):
    """A place is given, for every element is off a little."""
    rng = np.random.default_rng(4)
    phases = focus_phases(MODEL, TARGET) + 0.1 * rng.normal(size=256)
    result = cold.reconstruct_weights(np.exp(1j * phases))
    assert isinstance(result, NotSingle)
    assert result.outliers == ()
    assert np.linalg.norm(np.array(result.position_m) - TARGET) < 3e-3
    assert result.residual_rms_rad == pytest.approx(0.1, rel=0.15)


def test_dead_elements_leave_the_focus_where_it_is_and_cost_pressure(cold):
    drive = drive_for(MODEL, TARGET)
    whole = cold.reconstruct(drive)
    amplitudes = drive.amplitude_codes.copy()
    amplitudes[[3, 99]] = 0
    result = cold.reconstruct(Drive(drive.phase_codes, amplitudes))
    assert_on_target(result, TARGET)
    assert result.pressure_rms_pa < whole.pressure_rms_pa


def test_a_slip_of_two_steps_still_gives_the_focus(cold):
    codes = drive_for(MODEL, TARGET).phase_codes.astype(int)
    codes[17] = (codes[17] + 2) % 256
    assert_on_target(cold.reconstruct(Drive(codes, np.full(256, 255))), TARGET)


TURNS = {
    "transposed": (lambda codes: codes.T, lambda p: [p[1], p[0], p[2]]),
    "mirrored in x": (lambda codes: codes[::-1], lambda p: [-p[0], p[1], p[2]]),
    "mirrored in y": (lambda codes: codes[:, ::-1], lambda p: [p[0], -p[1], p[2]]),
    "rolled by a row": (
        lambda codes: np.roll(codes, 1, axis=0),
        lambda p: [p[0] + 0.01, p[1], p[2]],
    ),
}


@pytest.mark.parametrize("fault", ["transposed", "mirrored in x", "mirrored in y"])
def test_a_wrong_order_shows_as_another_place(cold, fault):
    reorder, moved = TURNS[fault]
    codes = reorder(drive_for(MODEL, TARGET).phase_codes.reshape(16, 16)).ravel()
    result = cold.reconstruct(Drive(codes, np.full(256, 255)))
    assert_on_target(result, moved(TARGET))
    assert np.linalg.norm(np.array(result.position_m) - TARGET) > 10e-3


def test_a_roll_by_a_row_is_a_shifted_focus_with_a_wrong_row(cold):
    reorder, moved = TURNS["rolled by a row"]
    codes = reorder(drive_for(MODEL, TARGET).phase_codes.reshape(16, 16)).ravel()
    result = cold.reconstruct(Drive(codes, np.full(256, 255)))
    assert isinstance(result, NotSingle)
    assert np.linalg.norm(np.array(result.position_m) - moved(TARGET)) < 1e-3
    assert set(result.outliers) <= set(range(16))
    assert len(result.outliers) >= 12


def test_a_coarse_drive_counts_by_its_own_resolution(cold):
    """A 3-bit drive is a focus for an 8-bit reconstructor; read as 8 bits it would not be."""
    drive = drive_for(MODEL, TARGET, 3)
    assert_on_target(cold.reconstruct(drive), TARGET)
    cold.reset()
    assert isinstance(cold.reconstruct_weights(drive.weights()), NotSingle)


@given(st.sampled_from([2, 4, 6]), hemisphere_targets(), st.booleans())
def test_a_correct_drive_is_never_refused_on_symmetry_planes(shared, bits, target, diagonal):
    """There few residuals are independent, so their RMS may come near half a step."""
    target[1] = target[0] if diagonal else 0.0
    assert_on_target(shared.reconstruct(drive_for(MODEL, target, bits)), target)


# --- with and without compiled code

COMPILED = (
    "usable_points_kernel",
    "lattice_pressure_kernel",
    "fit_phases_kernel",
    "cell_scores_kernel",
    "best_cell_kernel",
    "focused_frames_kernel",
)


def test_the_answer_does_not_depend_on_numba(monkeypatch):
    path = TARGET + np.array([(0, 0, 0), (0, 0.001, 0), (-0.05, 0, 0.03)])
    drives = [drive_for(MODEL, target) for target in path]
    dead = drives[1].amplitude_codes.copy()
    dead[40] = 0
    turned = drives[2].phase_codes.copy()
    turned[7] += 64
    drives.append(Drive(drives[1].phase_codes, dead))
    drives.append(Drive(turned, drives[2].amplitude_codes))
    fast = Reconstructor(MODEL)
    fast.warm_up()
    found = [fast.reconstruct(drive) for drive in drives]
    for module in ("field.engines.numba_engine", "reconstruct.reconstruction"):
        monkeypatch.setattr(f"haptogram.acoustics.{module}.load_kernels", lambda: None)
    slow = Reconstructor(MODEL)
    slow.warm_up()
    for drive, quick in zip(drives, found, strict=True):
        expected = slow.reconstruct(drive).as_dict()
        for name, value in quick.as_dict().items():
            if name == "force_n":
                assert value == pytest.approx(expected[name], rel=1e-4)
            elif name == "position_m":
                assert value == pytest.approx(expected[name], abs=1e-9)
            elif name in ("kind", "acquired", "observable", "outliers"):
                assert value == expected[name], name
            else:
                assert value == pytest.approx(expected[name], rel=1e-6), name
    assert [type(result).__name__ for result in found] == ["SingleFocus"] * 4 + ["NotSingle"]


def test_once_warm_nothing_is_compiled_or_searched_anew(monkeypatch):
    pytest.importorskip("numba")
    kernels = load_kernels()
    reconstructor = Reconstructor(MODEL)
    reconstructor.warm_up()

    def compiled():  # another one takes 0.4 s; a loop from stored machine code never has any
        loops = {name: getattr(kernels, name) for name in COMPILED}
        return {name: list(getattr(loop, "signatures", ())) for name, loop in loops.items()}

    def must_not(*_):
        raise AssertionError("the first drive had to wait")

    before = compiled()
    monkeypatch.setattr("haptogram.acoustics.reconstruct.tracking.search_volume", must_not)
    monkeypatch.setattr("haptogram.acoustics.reconstruct.acquisition.search_volume", must_not)
    drives = [drive_for(MODEL, TARGET + np.array([0, 0, step])) for step in (0.0, 0.001, 0.06)]
    for drive in drives:
        assert reconstructor.reconstruct(drive).as_dict()["kind"] == "single_focus"
    assert compiled() == before


def test_a_drive_of_all_elements_after_one_of_a_single_element_is_found():
    # The part of the array that is asked first was a point, and doubling its radius never ended.
    model = AcousticModel.default(8, 8)
    reconstructor = Reconstructor(model)
    alone = np.zeros(64)
    alone[10] = 1.0
    assert not isinstance(reconstructor.reconstruct_weights(alone), NoFocus)
    target = np.array([0.01, 0.02, 0.12])
    halves = np.exp(1j * focus_phases(model, target)) * (np.arange(64) != 3)
    found = reconstructor.reconstruct_weights(halves)
    assert isinstance(found, SingleFocus)
    assert found.position_m == pytest.approx(target, abs=1e-6)
