"""Focal shift, spot size and grating lobes of a 16 x 16 array."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram.acoustics import (
    AcousticModel,
    Calibration,
    CircularPiston,
    Medium,
    NumpyEngine,
    PointSource,
    RectangularPiston,
    Transducer,
    TransducerArray,
    focus_phases,
    pressure,
)
from haptogram.acoustics.levels.lobes import largest_secondary_lobe
from haptogram.acoustics.levels.shift import (
    find_pressure_peak,
    predict_focal_shift,
)
from haptogram.acoustics.levels.spot import measure_spot
from haptogram.acoustics.model.boards.table import LAYOUTS
from haptogram.errors import ConfigurationError
from strategies_acoustics import hemisphere_targets, targets

MODEL = AcousticModel.default()
#: Of which the printed figures are.
AIR_M_S = 343.2
ENGINE = NumpyEngine(MODEL)


def focus(model, target):
    return np.exp(1j * focus_phases(model, target))


def peak(model, target):
    return find_pressure_peak(NumpyEngine(model), focus(model, target), target)


# On the axis, in mm: 1/r only, 1/r and directivity.
AXIAL_SHIFTS = [
    (0.050, -0.82, 0.35),
    (0.075, -1.35, -0.02),
    (0.100, -2.17, -0.67),
    (0.150, -4.97, -3.15),
    (0.200, -9.73, -7.69),
    (0.250, -16.8, -14.7),
    (0.300, -26.4, -24.4),
    (0.400, -53.6, -52.4),
]


@pytest.mark.parametrize(("z", "plain", "shift"), AXIAL_SHIFTS)
def test_the_maximum_on_the_axis_is_where_it_was_found_before(z, plain, shift):
    target = np.array([0.0, 0.0, z])
    own = MODEL.with_sound_speed(AIR_M_S)
    omni = AcousticModel(MODEL.array, Medium(AIR_M_S, 1.204), Transducer(PointSource()))
    for model, expected in ((own, shift), (omni, plain)):
        found = peak(model, target) - target
        assert found[2] * 1e3 == pytest.approx(expected, abs=0.01 + 0.0025 * abs(expected))
        assert np.abs(found[:2]).max() < 1e-9


@pytest.mark.parametrize(("z", "shift"), [(0.1, -0.50), (0.2, -6.4)])
def test_a_wider_array_is_pulled_in_less(z, shift):
    model = AcousticModel.default(pitch_m=0.0105).with_sound_speed(AIR_M_S)
    found = peak(model, np.array([0.0, 0.0, z]))[2] - z
    assert found * 1e3 == pytest.approx(shift, abs=0.012)


@given(st.one_of(hemisphere_targets(), targets(low=0.100, high=0.200)))
def test_the_prediction_bounds_the_shift(target):
    """Never below the shift, at most 6, 9 and 17 % above; and the gain is never above its own."""
    predicted, found = predict_focal_shift(MODEL, target), peak(MODEL, target) - target
    limit = 0.1e-3 if target[2] < 0.1 else 0.5e-3 if target[2] < 0.15 else 2.7e-3
    assert np.linalg.norm(predicted.offset_m - found) < limit
    excess = 1.06 if target[2] < 0.1 else 1.09 if target[2] < 0.15 else 1.17
    ratio = np.linalg.norm(predicted.offset_m) / np.linalg.norm(found)
    assert 0.999 <= ratio <= excess or np.linalg.norm(found) < 2e-5
    level = np.abs(pressure(MODEL, focus(MODEL, target), np.stack([target, target + found])))
    assert 1.0 - 1e-9 <= level[1] / level[0] <= predicted.gain + 1e-6
    # What is left out of the second order is small against the gain itself.
    assert predicted.gain - level[1] / level[0] <= 0.1 * (predicted.gain - 1.0) + 1e-6


@given(targets(lateral=0.03, low=0.06, high=0.12), st.floats(0.1, 0.5))
def test_the_louder_half_of_an_array_pulls_the_maximum_its_way(target, share):
    amplitudes = np.where(MODEL.array.positions_m[:, 0] < 0.0, 1.0, share)
    found = find_pressure_peak(ENGINE, amplitudes * focus(MODEL, target), target) - target
    predicted = predict_focal_shift(MODEL, target, amplitudes).offset_m
    assert np.linalg.norm(predicted - found) < 0.02e-3 + 0.1 * np.linalg.norm(found)
    even = predict_focal_shift(MODEL, target).offset_m
    assert found[0] < even[0] - 0.03e-3


@given(targets(low=0.08, high=0.2), st.floats(-3e-3, 3e-3), st.floats(-3e-3, 3e-3))
def test_the_peak_is_a_maximum_found_from_anywhere_in_the_lobe(target, dx, dz):
    weights = focus(MODEL, target)
    found = find_pressure_peak(ENGINE, weights, target + np.array([dx / 3, 0.0, dz]))
    around = found + 2e-4 * np.random.default_rng(0).normal(size=(50, 3))
    level = np.abs(pressure(MODEL, weights, np.vstack([found, around])))
    assert level[0] >= level[1:].max()
    assert np.linalg.norm(found - peak(MODEL, target)) < 1e-5


@pytest.mark.parametrize("count", [30, pytest.param(100, marks=pytest.mark.nightly)])
def test_a_prediction_that_holds_is_within_a_quarter_of_the_shift(count):
    """97 of 100 of those near the limit, of any size, pitch and distance."""
    rng, misses = np.random.default_rng(5), []
    while len(misses) < count:
        nx, ny = rng.integers(3, 17, 2)
        model = AcousticModel.default(int(nx), int(ny), pitch_m=rng.uniform(0.006, 0.014))
        target = np.array([*rng.uniform(-0.03, 0.03, 2), rng.uniform(0.03, 0.3)])
        predicted = predict_focal_shift(model, target)
        if not predicted.valid or predicted.size_rad < 0.1:
            continue
        found = peak(model, target) - target
        misses.append(np.linalg.norm(predicted.offset_m - found) / np.linalg.norm(found))
    assert np.count_nonzero(np.array(misses) <= 0.25) >= 0.97 * count


def of_wide_pistons(nx, ny, pitch_m, radius_m):
    array = AcousticModel.default(nx, ny, pitch_m=pitch_m).array
    return AcousticModel(array, MODEL.medium, Transducer(CircularPiston(radius_m)))


@pytest.mark.parametrize(
    ("array", "target"),
    [
        ((6, 8, 0.0403, 0.0184), (-0.010, -0.017, 0.165)),
        ((13, 10, 0.0336, 0.0135), (0.017, 0.026, 0.098)),
        ((12, 9, 0.0477, 0.0187), (0.016, 0.019, 0.287)),
        ((12, 12, 0.0163, 0.0075), (0.026, -0.022, 0.162)),
        ((8, 13, 0.0420, 0.0189), (-0.003, -0.023, 0.227)),
        ((9, 12, 0.0330, 0.0158), (-0.008, -0.035, 0.135)),
        ((5, 13, 0.0332, 0.0144), (0.002, 0.002, 0.081)),
    ],
)
@pytest.mark.parametrize("gain", [1.0, 0.3j])
def test_elements_in_antiphase_pull_the_maximum_the_other_way(array, target, gain):
    """Up to a third of the elements have a side lobe towards these targets."""
    model = of_wide_pistons(*array)
    count, positions = model.array.count, model.array.positions_m
    model = model.calibrated(
        Calibration(np.full(count, abs(gain)), np.full(count, np.angle(gain)), positions)
    )
    shift, found = predict_focal_shift(model, target), peak(model, np.array(target)) - target
    assert shift.valid
    assert np.linalg.norm(shift.offset_m - found) < 0.25 * np.linalg.norm(found)
    level = np.abs(pressure(model, focus(model, target), np.stack([target, target + found])))
    assert level[1] / level[0] == pytest.approx(shift.gain, abs=5e-4)


@pytest.mark.parametrize(
    ("array", "target"),
    [
        ((8, 8, 0.0170, 0.0080), (0.0, 0.0, 0.060)),
        ((12, 12, 0.0260, 0.0120), (0.0, 0.0, 0.100)),
        ((12, 12, 0.0260, 0.0120), (0.02, 0.01, 0.100)),
    ],
)
def test_elements_in_antiphase_may_leave_no_maximum_at_the_target(array, target):
    model = of_wide_pistons(*array)
    shift, found = predict_focal_shift(model, target), peak(model, np.array(target)) - target
    assert not shift.valid
    assert np.isnan(shift.offset_m).all()
    assert np.linalg.norm(found) > MODEL.wavelength_m / 4.0


def test_around_a_line_of_elements_a_prediction_holds_where_all_are_equally_loud():
    """Along the circle around the line nothing curves: pistons pull the maximum over the line."""
    line = AcousticModel.default(32, 1, pitch_m=0.005)
    points = AcousticModel(line.array, line.medium, Transducer(PointSource()))
    shift = predict_focal_shift(points, (0.0, 0.03, 0.1))
    assert shift.valid
    assert abs(shift.offset_m @ np.array([0.0, 0.1, -0.03])) < 1e-9
    assert predict_focal_shift(line, (0.0, 0.0, 0.1)).valid
    assert not predict_focal_shift(line, (0.0, 0.03, 0.1)).valid
    assert abs(peak(line, np.array([0.0, 0.03, 0.1]))[1]) < 1e-3


def test_a_single_element_has_no_maximum_in_front_of_it():
    model = AcousticModel.default(1, 1)
    with pytest.raises(ConfigurationError, match="rises up to the array"):
        find_pressure_peak(NumpyEngine(model), [1.0], (0.0, 0.0, 0.05))


@pytest.mark.parametrize(
    "piston", [RectangularPiston(0.0054, 0.0044, (0.6, 0.8, 0.0)), CircularPiston(0.002)]
)
@pytest.mark.parametrize("target", [(-0.269, -0.024, 0.028), (-0.284, -0.03, 0.023)])
def test_the_plane_of_an_array_is_no_maximum(piston, target):
    """There the baffle cuts off a field that rises up to it, level on both sides."""
    model = AcousticModel(TransducerArray.grid(5, 4), Medium(321.0, 1.2, 3.0), Transducer(piston))
    with pytest.raises(ConfigurationError, match="rises up to the array"):
        find_pressure_peak(NumpyEngine(model), focus(model, target), target)


def test_silence_has_no_maximum():
    with pytest.raises(ConfigurationError, match="no sound"):
        find_pressure_peak(ENGINE, np.zeros(256), (0.0, 0.0, 0.1))
    with pytest.raises(ConfigurationError, match="no element"):
        predict_focal_shift(MODEL, (0.0, 0.0, 0.1), np.zeros(256))


# -3 dB, -6 dB, half of null to null, depth toward the array and away from it, in mm
@pytest.mark.parametrize(
    ("z", "three", "six", "null", "below", "above"),
    [
        (0.050, 4.80, 6.56, 5.47, 6.5, 7.9),
        (0.075, 5.60, 7.63, 6.39, 9.6, 10.9),
        (0.100, 6.51, 8.86, 7.38, 13.6, 14.8),
        (0.150, 8.43, 11.47, 9.57, 24.5, 24.6),
        (0.200, 10.51, 14.36, 11.94, 39.5, 37.1),
    ],
)
def test_the_spot_has_the_size_that_was_measured_before(z, three, six, null, below, above):
    target = np.array([0.0, 0.0, z])
    spot = measure_spot(ENGINE, focus(MODEL, target), target)
    for axis in (0, 1):
        assert spot.width_3db_m[axis] * 1e3 == pytest.approx(three, rel=0.008)
        assert spot.width_6db_m[axis] * 1e3 == pytest.approx(six, rel=0.008)
        assert spot.null_to_null_m[axis] * 5e2 == pytest.approx(null, rel=0.008)
    # The figures count from the target, and from the level there: the shift's gain is up to 2 %.
    from_target = np.array(spot.depth_3db_m) + np.array([-1, 1]) * spot.axial_peak_m
    assert 1e3 * from_target == pytest.approx([below, above], rel=0.035)
    assert spot.axial_peak_m == pytest.approx(peak(MODEL, target)[2] - z, abs=0.3e-3)


@pytest.mark.parametrize("target", [(0.0, 0.0, 0.1), (0.02, 0.0, 0.15), (-0.05, 0.03, 0.12)])
def test_a_spot_off_the_axis_reaches_from_null_to_null(target):
    """The nulls beside the maximum, which diffraction pulls away from the target."""
    model, offsets = AcousticModel.default(8, 8), np.arange(-0.06, 0.06, 5e-5)
    spot = measure_spot(NumpyEngine(model), focus(model, target), target)
    for axis, width_m in enumerate(spot.null_to_null_m):
        places = target + offsets[:, None] * np.eye(3)[axis]
        level = np.abs(pressure(model, focus(model, target), places))
        least = 1 + np.flatnonzero((level[1:-1] < level[:-2]) & (level[1:-1] < level[2:]))
        top = int(np.argmax(level * (np.abs(offsets) < 0.01)))
        low, high = least[least < top].max(), least[least > top].min()
        assert width_m == pytest.approx(offsets[high] - offsets[low], abs=1.5e-4)


@pytest.mark.parametrize("name", ["tinylev", "sonicsurface-stack"])
def test_a_spot_between_elements_that_face_each_other_has_its_depth(name):
    """At the centre no line leads there from the array: its own z; and just beside as well."""
    model = AcousticModel(LAYOUTS[name].array(), MODEL.medium, MODEL.transducer)
    up, offsets = model.array.axes[2], np.arange(-2e-3, 2e-3, 1e-5)
    for above_m in (0.0, 1e-4, 1e-3):
        target = model.array.centre_m + above_m * up
        weights = focus(model, target)
        spot = measure_spot(NumpyEngine(model), weights, target)
        level = np.abs(pressure(model, weights, target + offsets[:, None] * up))
        loud = offsets[level > level.max() * 10.0 ** (-3.0 / 20.0)]
        assert sum(spot.depth_3db_m) == pytest.approx(np.ptp(loud), abs=5e-5)
        assert spot.axial_peak_m == pytest.approx(offsets[level.argmax()], abs=1.5e-4)


def test_a_wide_array_makes_a_narrow_spot_across_its_width():
    target = np.array([0.0, 0.0, 0.1])
    wide, deep = AcousticModel.default(12, 6), AcousticModel.default(6, 12)
    spots = [measure_spot(NumpyEngine(m), focus(m, target), target) for m in (wide, deep)]
    for name in ("width_3db_m", "width_6db_m", "null_to_null_m"):
        (x, y), (across, along) = (getattr(spot, name) for spot in spots)
        assert (across, along) == pytest.approx((y, x), rel=1e-9)
        assert y > 1.5 * x


def test_far_away_the_spot_is_that_of_a_square_aperture():
    """.886, 1.207 and 2 times lambda r / D for small angles and equal elements."""
    model = AcousticModel(
        TransducerArray.grid(16, 16, pitch_m=0.005), Medium(343.2, 1.2), Transducer(PointSource())
    )
    target = np.array([0.0, 0.0, 0.8])
    spot = measure_spot(NumpyEngine(model), focus(model, target), target)
    unit = model.wavelength_m * 0.8 / 0.080
    # The reach is 8 wavelengths: the null at 10 is out of it.
    assert spot.width_3db_m[0] == pytest.approx(0.886 * unit, rel=0.01)
    assert spot.width_6db_m[1] == pytest.approx(1.207 * unit, rel=0.01)
    assert math.isnan(spot.null_to_null_m[0])


@pytest.mark.parametrize(
    ("target", "level"),
    [((0, 0, 0.1), -10.7), ((0.03, 0.02, 0.12), -8.0), ((0.06, 0.06, 0.15), -7.1)],
)
def test_the_largest_secondary_lobe_is_where_it_was_found_before(target, level):
    lobe = largest_secondary_lobe(ENGINE, focus(MODEL, target), target)
    assert lobe.level_db == pytest.approx(level, abs=0.15)
    assert lobe.position_m[2] == target[2]
    assert math.dist(lobe.position_m, target) > 0.02


def test_a_single_element_has_no_secondary_lobe():
    model = AcousticModel.default(1, 1)
    assert largest_secondary_lobe(NumpyEngine(model), [1.0], (0.0, 0.0, 0.1), 0.05) is None
