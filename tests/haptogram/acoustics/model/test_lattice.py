"""Lattices are recognised wherever they lie, and nothing else is taken for one."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram.acoustics import TransducerArray
from haptogram.acoustics.model.lattice import find_lattice, plane_axes
from strategies_acoustics import grids, poses, seeds


@given(grids(1, 12), poses(reach_m=2.0))
def test_every_element_lies_on_its_node(array, pose):
    array = pose.array(array)
    lattice = find_lattice(array)
    assert lattice is not None
    assert sorted(lattice.elements[lattice.elements >= 0]) == list(range(array.count))
    for (ix, iy), n in np.ndenumerate(lattice.elements):
        if n >= 0:
            place = np.array([lattice.x_m[ix], lattice.y_m[iy], 0.0]) @ lattice.axes
            assert place + array.centre_m == pytest.approx(array.positions_m[n], abs=2e-9)
    assert lattice.axes @ lattice.axes.T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(lattice.axes) == pytest.approx(1.0)
    assert lattice.axes[2] == pytest.approx(array.normals[0])


def test_a_grid_keeps_its_own_order():
    lattice = find_lattice(TransducerArray.grid(3, 4))
    assert (lattice.elements == np.arange(12).reshape(3, 4)).all()
    assert lattice.x_m == pytest.approx([-0.01, 0.0, 0.01])
    assert lattice.spread(np.arange(12.0)).shape == (3, 4)


def test_nodes_may_be_empty_but_not_too_many():
    positions = TransducerArray.grid(5, 5).positions_m
    some = TransducerArray.from_positions(np.delete(positions, [3, 12], axis=0))
    lattice = find_lattice(some)
    assert (lattice.elements == -1).sum() == 2
    assert (lattice.spread(np.ones(23)) == (lattice.elements >= 0)).all()
    diagonal = TransducerArray.from_positions(
        positions[::6] + [[0, 0.001 * n, 0] for n in range(5)]
    )
    line = find_lattice(TransducerArray.from_positions(positions[::6]))
    assert line is not None
    assert line.elements.shape in {(5, 1), (1, 5)}
    assert find_lattice(diagonal) is not None  # a line of unequal steps in another direction


@given(seeds, st.sampled_from(["height", "normal", "place"]))
def test_an_element_out_of_line_makes_it_no_lattice(seed, what):
    rng = np.random.default_rng(seed)
    array = TransducerArray.grid(4, 4)
    positions, normals = array.positions_m.copy(), array.normals.copy()
    n = rng.integers(16)
    if what == "height":
        positions[n, 2] += 1e-5
    elif what == "normal":
        normals[n, 0] += 1e-3
    else:  # scattered places need more nodes than there are elements
        positions[:, :2] += rng.uniform(-1e-3, 1e-3, (16, 2))
    assert find_lattice(TransducerArray.from_positions(positions, normals)) is None


def test_a_direction_along_the_normal_gives_no_axes():
    assert plane_axes(np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, 2.0])) is None
