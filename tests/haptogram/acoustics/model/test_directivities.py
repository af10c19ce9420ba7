"""The rectangular piston and measured tables."""

import cmath
import math

import numpy as np
import pytest
from hypothesis import given

from haptogram.acoustics import (
    AcousticModel,
    Medium,
    Transducer,
    TransducerArray,
    pressure,
    propagators,
)
from haptogram.acoustics.field.engines.engine import choose_engine
from haptogram.acoustics.model.directivities import RectangularPiston
from haptogram.errors import ConfigurationError
from strategies_acoustics import targets

K = 732.3
UP = np.array([[0.0, 0.0, 1.0]])


def rayleigh(point, width, height, cells=(24, 96)):
    """Pressure of a vibrating rectangle in the plane z = 0: a sum over its surface."""
    total = 0j
    for i in range(cells[0]):
        for j in range(cells[1]):
            x = ((i + 0.5) / cells[0] - 0.5) * width
            y = ((j + 0.5) / cells[1] - 0.5) * height
            r = math.dist(point, (x, y, 0.0))
            total += cmath.exp(1j * K * r) / r
    return total / (cells[0] * cells[1])


@given(targets(lateral=0.05, low=0.04, high=0.16))
def test_the_far_field_form_agrees_with_the_rayleigh_integral(target):
    distance = float(np.linalg.norm(target))
    gain = RectangularPiston(1e-3, 5e-3).gain_towards((target / distance)[None, None], UP, K)
    exact = rayleigh(target, 1e-3, 5e-3, (4, 16)) * distance
    assert gain[0, 0] == pytest.approx(abs(exact), rel=2e-3)


def test_the_rayleigh_sum_has_converged():
    point = (0.03, 0.04, 0.06)
    coarse, fine = (abs(rayleigh(point, 1e-3, 5e-3, n)) for n in ((4, 16), (16, 64)))
    assert coarse == pytest.approx(fine, rel=1e-3)


def test_the_field_uses_each_element_s_own_axes():
    """A second element that faces sideways sees the point along its normal."""
    normals = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    positions = np.array([[0.0, 0.0, 0.0], [-0.1, 0.0, 0.1]])
    array = TransducerArray.from_positions(positions, normals)
    piston = RectangularPiston(2e-3, 9e-3, (0.0, 1.0, 0.0))
    model = AcousticModel(array, Medium(343.0, 1.2), Transducer(piston, 1.0))
    gains = np.abs(propagators(model, [[0.0, 0.0, 0.1]]))[0]
    assert gains == pytest.approx([math.sqrt(2) / 0.1] * 2, rel=1e-12)


def test_width_and_height_are_not_confused():
    piston = RectangularPiston(1e-3, 8e-3)
    sideways = np.array(
        [[[math.sin(1.0), 0.0, math.cos(1.0)]], [[0.0, math.sin(1.0), math.cos(1.0)]]]
    )
    along_width, along_height = piston.gain_towards(sideways, UP, K)[:, 0]
    x, y = K * 0.5e-3 * math.sin(1.0), K * 4e-3 * math.sin(1.0)
    assert along_width == pytest.approx(math.sin(x) / x, rel=1e-12)
    assert along_height == pytest.approx(math.sin(y) / y, rel=1e-12)


def test_a_rectangle_is_silent_behind_its_baffle():
    down = np.array([[[0.0, 0.6, -0.8]]])
    assert RectangularPiston(1e-3, 5e-3).gain_towards(down, UP, K)[0, 0] == 0.0


def test_a_rectangle_never_passes_for_a_circle():
    with pytest.raises(ConfigurationError, match="gain_towards"):
        RectangularPiston(1e-3, 5e-3).gain(np.array([1.0]), K)


@pytest.mark.parametrize(
    "make",
    [
        lambda: RectangularPiston(0.0, 1e-3),
        lambda: RectangularPiston(1e-3, math.nan),
        lambda: RectangularPiston(1e-3, 1e-3, (0.0, 0.0, 0.0)),
        lambda: RectangularPiston(1e-3, 1e-3, (0.0, 0.0, 1.0)).gain_towards(UP[None], UP, K),
    ],
)
def test_an_impossible_rectangle_is_refused(make):
    with pytest.raises(ConfigurationError):
        make()


def test_the_engine_that_is_chosen_knows_rectangles():
    """The fast ones know circles only; they must not take a rectangle for one."""
    model = AcousticModel(
        TransducerArray.grid(4, 4), Medium(343.0, 1.2), Transducer(RectangularPiston(2e-3, 9e-3))
    )
    weights, points = np.exp(1j * np.arange(16.0)), [[0.03, 0.05, 0.06], [0.0, 0.04, 0.05]]
    chosen = choose_engine(model).pressure(weights, points)
    assert chosen == pytest.approx(pressure(model, weights, points), rel=1e-12)
