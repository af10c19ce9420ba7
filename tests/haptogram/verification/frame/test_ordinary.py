"""Frames judged many at once, in compiled code, beside the same frames judged one by one."""

import dataclasses
import functools

import numpy as np
import pytest

from haptogram.acoustics import (
    AcousticModel,
    Calibration,
    Drive,
    NoFocus,
    NumpyEngine,
    PointSource,
    Reconstructor,
    Transducer,
    TransducerArray,
    focus_phases,
)
from haptogram.acoustics.reconstruct import reconstruction
from haptogram.acoustics.reconstruct.warm import DriveToFind
from haptogram.records.frame import Evidence, Focus
from haptogram.verification import FrameJudge, Tolerance, Uncertainty
from haptogram.verification.frame import judge as judge_module
from haptogram.verification.frame.ordinary import BY_CRC, COMPILED
from latched_drives import drive_of, intend, registers, seen

pytest.importorskip("numba")

MODEL = AcousticModel.default()
TURN = np.array([[0.8, 0.0, 0.6], [0.0, 1.0, 0.0], [-0.6, 0.0, 0.8]])
STAIRS = np.add(MODEL.array.positions_m, np.outer(np.arange(256) % 16, (0.0, 0.0, 4e-4)))
SCATTERED = MODEL.array.positions_m + np.random.default_rng(5).normal(
    0.0, [5e-4, 5e-4, 0], (256, 3)
)
ARRAYS = {
    "16x16": MODEL,
    "8x8": AcousticModel.default(8, 8),
    "32x4": AcousticModel.default(32, 4),
    "turned": dataclasses.replace(MODEL, array=MODEL.array.moved(TURN, (0.01, -0.02, 0.05))),
    "of two heights": dataclasses.replace(MODEL, array=TransducerArray.from_positions(STAIRS)),
    "of no lattice": dataclasses.replace(MODEL, array=TransducerArray.from_positions(SCATTERED)),
    "in cold air": MODEL.with_sound_speed(331.0),
}


def path(model, count=12):
    """Frames along a circle that no two share, each near to the one before."""
    angles = np.linspace(0.0, 2.0, count)
    local = np.column_stack([0.03 * np.cos(angles), 0.03 * np.sin(angles), 0.1 + 0.02 * angles])
    return model.array.world_m(local)


def test_frames_without_a_focus_are_sought_as_seldom_as_one_by_one(monkeypatch):
    """Drives as they were sent, for air that is 3 % faster: no point explains their phases."""
    searched = []
    search = reconstruction.FocusAcquisition.fits
    monkeypatch.setattr(judge_module, "_MOST_SEARCHES", 2)
    monkeypatch.setattr(
        reconstruction.FocusAcquisition, "fits", lambda *a: searched.append(a) or search(*a)
    )
    model = AcousticModel.default(6, 6)
    host = model.with_sound_speed(1.03 * model.medium.sound_speed_m_s)
    places = [(0.04, 0.001 * number - 0.04, 0.04) for number in range(6)]
    sent = [
        intend(model, place, number=number, drive=registers(focus_phases(host, place)))
        for number, place in enumerate(places)
    ]
    pairs = [(frame, seen(frame)) for frame in sent]
    alone, together = (FrameJudge(model, carrier_us=25) for _ in range(2))
    expected = [alone.judge(*pair) for pair in pairs]
    assert len(searched) == 2
    assert list(together.judge_all(pairs)) == expected
    assert len(searched) == 4


def run_of(model, targets, bits=8, **changes):
    """Pairs of frames and latches, whose foci were found one by one."""
    pairs = _found_pairs(model, tuple(map(tuple, targets)), bits)
    return [(intended, dataclasses.replace(latch, **changes)) for intended, latch in pairs]


@functools.cache
def _found_pairs(model, targets, bits):
    finder, pairs = Reconstructor(model), []
    for number, target in enumerate(targets):
        intended = intend(model, target, bits, number)
        drive = intended.drive
        step_rad = finder.step_rad(drive.phase_bits, bits)
        (found,) = finder.reconstruct_all([DriveToFind(drive, step_rad)])
        extra = {"drive_crc": drive.digest(), "reconstruction": found}
        pairs.append((intended, seen(intended, **extra)))
    return pairs


def both_ways(model, pairs, **options):
    """Return the verdicts of all at once and one by one, and the ways that the first went."""
    judge = FrameJudge(model, carrier_us=25, **options)
    at_once = list(judge.judge_all(pairs))
    alone = FrameJudge(model, carrier_us=25, **options)
    return at_once, [alone.judge(*pair) for pair in pairs], judge.ways


def assert_same(found, expected):
    assert type(found) is type(expected)
    if isinstance(expected, float):
        assert found == pytest.approx(expected, rel=0.0, abs=1e-9)
    elif isinstance(expected, tuple):
        for one, other in zip(found, expected, strict=True):
            assert_same(one, other)
    else:
        assert found == expected


def assert_same_verdicts(found, expected):
    for one, other in zip(found, expected, strict=True):
        for field in dataclasses.fields(other):
            assert_same(getattr(one, field.name), getattr(other, field.name))
        assert list(one.criteria) == list(other.criteria)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", ARRAYS)
@pytest.mark.parametrize("bits", [8, 5])
def test_all_at_once_is_as_one_by_one(name, bits):
    pairs = run_of(ARRAYS[name], path(ARRAYS[name]), bits)
    known = Uncertainty(2.0, 10.0, 0.3, 0.2, is_guess=True)
    found, expected, ways = both_ways(ARRAYS[name], pairs, uncertainty=known)
    assert_same_verdicts(found, expected)
    assert all(verdict.passed for verdict in expected)
    if bits == 8:
        assert ways == {COMPILED: len(pairs)}


@pytest.mark.parametrize("side", [5, 6, 7])
def test_small_arrays_near_by_are_judged_as_one_by_one(side):
    """There the directivity bends the level along the beam as much as the waves do."""
    model = AcousticModel.default(side, side)
    low, high = np.array([(-0.02, -0.02, 0.035), (0.02, 0.02, 0.06)])
    pairs = run_of(model, np.random.default_rng(side).uniform(low, high, (8, 3)))
    found, expected, ways = both_ways(model, pairs)
    assert_same_verdicts(found, expected)
    assert all(verdict.passed for verdict in expected)
    assert ways[COMPILED] >= 4


def test_times_and_board_computed_drives_are_as_one_by_one():
    pairs = run_of(MODEL, path(MODEL, 12))
    changed = []
    for number, (intended, latch) in enumerate(pairs):
        late = dataclasses.replace(latch, t_latch_us=latch.t_latch_us + 30 * (number % 3) - 10)
        due = None if number == 5 else intended.t_apply_us
        points = dataclasses.replace(intended, board_computed=number % 2 == 0, t_apply_us=due)
        changed.append((points, late))
    found, expected, ways = both_ways(MODEL, changed)
    assert_same_verdicts(found, expected)
    assert ways == {COMPILED: 12}
    assert {(verdict.late, verdict.early) for verdict in found} == {
        (False, False), (True, False), (False, True),
    }  # fmt: skip


def off_by_one(latch):
    codes = latch.drive.phase_codes.astype(int)
    codes[17] += 1
    return dataclasses.replace(latch, drive=drive_of(codes), drive_crc=None)


def quieter(latch):
    return dataclasses.replace(latch, drive=drive_of(latch.drive.phase_codes, 254), drive_crc=None)


def seen_as(**changes):
    return lambda latch: dataclasses.replace(latch, **changes)


LATCHES = {
    "another drive than the intended one": [
        off_by_one,
        seen_as(drive_crc=1),
        lambda latch: seen_as(radiated=off_by_one(latch).drive)(latch),
    ],
    "amplitudes": [quieter],
    "no drive of the board, or another CRC": [
        seen_as(drive=None, drive_crc=None),
        seen_as(drive=None, drive_crc=7),
        seen_as(evidence=Evidence.WIRE),
    ],
    "no single focus": [seen_as(reconstruction=NoFocus("zero amplitude"))],
    "phases that are not of 8 bits": [lambda o: seen_as(drive=o.drive.in_bits(10))(o)],
}


@pytest.mark.parametrize("reason", LATCHES)
def test_latches_that_are_not_ordinary_are_judged_one_by_one(reason):
    pairs = run_of(MODEL, path(MODEL, 6))
    for change in LATCHES[reason]:
        some = [(f, change(o) if number % 2 else o) for number, (f, o) in enumerate(pairs)]
        found, expected, ways = both_ways(MODEL, some)
        assert_same_verdicts(found, expected)
        assert ways == {COMPILED: 3, reason: 3}


@pytest.mark.parametrize("bits", [8, 5])
def test_fields_that_nobody_rebuilt_are_rebuilt_at_once(bits):
    pairs = run_of(MODEL, path(MODEL), bits, reconstruction=None)
    some = [
        (f, off_by_one(o) if n % 9 == 4 else seen_as(drive=None)(o) if n % 3 == 1 else o)
        for n, (f, o) in enumerate(pairs)
    ]
    found, expected, ways = both_ways(MODEL, some)
    assert_same_verdicts(found, expected)
    assert ways.get(COMPILED, 0) == (11 if bits == 8 else 0)
    assert {verdict.note for verdict in found if verdict.passed} >= {"", BY_CRC}


def test_several_foci_are_judged_one_by_one():
    (intended, latch), *_ = run_of(MODEL, path(MODEL, 1))
    pair = dataclasses.replace(intended, foci=(Focus((0, 0, 0.1)), Focus((0.03, 0, 0.1))))
    found, expected, ways = both_ways(MODEL, [(pair, latch)])
    assert_same_verdicts(found, expected)
    assert ways == {"several foci": 1}


def test_what_does_not_hold_is_judged_one_by_one():
    colder = MODEL.with_sound_speed(MODEL.medium.sound_speed_m_s - 4.0)
    found, expected, ways = both_ways(colder, run_of(MODEL, path(MODEL, 4)))
    assert_same_verdicts(found, expected)
    assert ways == {"a criterion that does not hold": 4}
    assert not any(verdict.passed for verdict in expected)


def test_a_flat_peak_and_a_line_of_elements_are_judged_one_by_one():
    flat, unseen = AcousticModel.default(8, 8), AcousticModel.default(16, 1)
    for model, height_m, reason in (
        (flat, 0.6, "a peak that has no place, or that rounding moves far"),
        (unseen, 0.1, "a coordinate of the focus that does not show"),
    ):
        found, expected, ways = both_ways(model, run_of(model, [(0.0, 0.0, height_m)]))
        assert_same_verdicts(found, expected)
        assert ways == {reason: 1}


def bowl():
    array = MODEL.array
    away = array.positions_m - np.array([0.0, 0.0, 0.3])
    normals = -away / np.linalg.norm(away, axis=1)[:, None]
    return dataclasses.replace(MODEL, array=dataclasses.replace(array, normals=normals))


MODELS = {
    "elements with a calibration": lambda: MODEL.calibrated(
        Calibration(np.full(256, 0.9), np.zeros(256), MODEL.array.positions_m)
    ),
    "fewer than 4 elements": lambda: AcousticModel.default(3, 1),
    "elements that do not look one way": bowl,
    "elements that are no circular pistons: PointSource": lambda: dataclasses.replace(
        MODEL, transducer=Transducer(PointSource())
    ),
    "large pistons, or much absorption": lambda: dataclasses.replace(
        MODEL, transducer=dataclasses.replace(MODEL.transducer, frequency_hz=90e3)
    ),
}


@pytest.mark.parametrize("reason", MODELS)
def test_arrays_that_no_loop_serves_are_judged_one_by_one(reason):
    model = MODELS[reason]()
    found, expected, ways = both_ways(model, run_of(model, [(0.0, 0.0, 0.08)]))
    assert_same_verdicts(found, expected)
    assert ways == {reason: 1}


def test_a_tolerance_is_judged_one_by_one():
    pairs = run_of(MODEL, path(MODEL, 3))
    found, expected, ways = both_ways(MODEL, pairs, tolerance=Tolerance(miss_mm=0.5))
    assert_same_verdicts(found, expected)
    assert ways == {"a tolerance": 3}


def test_without_numba_all_are_judged_one_by_one(monkeypatch):
    monkeypatch.setattr("haptogram.acoustics.field.engines.parallel.load_kernels", lambda: None)
    found, expected, ways = both_ways(MODEL, run_of(MODEL, path(MODEL, 3)))
    assert_same_verdicts(found, expected)
    assert ways == {"numba is not installed": 3}


@pytest.mark.parametrize("size", [1, 7, 1000])
def test_how_many_are_judged_at_once_changes_no_bit(monkeypatch, size):
    pairs = run_of(MODEL, path(MODEL))
    expected = list(FrameJudge(MODEL, carrier_us=25).judge_all(pairs))
    monkeypatch.setattr(judge_module, "_AT_ONCE", size)
    assert list(FrameJudge(MODEL, carrier_us=25).judge_all(pairs)) == expected


# --- foci, each beside the one before ----------------------------------------------------------


def drives_of(model, targets):
    return [registers(focus_phases(model, target)) for target in targets]


def asked(finder, drives):
    return [DriveToFind(drive, finder.step_rad(drive.phase_bits)) for drive in drives]


def without_compiled(model):
    finder = Reconstructor(model)
    vars(finder)["_warm"] = None
    return finder


def odd_drives():
    """A drive of each kind that is not found beside the last one, and what is between them."""
    near, far = drives_of(MODEL, [(0.0, 0.0, 0.1), (0.06, -0.05, 0.25)])
    dead, turned = near.amplitude_codes.copy(), near.phase_codes.copy()
    dead[3] = 0
    turned[7] += 64
    noise = np.random.default_rng(1).integers(0, 256, 256)
    odd = [
        far, Drive(near.phase_codes, dead), Drive(turned, near.amplitude_codes), drive_of(noise),
        Drive.muted(256), near.in_bits(10), registers(focus_phases(MODEL, (0, 0, 0.1)), 2),
    ]  # fmt: skip
    return [near, *(drive for one in odd for drive in (one, near, near))]


@pytest.mark.parametrize("name", ARRAYS)
def test_foci_found_at_once_are_those_found_one_by_one(name):
    model = ARRAYS[name]
    finder, reference = Reconstructor(model), without_compiled(model)
    drives = drives_of(model, path(model))
    assert finder.why_not_compiled is None
    for found, drive in zip(finder.reconstruct_all(asked(finder, drives)), drives, strict=True):
        assert_same_foci(found, reference.reconstruct(drive))


def assert_same_foci(found, expected):
    assert type(found) is type(expected)
    for field in dataclasses.fields(expected):
        one, other = getattr(found, field.name), getattr(expected, field.name)
        if field.name == "pressure_rms_pa":
            assert one == pytest.approx(other, rel=1e-12)
        else:
            assert_same(one, other)


def test_an_engine_of_the_caller_finds_foci_one_by_one():
    pairs = run_of(MODEL, path(MODEL, 3))
    finder = Reconstructor(MODEL, engine=NumpyEngine(MODEL))
    assert finder.why_not_compiled == "another field engine"
    drives = [latch.drive for _, latch in pairs]
    for found, (_, latch) in zip(finder.reconstruct_all(asked(finder, drives)), pairs, strict=True):
        assert found.position_m == pytest.approx(latch.reconstruction.position_m, abs=1e-9)
        assert found.force_n == pytest.approx(latch.reconstruction.force_n, rel=1e-5)


def test_drives_that_are_not_beside_the_last_one_are_found_all_the_same():
    finder, reference, drives = Reconstructor(MODEL), without_compiled(MODEL), odd_drives()
    for found, drive in zip(finder.reconstruct_all(asked(finder, drives)), drives, strict=True):
        assert_same_foci(found, reference.reconstruct(drive))


@pytest.mark.parametrize("size", [1, 4, 64])
def test_how_many_foci_are_found_at_once_changes_no_bit(monkeypatch, size):
    drives = [*drives_of(MODEL, path(MODEL)), *odd_drives()]
    finder = Reconstructor(MODEL)
    expected = finder.reconstruct_all(asked(finder, drives))
    monkeypatch.setattr(reconstruction, "_AT_ONCE", size)
    assert (other := Reconstructor(MODEL)).reconstruct_all(asked(other, drives)) == expected
