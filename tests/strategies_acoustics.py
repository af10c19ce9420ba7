"""Hypothesis strategies for arrays, targets and drives of sensible size."""

import dataclasses
import math

import numpy as np
from hypothesis import strategies as st

from haptogram.acoustics import (
    AcousticModel,
    CircularPiston,
    Drive,
    Medium,
    PointSource,
    RectangularPiston,
    Transducer,
    TransducerArray,
)

seeds = st.integers(0, 2**32 - 1)
phase_bits = st.integers(1, 16)
finite_angles = st.floats(-50.0, 50.0)


@st.composite
def grids(draw, smallest=2, largest=12):
    """Rectangular arrays of 5 to 12 mm pitch."""
    sides = st.integers(smallest, largest)
    return TransducerArray.grid(draw(sides), draw(sides), pitch_m=draw(st.floats(0.005, 0.012)))


@st.composite
def models(draw, arrays=None):
    """Models of any array, medium and directivity within reason."""
    medium = Medium(
        draw(st.floats(320.0, 360.0)),
        draw(st.floats(1.0, 1.4)),
        draw(st.sampled_from([0.0, 0.15])),
    )
    piston = CircularPiston(draw(st.floats(2e-3, 4.7e-3)))
    directivity = draw(st.sampled_from([PointSource(), piston]))
    return AcousticModel(
        draw(grids() if arrays is None else arrays), medium, Transducer(directivity)
    )


def rotation(rng):
    """A random proper rotation of three dimensions."""
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q * np.sign(np.linalg.det(q))


@dataclasses.dataclass(frozen=True)
class Pose:
    """A rigid motion: turned, then shifted."""

    turn: np.ndarray
    shift_m: np.ndarray

    @classmethod
    def any(cls, rng, reach_m=1.0):
        return cls(rotation(rng), rng.uniform(-reach_m, reach_m, 3))

    @classmethod
    def about(cls, axis, angle_rad, shift_m=(0.0, 0.0, 0.0)):
        """Turned around one of the axes x, y, z, by its number."""
        c, s = math.cos(angle_rad), math.sin(angle_rad)
        planes = np.roll(np.arange(3), -1 - axis)[:2]
        turn = np.eye(3)
        turn[np.ix_(planes, planes)] = [[c, -s], [s, c]]
        return cls(turn, np.asarray(shift_m))

    def points(self, points_m):
        return np.asarray(points_m) @ self.turn.T + self.shift_m

    def array(self, array):
        return TransducerArray.from_positions(
            self.points(array.positions_m), array.normals @ self.turn.T
        )

    def model(self, model):
        """The same array somewhere else: all that has a direction turns with it."""
        transducer, pattern = model.transducer, model.transducer.directivity
        if isinstance(pattern, RectangularPiston):
            pattern = dataclasses.replace(pattern, width_axis=self.turn @ pattern.width_axis)
            transducer = dataclasses.replace(transducer, directivity=pattern)
        return AcousticModel(self.array(model.array), model.medium, transducer)


@st.composite
def poses(draw, reach_m=1.0):
    """Any orientation, anywhere within *reach_m*."""
    return Pose.any(np.random.default_rng(draw(seeds)), reach_m)


@st.composite
def upright_poses(draw, reach_m=1.0):
    """Turned around the vertical only: the array still looks up."""
    shift_m = np.random.default_rng(draw(seeds)).uniform(-reach_m, reach_m, 3)
    return Pose.about(2, draw(st.floats(-math.pi, math.pi)), shift_m)


@st.composite
def targets(draw, lateral=0.060, low=0.050, high=0.250):
    """Points above the array, some of them on its axes of symmetry."""
    offset = st.one_of(st.just(0.0), st.floats(-lateral, lateral))
    return np.array([draw(offset), draw(offset), draw(st.floats(low, high))])


@st.composite
def hemisphere_targets(draw):
    """Points of the half ball of 50 mm radius around a centre 100 mm above the array."""
    radius = 0.050 * draw(st.floats(0.0, 1.0)) ** (1.0 / 3.0)
    height = draw(st.floats(-1.0, 1.0))
    angle = draw(st.floats(0.0, 2.0 * math.pi))
    lateral = radius * math.sqrt(1.0 - height**2)
    return np.array([lateral * math.cos(angle), lateral * math.sin(angle), 0.100 + radius * height])


@st.composite
def weights_of(draw, count):
    """Complex weights of *count* elements, magnitudes up to 1."""
    rng = np.random.default_rng(draw(seeds))
    return rng.uniform(0.0, 1.0, count) * np.exp(2j * np.pi * rng.uniform(0.0, 1.0, count))


@st.composite
def drives(draw, count=None):
    """Drives of any resolution."""
    bits = draw(phase_bits)
    size = draw(st.integers(1, 64)) if count is None else count
    phases = draw(st.lists(st.integers(0, 2**bits - 1), min_size=size, max_size=size))
    amplitudes = draw(st.lists(st.integers(0, 255), min_size=size, max_size=size))
    return Drive(np.array(phases), np.array(amplitudes), bits)
