"""Directivity of one element."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import oracles
from haptogram.acoustics import CircularPiston, PointSource, Transducer
from haptogram.errors import ConfigurationError

JINC = oracles.reference_fields()["scalars"]["jinc"]


@pytest.mark.parametrize(("argument", "expected"), JINC.items())
def test_piston_gain_agrees_with_50_digits(argument, expected):
    # With k a = 4 the sine of the angle is x / 4.
    cosine = np.array([math.sqrt(1.0 - (float(argument) / 4.0) ** 2)])
    gain = CircularPiston(4.0e-3).gain(cosine, 1000.0)
    assert gain == pytest.approx([float(expected)], abs=1e-14)


@given(st.floats(0.0, 1.0), st.floats(1e-3, 10e-3))
def test_piston_gain_agrees_with_the_integral_of_bessel(cosine, radius):
    expected = oracles.piston_gain(732.3 * radius * math.sqrt(1.0 - cosine**2))
    assert CircularPiston(radius).gain(np.array([cosine]), 732.3) == pytest.approx(
        [expected], abs=1e-13
    )


def test_the_default_piston_has_a_beam_of_80_degrees():
    gain = CircularPiston().gain(np.cos(np.radians([0.0, 40.0])), 2 * math.pi * 40e3 / 343.2)
    assert gain[0] == pytest.approx(1.0, abs=1e-15)
    assert 20 * math.log10(gain[1]) == pytest.approx(-6.02, abs=0.05)


def test_a_piston_is_silent_behind_its_baffle():
    assert (CircularPiston().gain(np.array([-1.0, -0.5, -1e-5]), 732.3) == 0.0).all()
    assert (PointSource().gain(np.array([-1.0, 0.5]), 732.3) == 1.0).all()


@pytest.mark.parametrize(
    "make",
    [
        lambda: CircularPiston(0.0),
        lambda: CircularPiston(math.inf),
        lambda: Transducer(source_strength_pa_m=0.0),
        lambda: Transducer(frequency_hz=0.0),
        lambda: Transducer(frequency_hz=2e6),
    ],
)
def test_an_impossible_transducer_is_refused(make):
    with pytest.raises(ConfigurationError):
        make()


@pytest.mark.parametrize("pattern", [None, 0.0047, "piston", CircularPiston])
def test_what_is_no_directivity_is_refused(pattern):
    with pytest.raises(ConfigurationError, match=r"^directivity is .*, must be one such as"):
        Transducer(pattern)
