"""Targets to phases, and phases back to their focus."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptogram.acoustics import (
    AcousticModel,
    Medium,
    TransducerArray,
    check_focus_target,
    dequantise_phase,
    fit_focus,
    focus_phases,
    phase_step_rad,
    pressure,
    quantise_phase,
    superpose_foci,
)
from haptogram.acoustics.solvers.focus import check_focus_targets, focus_steering_reach_m
from haptogram.acoustics.solvers.focus_fit import wrapped_phases
from haptogram.errors import ConfigurationError
from strategies_acoustics import finite_angles, grids, models, seeds, targets

MODEL = AcousticModel.default()


def quantised(model, target, bits):
    return dequantise_phase(quantise_phase(focus_phases(model, target), bits), bits)


def nearby(seed, distance=0.004):
    """A step of at most *distance* in any direction."""
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=3)
    return distance * rng.uniform() * direction / np.linalg.norm(direction)


# --- to phases


@given(models(), targets())
def test_focus_phases_are_minus_k_r(model, target):
    expected = [-model.wavenumber * math.dist(target, p) for p in model.array.positions_m]
    assert focus_phases(model, target) == pytest.approx(expected, rel=1e-14)
    assert (focus_phases(model, [target, target])[1] == focus_phases(model, target)).all()


@given(targets(), targets(), finite_angles)
def test_superposition_is_the_sum_of_the_single_foci(first, second, lag):
    single = np.exp(1j * focus_phases(MODEL, [first, second]))
    weights = superpose_foci(MODEL, [first, second], [0.5, 0.25], [lag, 0.0])
    expected = 0.5 * np.exp(1j * lag) * single[0] + 0.25 * single[1]
    assert np.abs(weights - expected).max() <= 1e-13
    assert abs(superpose_foci(MODEL, [first], [1.0], [0.0])[7]) == pytest.approx(1.0)


def test_a_superposition_reaches_every_point_with_its_amplitude_and_phase():
    """Two far points hardly disturb each other: each is within 25 % of its own focus."""
    points, amplitudes, lags = [[0.03, 0, 0.12], [-0.03, 0.01, 0.12]], [0.6, 0.3], [0.0, 2.0]
    field = pressure(MODEL, superpose_foci(MODEL, points, amplitudes, lags), points)
    for i in range(2):
        own = pressure(
            MODEL, superpose_foci(MODEL, [points[i]], [amplitudes[i]], [lags[i]]), points
        )[i]
        assert abs(field[i] - own) < 0.25 * abs(own)
        assert np.angle(own) == pytest.approx(lags[i], abs=1e-9)


@pytest.mark.parametrize(
    ("target", "complaint"),
    [
        ([0, 0, math.nan], r"target_m\[2\] is nan"),
        ([0, 0], r"\(2,\), must be \(3,\)"),
        ([0, 0, 0.0199], r"height z is 19\.9 mm, must be at least 20 mm"),
        ([0, 0, -0.1], "height z is -100 mm, must be at least 20 mm"),
        ([0, 0, 1.0001], r"distance is 1000\.1 mm, must be at most 1000 mm"),
        ([0.2301, 0, 0.1], r"offset \|x\| is 230\.1 mm, must be at most 230 mm"),
        ([0, -0.2301, 0.1], r"offset \|y\| is 230\.1 mm, must be at most 230 mm"),
    ],
)
def test_a_target_out_of_reach_is_refused_with_value_and_limit(target, complaint):
    with pytest.raises(ConfigurationError, match=complaint):
        check_focus_target(MODEL, target)


@pytest.mark.parametrize("target", [[0, 0, 0.02], [0.23, -0.23, 0.1], [0, 0, 1.0]])
def test_a_target_at_the_limit_is_accepted(target):
    check_focus_target(MODEL, target)


def test_reach_is_counted_from_the_array_wherever_it_is():
    moved = TransducerArray.from_positions(MODEL.array.positions_m + np.array([1.0, 0, 0.5]))
    model = AcousticModel(moved, MODEL.medium, MODEL.transducer)
    check_focus_target(model, [1.0, 0, 0.6])
    with pytest.raises(ConfigurationError, match="offset"):
        check_focus_target(model, [0.5, 0, 0.6])
    assert focus_steering_reach_m(model) == pytest.approx((0.225, 0.225))


def test_a_target_among_the_elements_of_a_bowl_is_refused():
    array = TransducerArray.from_positions([[0, 0, 0], [0.1, 0, 0.1], [-0.1, 0, 0.1]])
    model = AcousticModel(array, MODEL.medium, MODEL.transducer)
    with pytest.raises(ConfigurationError, match="distance from an element is 10 mm"):
        check_focus_target(model, [0.1, 0, 0.11])


@pytest.mark.parametrize(
    "call",
    [
        lambda: focus_phases(MODEL, [0, 0]),
        lambda: focus_phases(MODEL, [0, math.inf, 1]),
        lambda: superpose_foci(MODEL, [[0, 0, 0.1]], [1.0, 1.0], [0.0]),
        lambda: superpose_foci(MODEL, [[0, 0, 0.1]], [1.0], [math.nan]),
        lambda: fit_focus(MODEL, np.zeros(255), [0, 0, 0.1], phase_bits=8),
        lambda: fit_focus(MODEL, np.full(256, np.nan), [0, 0, 0.1], phase_bits=8),
        lambda: fit_focus(MODEL, np.zeros(256), [0, 0, math.nan], phase_bits=8),
        lambda: fit_focus(MODEL, np.zeros(256), [0, 0, 0.1], phase_bits=17),
        lambda: fit_focus(MODEL, np.zeros(256), [0, 0, 0.1], phase_bits=8, active=[True]),
        lambda: fit_focus(MODEL, np.zeros(256), [0, 0, 0.1], phase_bits=8, active=np.zeros(256)),
    ],
)
def test_bad_arguments_are_refused(call):
    with pytest.raises(ConfigurationError):
        call()


# --- and back


@given(st.lists(st.floats(-100.0, 100.0), min_size=1, max_size=9))
def test_wrapping_keeps_the_angle_and_stays_within_half_a_turn(angles):
    wrapped = wrapped_phases(np.array(angles))
    assert np.abs(wrapped).max() <= math.pi + 1e-12
    assert np.exp(1j * wrapped) == pytest.approx(np.exp(1j * np.array(angles)), abs=1e-12)


@given(targets(), seeds, finite_angles)
def test_exact_phases_give_the_target_back(target, seed, common):
    """Any common phase; the focal shift of |p| plays no part."""
    phases = focus_phases(MODEL, target) + common
    fit = fit_focus(MODEL, phases, target + nearby(seed), phase_bits=8)
    assert fit.converged
    assert np.abs(fit.position_m - target).max() <= 1e-12 + 1e-9 * 1e-3
    assert fit.residual_rms_rad <= 1e-9
    assert abs(wrapped_phases(np.array(fit.phase_rad - common))) <= 1e-6


@pytest.mark.parametrize("bits", [4, 5, 8])
@given(targets(), seeds)
def test_rounded_phases_stay_within_the_bound(bits, target, seed):
    """In the symmetry planes too, where the errors are correlated and 4 sigma does not hold."""
    fit = fit_focus(MODEL, quantised(MODEL, target, bits), target + nearby(seed), phase_bits=bits)
    assert fit.observable.all()
    assert fit.residual_rms_rad <= math.pi / 2**bits
    # The bound is linear in the errors; 2 % covers the curvature at 4 bits.
    assert (np.abs(fit.position_m - target) <= 1.02 * fit.bound_m).all()
    assert (fit.std_m < fit.bound_m).all()


@given(grids(3, 4), targets(lateral=0.03, low=0.05, high=0.1), st.integers(3, 8), seeds)
@settings(max_examples=8)
def test_spread_and_bound_follow_from_how_the_fit_answers_each_element(array, target, bits, seed):
    """A little phase on one element after the other gives the slopes dx / dphi_n.

    Rounding is off by half a step at most, by step / sqrt(12) on the mean: so far the focus moves
    if all add up, or are independent.  An element that is left out counts for nothing.
    """
    model = AcousticModel(array, Medium.air(), MODEL.transducer)
    active = np.arange(array.count) != seed % array.count
    phases, little = focus_phases(model, target), 1e-5

    def fitted(offsets):
        return fit_focus(model, phases + offsets, target, phase_bits=bits, active=active)

    slopes = (
        np.array([fitted(little * unit).position_m - target for unit in np.eye(array.count)]).T
        / little
    )
    fit, step = fitted(0.0), phase_step_rad(bits)
    assert fit.observable.all()
    assert fit.bound_m == pytest.approx(np.abs(slopes).sum(axis=1) * step / 2, rel=1e-3)
    assert fit.std_m == pytest.approx(np.linalg.norm(slopes, axis=1) * step / 12**0.5, rel=1e-3)


@given(targets(), seeds)
def test_the_common_phase_leaves_residuals_of_mean_zero(target, seed):
    """The least-squares mean, not that of the phasors: with lopsided errors they differ."""
    rng = np.random.default_rng(seed)
    phases = focus_phases(MODEL, target) + 0.5 * rng.exponential(size=256).clip(0.0, 3.0)
    fit = fit_focus(MODEL, phases, target, phase_bits=8)
    assert fit.residual_rad.mean() == pytest.approx(0.0, abs=1e-9)


def test_scatter_of_random_targets_is_that_of_the_cramer_rao_bound():
    """RMS error over std_m is 1 within 15 % for 300 targets away from the symmetry planes."""
    rng = np.random.default_rng(11)
    scaled = []
    for target in rng.uniform([0.005, 0.02, 0.05], [0.015, 0.06, 0.25], (300, 3)):
        fit = fit_focus(MODEL, quantised(MODEL, target, 8), target, phase_bits=8)
        scaled.append((fit.position_m - target) / fit.std_m)
    assert np.sqrt(np.mean(np.square(scaled), axis=0)) == pytest.approx([1, 1, 1], abs=0.15)


@given(targets(), seeds)
def test_residuals_of_rounded_phases_span_at_most_one_step(target, seed):
    """S1: around the target, the half-range of the residual is at most pi / 2^b."""
    residual = wrapped_phases(quantised(MODEL, target, 8) + MODEL.wavenumber * distances(target))
    assert np.ptp(residual) / 2 <= math.pi / 256 + 1e-9
    faulty = quantised(MODEL, target, 8)
    faulty[seed % 256] += 2 * phase_step_rad(8)
    residual = wrapped_phases(faulty + MODEL.wavenumber * distances(target))
    assert np.ptp(residual) / 2 > math.pi / 256


def distances(target):
    return np.linalg.norm(MODEL.array.positions_m - target, axis=1)


@given(targets(), seeds)
def test_silent_elements_are_left_out(target, seed):
    rng = np.random.default_rng(seed)
    active = rng.uniform(size=256) < 0.5
    phases = np.where(active, focus_phases(MODEL, target), rng.uniform(-3, 3, 256))
    fit = fit_focus(MODEL, phases, target + nearby(seed, 0.003), phase_bits=8, active=active)
    assert np.abs(fit.position_m - target).max() <= 1e-9
    assert fit.residual_rms_rad <= 1e-9
    assert np.abs(fit.residual_rad[~active]).max() > 0.1


@given(targets(), seeds)
def test_an_inverted_element_shows_and_moves_the_fit_little(target, seed):
    phases = focus_phases(MODEL, target)
    phases[seed % 256] += math.pi
    fit = fit_focus(MODEL, phases, target, phase_bits=8)
    assert int(np.abs(fit.residual_rad).argmax()) == seed % 256
    assert fit.residual_rms_rad == pytest.approx(math.pi / 16, rel=0.05)
    # The bound is the sum over 256 elements of 1/256 of this error each; a corner counts fourfold.
    assert (np.abs(fit.position_m - target) < 4 * fit.bound_m).all()


# --- negative controls: a wrong drive must show as a wrong place


@given(targets(), seeds)
def test_an_offset_of_1_mm_is_measured(target, seed):
    rng = np.random.default_rng(seed)
    offset = rng.normal(size=3)
    offset *= 1e-3 / np.linalg.norm(offset)
    phases = quantised(MODEL, target + offset, 8)
    fit = fit_focus(MODEL, phases, target, phase_bits=8)
    assert (np.abs(fit.position_m - target - offset) <= fit.bound_m).all()


@pytest.mark.parametrize(("faster", "low_mm", "high_mm"), [(-3.2, -2.45, -1.0), (0.8, 0.25, 0.65)])
@given(targets(lateral=0.04, low=0.06, high=0.14))
def test_a_wrong_sound_speed_shows_as_a_wrong_depth(faster, low_mm, high_mm, target):
    """The fit sees drives made for another speed, in m/s, off along the ray."""
    other = MODEL.with_sound_speed(MODEL.medium.sound_speed_m_s + faster)
    fit = fit_focus(MODEL, quantised(other, target, 8), target, phase_bits=8)
    along = (fit.position_m - target) @ target / np.linalg.norm(target)
    assert low_mm <= 1e3 * along <= high_mm


def test_a_wrong_pitch_shows_as_a_wrong_depth():
    """Phases made for 10.5 mm, radiated by 10 mm: about 14 mm too near at 150 mm."""
    target = np.array([0.0, 0.0, 0.15])
    phases = quantised(AcousticModel.default(pitch_m=0.0105), target, 8)
    fit = fit_focus(MODEL, phases, target * 0.93, phase_bits=8)
    assert 1e3 * (target - fit.position_m)[2] == pytest.approx(14, abs=2)


# --- what an array cannot tell


@given(targets(low=0.06), seeds)
def test_a_line_of_elements_cannot_tell_y_from_z(target, seed):
    line = AcousticModel.default(128, 1)
    target = target + np.array([0.0, 0.002, 0.0]) * (target[1] == 0.0)
    phases = focus_phases(line, target)
    fit = fit_focus(line, phases, target + nearby(seed, 0.002), phase_bits=8)
    assert list(fit.observable) == [True, False, False]
    assert fit.position_m[0] == pytest.approx(target[0], abs=1e-9)
    assert np.hypot(*fit.position_m[1:]) == pytest.approx(np.hypot(*target[1:]), abs=1e-9)
    assert np.isinf(fit.std_m[1:]).all()
    assert np.isinf(fit.bound_m[1:]).all()
    assert np.isfinite([fit.std_m[0], fit.bound_m[0]]).all()


@pytest.mark.parametrize(
    ("nx", "ny", "observable"),
    [
        (1, 1, [False, False, False]),
        (2, 2, [True, True, False]),
        (1, 64, [False, True, False]),
        (64, 2, [True, True, True]),
        (3, 3, [True, True, True]),
    ],
)
def test_observability_on_the_axis(nx, ny, observable):
    """A line along y sees only y, on the axis too; four equal distances lose the depth."""
    model = AcousticModel.default(nx, ny)
    fit = fit_focus(model, focus_phases(model, [0, 0, 0.1]), [0, 0, 0.1], phase_bits=8)
    assert list(fit.observable) == observable


@given(grids(3, 8), targets(low=0.05, high=0.15))
def test_small_planar_arrays_observe_everything(array, target):
    model = AcousticModel(array, Medium.air(), MODEL.transducer)
    fit = fit_focus(model, focus_phases(model, target), target, phase_bits=8)
    assert fit.observable.all()
    assert np.abs(fit.position_m - target).max() <= 1e-6


def test_a_single_active_element_is_no_focus_but_no_error():
    active = np.arange(256) == 5
    fit = fit_focus(MODEL, np.ones(256), [0, 0, 0.1], phase_bits=8, active=active)
    assert list(fit.observable) == [False, False, False]
    assert fit.residual_rms_rad <= 1e-12


def test_a_hopeless_fit_ends():
    phases = np.random.default_rng(1).uniform(-3, 3, 256)
    fit = fit_focus(MODEL, phases, [0, 0, 0.1], phase_bits=8)
    assert fit.iterations <= 32
    assert fit.residual_rms_rad > 1.0


@given(seeds)
def test_targets_are_refused_together_as_one_by_one(seed):
    rng = np.random.default_rng(seed)
    low, high = (-0.3, -0.3, -0.1), (0.3, 0.3, 1.1)
    near = rng.normal(0.0, 0.03, (10, 3))
    places = np.vstack([rng.uniform(low, high, (10, 3)), near, rng.uniform(0.05, 0.1, (10, 3))])

    def refused(*some):
        try:
            check_focus_targets(MODEL, np.array(some))
        except ConfigurationError as error:
            return str(error)
        return None

    def alone(place):
        try:
            check_focus_target(MODEL, place)
        except ConfigurationError as error:
            return str(error)
        return None

    expected = [alone(place) for place in places]
    assert [refused(place) for place in places] == expected
    assert refused(*places) == next(filter(None, expected), None)
