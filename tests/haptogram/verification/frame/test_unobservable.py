"""What an array cannot observe is not verified: its miss is null, and never 0."""

import dataclasses

import numpy as np
import pytest

from haptogram.acoustics import AcousticModel, Drive, TransducerArray, focus_phases
from haptogram.errors import HaptogramError, VerificationError
from haptogram.records.frame import Focus
from haptogram.verification import FrameJudge, FrameStatus, Verdict, verify_run
from latched_drives import drive_of, intend, registers, seen

pytestmark = pytest.mark.sampled(3)

POINT = (0.0, 0.0, 0.1)
ASIDE = (0.02, 0.01, 0.12)


def array_of(shape):
    return AcousticModel.default(*shape)


@pytest.mark.parametrize(
    ("shape", "target", "lost"),
    [
        ((1, 1), POINT, "x and y and z"),
        ((2, 1), POINT, "y and z"),
        ((1, 2), POINT, "x and z"),
        ((2, 2), POINT, "z"),
        ((2, 2), ASIDE, "x and y and z"),
        ((1, 7), ASIDE, "x and z"),
        ((128, 1), ASIDE, "y and z"),
    ],
)
@pytest.mark.parametrize("bits", [8, 5])
def test_nothing_passes_that_cannot_be_seen(shape, target, lost, bits):
    model = array_of(shape)
    intended = intend(model, target, bits)
    run = verify_run([intended], [seen(intended)], model=model)
    (frame,) = run.frames
    assert frame.status is FrameStatus.NOT_VERIFIED
    assert f"along {lost}:" in frame.note
    assert frame.smallest_miss_mm is None
    for name, bound, place in zip("xyz", frame.bound_mm, frame.measured_m, strict=True):
        assert (bound is None) == (place is None) == (name in lost)
    assert (run.verdict, run.exit_status) == (Verdict.INCONCLUSIVE, 3)
    assert run.as_dict()["smallest_miss_mm"] is None


@pytest.mark.parametrize("shape", [(2, 2), (2, 1), (1, 1)])
def test_70_degrees_between_host_and_board_do_not_pass_unseen(shape):
    host = AcousticModel.default(*shape, temperature_c=-20.0)
    board = AcousticModel.default(*shape, temperature_c=50.0)
    intended = intend(host, POINT)
    run = verify_run([intended], [seen(intended)], model=board)
    assert run.verdict is Verdict.INCONCLUSIVE
    assert run.frames[0].axial_error_mm is None


@pytest.mark.parametrize("shape", [(2, 2), (1, 1), (128, 1)])
def test_what_can_be_seen_to_be_wrong_still_fails(shape):
    model = array_of(shape)
    intended = intend(model, POINT)
    silent = Drive(intended.drive.phase_codes, np.zeros(model.array.count, np.uint8))
    found = FrameJudge(model, carrier_us=25).judge(intended, seen(intended, silent))
    assert found.status is FrameStatus.WRONG_DRIVE


@pytest.mark.parametrize(
    "shape", [(5, 5), (3, 5), (5, 7), (7, 7), (6, 6), (8, 8), (9, 3), (20, 20)]
)
@pytest.mark.parametrize("bits", [8, 6, 5])
def test_arrays_with_an_element_in_the_middle_are_judged_like_others(shape, bits):
    model = array_of(shape)
    judge = FrameJudge(model, carrier_us=25)
    rng = np.random.default_rng(shape[0] + bits)
    for target in rng.uniform((-0.05, -0.05, 0.05), (0.05, 0.05, 0.25), (12, 3)):
        intended = intend(model, target, bits)
        found = judge.judge(intended, seen(intended))
        assert found.status is FrameStatus.ON_TARGET, found
        assert found.smallest_miss_mm > 0.0


APERTURES = {
    "left half": lambda p: (p[:, 0] < 0.0).astype(float),
    "centre 8 x 8": lambda p: (np.abs(p[:, :2]).max(axis=1) < 0.04).astype(float),
    "ring": lambda p: (np.linalg.norm(p, axis=1) > 0.05).astype(float),
    "Gaussian": lambda p: np.exp(-((np.linalg.norm(p, axis=1) / 0.05) ** 2)),
    "cosine": lambda p: np.cos(p[:, 0] / 0.08 * 1.4) * np.cos(p[:, 1] / 0.08 * 1.4),
}


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", APERTURES)
@pytest.mark.parametrize("bits", [8, 6])
def test_part_of_the_aperture_and_tapers_are_judged_by_what_was_intended(name, bits):
    model = array_of((16, 16))
    judge = FrameJudge(model, carrier_us=25)
    levels = APERTURES[name](model.array.positions_m)
    amplitudes = np.rint(255 * levels).astype(np.uint8)
    rng = np.random.default_rng(7)
    for target in rng.uniform((-0.05, -0.05, 0.05), (0.05, 0.05, 0.25), (12, 3)):
        drive = Drive(registers(focus_phases(model, target), bits).phase_codes, amplitudes)
        intended = intend(model, target, bits, drive=drive)
        found = judge.judge(intended, seen(intended))
        assert found.status is FrameStatus.ON_TARGET, found
        missed = registers(focus_phases(model, target + np.array([0.0, 0.004, 0.0])), bits)
        elsewhere = judge.judge(intended, seen(intended, Drive(missed.phase_codes, amplitudes)))
        assert elsewhere.status in (FrameStatus.OFF_TARGET, FrameStatus.WRONG_DRIVE)
        whole = judge.judge(intended, seen(intended, drive_of(drive.phase_codes)))
        assert whole.status in (FrameStatus.WRONG_DRIVE, FrameStatus.OFF_TARGET)


def turned(model, rotation, shift):
    array = model.array
    moved = TransducerArray.from_positions(
        array.positions_m @ rotation.T + shift, array.normals @ rotation.T
    )
    return dataclasses.replace(model, array=moved)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("seed", range(6))
def test_a_moved_and_turned_array_is_judged_like_the_same_array_in_its_place(seed):
    rng = np.random.default_rng(seed)
    rotation, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    rotation *= np.sign(np.linalg.det(rotation))
    shift = rng.uniform(-0.3, 0.3, 3)
    plain = array_of((12, 10))
    model = turned(plain, rotation, shift)
    for target in rng.uniform((-0.04, -0.04, 0.06), (0.04, 0.04, 0.2), (4, 3)):
        there = rotation @ target + shift
        here = intend(plain, target)
        moved = intend(model, there, drive=here.drive)
        found = FrameJudge(model, carrier_us=25).judge(moved, seen(moved))
        like = FrameJudge(plain, carrier_us=25).judge(here, seen(here))
        assert found.status is like.status is FrameStatus.ON_TARGET, found
        assert found.lateral_error_mm == pytest.approx(like.lateral_error_mm, abs=1e-3)
        assert found.axial_error_mm == pytest.approx(like.axial_error_mm, abs=1e-3)
        off = intend(model, there, drive=registers(focus_phases(model, there + 0.002)))
        assert (
            FrameJudge(model, carrier_us=25).judge(off, seen(off)).status is FrameStatus.OFF_TARGET
        )


def test_foci_that_merge_are_not_verified_each():
    model = array_of((16, 16))
    points = [(0.0, 0.0, 0.12), (0.0, 0.0, 0.121)]
    foci = tuple(Focus.at(point, 0.5) for point in points)
    phases = sum(np.exp(1j * focus_phases(model, point)) for point in points)
    intended = intend(model, points[0], foci=foci, drive=registers(np.angle(phases)))
    found = FrameJudge(model, carrier_us=25).judge(intended, seen(intended))
    assert found.status in (FrameStatus.NOT_VERIFIED, FrameStatus.ON_TARGET)
    assert found.status is FrameStatus.NOT_VERIFIED or found.smallest_miss_mm > 0.0


# --- The verdict as a value ----------------------------------------------------------------------


def run_of(*drives):
    model = array_of((8, 8))
    intended = [intend(model, (0.0, 0.01 * n, 0.1), number=n) for n in range(len(drives))]
    observations = [
        seen(frame, drive(frame)) for frame, drive in zip(intended, drives, strict=True) if drive
    ]
    return verify_run(intended, observations, model=model)


def right(frame):
    return frame.drive


def wrong(frame):
    return drive_of(-frame.drive.phase_codes.astype(int))


@pytest.mark.parametrize(
    ("drives", "verdict"),
    [
        ((right, right), Verdict.PASS),
        ((right, wrong), Verdict.FAIL),
        ((right, None), Verdict.FAIL),
        ((None, None), Verdict.INCONCLUSIVE),
    ],
)
def test_a_verdict_is_true_for_a_pass_only(drives, verdict):
    run = run_of(*drives)
    assert run.verdict is verdict
    assert bool(run) is bool(run.verdict) is run.passed is (verdict is Verdict.PASS)
    if run.passed:
        run.raise_for_verdict()
        return
    with pytest.raises(VerificationError) as raised:
        run.raise_for_verdict()
    assert str(raised.value) == str(run)
    assert isinstance(raised.value, HaptogramError | AssertionError)


def test_every_frame_says_what_its_verdict_rests_on():
    on_target, off = (str(frame) for frame in run_of(right, wrong).frames)
    assert on_target.startswith("frame 0: on target; ")
    assert "mm on shows" in on_target
    assert on_target.endswith("S1, S2, S3, S4, S5; external evidence")
    assert off.startswith("frame 1: wrong drive; opposite sign of all phases")
    assert "S1 failed" in off
