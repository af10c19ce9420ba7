"""Laws that the field obeys for every array, medium and drive.

S is the sum of the magnitudes of the contributions: the scale of rounding errors.
"""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram.acoustics import (
    AcousticModel,
    Medium,
    PointSource,
    Transducer,
    TransducerArray,
    dequantise_phase,
    focus_phases,
    force_on_disc_n,
    phase_step_rad,
    pressure,
    propagators,
    quantise_phase,
)
from strategies_acoustics import finite_angles, grids, models, phase_bits, seeds, targets


def random_weights(model, seed):
    rng = np.random.default_rng(seed)
    phases = rng.uniform(0.0, 2.0 * np.pi, model.array.count)
    return rng.uniform(0.1, 1.0, model.array.count) * np.exp(1j * phases)


def contributions(model, weights, point):
    return weights * propagators(model, [point])[0]


def omni_model(array, absorption=0.0):
    return AcousticModel(array, Medium(343.2, 1.204, absorption), Transducer(PointSource()))


@given(models(), targets(), seeds)
def test_conjugate_phases_add_up_all_magnitudes_and_no_others_do(model, target, seed):
    gains = propagators(model, [target])[0]
    amplitudes = np.abs(random_weights(model, seed))
    largest = (amplitudes * np.abs(gains)).sum()
    focused = amplitudes * np.exp(1j * focus_phases(model, target))
    assert abs(pressure(model, focused, [target])[0]) == pytest.approx(largest, rel=1e-12)
    other = random_weights(model, seed)
    bound = (np.abs(other) * np.abs(gains)).sum()
    assert abs(pressure(model, other, [target])[0]) <= bound * (1 + 1e-12)
    jitter = 0.05 * np.random.default_rng(seed).normal(size=model.array.count)
    assert abs(pressure(model, focused * np.exp(1j * jitter), [target])[0]) < largest


@given(models(), targets())
def test_focus_phases_are_the_conjugate_of_the_propagators(model, target):
    """Where every directivity is positive, which holds up to its first zero (k a = 3.83)."""
    gains = propagators(model, [target])[0]
    arrival = np.exp(1j * focus_phases(model, target)) * gains
    assert np.abs(np.angle(arrival)).max() <= 1e-12


@given(models(), targets(), seeds, finite_angles)
def test_a_common_phase_turns_the_field_and_changes_no_level(model, point, seed, angle):
    weights = random_weights(model, seed)
    scale = np.abs(contributions(model, weights, point)).sum()
    turned = pressure(model, weights * np.exp(1j * angle), [point])[0]
    plain = pressure(model, weights, [point])[0]
    assert abs(turned - plain * np.exp(1j * angle)) <= 1e-12 * scale


SQUARE_SYMMETRIES = [
    np.array(matrix)
    for matrix in (
        [[0, 1], [1, 0]],
        [[-1, 0], [0, 1]],
        [[1, 0], [0, -1]],
        [[-1, 0], [0, -1]],
        [[0, -1], [1, 0]],
        [[0, 1], [-1, 0]],
        [[0, -1], [-1, 0]],
    )
]


@given(st.integers(2, 10), targets(), targets(), st.sampled_from(SQUARE_SYMMETRIES))
def test_a_square_array_has_the_symmetries_of_the_square(side, target, point, symmetry):
    model = AcousticModel.default(side, side)

    def moved(position):
        return np.array([*(symmetry @ position[:2]), position[2]])

    plain = np.exp(1j * focus_phases(model, target))
    image = np.exp(1j * focus_phases(model, moved(target)))
    scale = np.abs(contributions(model, plain, point)).sum()
    difference = pressure(model, image, [moved(point)])[0] - pressure(model, plain, [point])[0]
    assert abs(difference) <= 1e-12 * scale


@given(models(), targets(), seeds, st.floats(-2.0, 2.0), st.floats(-2.0, 2.0))
def test_the_field_is_linear(model, point, seed, first, second):
    a, b = random_weights(model, seed), random_weights(model, seed + 1)
    together = pressure(model, first * a + second * b, [point])[0]
    apart = first * pressure(model, a, [point])[0] + second * pressure(model, b, [point])[0]
    scale = 4.0 * np.abs(propagators(model, [point])).sum()
    assert abs(together - apart) <= 1e-12 * scale


@given(targets(), targets(low=0.3, high=0.6))
def test_a_point_source_and_a_point_receiver_may_change_places(here, there):
    forward = propagators(omni_model(TransducerArray.from_positions([here]), 0.15), [there])
    backward = propagators(omni_model(TransducerArray.from_positions([there]), 0.15), [here])
    assert forward[0, 0] == pytest.approx(backward[0, 0], rel=1e-14)


@given(models(), targets(), seeds, st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=3))
def test_moving_array_and_point_together_changes_nothing(model, point, seed, shift):
    weights = random_weights(model, seed)
    moved = AcousticModel(
        TransducerArray.from_positions(model.array.positions_m + shift),
        model.medium,
        model.transducer,
    )
    scale = np.abs(contributions(model, weights, point)).sum()
    difference = pressure(moved, weights, [point + shift])[0] - pressure(model, weights, [point])[0]
    assert abs(difference) <= 1e-11 * scale


@given(st.integers(2, 60), st.floats(0.02, 0.1), st.floats(0.05, 0.25))
def test_equal_distances_add_up_in_phase(count, radius, height):
    angles = 2.0 * np.pi * np.arange(count) / count
    ring = np.stack([radius * np.cos(angles), radius * np.sin(angles), 0.0 * angles], axis=1)
    model = AcousticModel(TransducerArray.from_positions(ring), Medium.air(), Transducer())
    gains = propagators(model, [[0, 0, height]])[0]
    total = abs(pressure(model, np.ones(count), [[0, 0, height]])[0])
    assert total == pytest.approx(count * abs(gains[0]), rel=1e-12)


@given(models(), targets(), seeds, st.floats(0.01, 1.0))
def test_pressure_is_proportional_to_the_drive_and_force_to_its_square(model, point, seed, gain):
    weights = random_weights(model, seed)
    assert pressure(model, gain * weights, [point]) == pytest.approx(
        gain * pressure(model, weights, [point]), rel=1e-11
    )
    assert force_on_disc_n(model, gain * weights, point) == pytest.approx(
        gain**2 * force_on_disc_n(model, weights, point), rel=1e-11
    )


@pytest.mark.parametrize(
    ("bits", "largest_deviation"),
    [(1, 0.35), (2, 6.2e-2), (3, 1.8e-2), (4, 4.2e-3), (5, 6.6e-4), (8, 1.1e-5)],
)
def test_phase_steps_cost_what_they_must(bits, largest_deviation):
    """Never below cos(pi / 2^b); sinc(2^-b) on the mean, and close to it for every target."""
    model = AcousticModel.default()
    rng = np.random.default_rng(bits)
    efficiencies = []
    for target in rng.uniform([-0.06, -0.06, 0.05], [0.06, 0.06, 0.25], (150, 3)):
        weights = np.exp(
            1j * dequantise_phase(quantise_phase(focus_phases(model, target), bits), bits)
        )
        arrivals = contributions(model, weights, target)
        efficiencies.append(abs(arrivals.sum()) / np.abs(arrivals).sum())
    expected = np.sinc(2.0**-bits)
    assert min(efficiencies) >= math.cos(math.pi / 2**bits) - 1e-12
    assert np.abs(np.array(efficiencies) - expected).max() <= largest_deviation
    assert np.mean(efficiencies) == pytest.approx(expected, abs=largest_deviation / 5)


@given(models(), targets(), phase_bits, seeds)
def test_no_model_loses_more_to_phase_steps(model, target, bits, seed):
    """|p| >= cos(pi / 2^b) S, whatever the amplitudes, if the phases were those of a focus."""
    codes = quantise_phase(focus_phases(model, target), bits)
    amplitudes = np.abs(random_weights(model, seed))
    arrivals = contributions(model, amplitudes * np.exp(1j * dequantise_phase(codes, bits)), target)
    assert abs(arrivals.sum()) >= (math.cos(math.pi / 2**bits) - 1e-12) * np.abs(arrivals).sum()


@given(phase_bits, seeds)
def test_rounding_errors_of_random_phases_are_uniform(bits, seed):
    """Mean 0 and variance step^2 / 12, as `std_m` of a fit takes them; 5 sigma of 20 000."""
    phases = np.random.default_rng(seed).uniform(-50.0, 50.0, 20_000)
    error = dequantise_phase(quantise_phase(phases, bits), bits) - phases
    steps = np.angle(np.exp(1j * error)) / phase_step_rad(bits)
    assert np.abs(steps).max() <= 0.5 + 1e-9
    assert steps.mean() == pytest.approx(0.0, abs=5 / math.sqrt(12 * 20_000))
    assert steps.var() == pytest.approx(1 / 12, rel=5 * math.sqrt(0.8 / 20_000))


@pytest.mark.parametrize("sigma", [0.2, 0.4, 0.8])
def test_random_phase_errors_cost_the_expected_amount(sigma):
    """Mean of |p| / S is exp(-s^2 / 2), within 0.5 %, up to the 1 / (2 N) of the random part."""
    model = omni_model(TransducerArray.grid(16, 16))
    rng = np.random.default_rng(round(10 * sigma))
    ratios = []
    for target in rng.uniform([-0.06, -0.06, 0.1], [0.06, 0.06, 0.25], (300, 3)):
        phases = focus_phases(model, target) + sigma * rng.normal(size=256)
        arrivals = contributions(model, np.exp(1j * phases), target)
        ratios.append(abs(arrivals.sum()) / np.abs(arrivals).sum())
    assert np.mean(ratios) == pytest.approx(math.exp(-(sigma**2) / 2), rel=5e-3)


def helmholtz_error(model, weights, point, wavenumber, steps=20):
    """|laplace p + k^2 p| / (k^2 S), by 4th-order differences at a part of the wavelength."""
    step = model.wavelength_m / steps
    stencil = {0: -5 / 2, 1: 4 / 3, -1: 4 / 3, 2: -1 / 12, -2: -1 / 12}
    laplace = 0j
    for axis in np.eye(3):
        points = [point + shift * step * axis for shift in stencil]
        laplace += pressure(model, weights, points) @ list(stencil.values()) / step**2
    plain = pressure(model, weights, [point])[0]
    scale = abs(wavenumber) ** 2 * np.abs(contributions(model, weights, point)).sum()
    return abs(laplace + wavenumber**2 * plain) / scale


@given(grids(2, 8), targets(), seeds, st.sampled_from([0.0, 0.15, 2.0]))
def test_point_sources_solve_the_helmholtz_equation(array, point, seed, absorption):
    """With the complex wavenumber k + j alpha, to the error of the differences: (k h)^4 / 90."""
    model = omni_model(array, absorption)
    weights = random_weights(model, seed)
    for steps, error in ((20, 1e-4), (40, 7e-6), (80, 4.5e-7)):
        complex_k = model.wavenumber + 1j * absorption
        assert helmholtz_error(model, weights, point, complex_k, steps) <= error


@given(grids(2, 8), targets(), st.floats(0.1, 2.0))
def test_a_real_wavenumber_leaves_twice_the_absorption(array, target, absorption):
    """|(k + j alpha)^2 - k^2| / k^2, at a focus, where all elements are in phase."""
    model = omni_model(array, absorption)
    weights = np.exp(1j * focus_phases(model, target))
    left = helmholtz_error(model, weights, target, model.wavenumber, 40)
    assert left == pytest.approx(2.0 * absorption / model.wavenumber, rel=0.03, abs=7e-6)


@given(grids(2, 8), targets(), seeds)
def test_pistons_nearly_solve_the_helmholtz_equation(array, point, seed):
    """D / r is the far field of a piston and no exact solution: 3e-3 is what it leaves."""
    model = AcousticModel(array, Medium(343.2, 1.204), Transducer())
    assert helmholtz_error(model, random_weights(model, seed), point, model.wavenumber) <= 3e-3


@pytest.mark.parametrize(
    ("target", "at_5_k", "at_10_k"),
    [
        ((0, 0, 0.1), 0.99787, 0.9917),
        ((0, 0, 0.2), 0.99927, 0.9972),
        ((0.05, 0, 0.1), 0.99458, 0.9790),
    ],
)
def test_a_wrong_temperature_costs_little_coherence(target, at_5_k, at_10_k):
    cold = AcousticModel.default().with_sound_speed(343.2)
    weights = np.exp(1j * focus_phases(cold, target))
    for warmer, expected in ((5.0, at_5_k), (10.0, at_10_k)):
        warm = cold.with_sound_speed(343.2 * math.sqrt(1.0 + warmer / 293.15))  # dry air
        arrivals = contributions(warm, weights, target)
        coherence = abs(arrivals.sum()) / np.abs(arrivals).sum()
        assert coherence == pytest.approx(expected, abs=6e-5)
