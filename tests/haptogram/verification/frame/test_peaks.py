"""S4: the pressure peak, as it is climbed to, against one found on a fine grid; what moves it."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram.acoustics import AcousticModel, focus_phases, pressure
from haptogram.verification.frame import criteria
from haptogram.verification.frame.peaks import (
    NEXT_TO_TARGET_RAD,
    expected_frame_peak,
    find_frame_peak,
    frame_peak_response,
)
from latched_drives import field_of, registers, working_volume

bits_of_phases = st.sampled_from([8, 6, 5])
# Half the beam is about 2 rad wide: the grid holds the main lobe and nothing of the next.
REACH_RAD = 1.0
POINTS = 13
ROUNDS = 5  # each on a grid a quarter as wide


def grid_peak_m(model, weights, start_m, direction):
    """Offset (D,) of the loudest point along *direction*, by grids that close in on it."""
    scale_m = 1.0 / np.sqrt(np.diag(direction.metric))  # 1 rad, along each axis
    offset, reach = np.zeros(len(scale_m)), REACH_RAD
    for _ in range(ROUNDS):
        line = np.linspace(-reach, reach, POINTS)
        local = offset + scale_m * np.stack(
            np.meshgrid(*[line] * len(scale_m), indexing="ij"), axis=-1
        ).reshape(-1, len(scale_m))
        loudness = np.abs(pressure(model, weights, start_m + local @ direction.axes))
        offset, reach = local[loudness.argmax()], reach / 4.0
    return offset


def apart_rad(one, other, direction):
    return direction.length_rad((one - other) @ direction.axes)


@given(working_volume(), bits_of_phases)
def test_the_peak_climbed_to_is_the_loudest_point_of_a_grid(target, bits):
    model = AcousticModel.default()
    field = field_of(model, target, bits)
    weights = registers(focus_phases(model, target), bits).weights()
    directions = field.directions()
    assert [len(direction.axes) for direction in directions] == [2, 1]
    for direction in [*directions, field.direction(np.eye(3))]:
        found = find_frame_peak(model, weights, field.position_m, direction)
        searched = grid_peak_m(model, weights, field.position_m, direction)
        assert apart_rad(found, searched, direction) < 0.02


@pytest.mark.parametrize(
    ("height_m", "shift_mm"), [(0.075, -0.02), (0.1, -0.67), (0.15, -3.15), (0.2, -7.69)]
)
def test_the_peak_sits_where_diffraction_puts_it(height_m, shift_mm):
    # Published figures of the focal shift of this array.
    model = AcousticModel.default()
    field = field_of(model, (0.0, 0.0, height_m))
    _, along = field.directions()
    found = find_frame_peak(model, np.exp(1j * field.phases_rad), field.position_m, along)
    assert 1e3 * found[0] == pytest.approx(shift_mm, abs=0.2)


@pytest.mark.sampled(8)
@pytest.mark.parametrize("side", [8, 12, 16])
@pytest.mark.parametrize("fresnel_number", [1.0, 2.0, 3.0, 5.0])
@pytest.mark.parametrize("bits", [8, 5])
def test_the_peak_of_a_right_drive_is_where_rounding_lets_it_be(fresnel_number, side, bits):
    model = AcousticModel.default(side, side)
    distance_m = (side * 0.005) ** 2 / (model.wavelength_m * fresnel_number)
    rng = np.random.default_rng(side)
    for _ in range(4):
        sideways = rng.uniform(-0.3, 0.3, 2)  # of the distance
        target = distance_m * np.array([*sideways, 1.0]) / math.hypot(*sideways, 1.0)
        field = field_of(model, target, bits)
        weights = registers(focus_phases(model, target), bits).weights()
        offsets_m = criteria.peak_offsets_m(model, field.peaks, weights)
        assert len(offsets_m) == 2 or fresnel_number < 3.0
        assert criteria.are_peaks_in_place(field.peaks, offsets_m), offsets_m


def test_the_peak_of_a_small_array_far_below_its_target_is_found():
    # 8 x 8 at 250 mm: an ascent without a line search cycled and came out at -217.6 mm.
    model = AcousticModel.default(8, 8).with_sound_speed(343.2)
    field = field_of(model, (0.0, 0.0, 0.25))
    _, along = field.peaks
    offset_m = along.place_m - field.position_m
    assert 1e3 * offset_m == pytest.approx((0.0, 0.0, -98.15), abs=0.02)
    assert along.direction.length_rad(offset_m) == pytest.approx(0.361, abs=0.001)
    line = field.position_m + np.linspace(-0.23, 0.05, 2801)[:, None] * along.direction.axes
    loudest = np.abs(pressure(model, np.exp(1j * field.phases_rad), line)).argmax()
    assert line[loudest] == pytest.approx(along.place_m, abs=1e-4)


@given(working_volume(), st.integers(0, 2**32 - 1))
def test_the_response_is_that_of_the_peak_to_small_errors_of_the_phases(target, seed):
    model = AcousticModel.default()
    field = field_of(model, target)
    ideal = np.exp(1j * field.phases_rad)
    errors_rad = 0.01 * np.random.default_rng(seed).standard_normal(256)
    for peak in field.peaks:
        found = peak.offset_m(model, ideal * np.exp(1j * errors_rad))
        expected = peak.response @ errors_rad
        assert found == pytest.approx(expected, abs=0.05 * float(np.abs(expected).max()) + 4e-6)


def test_a_phase_that_all_share_moves_no_peak():
    model = AcousticModel.default()
    field = field_of(model, (0.02, -0.01, 0.12))
    for peak in field.peaks:
        assert np.abs(peak.response.sum(axis=1)).max() < 1e-9 * np.abs(peak.response).max() * 256
        turned = np.exp(1j * (field.phases_rad + 1.2))
        assert np.linalg.norm(peak.offset_m(model, turned)) < 3e-6


@given(working_volume(), st.sampled_from([0, 1]), bits_of_phases)
def test_the_worst_rounding_stays_within_the_limit_and_reaches_it(target, which, bits):
    model = AcousticModel.default()
    field = field_of(model, target, bits)
    if which >= len(field.peaks):
        return
    peak = field.peaks[which]
    ideal = np.exp(1j * field.phases_rad)
    for axis, row in enumerate(peak.response):
        worst = ideal * np.exp(1j * math.pi / 2**bits * np.sign(row))
        moved = abs(peak.offset_m(model, worst)[axis])
        assert moved <= peak.rounding_m[axis]
        assert moved >= 0.7 * peak.rounding_m[axis] - 8e-6


@given(working_volume(), st.sampled_from([0, 1]), st.sampled_from([-1.0, 1.0]), bits_of_phases)
def test_a_miss_of_twice_the_limit_is_seen_by_the_pressure_alone(target, which, sign, bits):
    model = AcousticModel.default()
    field = field_of(model, target, bits)
    if which >= len(field.peaks):
        return
    peak = field.peaks[which]
    missed = field.position_m + sign * 2.2 * peak.rounding_m[0] * peak.direction.axes[0]
    ideal = np.exp(1j * focus_phases(model, missed))
    offsets_m = criteria.peak_offsets_m(model, [peak], ideal)
    assert not criteria.are_peaks_in_place([peak], offsets_m)


def test_there_is_no_peak_behind_the_array_at_an_element_or_in_silence():
    # A middle element under the target, and an ascent that leads to it.
    model = AcousticModel.default(5, 5)
    field = field_of(model, (0.0, 0.0, 0.1))
    _, along = field.directions()
    only_middle = np.zeros(25, dtype=complex)
    only_middle[12] = 1.0
    assert find_frame_peak(model, only_middle, field.position_m, along) is None
    assert find_frame_peak(model, np.zeros(25, dtype=complex), field.position_m, along) is None
    assert expected_frame_peak(model, only_middle, field.position_m, along, 0.01) is None
    assert frame_peak_response(model, np.zeros(25, dtype=complex), field.position_m, along) is None


@pytest.mark.parametrize("shape", [(5, 5), (3, 5), (5, 7), (7, 7), (6, 6), (1, 7), (20, 3)])
def test_what_is_expected_is_next_to_the_target(shape):
    model = AcousticModel.default(*shape)
    rng = np.random.default_rng(shape[0])
    for _ in range(20):
        field = field_of(model, rng.uniform((-0.04, -0.04, 0.06), (0.04, 0.04, 0.3)), 6)
        for peak in field.peaks:
            offset_m = peak.place_m - field.position_m
            assert peak.direction.length_rad(offset_m) <= NEXT_TO_TARGET_RAD


def test_the_scale_of_the_amplitudes_does_not_move_the_peak():
    model = AcousticModel.default()
    full = field_of(model, (0.02, -0.01, 0.12))
    third = field_of(model, (0.02, -0.01, 0.12), amplitudes=1.0 / 3.0)
    weights = registers(focus_phases(model, full.position_m)).weights()
    louder_m = criteria.peak_offsets_m(model, full.peaks, weights)
    fainter_m = criteria.peak_offsets_m(model, third.peaks, weights / 3.0)
    for one, other in zip(louder_m, fainter_m, strict=True):
        assert one == pytest.approx(other, abs=1e-6)
    assert criteria.are_peaks_in_place(full.peaks, louder_m)
    assert criteria.are_peaks_in_place(third.peaks, fainter_m)
