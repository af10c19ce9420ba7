"""Frames that are no plain focus: silence, other air, several foci of phases only, odd evidence."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram.acoustics import (
    AcousticModel,
    Calibration,
    Drive,
    NoFocus,
    NotSingle,
    Reconstructor,
    focus_phases,
    superpose_foci,
)
from haptogram.acoustics.model.drive import quantise_phase
from haptogram.acoustics.solvers.several import solve_foci
from haptogram.records.frame import Focus
from haptogram.verification import FrameJudge, FrameStatus, Verdict, verify_run
from haptogram.verification.frame import judge as judge_module
from haptogram.verification.frame.ideal_drive import IdealFociLevels
from latched_drives import codes, drive_of, field_of, intend, registers, seen, working_volume

MODEL = AcousticModel.default()
JUDGE = FrameJudge(MODEL, carrier_us=25)
TARGET = (0.013, -0.021, 0.11)


def judge(intended, drive=None, **changes):
    return JUDGE.judge(intended, seen(intended, drive, **changes))


# --- Silence -------------------------------------------------------------------------------------


def silent_frame():
    return intend(MODEL, TARGET, foci=(Focus.at(TARGET, 0.0),), drive=Drive.muted(256))


def test_silence_that_was_intended_is_right():
    found = judge(silent_frame())
    assert (found.status, found.faults) == (FrameStatus.ON_TARGET, ())
    assert (found.criteria, found.note) == ({"S5": True}, "silence was intended")


def test_the_phases_of_silence_do_not_matter():
    found = judge(silent_frame(), drive_of(np.arange(256), 0))
    assert (found.status, found.faults) == (FrameStatus.ON_TARGET, ())


def test_sound_where_silence_was_intended_is_a_wrong_drive():
    found = judge(silent_frame(), registers(focus_phases(MODEL, TARGET)))
    assert found.status is FrameStatus.WRONG_DRIVE
    assert found.faults[0] == "amplitude of 256 elements off, by up to +255/255"


@pytest.mark.parametrize("reason", ["muted", "zero amplitude"])
def test_a_right_drive_that_was_not_radiated_is_wrong(reason):
    found = judge(intend(MODEL, TARGET), reconstruction=NoFocus(reason))
    assert found.status is FrameStatus.WRONG_DRIVE
    assert found.faults == (f"the drive is right, but nothing was radiated: {reason}",)


@pytest.mark.parametrize("reason", ["muted", "zero amplitude"])
def test_several_foci_that_were_not_radiated_are_a_wrong_drive(reason):
    found = judge(solved(RING), reconstruction=NoFocus(reason))
    assert found.status is FrameStatus.WRONG_DRIVE
    assert found.faults == (f"the drive is right, but nothing was radiated: {reason}",)


def test_sound_that_somebody_found_where_silence_was_intended_is_wrong():
    heard = Reconstructor(MODEL).reconstruct(registers(focus_phases(MODEL, TARGET)))
    found = judge(silent_frame(), reconstruction=heard)
    assert found.status is FrameStatus.WRONG_DRIVE
    assert found.faults == ("sound was radiated where silence was intended",)


@pytest.mark.parametrize(("code", "faults"), [(0, 0), (1, 1)])
def test_sound_whose_field_nobody_found_is_heard_where_the_board_computes_silence(code, faults):
    """Its arithmetic may miss an amplitude by one code, but not make sound of silence."""
    silence = dataclasses.replace(silent_frame(), board_computed=True)
    found = judge(silence, drive_of(np.zeros(256), code), reconstruction=None)
    assert found.faults == ("sound was radiated where silence was intended",) * faults


@pytest.mark.parametrize("count", [1, 2])
def test_elements_that_the_calibration_calls_dead_are_not_verified(count):
    gain = np.ones(256)
    gain[:128] = 0.0
    elements = Calibration(gain, np.zeros(256), MODEL.array.positions_m)
    points = [TARGET, (-0.02, 0.01, 0.1)][:count]
    drive = Drive.from_weights(
        np.where(
            gain == 0.0, superpose_foci(MODEL, points, [1.0 / count] * count, [0.0] * count), 0.0
        )
    )
    foci = tuple(Focus.at(point, 1.0 / count) for point in points)
    intended = intend(MODEL, TARGET, foci=foci, drive=drive)
    found = FrameJudge(MODEL.calibrated(elements), carrier_us=25).judge(intended, seen(intended))
    assert found.status is FrameStatus.NOT_VERIFIED
    assert "gain of 0" in found.note


def test_what_does_not_fit_the_array_is_not_verified():
    small = Drive.from_weights(np.ones(64))
    found = judge(intend(MODEL, TARGET), radiated=small)
    assert found.status is FrameStatus.NOT_VERIFIED
    assert "64 elements" in found.note
    alien = NotSingle(0.5, (0.0, 0.0, 0.1), 100.0, 0.5, (999,))
    found = judge(intend(MODEL, TARGET), reconstruction=alien)
    assert found.status is FrameStatus.NOT_VERIFIED
    assert "element 999" in found.note


def test_a_focus_of_no_amplitude_among_others_needs_no_place():
    points = [TARGET, (-0.03, 0.015, 0.1), (0.0, 0.03, 0.12)]
    levels = [0.5, 0.5, 0.0]
    drive = Drive.from_weights(superpose_foci(MODEL, points, levels, [0.0] * 3))
    foci = tuple(Focus.at(point, level) for point, level in zip(points, levels, strict=True))
    found = judge(intend(MODEL, TARGET, foci=foci, drive=drive))
    assert found.status is FrameStatus.ON_TARGET, found


def test_a_board_that_computes_may_round_a_faint_element_to_nothing():
    points = [TARGET, (-0.03, 0.015, 0.1)]
    drive = Drive.from_weights(superpose_foci(MODEL, points, [0.5, 0.5], [0.0, 0.0]))
    faint = drive.amplitude_codes.copy()
    faint[7] = 1
    foci = tuple(Focus.at(point, 0.5) for point in points)
    intended = intend(
        MODEL, TARGET, foci=foci, drive=Drive(drive.phase_codes, faint), board_computed=True
    )
    dark = faint.copy()
    dark[7] = 0
    found = judge(intended, Drive(drive.phase_codes, dark))
    assert found.faults == ()


# --- Other air -----------------------------------------------------------------------------------


@pytest.mark.sampled(5)
@pytest.mark.parametrize(("host_c", "board_c", "sign"), [(20, 25, -1.0), (25, 20, 1.0)])
@pytest.mark.parametrize("height_m", [0.05, 0.1, 0.15, 0.2, 0.25])
@pytest.mark.parametrize("bits", [8, 6])
def test_warmer_air_over_the_board_draws_the_focus_toward_it(host_c, board_c, sign, height_m, bits):
    # The host delays by k r of cold air; in warm air k is less, and the same delays bend more.
    host = AcousticModel.default(temperature_c=host_c)
    board = AcousticModel.default(temperature_c=board_c)
    intended = intend(host, (0.0, 0.0, height_m), bits)
    found = FrameJudge(board, carrier_us=25).judge(intended, seen(intended))
    assert (found.status, found.faults) == (FrameStatus.OFF_TARGET, ())
    assert not found.criteria["S1"]
    assert 0.5 < sign * found.axial_error_mm < 3.0
    assert found.lateral_error_mm < 0.01  # on the axis by symmetry
    assert found.pressure_rms_pa > 1000.0


def test_other_air_fails_a_run_with_its_error_in_mm():
    host, board = AcousticModel.default(temperature_c=20), AcousticModel.default(temperature_c=25)
    intended = [intend(host, (0.0, 0.0, 0.1 + 0.01 * n), number=n) for n in range(4)]
    run = verify_run(intended, [seen(frame) for frame in intended], model=board)
    assert (run.verdict, run.reasons) == (Verdict.FAIL, ("4 frames off target",))
    assert 1.0 < run.as_dict()["axial_error_mm"]["p50"] < 2.0
    assert "-1.4" in str(run)


# --- Misses --------------------------------------------------------------------------------------


@given(
    working_volume(),
    st.floats(2.01, 40.0),
    st.floats(0.0, 2.0 * math.pi),
    st.floats(-1.0, 1.0),
    st.sampled_from([8, 6, 5]),
)
def test_a_miss_beyond_the_smallest_is_never_on_target(target, factor, angle, height, bits):
    intended = intend(MODEL, target, bits)
    smallest_m = judge(intended).smallest_miss_mm / 1e3
    level = math.sqrt(1.0 - height**2)
    way = np.array([level * math.cos(angle), level * math.sin(angle), height])
    # The missed focus is itself rounded, so that it may come out nearer by as much again.
    missed = np.add(target, min(factor * smallest_m, 0.02) * way)
    found = judge(intended, registers(focus_phases(MODEL, missed), bits))
    assert found.status in (FrameStatus.OFF_TARGET, FrameStatus.WRONG_DRIVE)


# --- The board's arithmetic ----------------------------------------------------------------------


@given(working_volume(), st.integers(0, 2**32 - 1), st.sampled_from([1.0, 0.5, 0.1]))
def test_a_board_that_computes_may_round_amplitudes_its_own_way(target, seed, level):
    weights = level * np.exp(1j * focus_phases(MODEL, target))
    drive = Drive.from_weights(weights)
    foci = (Focus.at(target, level),)
    intended = intend(MODEL, target, foci=foci, drive=drive, board_computed=True)
    rng = np.random.default_rng(seed)
    for steps in (rng.integers(-1, 2, 256), np.full(256, -1)):
        amplitudes = np.clip(drive.amplitude_codes.astype(int) + steps, 0, 255)
        found = judge(intended, Drive(drive.phase_codes, amplitudes.astype(np.uint8)))
        assert (found.status, found.faults) == (FrameStatus.ON_TARGET, ()), found
    too_few = np.maximum(drive.amplitude_codes.astype(int) - 2, 0).astype(np.uint8)
    found = judge(intended, Drive(drive.phase_codes, too_few))
    assert found.status is FrameStatus.WRONG_DRIVE
    assert not found.criteria["S5"]


def test_the_bound_is_the_worst_case_of_rounding():
    # Half a step on every element, each with the sign that moves the focus most.
    offsets = np.array(TARGET) - MODEL.array.positions_m
    slopes = MODEL.wavenumber * offsets / np.linalg.norm(offsets, axis=1)[:, None]
    inverse = np.linalg.pinv(np.column_stack([slopes, -np.ones(256)]))[:3]
    for bits in (8, 6, 5):
        worst_mm = 1e3 * np.abs(inverse).sum(axis=1) * math.pi / 2**bits
        found = judge(intend(MODEL, TARGET, bits))
        assert 0.9999 < min(found.bound_mm / worst_mm) <= max(found.bound_mm / worst_mm) < 1.05
        assert found.smallest_miss_mm == pytest.approx(np.linalg.norm(found.bound_mm), rel=1e-9)


def test_the_bound_that_is_reported_holds_the_allowance():
    host = judge(intend(MODEL, TARGET))
    board = judge(intend(MODEL, TARGET, board_computed=True))
    # Half a step of rounding, and a whole step more.
    assert board.bound_mm == pytest.approx(tuple(3.0 * side for side in host.bound_mm), rel=1e-6)
    assert board.smallest_miss_mm == pytest.approx(3.0 * host.smallest_miss_mm, rel=1e-6)


# --- Several foci --------------------------------------------------------------------------------


@given(working_volume(), st.floats(-math.pi, math.pi), st.sampled_from([8, 6, 5]))
def test_several_foci_of_phases_only_are_judged_at_full_amplitude(target, phase_rad, bits):
    points = [target, (-0.03, 0.015, 0.1)]
    foci = (Focus.at(points[0], 0.5), Focus.at(points[1], 0.5, phase_rad))
    weights = superpose_foci(MODEL, points, [0.5, 0.5], [0.0, phase_rad])
    drive = registers(np.angle(weights), bits)
    intended = intend(MODEL, target, bits, foci=foci, drive=drive)
    found = judge(intended)
    assert found.status is FrameStatus.ON_TARGET, found
    assert found.criteria == {"S1": True, "S2": True, "S3": True, "S5": True}
    wrong = judge(intended, drive_of(-codes(intended)))
    assert wrong.status is FrameStatus.WRONG_DRIVE
    assert wrong.faults == ("opposite sign of all phases",)


def test_several_foci_in_other_air_are_off_target():
    board = AcousticModel.default(temperature_c=40.0)
    points = [TARGET, (-0.03, 0.015, 0.1)]
    drive = Drive.from_weights(superpose_foci(MODEL, points, [0.5, 0.5], [0.0, 0.0]))
    foci = tuple(Focus.at(point, 0.5) for point in points)
    intended = intend(MODEL, TARGET, foci=foci, drive=drive)
    found = FrameJudge(board, carrier_us=25).judge(intended, seen(intended))
    assert (found.status, found.faults) == (FrameStatus.OFF_TARGET, ())


RING = [(0.03 * math.cos(turn), 0.03 * math.sin(turn), 0.12) for turn in np.arange(4) * math.pi / 2]


def solved(points, *, drive_for=None, **changes):
    """Intend foci on *points*, with the drive of a solver for them or for others."""
    weights = solve_foci(MODEL, points if drive_for is None else drive_for, method="wgs")
    foci = tuple(Focus.at(point) for point in points)
    drive = Drive.from_weights(weights)
    return intend(MODEL, points[0], foci=foci, drive=drive, solver="wgs", **changes)


def test_every_focus_of_a_solver_is_there():
    found = judge(solved(RING))
    assert found.status is FrameStatus.ON_TARGET
    assert found.criteria == {"S1": True, "S2": True, "S3": True, "S5": True}
    assert "4 foci" in found.note
    assert found.lateral_error_mm <= found.smallest_miss_mm
    assert 0.0 < found.smallest_miss_mm < 1.0


@pytest.mark.parametrize("amplitude", [1.0, 0.1])
def test_efficiency_is_of_the_output_that_was_asked_for(amplitude):
    """Foci that are quiet on purpose are no worse for it; one that is missing is, loud or quiet."""
    weights = amplitude * solve_foci(MODEL, RING, method="wgs")
    foci = tuple(Focus.at(point, amplitude) for point in RING)
    intended = intend(MODEL, RING[0], foci=foci, drive=Drive.from_weights(weights), solver="wgs")
    targets = [field_of(MODEL, focus.position_m) for focus in foci]
    right = IdealFociLevels.of(intended, weights, targets)
    assert right.made
    assert right.efficiency == pytest.approx(1.0, abs=0.15)
    alone = amplitude * solve_foci(MODEL, RING[:1], method="wgs")
    assert not IdealFociLevels.of(intended, alone, targets).made


@pytest.mark.parametrize(
    "drive_for",
    [
        RING[:3],  # one is missing
        [(x, y, z + 0.05) for x, y, z in RING],
        [(-x - 0.01, y, z) for x, y, z in RING],
    ],
)
def test_a_solver_that_served_other_foci_is_found_out(drive_for):
    found = judge(solved(RING, drive_for=drive_for))
    assert (found.status, found.faults) == (FrameStatus.OFF_TARGET, ())


def test_foci_of_a_solver_in_other_air_are_off_target():
    board = AcousticModel.default(temperature_c=40.0)
    intended = solved(RING)
    found = FrameJudge(board, carrier_us=25).judge(intended, seen(intended))
    assert (found.status, found.criteria["S3"]) == (FrameStatus.OFF_TARGET, False)


def test_phases_that_make_no_foci_never_pass_whatever_the_solver_says(monkeypatch):
    noise = np.exp(1j * np.random.default_rng(1).uniform(0.0, math.tau, MODEL.array.count))
    monkeypatch.setattr(judge_module, "frame_weights", lambda *_, **__: noise)
    foci = tuple(Focus.at(point) for point in RING)
    drive = Drive.from_weights(noise)
    intended = intend(MODEL, RING[0], foci=foci, drive=drive, solver="wgs")
    found = FrameJudge(MODEL, carrier_us=25).judge(
        intended, seen(intended)
    )  # one that remembers none
    assert found.status is FrameStatus.NOT_VERIFIED
    assert "did not make the foci" in found.note


def test_another_drive_than_the_solvers_is_wrong():
    intended = solved(RING)
    found = judge(intended, drive_of(-codes(intended)))
    assert found.status is FrameStatus.WRONG_DRIVE
    assert not found.criteria["S3"]


# --- Evidence ------------------------------------------------------------------------------------


def test_a_drive_and_a_crc_that_contradict_each_other_are_no_evidence():
    intended = intend(MODEL, TARGET)
    digest = intended.drive.digest()
    assert judge(intended, drive_crc=digest).status is FrameStatus.ON_TARGET
    found = judge(intended, drive_crc=digest ^ 1)
    assert found.status is FrameStatus.NOT_VERIFIED
    assert f"{digest:08x}, not {digest ^ 1:08x}" in found.note


def test_a_reconstruction_without_a_drive_is_not_enough():
    intended = intend(MODEL, TARGET)
    radiated = Reconstructor(MODEL).reconstruct(intended.drive)
    only = dataclasses.replace(seen(intended, reconstruction=radiated), drive=None)
    assert JUDGE.judge(intended, only).status is FrameStatus.NOT_VERIFIED


def test_the_codes_of_the_wire_are_those_of_the_program():
    # The tests round by themselves; both ways must agree for the tests to mean anything.
    phases = focus_phases(MODEL, TARGET)
    for bits in (8, 6, 5):
        ours = registers(phases, bits).phase_codes
        np.testing.assert_array_equal(ours, quantise_phase(phases, bits) << (8 - bits))
