"""One frame: S1 to S5, what each of them can see, and what is not judged."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram.acoustics import (
    AcousticModel,
    Drive,
    NoFocus,
    NotSingle,
    Reconstructor,
    SingleFocus,
    focus_phases,
    superpose_foci,
)
from haptogram.records.frame import Evidence, Focus
from haptogram.verification import FrameJudge, FrameStatus
from haptogram.verification.frame import judge as judge_module
from latched_drives import codes, drive_of, intend, registers, seen, working_volume

MODEL = AcousticModel.default()
JUDGE = FrameJudge(MODEL, carrier_us=25)
TARGET = (0.013, -0.021, 0.11)


def judge(intended, drive=None, **changes):
    return JUDGE.judge(intended, seen(intended, drive, **changes))


def aside(point, distance_m, angle_rad):
    x, y, z = point
    return x + distance_m * math.cos(angle_rad), y + distance_m * math.sin(angle_rad), z


@pytest.mark.sampled(2)
@pytest.mark.parametrize("shape", [(16, 16), (8, 8), (32, 4), (24, 24)])
@pytest.mark.parametrize("bits", [8, 6, 5])
def test_right_drives_of_other_arrays_are_on_target(shape, bits):
    model = AcousticModel.default(*shape)
    judge = FrameJudge(model, carrier_us=25)
    rng = np.random.default_rng(shape[0] + bits)
    for target in rng.uniform((-0.06, -0.06, 0.05), (0.06, 0.06, 0.3), (25, 3)):
        intended = intend(model, target, bits)
        found = judge.judge(intended, seen(intended))
        assert (found.status, found.faults) == (FrameStatus.ON_TARGET, ()), found


@pytest.mark.parametrize("mirror", [(1, 1), (-1, 1), (1, -1), (-1, -1)])
def test_a_peak_far_before_its_target_is_climbed_to(mirror):
    """Near a small array directivity bends the field along the beam as much as 1 / r does."""
    model = AcousticModel.default(5, 5, pitch_m=0.00794, temperature_c=49.904)
    intended = intend(model, (0.005 * mirror[0], 0.009 * mirror[1], 0.052))
    found = FrameJudge(model, carrier_us=25).judge(intended, seen(intended))
    assert found.status is FrameStatus.ON_TARGET, found


@pytest.mark.sampled(1)
@pytest.mark.parametrize("bits", [8, 6, 5])
def test_a_correct_drive_never_exceeds_the_worst_case_of_its_rounding(bits):
    # On the axis all rounding errors are correlated: four standard deviations are not enough.
    for height in np.linspace(0.05, 0.25, 41):
        intended = intend(MODEL, (0.0, 0.0, height), bits)
        found = judge(intended)
        assert found.phase_error_rad <= math.pi / 2**bits + 1e-9
        assert abs(found.axial_error_mm) <= found.bound_mm[2]
        assert found.coherence >= math.cos(math.pi / 2**bits)


@given(working_volume(), st.floats(0.0, 2.0 * math.pi))
def test_a_miss_of_1_mm_across_is_seen(target, angle):
    intended = intend(MODEL, target)
    where = aside(target, 0.001, angle)
    found = judge(intended, registers(focus_phases(MODEL, where)))
    assert found.status is FrameStatus.OFF_TARGET
    assert {name for name in ("S1", "S2") if found.criteria[name]} == set()
    # In a plane parallel to the array, which is tilted against the beam.
    total_mm = math.hypot(found.lateral_error_mm, found.axial_error_mm)
    assert total_mm == pytest.approx(1.0, abs=found.smallest_miss_mm)


@pytest.mark.parametrize(("faster", "low_mm", "high_mm"), [(-3.2, -2.4, -1.1), (0.8, 0.2, 0.6)])
def test_other_air_over_the_board_moves_the_focus_along_the_beam(faster, low_mm, high_mm):
    host = MODEL.with_sound_speed(MODEL.medium.sound_speed_m_s + faster)
    target = (0.0, 0.0, 0.15)
    intended = intend(MODEL, target, drive=registers(focus_phases(host, target)))
    found = judge(intended)
    assert found.status is FrameStatus.OFF_TARGET
    assert low_mm < found.axial_error_mm < high_mm or low_mm < -found.axial_error_mm < high_mm
    assert found.lateral_error_mm < 0.1


def test_a_line_of_elements_tells_x_only():
    model = AcousticModel.default(128, 1)
    judge = FrameJudge(model, carrier_us=25)
    intended = intend(model, (0.02, 0.0, 0.15))
    found = judge.judge(intended, seen(intended))
    assert found.status is FrameStatus.NOT_VERIFIED
    assert "along y and z" in found.note
    assert (found.lateral_error_mm, found.axial_error_mm) == (None, None)
    assert (found.bound_mm[1:], found.measured_m[1:]) == ((None, None), (None, None))
    assert found.smallest_miss_mm is None
    elsewhere = registers(focus_phases(model, (0.021, 0.0, 0.15)))
    assert judge.judge(intended, seen(intended, elsewhere)).status is FrameStatus.OFF_TARGET


def test_the_back_door_s_word_on_what_was_radiated_counts():
    # The registers hold the right drive, but what left the array focuses elsewhere.
    intended = intend(MODEL, TARGET)
    elsewhere = registers(focus_phases(MODEL, (0.013, -0.021, 0.113)))
    radiated = Reconstructor(MODEL).reconstruct(elsewhere)
    found = judge(intended, reconstruction=radiated)
    assert found.status is FrameStatus.OFF_TARGET
    assert {name for name, passed in found.criteria.items() if not passed} == {"S2"}
    grid = codes(intended)
    grid[1, 1] += 128
    radiated = Reconstructor(MODEL).reconstruct(drive_of(grid))
    assert isinstance(radiated, NotSingle)
    found = judge(intended, reconstruction=radiated)
    assert found.status is FrameStatus.WRONG_DRIVE
    assert found.faults == ("element 17 (1, 1) radiated otherwise than latched",)


def test_of_two_points_that_suit_the_same_phases_the_one_next_to_the_target_counts():
    # Twelve elements with 5 bits: a blind search may come out at either.
    model = AcousticModel.default(4, 3)
    judge = FrameJudge(model, carrier_us=25)
    intended = intend(model, (0.0506002, 0.0, 0.11256724), 5)
    blind = Reconstructor(model, 5).reconstruct(intended.drive)
    assert isinstance(blind, SingleFocus)
    assert math.dist(blind.position_m, (0.0506002, 0.0, 0.11256724)) > 0.01
    found = judge.judge(intended, seen(intended, reconstruction=blind))
    assert found.status is FrameStatus.ON_TARGET
    assert found.criteria["S2"]
    assert "the phases suit another point as well, " in found.note


def test_what_has_no_evidence_is_not_verified():
    intended = intend(MODEL, TARGET)
    nothing = dataclasses.replace(seen(intended), drive=None)
    assert JUDGE.judge(intended, nothing).status is FrameStatus.NOT_VERIFIED
    ramping = judge(intended, reconstruction=NoFocus("ramping"))
    assert ramping.status is FrameStatus.NOT_VERIFIED
    assert "ramping" in ramping.note
    other_array = judge(intended, drive_of(np.zeros(64)))
    assert other_array.status is FrameStatus.NOT_VERIFIED
    assert "64 elements" in other_array.note


def test_a_crc_stands_for_the_drive_that_was_intended():
    intended = intend(MODEL, TARGET)
    crc = intended.drive.digest()
    only_crc = dataclasses.replace(
        seen(intended, evidence=Evidence.SELF_REPORTED), drive=None, drive_crc=crc
    )
    found = JUDGE.judge(intended, only_crc)
    assert (found.status, found.evidence) == (FrameStatus.ON_TARGET, Evidence.SELF_REPORTED)
    assert "CRC" in found.note
    damaged = JUDGE.judge(intended, dataclasses.replace(only_crc, drive_crc=crc ^ 1))
    assert damaged.status is FrameStatus.CORRUPT
    assert f"{crc ^ 1:08x}" in damaged.faults[0]
    # Its own arithmetic may differ by a step, and the CRC then differs altogether.
    by_board = dataclasses.replace(intended, board_computed=True)
    assert JUDGE.judge(by_board, only_crc).status is FrameStatus.NOT_VERIFIED


@given(working_volume(), st.integers(0, 2**32 - 1))
def test_a_board_that_computes_may_differ_by_one_step(target, seed):
    intended = dataclasses.replace(intend(MODEL, target), board_computed=True)
    steps = np.random.default_rng(seed).integers(-1, 2, (16, 16))
    found = judge(intended, drive_of(codes(intended) + steps))
    assert (found.status, found.faults) == (FrameStatus.ON_TARGET, ())
    steps[3, 3] = 2
    found = judge(intended, drive_of(codes(intended) + steps))
    assert found.status in (FrameStatus.CORRUPT, FrameStatus.WRONG_DRIVE)
    assert found.faults == ("element 51 (3, 3) off by +2 LSB",)


@given(working_volume(), st.floats(-math.pi, math.pi), st.sampled_from([8, 6, 5]))
def test_two_foci_are_judged_by_the_pressure_at_each(target, phase_rad, bits):
    points = [target, (-0.03, 0.015, 0.1)]
    foci = (Focus.at(points[0], 0.5), Focus.at(points[1], 0.5, phase_rad))
    weights = superpose_foci(MODEL, points, [0.5, 0.5], [0.0, phase_rad])
    exact = Drive.from_weights(weights)
    drive = Drive(registers(np.angle(weights), bits).phase_codes, exact.amplitude_codes)
    intended = intend(MODEL, target, bits, foci=foci, drive=drive)
    found = judge(intended)
    assert found.status is FrameStatus.ON_TARGET, found
    assert found.criteria == {"S1": True, "S2": True, "S3": True, "S5": True}
    one_only = registers(focus_phases(MODEL, points[1]), bits)
    wrong = judge(intended, Drive(one_only.phase_codes, exact.amplitude_codes))
    assert wrong.status is FrameStatus.WRONG_DRIVE
    assert not wrong.criteria["S3"]


def test_late_and_early_are_measured_from_the_first_boundary_at_or_after_the_time():
    intended = intend(MODEL, TARGET, number=1)
    for delay_us, late, early in [(0, False, False), (24, False, False), (25, True, False)]:
        found = judge(intended, t_latch_us=1000 + delay_us)
        assert (found.late, found.early, found.lateness_us) == (late, early, delay_us)
    assert judge(intended, t_latch_us=999).early
    assert judge(intended, late=True).late


def test_what_repeats_is_judged_once_but_for_its_times(monkeypatch):
    judged = []
    name_drive_faults = judge_module.name_drive_faults
    monkeypatch.setattr(
        judge_module, "name_drive_faults", lambda *a: judged.append(a) or name_drive_faults(*a)
    )
    own = FrameJudge(MODEL, carrier_us=25)
    first, again = (intend(MODEL, TARGET, number=number) for number in (0, 7))
    found = own.judge(first, seen(first))
    late = own.judge(again, seen(again, t_latch_us=again.t_apply_us + 50))
    assert len(judged) == 1
    assert (late.number, late.key, late.t_apply_us, late.late) == (7, again.key, 7000, True)
    same = {"number": 0, "key": first.key, "t_apply_us": 0, "t_latch_us": 0, "late": False}
    assert dataclasses.replace(late, **same) == found
    assert not own.judge(again, seen(again, drive_of(-codes(again)))).criteria["S1"]


def test_wrong_drives_without_a_focus_are_sought_in_the_whole_volume_a_limited_number_of_times(
    monkeypatch,
):
    monkeypatch.setattr(judge_module, "_MOST_SEARCHES", 3)
    rng = np.random.default_rng(1)
    model = AcousticModel.default(4, 4)
    limited = FrameJudge(model, carrier_us=25)
    intended = intend(model, TARGET)
    wrong = [
        Drive(rng.integers(0, 256, 16).astype(np.uint8), np.full(16, 255, np.uint8))
        for _ in range(5)
    ]
    found = [limited.judge(intended, seen(intended, drive)) for drive in wrong]
    assert [verdict.status for verdict in found] == [FrameStatus.WRONG_DRIVE] * 5
    assert ["not searched for" in verdict.note for verdict in found] == [False] * 3 + [True] * 2
    assert "S2" not in found[-1].criteria
    # What needs no such search is told as before: a right drive, and a focus that is elsewhere.
    assert limited.judge(intended, seen(intended)).status is FrameStatus.ON_TARGET
    away = aside(TARGET, 0.004, 0.0)
    elsewhere = limited.judge(intended, seen(intended, intend(model, away).drive))
    assert elsewhere.measured_m == pytest.approx(away, abs=1e-3)
    assert not elsewhere.criteria["S2"]
