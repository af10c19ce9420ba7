"""Every way to the field gives the same field, wherever the array lies and whichever way it faces.

The measure is the triple loop of `oracles`, on the array as it was before it was turned and moved:
so each way is held against the others, against the equations, and to both invariances at once. And
so it is for elements that are calibrated: the loop takes what they radiate from where they are.
"""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings

import oracles
from haptogram.acoustics import (
    AcousticModel,
    Calibration,
    CircularPiston,
    Medium,
    NumbaEngine,
    NumpyEngine,
    PointSource,
    RectangularPiston,
    Resonator,
    Transducer,
    TransducerArray,
    force_on_disc_n,
    mean_square_pressure,
    pressure,
    propagators,
)
from haptogram.acoustics.field.engines.engine import choose_engine
from haptogram.acoustics.field.engines.numba_engine import _APERTURE_LOSS
from strategies_acoustics import poses, seeds

pytestmark = pytest.mark.sampled(6)

MEDIUM = Medium(343.2, 1.204, 0.15)
K = 2.0 * math.pi * 40e3 / 343.2
STRENGTH = 3.1
AXIS = (0.6, 0.8, 0.0)


class FallingToTheRear:
    """A pattern of a user's own: 1 ahead, 0 behind, and straight between them."""

    baffled = False

    def gain(self, cos_theta, wavenumber):  # noqa: ARG002  (Directivity)
        return 1.0 - np.arccos(np.clip(cos_theta, -1.0, 1.0)) / np.pi


# Each pattern with the equation that the oracle has of it.
PATTERNS = {
    "point": (PointSource(), oracles.omnidirectional),
    "circle": (CircularPiston(4.7e-3), oracles.circular_piston(K * 4.7e-3)),
    "rectangle": (
        RectangularPiston(3e-3, 7e-3, AXIS),
        oracles.rectangular_piston(K * 1.5e-3, K * 3.5e-3, AXIS),
    ),
    "own": (FallingToTheRear(), oracles.falling_to_the_rear),
}
WITH_SINGLE_PRECISION = ("point", "circle")


def grid(rng):
    return TransducerArray.grid(*rng.integers(1, 4, 2), pitch_m=rng.uniform(5e-3, 12e-3))


def grid_with_a_hole(rng):
    whole = TransducerArray.grid(4, 3).positions_m
    return TransducerArray.from_positions(np.delete(whole, rng.integers(12), axis=0))


def scattered(rng):
    """Elements that look up and aside."""
    places = rng.uniform(-0.06, 0.06, (7, 3)) * [1.0, 1.0, 0.2]
    return TransducerArray.from_positions(places, rng.normal(size=(7, 3)) * 0.3 + [0.0, 0.0, 1.0])


LAYOUTS = {"grid": grid, "holes": grid_with_a_hole, "scattered": scattered}

# (engine's pressure of one drive, share of the sum of magnitudes that it may be off)
REFERENCE = {
    "pressure": (lambda m, w, x: pressure(m, w, x), 1e-11),
    "pressure of several": (lambda m, w, x: pressure(m, np.stack([0 * w, w]), x)[1], 1e-11),
    "propagators": (lambda m, w, x: propagators(m, x) @ w, 1e-11),
    "reference engine": (lambda m, w, x: NumpyEngine(m).pressure(w, x), 1e-11),
    "chosen engine": (lambda m, w, x: choose_engine(m).pressure(w, x), 2e-5),
}
SINGLE = {
    f"{kind.__name__} {way}": (call, 2e-5)
    for kind in (NumbaEngine,)
    for way, call in {
        "loops": lambda m, w, x, kind=kind: kind(m).pressure(w, x),
        "waves": lambda m, w, x, kind=kind: kind(m).pressure(np.stack([0.5 * w, w]), x)[1],
        "propagators": lambda m, w, x, kind=kind: kind(m).propagators(x) @ w,
    }.items()
}


def measured(rng, array, away_m):
    """Elements of any phase, of which one is dead, in their places or beside them."""
    gain = np.where(np.arange(array.count) == rng.integers(array.count + 1), 0.0, 1.3)
    phase = rng.uniform(-3.0, 3.0, array.count)
    away = away_m * rng.uniform(-1.0, 1.0, (array.count, 3))
    return Calibration(gain if gain.any() else gain + 1.0, phase, array.positions_m + away)


def moved_with(pose, found):
    return dataclasses.replace(found, positions_m=pose.points(found.positions_m))


def oracle(model, points, weights, gain):
    """Pressure and sum of magnitudes, each (M,)."""
    found = oracles.field(
        points, model.array.positions_m, model.array.normals, weights,
        wavenumber=K, absorption=0.15, peak_strength=math.sqrt(2.0) * STRENGTH, gain=gain,
    )  # fmt: skip
    return np.array(found).T[0], np.array(found).T[1].real


@pytest.mark.sampled(2)
@pytest.mark.parametrize("away_m", [None, 0.0, 3e-4], ids=["equal", "lagging", "beside"])
@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("pattern", PATTERNS)
@given(seed=seeds, pose=poses())
@settings(max_examples=6)
def test_every_way_is_the_triple_loop_in_any_pose(pattern, layout, away_m, seed, pose):
    rng = np.random.default_rng(seed)
    directivity, gain = PATTERNS[pattern]
    model = AcousticModel(LAYOUTS[layout](rng), MEDIUM, Transducer(directivity, STRENGTH))
    weights = rng.normal(size=(model.array.count, 2)) @ [1, 1j]
    points = np.column_stack([rng.uniform(-0.1, 0.1, (6, 2)), rng.uniform(0.03, 0.3, 6)])
    moved, places, radiated = pose.model(model), pose.points(points), weights
    if away_m is not None:
        found = measured(rng, model.array, away_m)
        moved = moved.calibrated(moved_with(pose, found))
        model, radiated = model.calibrated(found), weights * found.response
    expected, scale = oracle(model, points, radiated, gain)
    ways = REFERENCE | (SINGLE if pattern in WITH_SINGLE_PRECISION else {})
    for name, (way, tolerance) in ways.items():
        error = np.abs(way(moved, weights, places) - expected)
        assert (error <= tolerance * scale).all(), name


@pytest.mark.sampled(2)
@pytest.mark.parametrize("kind", [NumbaEngine])
@pytest.mark.parametrize("active", [1, 80])
@pytest.mark.parametrize("loss", [0.0, 0.99])
@given(seed=seeds)
@settings(max_examples=3)
def test_single_precision_keeps_its_promise_at_its_limits(kind, active, loss, seed):
    """One element whose errors nothing evens out; air that absorbs as much as an engine takes.

    2e-5 of the magnitudes, from as near to as far as it goes; and so beside a point beyond that,
    which goes another way.
    """
    rng = np.random.default_rng(seed)
    array = TransducerArray.grid(10, 9)
    absorption = loss * _APERTURE_LOSS / np.linalg.norm(array.positions_m, axis=1).max()
    model = AcousticModel(array, Medium(343.2, 1.2, absorption), Transducer())
    weights = np.zeros(90, dtype=complex)
    weights[rng.choice(90, active, replace=False)] = np.exp(2j * np.pi * rng.random(active))
    directions = rng.normal(size=(1500, 3)) * [1.0, 1.0, 0.7]
    directions[:, 2] = np.abs(directions[:, 2])
    distances = np.geomspace(0.01, 8.0, 1500)  # in order: a block of them is near, or far
    points = directions / np.linalg.norm(directions, axis=1)[:, None] * distances[:, None]
    points[:, 2] += 3e-3
    for places in (points, np.vstack([points, [[0.0, 0.0, 30.0]]])):
        matrix = propagators(model, places)
        error = np.abs(kind(model).pressure(weights, places) - matrix @ weights)
        assert (error <= 2e-5 * (np.abs(matrix) @ np.abs(weights))).all()


@pytest.mark.parametrize("kind", [NumbaEngine])
@given(seed=seeds)
@settings(max_examples=6)
def test_force_and_mean_square_do_not_depend_on_the_engine(kind, seed):
    """Within twice the engine's error in the pressure, of the largest that the drive can make."""
    rng = np.random.default_rng(seed)
    model = AcousticModel(grid_with_a_hole(rng), MEDIUM, Transducer())
    drives = rng.normal(size=(3, 11, 2)) @ [1, 1j]
    points = rng.uniform(0.05, 0.15, (5, 3))
    largest = 0.5 * (np.abs(drives) @ np.abs(propagators(model, points)).T) ** 2
    for resonator in (None, Resonator(4e-4)):
        exact, found = (
            mean_square_pressure(engine, drives, points, 1e-3, resonator)
            for engine in (NumpyEngine(model), kind(model))
        )
        assert (np.abs(found - exact) <= 1e-4 * largest.max(axis=0)).all()
    exact, found = (
        force_on_disc_n(engine, drives[0], [0.01, 0.02, 0.08])
        for engine in (NumpyEngine(model), kind(model))
    )
    assert found == pytest.approx(exact, rel=1e-3)
