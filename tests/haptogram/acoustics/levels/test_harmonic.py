"""Finite amplitude: the estimate against the integral of the second harmonic's source."""

import re

import numpy as np
import pytest

from haptogram.acoustics import AcousticModel, Drive, choose_engine, focus_phases, shock_lengths
from haptogram.acoustics.levels.harmonic import finite_amplitude_text
from haptogram.acoustics.model.boards.table import LAYOUTS

BETA = 1.2


def second_harmonic(engine, weights, focus, step=1e-3):
    """p2 = -beta k^2 / (2 pi rho c^2) int p1^2 e^{2jkR} / R dV, Westervelt's source."""
    model = engine.model
    places, margin = model.array.positions_m, 0.01
    low = np.minimum(places.min(0) - margin, focus - 2 * margin)
    high = np.maximum(places.max(0) + margin, focus + 2 * margin)
    low[2] = 0.003
    x, y, z = (np.arange(a, b, step) for a, b in zip(low, high, strict=True))
    total = 0j
    for level in z:
        points = np.stack(np.meshgrid(x, y, [level]), axis=-1).reshape(-1, 3)
        far = np.linalg.norm(points - focus, axis=1)
        outside = far > step / 2
        field, far = engine.pressure(weights, points[outside]), far[outside]
        total += (field**2 * np.exp(2j * model.wavenumber * far) / far).sum()
    stiffness = model.medium.density_kg_m3 * model.medium.sound_speed_m_s**2
    return abs(BETA * model.wavenumber**2 / (2 * np.pi * stiffness) * total) * step**3


@pytest.mark.parametrize(
    ("shape", "focus"),
    [((8, 8), (0.0, 0.0, 0.05)), ((8, 8), (0.02, 0.0, 0.08)), ((4, 4), (0.0, 0.0, 0.05))],
)
def test_half_a_shock_length_is_the_second_harmonic_within_a_fifth(shape, focus):
    model, focus = AcousticModel.default(*shape), np.array(focus)
    engine = choose_engine(model)
    weights = np.exp(1j * focus_phases(model, focus))
    first = abs(engine.pressure(weights, [focus])[0])
    sigma = shock_lengths(engine, weights, focus)
    assert sigma / 2 == pytest.approx(second_harmonic(engine, weights, focus) / first, rel=0.2)
    assert shock_lengths(engine, 0.25 * weights, focus) == pytest.approx(sigma / 4, rel=1e-6)


@pytest.mark.parametrize(
    ("share", "words"),
    [(1.0, "steep before it"), (0.5, r"about 36% of the pressure \(-9 dB\)"), (0.1, None)],
)
def test_what_the_linear_field_leaves_out_is_said_where_it_matters(share, words):
    model = AcousticModel.default()
    weights = share * np.exp(1j * focus_phases(model, (0.0, 0.0, 0.15)))
    text = finite_amplitude_text(choose_engine(model), weights, (0.0, 0.0, 0.15))
    assert (text is None) == (words is None)
    assert words is None or re.search(words, text)


def test_silence_and_elements_face_to_face_have_no_shock():
    model = AcousticModel.default(2, 2)
    assert shock_lengths(choose_engine(model), Drive.muted(4).weights(), (0, 0, 0.1)) == 0.0
    array = LAYOUTS["sonicsurface-stack"].array()
    facing = AcousticModel(array, model.medium, model.transducer)
    assert shock_lengths(choose_engine(facing), np.ones(array.count), (0.0, 0.0, 0.01)) is None
