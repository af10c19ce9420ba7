"""The field of many small sources against what their limit is known to be, and its energy."""

import math

import numpy as np
import pytest
from hypothesis import given, settings

import oracles
from haptogram.acoustics import (
    AcousticModel,
    Medium,
    PointSource,
    Transducer,
    TransducerArray,
    focus_phases,
    pressure,
)
from strategies_acoustics import grids, seeds

SCALARS = oracles.reference_fields()["scalars"]
RADIUS_M = 0.080
MEDIUM = Medium(343.2, 1.204)
SOURCE = Transducer(PointSource(), math.sqrt(0.5))  # 1 Pa m, peak
K = MEDIUM.wavenumber(SOURCE.frequency_hz)


def disc_field(pitch_m, heights_m, focus_m=None):
    """Integral of e^{jkr} / r over a disc, as a sum of sources at the midpoints of squares.

    There are more of them than an array may have: the fields of several arrays add up.
    """
    half = math.ceil(RADIUS_M / pitch_m)
    cells = (np.arange(-half, half) + 0.5) * pitch_m
    x, y = (axis.ravel() for axis in np.meshgrid(cells, cells))
    inside = x**2 + y**2 < RADIUS_M**2
    sources = np.stack([x[inside], y[inside], np.zeros(inside.sum())], axis=1)
    points = np.stack([0.0 * heights_m, 0.0 * heights_m, heights_m], axis=1)
    total = np.zeros(len(points), dtype=complex)
    for start in range(0, len(sources), 1024):
        array = TransducerArray.from_positions(sources[start : start + 1024])
        model = AcousticModel(array, MEDIUM, SOURCE)
        phases = np.zeros(array.count) if focus_m is None else focus_phases(model, focus_m)
        total += pressure(model, np.exp(1j * phases), points)
    return total * pitch_m**2


def test_a_disc_of_sources_converges_to_the_baffled_piston():
    """On the axis |p| = 2 rho c v |sin(k (sqrt(z^2 + a^2) - z) / 2)|.

    Every halving of the pitch brings it nearer; at 2.5 mm the error is 1.5 % RMS of 2 rho c v.
    """
    heights = np.linspace(0.06, 0.4, 41)
    exact = 2.0 * np.abs(np.sin(0.5 * K * (np.sqrt(heights**2 + RADIUS_M**2) - heights)))
    for case in SCALARS["circular_piston_onaxis_a80mm"]:
        z = float(case["z"])
        closed = 2.0 * abs(math.sin(0.5 * K * (math.hypot(z, RADIUS_M) - z)))
        assert closed == pytest.approx(float(case["abs"]), rel=1e-12)
    errors = []
    for pitch in (0.010, 0.005, 0.0025):
        field = np.abs(disc_field(pitch, heights)) * K / (2.0 * math.pi)
        errors.append(math.sqrt(np.mean((field - exact) ** 2)) / 2.0)
    assert errors[0] > 3.0 * errors[1] > 6.0 * errors[2]
    assert errors[2] < 0.02


def test_a_focused_disc_of_sources_converges_to_the_rayleigh_integral():
    """In amplitude and phase, within 0.5 % at 2.5 mm; 0.31 % at the focus."""
    cases = SCALARS["focused_disc_onaxis_a80mm_F100mm"]
    heights = np.array([float(case["z"]) for case in cases])
    exact = np.array([complex(float(case["re"]), float(case["im"])) for case in cases])
    largest = np.abs(exact).max()
    errors = [
        np.abs(disc_field(pitch, heights, [0.0, 0.0, 0.1]) - exact).max() / largest
        for pitch in (0.010, 0.005, 0.0025)
    ]
    assert errors[0] > 3.0 * errors[1] > 6.0 * errors[2]
    assert errors[2] < 0.005


# Derivative at 0 from the samples at -4 ... 4 steps, of the 8th order.
DERIVATIVE = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0.0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])


def flux_through_a_sphere(model, weights, radius_m, order=40):
    """Integral of Im(conj(p) dp/dr) / k over a sphere: what flows out, whatever the radius."""
    heights, rule = np.polynomial.legendre.leggauss(order)
    angles = 2.0 * np.pi * np.arange(2 * order) / (2 * order)
    lateral = np.sqrt(1.0 - heights**2)
    directions = np.stack(
        [
            np.outer(lateral, np.cos(angles)).ravel(),
            np.outer(lateral, np.sin(angles)).ravel(),
            np.repeat(heights, len(angles)),
        ],
        axis=1,
    )
    step = model.wavelength_m / 80
    shells = [pressure(model, weights, (radius_m + i * step) * directions) for i in range(-4, 5)]
    flow = np.imag(np.conj(shells[4]) * (DERIVATIVE @ shells)) / (step * model.wavenumber)
    areas = np.repeat(rule, len(angles)) * radius_m**2 * np.pi / order
    return float(flow @ areas)


@settings(max_examples=6)
@given(grids(1, 3), seeds)
def test_what_coupled_point_sources_radiate_flows_through_any_sphere(array, seed):
    """4 pi p1^2 w^H sinc(k d) w, whose eigenvalues bound it; no other law of the field is used."""
    rng = np.random.default_rng(seed)
    model = AcousticModel(array, MEDIUM, SOURCE)
    weights = rng.uniform(0.1, 1.0, array.count) * np.exp(2j * np.pi * rng.random(array.count))
    offsets = array.positions_m[:, None] - array.positions_m
    coupling = np.sinc(K * np.linalg.norm(offsets, axis=2) / np.pi)
    expected = 4.0 * np.pi * (weights.conj() @ coupling @ weights).real
    for radius in (0.06, rng.uniform(0.07, 0.3)):
        power = flux_through_a_sphere(model, weights, radius)
        assert power == pytest.approx(expected, rel=1e-10)
        share = power / (4.0 * np.pi * float(np.abs(weights) @ np.abs(weights)))
        bounds = np.linalg.eigvalsh(coupling)
        assert bounds[0] * (1 - 1e-10) <= share <= bounds[-1] * (1 + 1e-10)


@pytest.mark.parametrize(
    ("pitch", "least", "most"),
    [(0.010, 0.591, 2.156), (0.0105, 0.522, 1.826), (0.01125, 0.440, 1.721)],
)
def test_the_bounds_of_the_power_of_16_by_16_elements(pitch, least, most):
    """And a focus radiates about what as many single elements would: 0.86 to 1.13 of it."""
    model = AcousticModel(TransducerArray.grid(16, 16, pitch_m=pitch), MEDIUM, SOURCE)
    places = model.array.positions_m
    coupling = np.sinc(K * np.linalg.norm(places[:, None] - places, axis=2) / np.pi)
    bounds = np.linalg.eigvalsh(coupling)
    assert bounds[[0, -1]] == pytest.approx([least, most], abs=1e-3)
    rng = np.random.default_rng(1)
    for target in rng.uniform([-0.06, -0.06, 0.05], [0.06, 0.06, 0.25], (40, 3)):
        weights = np.exp(1j * focus_phases(model, target))
        share = (weights.conj() @ coupling @ weights).real / 256
        assert bounds[0] < 0.8 <= share <= 1.2 < bounds[-1]
