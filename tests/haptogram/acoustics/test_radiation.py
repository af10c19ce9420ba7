"""Levels, radiation pressure, force: published values, symmetry, convergence."""

import math

import numpy as np
import pytest
from hypothesis import given, settings

from haptogram.acoustics import (
    AcousticModel,
    Medium,
    NumpyEngine,
    Transducer,
    TransducerArray,
    focus_phases,
    force_on_disc_n,
    level_db_spl,
    pressure,
    radiation_pressure_pa,
    superpose,
)
from haptogram.acoustics.radiation import disc_nodes
from haptogram.errors import ConfigurationError
from strategies_acoustics import seeds, targets

AIR = Medium(343.2, 1.2041)


def strong(array):
    """A model of 6 Pa m RMS per element: 120 dB at 0.3 m."""
    return AcousticModel(array, Medium.air(), Transducer(source_strength_pa_m=6.0))


def midpoint_force(model, weights, centre, radius, rings=80, spokes=120):
    """Force by a plain midpoint rule, the independent way to the same integral."""
    r = (np.arange(rings) + 0.5) / rings * radius
    angle = (np.arange(spokes) + 0.5) / spokes * 2 * np.pi
    x, y = np.outer(r, np.cos(angle)).ravel(), np.outer(r, np.sin(angle)).ravel()
    points = np.stack([x, y, 0 * x], axis=1) + centre
    area = np.repeat(r, spokes) * (radius / rings) * (2 * np.pi / spokes)
    mean_square = np.abs(pressure(model, weights, points)) ** 2 / 2
    stiffness = model.medium.density_kg_m3 * model.medium.sound_speed_m_s**2
    return 2 * float(mean_square @ area) / stiffness


def test_levels():
    assert level_db_spl(20e-6) == 0.0
    assert level_db_spl(2.0) == pytest.approx(100.0)
    assert level_db_spl(0.0) == -math.inf


def test_radiation_pressure_uses_the_rms_of_the_peak_phasor():
    """p_peak^2 / (rho c^2) at total reflection, half of it at absorption."""
    stiffness = AIR.density_kg_m3 * AIR.sound_speed_m_s**2
    assert radiation_pressure_pa(1000j, AIR) == pytest.approx(1e6 / stiffness)
    assert radiation_pressure_pa([1000.0], AIR, 1.0) == pytest.approx([0.5e6 / stiffness])


def test_the_levels_of_a_16_by_16_array_at_100_mm():
    """At 6 Pa m: 8.60 kPa RMS (172.7 dB), 1042 Pa."""
    model, target = strong(TransducerArray.grid(16, 16)), np.array([0, 0, 0.1])
    weights = np.exp(1j * focus_phases(model, target))
    peak = pressure(model, weights, [target])[0]
    assert abs(peak) / math.sqrt(2) == pytest.approx(8600, rel=2e-3)
    assert level_db_spl(abs(peak) / math.sqrt(2)) == pytest.approx(172.7, abs=0.05)
    assert float(radiation_pressure_pa(peak, model.medium)) == pytest.approx(1042, rel=4e-3)


def test_the_18_by_18_prototype_at_200_mm():
    """74.4 mN within 10 mm at 6 Pa m, so 16 mN (measured, Hoshi et al. 2010) is 2.78 Pa m."""
    model, target = strong(TransducerArray.grid(18, 18)), np.array([0, 0, 0.2])
    force = force_on_disc_n(model, np.exp(1j * focus_phases(model, target)), target)
    assert force == pytest.approx(74.4e-3, rel=5e-3)
    assert 6.0 * math.sqrt(16e-3 / force) == pytest.approx(2.78, abs=0.02)


@given(targets(low=0.03), seeds)
@settings(max_examples=9)
def test_the_quadrature_agrees_with_a_midpoint_rule(target, seed):
    """To 0.5 % for one focus or two, on the disc's centre or beside it, for any radius."""
    rng = np.random.default_rng(seed)
    model = AcousticModel.default(*[(16, 16), (8, 8), (32, 4)][seed % 3])
    points = [target, target + rng.normal(0, 0.006, 3) + [0, 0, 0.01]]
    weights = superpose(model, points, [1.0, rng.uniform(0, 1)], [0.0, rng.uniform(0, 6)])
    centre = target + rng.normal(0, 0.002, 3)
    radius = [0.003, 0.010, 0.025][seed % 3]
    expected = midpoint_force(model, weights, centre, radius)
    assert force_on_disc_n(model, weights, centre, radius) == pytest.approx(expected, rel=5e-3)


def test_the_nodes_cover_the_disc_exactly_once():
    offsets, areas = disc_nodes(0.010, 732.3)
    assert len(areas) <= 300
    assert areas.sum() == pytest.approx(math.pi * 1e-4, rel=1e-12)
    assert areas @ (offsets[:, 0] ** 2) == pytest.approx(math.pi * 1e-8 / 4, rel=1e-12)
    assert np.hypot(offsets[:, 0], offsets[:, 1]).max() < 0.010
    assert (offsets[:, 2] == 0.0).all()


def test_an_engine_gives_the_force_of_its_model():
    model = AcousticModel.default(4, 4)
    engine = NumpyEngine(model)
    assert force_on_disc_n(engine, np.ones(16), [0, 0, 0.1]) == force_on_disc_n(
        model, np.ones(16), [0, 0, 0.1]
    )


@pytest.mark.parametrize(
    ("call", "complaint"),
    [
        (lambda m: force_on_disc_n(m, np.ones(4), [0, 0, 0.1], 0.0), "radius_m is 0"),
        (lambda m: force_on_disc_n(m, np.ones(4), [0, 0, 0.1], 0.2), "radius_m is 0.2.* 0.1"),
        (lambda m: force_on_disc_n(m, np.ones(4), [0, 0]), r"centre_m has shape \(2,\)"),
        (lambda m: force_on_disc_n(m, np.ones((2, 4)), [0, 0, 0.1]), "2 drives"),
        (lambda m: radiation_pressure_pa(1.0, m.medium, 2.5), "reflection is 2.5, must be 1 to 2"),
        (lambda _: level_db_spl(-1.0), "pressure_rms_pa is -1"),
        (lambda _: level_db_spl(math.nan), "pressure_rms_pa is nan"),
        (lambda _: disc_nodes(0.01, 0.0), "wavenumber is 0"),
    ],
)
def test_bad_arguments_are_refused_with_value_and_limit(call, complaint):
    with pytest.raises(ConfigurationError, match=complaint):
        call(AcousticModel.default(2, 2))
