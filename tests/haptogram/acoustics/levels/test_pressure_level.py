"""Gradient and curvature of ln |p|^2, in both arithmetics, against differences of the field."""

import dataclasses
import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import oracles
from haptogram.acoustics import (
    AcousticModel,
    CircularPiston,
    PointSource,
    RectangularPiston,
    Transducer,
    TransducerArray,
    focus_phases,
)
from haptogram.acoustics.levels.shift import PressureLevel

ROOT = Path(__file__).parents[4]
TURN = np.array([[0.8, 0.0, 0.6], [0.0, 1.0, 0.0], [-0.6, 0.0, 0.8]])
RNG = np.random.default_rng(3)
#: Differences of the sixth order: moves, weights of the first and of the second derivative.
MOVES = np.arange(-3, 4)
FIRST = np.array([-1, 9, -45, 0, 45, -9, 1]) / 60.0
SECOND = np.array([2, -27, 270, -490, 270, -27, 2]) / 180.0
STEP_M = 8e-5


def jittered(count, tilt):
    places = TransducerArray.grid(count, count).positions_m + RNG.normal(
        0.0, (1e-3, 1e-3, 2e-3), (count * count, 3)
    )
    normals = np.array((0.0, 0.0, 1.0)) + RNG.normal(0.0, tilt, places.shape)
    return TransducerArray.from_positions(places, normals if tilt else None)


FLAT = AcousticModel.default(5, 5)
ARRAYS = {
    "5x5": FLAT.array,
    "2x3": TransducerArray.grid(2, 3),
    "16x16": TransducerArray.grid(16, 16),
    "turned": TransducerArray.grid(6, 4).moved(TURN, (0.01, -0.02, 0.05)),
    "scattered": jittered(5, 0.0),
    "looking aside": jittered(4, 0.2),
}
PISTONS = {
    "point": (PointSource(), lambda _: oracles.omnidirectional),
    "piston": (CircularPiston(), lambda k: oracles.circular_piston(k * 4.7e-3)),
    "wide piston": (CircularPiston(9e-3), lambda k: oracles.circular_piston(k * 9e-3)),
    "rectangle": (
        RectangularPiston(9e-3, 4e-3),
        lambda k: oracles.rectangular_piston(k * 4.5e-3, k * 2e-3, (1.0, 0.0, 0.0)),
    ),
}
PLACES = [(0.0, 0.0, 0.052), (0.01, 0.02, 0.06), (-0.03, 0.01, 0.12), (0.01, -0.03, 0.25)]


def differences(model, weights, place_m, axes, gain):
    """Gradient and curvature of ln |p|^2 along orthonormal *axes* by differences."""

    def along(way):
        points = place_m + STEP_M * MOVES[:, None] * way
        found = oracles.field(
            points, model.array.positions_m, model.array.normals, weights,
            wavenumber=model.wavenumber, absorption=model.medium.absorption_np_m,
            peak_strength=math.sqrt(2.0) * model.transducer.source_strength_pa_m, gain=gain,
        )  # fmt: skip
        sums = np.array([total for total, _ in found])
        middle = sums[3]
        return FIRST @ sums / STEP_M / middle, SECOND @ sums / STEP_M**2 / middle

    count = len(axes)
    slopes, own = np.array([along(axis) for axis in axes]).T
    bends = np.diag(own)
    for i in range(count):
        for j in range(i):
            mixed = (along(axes[i] + axes[j])[1] - own[i] - own[j]) / 2.0
            bends[i, j] = bends[j, i] = mixed
    return 2.0 * slopes.real, 2.0 * (bends - np.outer(slopes, slopes)).real


@pytest.mark.parametrize("kind", PISTONS)
@pytest.mark.parametrize("name", ARRAYS)
def test_gradient_and_curvature_are_those_of_the_field(name, kind):
    """Of the whole field: distance, air and directivity, along any axes."""
    array, (directivity, gain_at) = ARRAYS[name], PISTONS[kind]
    model = dataclasses.replace(FLAT, array=array, transducer=Transducer(directivity))
    rng = np.random.default_rng(7)
    for number, place in enumerate(PLACES[:2] if name == "16x16" else PLACES):
        target = array.world_m(np.array(place))
        weights = np.exp(1j * focus_phases(model, target))
        axes = np.linalg.qr(rng.normal(size=(3, 3)))[0][: 1 + number % 3]
        around = target + rng.uniform(-1e-3, 1e-3, 3)
        gradient, curvature = differences(model, weights, around, axes, gain_at(model.wavenumber))
        found = PressureLevel.at(model, weights, around, axes)
        size = np.abs(curvature).max()
        assert np.abs(found.gradient - gradient).max() < 1e-6 * math.sqrt(size)
        # What is large in the field, of the order of k^2, cancels in what is small.
        limit = 1e-6 * size + 1e-8 * model.wavenumber**2
        assert np.abs(found.curvature - curvature).max() < limit


def test_an_element_beside_which_a_place_lies_is_level_around():
    """There a baffle cuts the field off, and no difference across that edge is a derivative."""
    places = np.vstack([TransducerArray.grid(4, 4).positions_m, (0.1, 0.0, 0.05)])
    normals = np.array([(0.0, 0.0, 1.0)] * 17)
    model = dataclasses.replace(FLAT, array=TransducerArray.from_positions(places, normals))
    target = np.array([0.0, 0.0, 0.0501])
    weights = np.exp(1j * focus_phases(model, target))
    found = PressureLevel.at(model, weights, target, np.eye(3))
    without = PressureLevel.at(model, weights * (np.arange(17) < 16), target, np.eye(3))
    assert np.abs(found.curvature - without.curvature).max() < 0.2 * np.abs(found.curvature).max()


COMPILED = """
import numpy as np
from haptogram.acoustics import AcousticModel, TransducerArray, focus_phases
from haptogram.acoustics.field.engines.kernels import peaks
from haptogram.acoustics.field.engines.parallel import ParallelPistons
from haptogram.acoustics.levels.shift import PressureLevel
rng, sums = np.random.default_rng(2), np.empty(peaks.SUMS)
turn = np.array([[0.8, 0.0, 0.6], [0.0, 1.0, 0.0], [-0.6, 0.0, 0.8]])
for shape in ((5, 5), (4, 7), (8, 8)):
    for turned in (False, True):
        flat = AcousticModel.default(*shape)
        array = flat.array.moved(turn, (0.01, -0.02, 0.05)) if turned else flat.array
        model = AcousticModel(array, flat.medium, flat.transducer)
        pistons = ParallelPistons.of(model)
        for _ in range(6):
            target = array.world_m(rng.uniform((-0.05, -0.05, 0.03), (0.05, 0.05, 0.3)))
            pistons.places[3] = focus_phases(model, target) / (2.0 * np.pi)
            weights = np.exp(2j * np.pi * pistons.places[3])
            axes = np.linalg.qr(rng.normal(size=(3, 3)))[0][:2].copy()
            place = target + rng.uniform(-1e-3, 1e-3, 3)
            peaks._peak_sums_kernel(pistons.places, *place, axes, pistons.medium, sums)
            g0, g1, *found = peaks._derivatives_kernel(sums, True)
            level = PressureLevel.at(model, weights, place, axes)
            size = abs(level.curvature).max()
            bends = level.curvature[(0, 0, 1), (0, 1, 1)]
            assert np.abs(found[:3] - bends).max() < 1e-9 * size, (shape, found, bends)
            assert np.abs(level.gradient - (g0, g1)).max() < 1e-9 * size**0.5
            assert found[3] == level.is_peak
"""


def test_the_compiled_derivatives_are_the_same():
    pytest.importorskip("numba")
    paths = os.pathsep.join([str(ROOT), str(ROOT / "protocol")])
    done = subprocess.run(
        [sys.executable, "-c", COMPILED],
        env=os.environ | {"PYTHONPATH": paths, "NUMBA_DISABLE_JIT": "1"},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
