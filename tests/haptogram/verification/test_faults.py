"""Negative controls: every wrong drive is reported by its name, and only where it is wrong."""

import dataclasses
import math
import re

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from haptogram.acoustics import AcousticModel, Drive, TransducerArray, focus_phases
from haptogram.acoustics.model.transducer import Transducer
from haptogram.verification import FrameJudge, FrameStatus, name_drive_faults
from latched_drives import codes, drive_of, intend, registers, seen, working_volume

pytestmark = pytest.mark.sampled(6)

MODEL = AcousticModel.default()
TARGET_M = (0.013, -0.021, 0.11)
JUDGE = FrameJudge(MODEL, carrier_us=25)
ELEMENTS = st.integers(0, 255)
NAMED_BY_CRC = re.compile(
    r"opposite sign|x and y|. mirrored|elements rolled|elements .* swapped|element \d|packed|bits"
)


def verdict(intended, drive):
    return JUDGE.judge(intended, seen(intended, drive))


def assert_wrong(intended, drive, *names):
    """See a drive judged wrong by its codes; and by its CRC alone, where that names it."""
    found = verdict(intended, drive)
    assert (found.status, found.faults) == (FrameStatus.WRONG_DRIVE, names)
    if len(names) == 1 and NAMED_BY_CRC.match(names[0]):
        crc = dataclasses.replace(seen(intended), drive=None, drive_crc=drive.digest())
        by_crc = JUDGE.judge(intended, crc)
        assert (by_crc.status, by_crc.faults) == (found.status, found.faults)


def assert_right(intended, drive):
    found = verdict(intended, drive)
    assert (found.status, found.faults) == (FrameStatus.ON_TARGET, ())


@given(working_volume())
def test_wrong_sign(target):
    intended = intend(MODEL, target)
    assert_wrong(intended, drive_of(-codes(intended)), "opposite sign of all phases")


@given(working_volume(off_diagonal=0.002))
def test_transposed(target):
    intended = intend(MODEL, target)
    assert_wrong(intended, drive_of(codes(intended).T), "x and y exchanged (transposed)")


@given(working_volume(off_x=0.002))
def test_mirrored_x(target):
    # At y = -x (or y = x) the transposed drive is another; nothing simpler equals a mirrored one.
    intended = intend(MODEL, target)
    assert_wrong(intended, drive_of(codes(intended)[::-1]), "x mirrored")


@given(working_volume(off_x=0.002, off_y=0.002))
def test_mirrored_y(target):
    intended = intend(MODEL, target)
    assert_wrong(intended, drive_of(codes(intended)[:, ::-1]), "y mirrored")


@given(working_volume(), st.integers(-127, 128).filter(bool))
def test_rolled(target, shift):
    intended = intend(MODEL, target)
    rolled = np.roll(codes(intended).ravel(), shift)
    assert_wrong(intended, drive_of(rolled), f"elements rolled by {shift:+d}")


@given(working_volume(), ELEMENTS, ELEMENTS)
def test_a_swapped_pair(target, first, second):
    intended = intend(MODEL, target)
    found = codes(intended).ravel()
    distance = abs((found[first] - found[second] + 128) % 256 - 128)
    # Where the two phases differ by less than two steps lie the planes of symmetry of this fault.
    assume(distance >= 2)
    found[[first, second]] = found[[second, first]]
    low, high = sorted((first, second))
    name = f"elements {low} ({low // 16}, {low % 16}), {high} ({high // 16}, {high % 16}) swapped"
    assert_wrong(intended, drive_of(found), name)


@given(working_volume(), ELEMENTS)
def test_one_dead(target, element):
    intended = intend(MODEL, target)
    amplitudes = np.full(256, 255)
    amplitudes[element] = 0
    drive = Drive(intended.drive.phase_codes, amplitudes)
    assert_wrong(intended, drive, f"element {element} ({element // 16}, {element % 16}) dead")


@given(working_volume(), ELEMENTS)
def test_one_inverted(target, element):
    intended = intend(MODEL, target)
    found = codes(intended).ravel()
    found[element] += 128
    name = f"element {element} ({element // 16}, {element % 16}) inverted"
    assert_wrong(intended, drive_of(found), name)


@given(working_volume(), ELEMENTS, st.sampled_from([-2, 2]), st.sampled_from([8, 6, 5]))
def test_one_off_by_2_lsb(target, element, steps, bits):
    intended = intend(MODEL, target, bits)
    found = codes(intended).ravel()
    found[element] += steps * 2 ** (8 - bits)
    name = f"element {element} ({element // 16}, {element % 16}) off by {steps:+d} LSB"
    assert_wrong(intended, drive_of(found), name)


@given(working_volume(), ELEMENTS)
def test_one_off_by_1_lsb_is_never_passed(target, element):
    # The field may not show it, but it is not what was sent.
    intended = intend(MODEL, target)
    found = codes(intended).ravel()
    found[element] += 1
    found_verdict = verdict(intended, drive_of(found))
    assert found_verdict.status in (FrameStatus.CORRUPT, FrameStatus.WRONG_DRIVE)
    assert found_verdict.faults[0].endswith("off by +1 LSB")


@given(working_volume(), st.sampled_from([8, 6, 5]))
def test_a_right_drive_is_on_target(target, bits):
    intended = intend(MODEL, target, bits)
    found = verdict(intended, intended.drive)
    assert (found.status, found.faults) == (FrameStatus.ON_TARGET, ())
    assert found.criteria == dict.fromkeys(("S1", "S2", "S3", "S4", "S5"), True)


@given(working_volume(), st.sampled_from([8, 6, 5]))
def test_mistakes_are_invisible_on_their_planes_of_symmetry(target, bits):
    x, y, z = target
    on_x, on_y = intend(MODEL, (0.0, y, z), bits), intend(MODEL, (x, 0.0, z), bits)
    diagonal, axis = intend(MODEL, (x, x, z), bits), intend(MODEL, (0.0, 0.0, z), bits)
    assert_right(on_x, drive_of(codes(on_x)[::-1]))
    assert_right(on_y, drive_of(codes(on_y)[:, ::-1]))
    assert_right(diagonal, drive_of(codes(diagonal).T))
    assert_right(axis, drive_of(np.rot90(codes(axis))))
    grid = codes(on_x)
    grid[[0, 15]] = grid[[15, 0]]  # pairs of equal distance
    assert_right(on_x, drive_of(grid))


@given(working_volume(), st.integers(1, 255))
def test_a_phase_that_all_share_is_named_but_moves_nothing(target, steps):
    intended = intend(MODEL, target)
    found = verdict(intended, drive_of(codes(intended) + steps))
    signed = (steps + 128) % 256 - 128
    assert found.faults == (f"all phases off by {signed:+d} LSB, the focus is not",)
    assert (found.status, all(found.criteria.values())) == (FrameStatus.CORRUPT, True)


@pytest.mark.parametrize("bits", [8, 6, 5])
def test_rounded_down(bits):
    target = (0.013, -0.021, 0.11)
    intended = intend(MODEL, target, bits)
    turns = focus_phases(MODEL, target) / (2.0 * math.pi)
    down = np.floor(turns * 2**bits).astype(int) * 2 ** (8 - bits)
    found = verdict(intended, drive_of(down))
    assert found.faults == ("phases rounded down instead of to the nearest code",)
    assert found.status is not FrameStatus.ON_TARGET


@pytest.mark.parametrize(("axis", "name"), [(0, "column"), (1, "row")])
def test_a_line_of_the_grid_that_is_stuck_or_dead(axis, name):
    intended = intend(MODEL, (0.013, -0.021, 0.11))
    grid = codes(intended)
    np.moveaxis(grid, axis, 0)[3] = 77
    assert_wrong(intended, drive_of(grid), f"{name} 3 stuck at phase 77")
    amplitudes = np.full((16, 16), 255)
    np.moveaxis(amplitudes, axis, 0)[3] = 0
    drive = Drive(intended.drive.phase_codes, amplitudes.ravel())
    assert_wrong(intended, drive, f"{name} 3 dead")


def test_two_mistakes_at_once():
    intended = intend(MODEL, (0.013, -0.021, 0.11))
    assert_wrong(
        intended, drive_of(-codes(intended).T), "x and y exchanged (transposed), and opposite sign"
    )
    rolled = np.roll(-codes(intended).ravel(), 5)
    assert_wrong(intended, drive_of(rolled), "elements rolled by +5, and opposite sign")


def test_a_dead_element_beside_a_wrong_one():
    intended = intend(MODEL, (0.013, -0.021, 0.11))
    found, amplitudes = codes(intended).ravel(), np.full(256, 255)
    found[17] += 128
    amplitudes[40] = 0
    drive = Drive(found.astype(np.uint8), amplitudes)
    assert_wrong(intended, drive, "element 40 (2, 8) dead", "element 17 (1, 1) inverted")


def test_another_focus_is_no_wrong_drive_but_off_target():
    intended = intend(MODEL, (0.013, -0.021, 0.11))
    found = verdict(intended, registers(focus_phases(MODEL, (0.014, -0.021, 0.11))))
    assert found.status is FrameStatus.OFF_TARGET
    assert found.lateral_error_mm == pytest.approx(1.0, abs=0.1)


def test_noise_has_no_name():
    intended = intend(MODEL, (0.013, -0.021, 0.11))
    drive = drive_of(np.random.default_rng(1).integers(0, 256, 256))
    assert_wrong(intended, drive, "most phases are not those intended")


def test_silence():
    intended = intend(MODEL, (0.013, -0.021, 0.11))
    assert_wrong(intended, drive_of(codes(intended), 0), "the whole array is silent")


def test_amplitudes():
    intended = intend(MODEL, (0.013, -0.021, 0.11))
    assert_wrong(
        intended, drive_of(codes(intended), 200), "amplitude of 256 elements off, by up to -55/255"
    )


def test_an_array_without_a_grid_has_numbers_only():
    positions = np.random.default_rng(2).uniform(-0.08, 0.08, (60, 3)) * (1.0, 1.0, 0.0)
    array = TransducerArray.from_positions(positions)
    model = AcousticModel(array, MODEL.medium, Transducer())
    intended = intend(model, (0.013, -0.021, 0.11))
    found = intended.drive.phase_codes.astype(int)
    found[17] += 128
    assert name_drive_faults(model, intended, drive_of(found)) == ("element 17 inverted",)
    found = np.roll(intended.drive.phase_codes.astype(int), -3)
    assert name_drive_faults(model, intended, drive_of(found)) == ("elements rolled by -3",)


def test_many_wrong_elements_are_counted_rather_than_listed():
    intended = intend(MODEL, (0.013, -0.021, 0.11))
    found = codes(intended).ravel()
    found[5:185:20] += 128  # nine
    assert_wrong(intended, drive_of(found), "9 elements inverted")
    found = codes(intended).ravel()
    found[5:185:20] += np.arange(20, 29)  # nine, each in its own way
    assert_wrong(intended, drive_of(found), "9 elements off, by up to +28 LSB")
    amplitudes = np.full(256, 255)
    amplitudes[5:185:20] = 0
    assert_wrong(intended, Drive(intended.drive.phase_codes, amplitudes), "9 elements dead")


def test_lines_are_named_as_lines_and_a_group_hides_no_element():
    intended = intend(MODEL, (0.013, -0.021, 0.11))
    found = codes(intended).reshape(16, 16)
    found[[0, 8]] += 128
    names = name_drive_faults(MODEL, intended, drive_of(found.ravel()))
    assert names == ("column 0 inverted", "column 8 inverted")
    found = codes(intended).ravel()
    found[3::16][::2] += 1
    found[3::16][1::2] -= 1
    found[200] += 50
    names = name_drive_faults(MODEL, intended, drive_of(found))
    assert [name.partition(":")[0] for name in names] == [
        "elements n mod 32 = 3 (8 of 256)",
        "elements n mod 32 = 19 (8 of 256)",
        "element 200 (12, 8) off by +50 LSB",
    ]


def test_an_error_that_is_no_whole_step_of_the_wire_is_given_in_turns():
    intended = intend(MODEL, (0.013, -0.021, 0.11), 6)
    found = codes(intended).ravel()
    found[17] += 6
    assert_wrong(intended, drive_of(found), "element 17 (1, 1) off by +6/256 of a turn")


def test_dead_and_stuck_elements_of_an_array_without_a_grid():
    positions = np.random.default_rng(2).uniform(-0.08, 0.08, (60, 3)) * (1.0, 1.0, 0.0)
    model = AcousticModel(TransducerArray.from_positions(positions), MODEL.medium, Transducer())
    intended = intend(model, (0.013, -0.021, 0.11))
    amplitudes = np.full(60, 255)
    amplitudes[[3, 4]] = 0
    found = Drive(intended.drive.phase_codes, amplitudes)
    assert name_drive_faults(model, intended, found) == ("elements 3, 4 dead",)
    stuck = drive_of(np.full(60, 77))
    assert name_drive_faults(model, intended, stuck) == ("60 elements stuck at phase 77",)


def spiral():
    n = np.arange(120)
    turn, far = n * 2.39996, 0.006 * np.sqrt(n + 0.5)
    places = np.column_stack([far * np.cos(turn), far * np.sin(turn), np.zeros(120)])
    return AcousticModel(TransducerArray.from_positions(places), MODEL.medium, Transducer())


def off_in_order(found, _):
    found[:] = found[::-1].copy()


def off_in_low_bits(found, _):
    found[:] = found >> 5 << 5


def off_by_copies(found, _):
    found[1::2] = found[::2]


def off_by_units(found, _):
    found[len(found) // 2 :] += 50


def off_before_rounding(found, _):
    late = found[len(found) // 2 :]
    late += 32 + (np.arange(len(late)) % 3 > 0)


def off_by_chips(found, _):
    found[16:48] += 30
    found[64:80] += 9


def off_by_one_code(found, _):
    found[10:70] = 33


def off_by_a_twin(found, places):
    found[places[:, 0] * 0.8 + places[:, 1] * 0.6 > 0.0] += 128


def off_in_bit_order(found, _):
    found[:] = [int(f"{code:08b}"[::-1], 2) for code in found]


def off_by_a_vortex(found, places):
    found += np.rint(-256 * np.arctan2(places[:, 1], places[:, 0]) / math.tau).astype(int)


def off_by_a_vortex_around_the_focus(found, places):
    off_by_a_vortex(found, places - [*TARGET_M[:2], 0.0])


@pytest.mark.parametrize("model", [MODEL, spiral()], ids=["grid", "spiral"])
@pytest.mark.parametrize(
    ("fault", "grid_name", "name"),
    [
        (
            off_in_order,
            "x and y mirrored (turned by 180 degrees)",
            "order of the elements reversed",
        ),
        (off_in_low_bits, None, "lowest 5 bits of every phase lost"),
        (off_in_bit_order, None, "bits of every phase in reverse order"),
        (off_by_copies, None, "every second element has the phase of the one before it"),
        (off_by_units, "elements 128 to 255 off by +50 LSB", "elements 60 to 119 off by +50 LSB"),
        (
            off_before_rounding,
            "elements 128 to 255 off by +33 LSB",
            "elements 60 to 119 off by +33 LSB",
        ),
        (off_by_chips, "column 1 off by +30 LSB", "elements 64 to 79 off by +9 LSB"),
        (off_by_one_code, None, "stuck at phase 33"),
        (off_by_a_twin, None, "twin in place of a focus"),
        (off_by_a_vortex, None, "vortex of charge -1 in place of a focus"),
        (off_by_a_vortex_around_the_focus, None, "vortex of charge -1 in place of a focus"),
    ],
)
def test_what_is_wrong_with_much_of_an_array_has_a_name(model, fault, grid_name, name):
    intended = intend(model, TARGET_M)
    found = codes(intended).ravel() if model is MODEL else intended.drive.phase_codes.astype(int)
    fault(found, model.array.positions_m)
    faults = "; ".join(name_drive_faults(model, intended, drive_of(found)))
    assert (name if model is not MODEL or grid_name is None else grid_name) in faults
