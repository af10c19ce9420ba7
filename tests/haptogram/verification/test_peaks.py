"""S4: the pressure peak, as it is predicted and climbed to, against one found on a fine grid."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptogram.acoustics import AcousticModel, focus_phases, pressure
from haptogram.records import Focus
from haptogram.verification import criteria
from haptogram.verification.target import (
    LEAST_FRESNEL_NUMBER,
    LONGEST_SHIFT_RAD,
    PREDICTION_SHARE,
    TargetField,
    metric_length,
    peak_offset_m,
    predicted_shift_m,
)
from latched_drives import registers, working_volume

few = settings(max_examples=15)
bits_of_phases = st.sampled_from([8, 6, 5])
# Half the beam is about 2 rad wide: the grid holds the main lobe and nothing of the next.
REACH_RAD = 1.0
POINTS = 13
ROUNDS = 5  # each on a grid a quarter as wide


def grid_peak_m(model, weights, start_m, direction):
    """Offset of the loudest point along *direction*, by grids that close in on it."""
    scale_m = 1.0 / np.sqrt(np.diag(direction.metric))  # 1 rad, along each axis
    offset, reach = np.zeros(len(scale_m)), REACH_RAD
    for _ in range(ROUNDS):
        line = np.linspace(-reach, reach, POINTS)
        local = offset + scale_m * np.stack(
            np.meshgrid(*[line] * len(scale_m), indexing="ij"), axis=-1
        ).reshape(-1, len(scale_m))
        loudness = np.abs(pressure(model, weights, start_m + local @ direction.axes))
        offset, reach = local[loudness.argmax()], reach / 4.0
    return offset @ direction.axes


def apart_rad(one_m, other_m, direction):
    return metric_length(one_m - other_m, direction)


@few
@given(working_volume(), bits_of_phases)
def test_the_peak_climbed_to_is_the_loudest_point_of_a_grid(target, bits):
    model = AcousticModel.default()
    field = TargetField.of(model, Focus.at(target), bits)
    weights = registers(focus_phases(model, target), bits).weights()
    assert len(field.directions) == 2
    for direction in field.directions:
        found_m = peak_offset_m(model, weights, field.position_m, direction)
        searched_m = grid_peak_m(model, weights, field.position_m, direction)
        assert apart_rad(found_m, searched_m, direction) < 0.005


@few
@given(working_volume())
def test_the_prediction_is_within_its_share_of_the_ideal_peak(target):
    model = AcousticModel.default()
    field = TargetField.of(model, Focus.at(target), 8)
    if field.fresnel_number < LEAST_FRESNEL_NUMBER:
        return  # a steered target at the upper rim of the volume
    ideal = np.exp(1j * field.phases_rad)
    for direction in field.directions:
        shift_m = predicted_shift_m(model, field, np.ones(256), direction)
        searched_m = grid_peak_m(model, ideal, field.position_m, direction)
        tolerance = criteria.PEAK_SLACK_RAD + PREDICTION_SHARE * metric_length(shift_m, direction)
        assert apart_rad(shift_m, searched_m, direction) <= tolerance


@pytest.mark.parametrize("fresnel_number", [2.6, 2.9, 3.1, 3.5])
@pytest.mark.parametrize("side", [8, 12, 16])
@pytest.mark.parametrize("bits", [8, 5])
def test_healthy_drives_pass_on_both_sides_of_the_limit_of_the_prediction(
    fresnel_number, side, bits
):
    model = AcousticModel.default(side, side)
    half_width_m = side * 0.005
    distance_m = half_width_m**2 / (model.wavelength_m * fresnel_number)
    rng = np.random.default_rng(side)
    for _ in range(4):
        sideways = rng.uniform(-0.3, 0.3, 2)  # of the distance
        ray = np.array([*sideways, 1.0]) / math.hypot(*sideways, 1.0)
        target = distance_m * ray
        field = TargetField.of(model, Focus.at(target), bits)
        assert field.fresnel_number == pytest.approx(fresnel_number)
        weights = registers(focus_phases(model, target), bits).weights()
        errors = criteria.peak_errors(model, field, weights, np.ones(side**2), math.pi / 2**bits)
        assert len(errors) == 2
        assert all(error.ok for error in errors), errors


@few
@given(st.floats(0.09, 0.30), st.floats(-0.02, 0.02), bits_of_phases)
def test_below_the_limit_the_ideal_drive_is_the_measure(height_m, aside_m, bits):
    model = AcousticModel.default(8, 8)
    target = (aside_m, 0.004, height_m)
    field = TargetField.of(model, Focus.at(target), bits)
    assert field.fresnel_number < LEAST_FRESNEL_NUMBER
    weights = registers(focus_phases(model, target), bits).weights()
    errors = criteria.peak_errors(model, field, weights, np.ones(64), math.pi / 2**bits)
    assert all(error.ok for error in errors), errors
    # Along the beam a small array makes no peak near its target: then there is nothing to judge.
    ideal = np.exp(1j * field.phases_rad)
    shifts = [
        metric_length(peak_offset_m(model, ideal, field.position_m, d), d) for d in field.directions
    ]
    assert len(errors) == sum(shift <= LONGEST_SHIFT_RAD for shift in shifts)


def beside(field, direction, length_rad):
    """Point at that distance from the target, in the metric of the focus, along the first axis."""
    step_m = length_rad / math.sqrt(direction.metric[0, 0])
    return field.position_m + step_m * direction.axes[0]


@few
@given(working_volume(), st.sampled_from([0, 1]), st.sampled_from([-1.0, 1.0]), bits_of_phases)
def test_a_miss_of_twice_the_limit_is_seen_by_the_pressure_alone(target, which, sign, bits):
    model = AcousticModel.default()
    field = TargetField.of(model, Focus.at(target), bits)
    limit_rad = math.pi / 2**bits
    right = np.exp(1j * field.phases_rad)
    limits = [
        e.limit_rad for e in criteria.peak_errors(model, field, right, np.ones(256), limit_rad)
    ]
    missed = beside(field, field.directions[which], sign * 2.2 * limits[which])
    ideal = np.exp(1j * focus_phases(model, missed))
    error = criteria.peak_errors(model, field, ideal, np.ones(256), limit_rad)[which]
    assert not error.ok


def test_a_line_of_elements_has_no_plane_to_judge():
    model = AcousticModel.default(128, 1)
    field = TargetField.of(model, Focus.at((0.02, 0.0, 0.15)), 8)
    for direction in field.directions:
        assert np.linalg.eigvalsh(direction.metric)[0] > 0.0
    ideal = np.exp(1j * field.phases_rad)
    assert all(e.ok for e in criteria.peak_errors(model, field, ideal, np.ones(128), 0.0))


def test_the_scale_of_the_amplitudes_does_not_move_the_peak():
    model = AcousticModel.default()
    field = TargetField.of(model, Focus.at((0.02, -0.01, 0.12)), 8)
    weights = registers(focus_phases(model, field.position_m)).weights()
    full = criteria.peak_errors(model, field, weights, np.ones(256), 0.0)
    third = criteria.peak_errors(model, field, weights / 3.0, np.full(256, 1.0 / 3.0), 0.0)
    for one, other in zip(full, third, strict=True):
        assert one.error_rad == pytest.approx(other.error_rad, abs=1e-4)
        assert one.limit_rad == pytest.approx(other.limit_rad, abs=1e-4)
        assert one.offset_m == pytest.approx(other.offset_m, abs=1e-6)
