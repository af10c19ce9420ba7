"""A board watched: patterns, verdicts by what is expected, and defects by name."""

import dataclasses
import doctest
import json
import math
import re

import numpy as np
import pytest

import pattern_drives as drives
from dialect_boards import SENT, DialectBoard
from haptogram.acoustics import AcousticModel, Calibration, focus_phases
from haptogram.acoustics.model.boards.table import LAYOUTS
from haptogram.errors import ConfigurationError
from haptogram.records.remark import About
from haptogram.verification import FrameStatus, Tolerance, Verdict
from haptogram.verification.frame.target import FrameTarget
from haptogram.verification.watch import (
    Defect,
    Diagnosis,
    Expectation,
    SeenLatch,
    Watch,
    defect,
    diagnosis,
    expectation,
    latch,
    watch,
)
from haptogram.verification.watch.diagnosis import FrameDefects
from watched_runs import TARGETS, latches, model_of, targets_of, watched

pytestmark = pytest.mark.sampled(2)

BOARDS = {"sonicsurface": 32, "interactlab": 128, "ultraino-flat8": 10}


def named(result):
    return [found.defect for found in result.diagnoses]


FOUND = {  # in the firmware of boards: dialect, defect, figures, and how much pressure is left
    "last_bit=late": (
        "sonicsurface",
        Defect.TOGETHER,
        r"elements n mod 8 = 3 \(32 of 256\): one step of 32 late, .* by 0\.\d\d mm",
        0.997,
    ),
    "carrier=20kHz": ("ultraino-mega64", Defect.CARRIER, "a transducer hears -6.0 dB", 0.5),
    "upload=drawn-out": ("ultraino-mega64", Defect.UPLOAD, "-6.0 dB", 0.5),
}


@pytest.mark.parametrize("option", ["", *FOUND])
def test_what_was_found_in_firmware_is_named_with_what_it_costs(option):
    dialect, defect, figures, left = FOUND.get(option, ("ultraino-mega64", None, "", 1.0))
    board = DialectBoard(dialect, *filter(None, [option]))
    for _ in range(2):
        board.send(SENT[dialect])
        board.pass_us(5_000)
    watch = Watch(board.settings.truth)
    steps = board.settings.wiring.steps
    kinds = [
        watch.take(
            SeenLatch(n, seen.radiated, steps, seen.t_latch_us, seen.cause, seen.counted)
        ).pattern.kind
        for n, seen in enumerate(board.latches)
        if seen.cause != "power-up"
    ]
    assert set(kinds) <= {"one focus", "uniform"}
    result = watch.result()
    assert named(result) == ([] if defect is None else [defect])
    for found in result.diagnoses:
        costs = re.search(rf"{figures}.* (\d+) Pa instead of (\d+) Pa$", found.detail)
        assert float(costs[1]) / float(costs[2]) == pytest.approx(left, abs=3e-3)


# --- expectation ---------------------------------------------------------------------------------


@pytest.mark.sampled(1)
@pytest.mark.parametrize("board", BOARDS)
def test_right_foci_are_on_target(board):
    array, steps = LAYOUTS[board].array(), BOARDS[board]
    targets = targets_of(array)
    result = watched(array, latches(array, steps, targets), targets).result()
    assert result.statuses == {FrameStatus.ON_TARGET: len(targets)}
    assert result.verdict is Verdict.PASS
    assert result.diagnoses == ()


@pytest.mark.parametrize("board", BOARDS)
def test_a_miss_larger_than_the_bound_of_the_steps_fails(board):
    """The bound follows the board's steps: what it says is missed is twice its length."""
    array, steps = LAYOUTS[board].array(), BOARDS[board]
    targets = targets_of(array)[:1]
    run = watched(array, [], targets)
    (seen,) = latches(array, steps, targets)
    bound_mm = run.take(seen).verdict.bound_mm
    for axis in range(3):
        moved = targets[0] + 2e-3 * bound_mm[axis] * np.eye(3)[axis]
        (seen,) = latches(array, steps, [moved])
        assert run.take(seen).verdict.status is not FrameStatus.ON_TARGET


def test_frames_repeat_in_order():
    array = LAYOUTS["sonicsurface"].array()
    targets = targets_of(array)[:3]
    result = watched(array, latches(array, 32, [*targets, *targets]), targets).result()
    assert result.statuses == {FrameStatus.ON_TARGET: 6}


def test_silence_and_power_up_are_no_frames_of_the_client():
    array = LAYOUTS["sonicsurface"].array()
    targets = targets_of(array)[:2]
    one, two = latches(array, 32, targets)
    power_up = SeenLatch(0, np.ones(256), 32, cause="power-up")
    off = SeenLatch(9, np.zeros(256), 32)
    result = watched(array, [power_up, one, off, two, off], targets).result()
    assert result.statuses == {FrameStatus.ON_TARGET: 2}
    assert result.kinds == {"one focus": 2, "off": 2}
    assert result.latches == 5


def test_another_pattern_where_a_focus_was_expected_is_a_wrong_drive():
    array = LAYOUTS["sonicsurface"].array()
    target = targets_of(array)[0]
    phases = drives.focus(array.positions_m, target, drives.k_of())
    phases = phases + drives.azimuth(array.positions_m, array.centre_m)
    seen = SeenLatch(1, drives.radiated(drives.coded(phases, 32), 32), 32)
    verdict = watched(array, [], [target]).take(seen).verdict
    assert verdict.status is FrameStatus.WRONG_DRIVE
    assert verdict.faults == ("vortex where one focus was expected",)


def test_several_foci_are_expected_together():
    array = LAYOUTS["interactlab"].array()
    frame = np.array([[-0.03, 0.01, 0.12], [0.03, -0.01, 0.12]])
    phases = drives.several(array.positions_m, frame, [0.3, 1.9], drives.k_of())
    seen = SeenLatch(1, drives.radiated(drives.coded(phases, 128), 128), 128)
    model = model_of(array)
    right = Watch(model, expectation=Expectation(model, [frame])).take(seen).verdict
    assert right.status is FrameStatus.ON_TARGET
    off = Watch(model, expectation=Expectation(model, [frame + np.array([0.004, 0.0, 0.0])])).take(
        seen
    )
    assert off.verdict.status is FrameStatus.OFF_TARGET
    for found in (right, off.verdict):
        miss_mm = 1e3 * np.subtract(found.measured_m, found.target_m)
        beam = np.array(found.target_m) - array.positions_m.mean(axis=0)
        along_mm = miss_mm @ beam / np.linalg.norm(beam)
        assert found.axial_error_mm == pytest.approx(along_mm, abs=1e-9)
        across_mm = math.sqrt(miss_mm @ miss_mm - along_mm**2)
        assert found.lateral_error_mm == pytest.approx(across_mm, abs=1e-6)
    one = Watch(model, expectation=Expectation(model, [frame[:1]])).take(seen)
    assert one.verdict.faults == ("several foci where one focus was expected",)


def test_a_tolerance_of_the_air_lets_another_speed_of_sound_pass():
    array = LAYOUTS["interactlab"].array()
    targets, model = targets_of(array), model_of(array)
    for tolerance, verdict in ((None, Verdict.FAIL), (Tolerance(temperature_c=6.0), Verdict.PASS)):
        run = Watch(model, expectation=Expectation(model, list(targets), tolerance=tolerance))
        for seen in latches(array, 128, targets, speed=346.0):
            run.take(seen)
        assert run.result().verdict is verdict


def test_nothing_latched_is_inconclusive():
    array = LAYOUTS["sonicsurface"].array()
    assert watched(array, []).result().verdict is Verdict.INCONCLUSIVE
    assert watched(array, [], targets_of(array)).result().verdict is Verdict.INCONCLUSIVE
    (seen,) = latches(array, 32, targets_of(array)[:1])
    run = watched(array, [seen])
    assert run.result().verdict is Verdict.PASS
    assert run.result("the board was killed").verdict is Verdict.INCONCLUSIVE


@pytest.mark.parametrize(
    ("frames_m", "message"),
    [
        ([], "frames_m holds no frame"),
        ([(0.0, 0.0, 0.1), (0.0, 0.0, -0.1)], "point 1 is 100 mm behind the baffle"),
        ([[(0.0, 0.0, 0.1), (0.0, 0.0, 0.0)]], "point 1 is .* mm from element"),
    ],
)
def test_an_expectation_needs_frames_of_places_with_a_field(frames_m, message):
    """The board that is watched would go on without a verdict from its first latch on."""
    with pytest.raises(ConfigurationError, match=message):
        Expectation(AcousticModel.default(3, 3), frames_m)


def test_a_tolerance_is_refused_at_the_begin_and_not_for_what_is_latched():
    """Where only the rim sounds, the focus is narrower."""
    model, target = AcousticModel.default(8, 8), (0.0, 0.0, 0.1)
    with pytest.raises(ConfigurationError, match="half of that at most"):
        Expectation(model, [target], tolerance=Tolerance(miss_mm=10.0))
    half_mm = FrameTarget(model, np.array(target), np.ones(64), 0.0, Tolerance()).width_m * 5e2
    expected = Expectation(model, [target], tolerance=Tolerance(miss_mm=0.99 * half_mm))
    rim = np.ones((8, 8))
    rim[2:-2, 2:-2] = 0.0
    seen = SeenLatch(1, rim.ravel() * np.exp(1j * focus_phases(model, target)), 256)
    assert Watch(model, expectation=expected).take(seen).verdict.passed


# --- mistakes, with an expectation ----------------------------------------------------------------


def mirrored(array, places):
    return array.centre_m + (places - array.centre_m) * [-1.0, 1.0, 1.0]


def transposed(array, places):
    return array.centre_m + (places - array.centre_m)[:, [1, 0, 2]]


def frame_of_ultraino(array, places):  # noqa: ARG001  of one form
    return places + np.array([0.0, 2e-3, 0.0])


MISTAKES = {mirrored: Defect.ORDER, transposed: Defect.ORDER, frame_of_ultraino: Defect.AXES}


@pytest.mark.sampled(1)
@pytest.mark.parametrize("board", ["interactlab", "ultraino-flat8"])
@pytest.mark.parametrize("mistake", MISTAKES, ids=lambda mistake: mistake.__name__)
def test_a_mistake_of_the_client_is_named(board, mistake):
    array, steps = LAYOUTS[board].array(), BOARDS[board]
    targets = targets_of(array)
    seen = list(latches(array, steps, mistake(array, targets)))
    assert named(watched(array, seen, targets).result()) == [MISTAKES[mistake]]
    # Never without an expectation, and never from two targets: a mirrored focus is a perfect one.
    assert named(watched(array, seen).result()) == []
    assert named(watched(array, seen[:2], targets).result()) == []


def test_another_speed_of_sound_is_named_where_the_steps_show_it():
    for board, named_there in (("interactlab", [Defect.SPEED]), ("ultraino-flat8", [])):
        array = LAYOUTS[board].array()
        targets = targets_of(array)
        run = watched(array, latches(array, BOARDS[board], targets, speed=346.0), targets)
        assert named(run.result()) == named_there


def test_one_target_is_enough_for_a_hint_at_the_speed_of_sound():
    array = LAYOUTS["interactlab"].array()
    targets = targets_of(array)[:1]
    result = watched(array, latches(array, 128, targets, speed=346.0), targets).result()
    assert named(result) == []
    (hint,) = result.hints
    told = re.search(r"assumes ([0-9.]+) m/s, air of ([0-9.]+) C \(--temperature-c \2\)", hint)
    assert [float(value) for value in told.groups()] == pytest.approx([346.0, 23.2], abs=0.2)
    assert hint.endswith(": 3 targets or more tell whether it is")
    # Coarser steps do not tell it from a shift.
    coarse = LAYOUTS["sonicsurface"].array()
    seen = latches(coarse, 32, targets_of(coarse)[:1], speed=346.0)
    (hint,) = watched(coarse, seen, targets_of(coarse)[:1]).result().hints
    assert "another coordinate frame: shifted by (" in hint
    assert hint.endswith(": 3 targets or more tell which it is")
    aside = targets + np.array([0.003, 0.0, 0.0])
    assert watched(array, latches(array, 128, aside), targets).result().hints == ()


def test_foci_in_place_whose_codes_are_cut_off_are_a_hint_at_tolerances():
    array = LAYOUTS["sonicsurface"].array()
    targets = targets_of(array)[:2]
    spoil = {"spoil": lambda w: w * np.exp(0.12j * (np.arange(256) % 2))}
    seen = list(latches(array, 32, targets, **spoil))
    result = watched(array, seen, targets).result()
    assert result.verdict is Verdict.FAIL
    (hint,) = result.hints
    assert hint.startswith("every focus is where it was expected; single phases are off")
    elsewhere = latches(array, 32, targets_of(array)[2:3])
    run = watched(array, [*seen, *elsewhere], [*targets[:, None], targets])
    assert run.result().statuses[FrameStatus.WRONG_DRIVE] >= 1  # one focus, of two
    assert run.result().hints == ()


@pytest.mark.sampled(1)
@pytest.mark.slow
@pytest.mark.parametrize("board", ["sonicsurface", "ultraino-flat8", "sonicsurface-stack"])
def test_phases_of_the_opposite_sign_are_named_from_one_target_on(board):
    """A flat array radiates no focus then; nothing else would make the conjugate one."""
    array = LAYOUTS[board].array()
    places = TARGETS[:3] / (4.0 if "stack" in board else 1.0)  # between the boards, or above one
    targets = targets_of(array, places)
    for count in (1, len(targets)):
        seen = list(latches(array, BOARDS.get(board, 32), targets[:count], spoil=np.conj))
        assert named(watched(array, seen, targets[:count]).result()) == [Defect.SIGN]
        assert named(watched(array, seen).result()) == []
        mirror = mirrored(array, targets[:count])
        seen = latches(array, BOARDS.get(board, 32), mirror, spoil=np.conj)
        (found,) = watched(array, seen, targets[:count]).result().diagnoses or [None]
        if count == 1:  # it is a focus beside the target, once the sign is turned
            assert found is None or board == "sonicsurface-stack"
        else:
            assert "; and another order of the elements: x mirrored" in found.detail


@pytest.mark.nightly
def test_near_the_middle_of_bowls_several_targets_show_the_sign():
    """The conjugate of a focus is nearly a focus there, on the other side of the middle."""
    array = LAYOUTS["tinylev"].array()
    targets = (
        array.centre_m
        + np.array([[2.0, 1.0, 3.0], [-3.0, 2.0, 1.0], [1.0, -2.5, -2.0], [3.0, 3.0, -1.0]]) * 1e-3
    )
    run = watched(array, latches(array, 128, targets, spoil=np.conj), targets)
    assert named(run.result()) == [Defect.SIGN]
    run = watched(array, latches(array, 128, targets[3:], spoil=np.conj), targets[3:])
    assert named(run.result()) == []


def test_on_a_symmetry_plane_a_mirror_is_invisible_and_not_named():
    array = LAYOUTS["sonicsurface"].array()
    targets = targets_of(array, TARGETS * [0.0, 1.0, 1.0])
    result = watched(array, latches(array, 32, mirrored(array, targets)), targets).result()
    assert result.verdict is Verdict.PASS
    assert named(result) == []


# --- defects, without an expectation --------------------------------------------------------------


def test_scattered_silent_elements_are_named():
    array = LAYOUTS["interactlab"].array()
    dead = np.random.default_rng(1).choice(256, 32, replace=False)

    def spoil(weights):
        weights = weights.copy()
        weights[dead] = np.nan
        return weights

    result = watched(array, latches(array, 128, targets_of(array), spoil=spoil)).result()
    assert named(result) == [Defect.SILENT]
    assert result.diagnoses[0].detail.startswith("32 elements")
    assert result.verdict is Verdict.FAIL


def test_sets_of_silent_elements_are_kept_up_to_a_count(monkeypatch):
    monkeypatch.setattr(diagnosis, "_MOST_SETS", 3)
    array = LAYOUTS["sonicsurface"].array()
    finder = diagnosis.DefectFinder(array.positions_m, 256)
    run = watched(array, [])
    (whole,) = latches(array, 32, targets_of(array)[:1])
    pattern = run.take(whole).pattern
    for number in (*range(100, 110), *[109] * 5, *[100] * 2):
        weights = whole.weights.copy()
        weights[[3, number]] = 0.0
        assert Defect.SILENT in finder.take(SeenLatch(number, weights, 32), pattern)
    (found,) = finder.diagnoses()
    assert found.detail == "2 elements, 3, 100 beside a pattern of all the others"


def test_a_part_of_the_array_that_is_left_out_is_no_defect():
    array = LAYOUTS["interactlab"].array()
    x = array.positions_m[:, 0]
    for part in (x > 0.07, x > 0.0, np.linalg.norm(array.positions_m, axis=1) > 0.085):
        seen = latches(
            array, 128, targets_of(array), spoil=lambda w, part=part: np.where(part, 0.0, w)
        )
        assert named(watched(array, seen).result()) == []


def test_reversed_elements_are_named_from_several_drives():
    array = LAYOUTS["sonicsurface"].array()
    sign = np.ones(256)
    sign[[17, 200]] = -1.0
    seen = list(latches(array, 32, targets_of(array), spoil=lambda weights: weights * sign))
    result = watched(array, seen).result()
    assert named(result) == [Defect.REVERSED]
    assert "17, 200" in result.diagnoses[0].detail
    assert named(watched(array, [seen[0]] * 9).result()) == []  # one drive proves nothing


def test_elements_that_are_off_by_less_than_half_a_turn_are_not_reversed():
    array = LAYOUTS["sonicsurface"].array()
    turn = np.ones(256, dtype=complex)
    turn[17] = np.exp(2.0j)
    seen = latches(array, 32, targets_of(array), spoil=lambda weights: weights * turn)
    assert named(watched(array, seen).result()) == []


@pytest.mark.parametrize(
    ("counted", "stray", "defect"),
    [
        ({"frames_short": 1}, (), Defect.BYTES_LOST),
        ({"frames_cut_short": 1}, (), Defect.BYTES_LOST),
        ({"start_bits_in_frame": 3}, (), Defect.BYTES_LOST),
        ({"codes_beyond_array": 256}, (), Defect.BYTES_LOST),  # two frames, and no FB between
        ({"frames_without_commit": 2}, (), Defect.NO_COMMIT),
        ({}, (72, 73, 255), Defect.STRAY_CHANNELS),
        ({"commits_of_old_codes": 1}, (), None),
    ],
)
def test_what_the_codec_counted_has_a_name(counted, stray, defect):
    array = LAYOUTS["sonicsurface"].array()
    seen = latches(array, 32, targets_of(array)[:1], counted=counted, stray=stray)
    result = watched(array, seen).result()
    assert named(result) == ([] if defect is None else [defect])
    assert bool(result.torn) == (defect is Defect.BYTES_LOST)


def test_an_amplitude_frame_is_told_from_a_second_frame_of_phases():
    """FB and 256 amplitudes are 257 bytes, and none above half a turn."""
    array = LAYOUTS["ultraino-sonicsurface"].array()
    counted = {"codes_beyond_array": 257, "codes_out_of_range": 1}
    eighth = SeenLatch(1, np.full(256, np.exp(2j * np.pi * (8 + 8) / 32)), 32, counted=counted)
    assert named(watched(array, [eighth]).result()) == [Defect.AMPLITUDES_AS_PHASES]
    codes = np.random.default_rng(0).integers(0, 32, 256)
    phases = SeenLatch(1, np.exp(2j * np.pi * (codes + 8) / 32), 32, counted=counted)
    assert named(watched(array, [phases]).result()) == [Defect.BYTES_LOST]


def test_the_power_up_shows_no_defect_of_the_client():
    array = LAYOUTS["sonicsurface"].array()
    seen = SeenLatch(0, np.ones(256), 32, cause="power-up", stray=(300,))
    assert named(watched(array, [seen]).result()) == []


# --- what the board says of its client ------------------------------------------------------------


def heard(*events):
    """Return the result of latches, remarks about a client, and departures (None), in order."""
    array = LAYOUTS["sonicsurface"].array()
    (whole,) = latches(array, 32, targets_of(array)[:1])
    run = watched(array, [])
    for number, event in enumerate(events):
        if event is None:
            run.frames.client_left()
        elif isinstance(event, About):
            run.frames.remark(event, f"said {number}")
        else:
            run.take(dataclasses.replace(whole, number=number, counted=event))
    return run.result()


SHORT, LOST = {"frames_short": 1}, [(Defect.BYTES_LOST, "1 torn")]
ONE_UNSHOWN, ALL_UNSHOWN = "1 whole and never shown", "frame after frame whole and never shown"


@pytest.mark.parametrize(
    ("events", "found", "verdict"),
    [
        (({}, SHORT), LOST, "fail"),
        # Bytes of another wire are no frames; those of the client before it are.
        ((SHORT, About.OTHER_WIRE, SHORT, {"frames_without_commit": 1}), [], "inconclusive"),
        ((SHORT, None, SHORT, About.OTHER_WIRE), LOST, "fail"),
        ((SHORT, About.OTHER_WIRE, None, {}, SHORT), LOST, "fail"),
        ((About.OTHER_WIRE, None, SHORT, {}), [(Defect.STOPPED, "1 torn by it")], "fail"),
        # A client that was killed tears the frames up to the next whole one.
        (
            ({}, About.STOPPED, None, {"frames_cut_short": 1}, {}),
            [(Defect.STOPPED, "1 torn by it")],
            "fail",
        ),
        (
            ({}, About.STOPPED, SHORT, {}, SHORT),
            [*LOST, (Defect.STOPPED, "1 torn by it")],
            "fail",
        ),
        (({}, About.STOPPED, None), [], "pass"),
        # A commit that a client had no time for is not missing in the next one.
        (({}, About.STOPPED, None, {"frames_without_commit": 1}), [], "pass"),
        (({}, None, {"frames_without_commit": 1}), [(Defect.NO_COMMIT, ONE_UNSHOWN)], "fail"),
        # Frames that nothing ever showed are no latches.
        ((About.NO_COMMIT, None), [(Defect.NO_COMMIT, ALL_UNSHOWN)], "fail"),
        (
            (About.NO_COMMIT, {"frames_without_commit": 1}),
            [(Defect.NO_COMMIT, ONE_UNSHOWN)],
            "fail",
        ),
        ((About.NO_COMMIT, About.OTHER_WIRE), [], "inconclusive"),
        # At a rate that real boards do not have they latch nothing, whatever this one does.
        (({}, About.OTHER_RATE, {}), [], "inconclusive"),
        (({}, None, About.OTHER_RATE, {}, None, {}), [], "inconclusive"),
        # Frames of another size prove another array, or nothing, or had lost a lot.
        ((SHORT, About.OTHER_SIZE), [], "inconclusive"),
        (({}, SHORT, About.OTHER_SIZE), LOST, "fail"),
        (
            (SHORT, About.OTHER_SIZE, SHORT, SHORT, About.OTHER_ARRAY, SHORT),
            [(Defect.OTHER_ARRAY, "4 latches of them")],
            "fail",
        ),
    ],
)
def test_the_frames_of_a_client_are_judged_by_what_the_board_says_of_it(events, found, verdict):
    result = heard(*events)
    assert [(one.defect, one.detail) for one in result.diagnoses] == found
    assert str(result.verdict) == verdict
    assert len(result.remarks) == sum(isinstance(event, About) for event in events)


def test_frames_of_bytes_that_look_like_no_wire_are_not_judged():
    frames = FrameDefects()
    array = LAYOUTS["sonicsurface"].array()
    (whole,) = latches(array, 32, targets_of(array)[:1])
    torn = dataclasses.replace(whole, counted={"frames_short": 1})
    frames.take(torn)
    assert frames.waits_for_wire
    frames.cut_short()
    assert frames.diagnoses() == frames.torn == []
    assert frames.undecided == "the client's bytes were not recognised as those of this board"
    frames.wire_compared(is_own=True)  # a whole frame came
    assert [one.defect for one in frames.diagnoses()] == [Defect.BYTES_LOST]
    assert frames.undecided is None


def test_silent_elements_of_a_wave_from_afar_are_not_named():
    array = LAYOUTS["sonicsurface"].array()
    weights = np.ones(256, dtype=complex)
    weights[[3, 100]] = 0.0
    (seen,) = latches(array, 32, targets_of(array)[:1])
    near = dataclasses.replace(seen, weights=seen.weights * weights)
    pattern = watched(array, []).take(near).pattern
    finder = diagnosis.DefectFinder(array.positions_m, 256)
    assert finder.take(near, pattern) == (Defect.SILENT,)
    far = dataclasses.replace(pattern, bound_m=(0.1, 0.1, 6.0))
    assert finder.take(near, far) == ()


@pytest.mark.parametrize("steps", [10, 128])
def test_an_expected_focus_is_looked_for_where_it_is_expected(steps):
    """A search of a whole volume may miss a focus as small as a bowl makes it."""
    array = LAYOUTS["tinylev"].array()
    places = array.centre_m + np.array([[0.002, 0.001, 0.0235], [0.0, 0.024, 0.002]])
    run = watched(array, [], places)
    for seen in latches(array, steps, places):
        assert run.take(seen).verdict.status is FrameStatus.ON_TARGET


@pytest.mark.sampled(1)
@pytest.mark.parametrize("radius_m", [0.008, 0.011, 0.014])
def test_a_focus_of_bowls_is_found_without_being_expected(radius_m):
    array = LAYOUTS["tinylev"].array()
    ways = np.random.default_rng(4).normal(size=(6, 3))
    places = array.centre_m + radius_m * ways / np.linalg.norm(ways, axis=1)[:, None]
    for place, seen in zip(places, latches(array, 128, places), strict=True):
        pattern = watched(array, []).take(seen).pattern
        assert pattern.kind == "one focus"
        np.testing.assert_allclose(pattern.position_m, place, atol=3e-4)


def test_elements_too_few_for_a_focus_are_not_verified():
    """Eight of them prove nothing: the right drive is no wrong one, and a wrong one is."""
    array = LAYOUTS["ultraino-nano8"].array()
    target = np.array([[0.004, 0.005, 0.04]])
    run = watched(array, latches(array, 24, target), target)
    assert run.result().statuses == {FrameStatus.NOT_VERIFIED: 1}
    assert run.result().verdict is Verdict.INCONCLUSIVE
    told = "8 elements with 24 steps do not prove a focus: S2 is not judged"
    assert run.result().hints == (f"not verified: {told}",)
    told = "8 elements prove no pattern: with --expect their phases are judged"
    assert watched(array, latches(array, 24, target)).result().hints == (told,)
    run = watched(array, latches(array, 24, mirrored(array, target)), target)
    assert run.result().verdict is Verdict.FAIL


def test_the_mounting_of_elements_does_not_hide_the_sign_of_their_phases():
    array = LAYOUTS["sonicsurface"].array()
    turned = np.random.default_rng(2).integers(0, 2, 256) * np.pi
    model = model_of(array).calibrated(Calibration(np.ones(256), turned, array.positions_m))
    targets = targets_of(array)[:1]
    response = np.exp(1j * turned)
    watch = Watch(model, expectation=Expectation(model, list(targets)))
    for seen in latches(array, 32, targets, spoil=lambda w: np.conj(w) / response):
        watch.take(seen)
    assert named(watch.result()) == [Defect.SIGN]


# --- results --------------------------------------------------------------------------------------


def test_results_are_plain_values_and_lines():
    array = LAYOUTS["sonicsurface"].array()
    targets = targets_of(array)
    run = watched(array, [], targets)
    taken = [run.take(seen) for seen in latches(array, 32, targets, counted={"frames_short": 1})]
    document = json.loads(json.dumps([run.result().as_dict(), *(one.as_dict() for one in taken)]))
    assert document[0]["verdict"] == "fail"
    assert document[1]["pattern"]["kind"] == "one focus"
    assert (document[1]["torn"], document[1]["defects"]) == ({"frames_short": 1}, [])
    assert "defect    bytes lost in the middle of a frame: 5 torn" in str(run.result())
    assert str(Diagnosis(Defect.NO_COMMIT, "9", tuple(range(9)))).endswith("4, 5, ... (9))")


def test_a_drive_that_comes_again_is_not_searched_again():
    array = LAYOUTS["sonicsurface"].array()
    run = watched(array, [])
    (seen,) = latches(array, 32, targets_of(array)[:1])
    assert run.take(seen).took_ms > 0.0
    assert run.take(seen).took_ms == 0.0


def test_the_examples_run():
    model = model_of(LAYOUTS["sonicsurface"].array())
    weights = np.exp(1j * focus_phases(model, (0.0, 0.0, 0.15)))
    names = {"model": model, "weights": weights, "np": np, "SeenLatch": SeenLatch}
    for module in (defect, expectation, latch, watch):
        assert doctest.testmod(module, extraglobs=names).failed == 0
