"""The default model is the one that every figure of the project is stated for."""

import math

import pytest

from haptogram.acoustics import AcousticModel, CircularPiston, Medium


def test_the_default_model():
    model = AcousticModel.default()
    assert model.array.grid_shape == (16, 16)
    assert model.array.pitch_m == 0.010
    assert model.transducer.directivity == CircularPiston(4.70e-3)
    assert model.transducer.source_strength_pa_m == 3.10
    assert model.frequency_hz == 40e3
    assert model.wavelength_m == pytest.approx(Medium.air(20.0, 50.0).sound_speed_m_s / 40e3)
    assert model.wavenumber == pytest.approx(2 * math.pi / model.wavelength_m, rel=1e-12)


def test_temperature_changes_the_medium_and_nothing_else():
    cold, warm = (
        AcousticModel.default(temperature_c=10.0),
        AcousticModel.default(temperature_c=30.0),
    )
    assert cold.medium.sound_speed_m_s < warm.medium.sound_speed_m_s
    assert cold.array.digest() == warm.array.digest()
    assert cold.transducer == warm.transducer
