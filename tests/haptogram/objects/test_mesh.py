"""Points on meshes: on the surface, one per square of a resolution, a way round that closes."""

import math
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from haptogram.errors import ConfigurationError
from haptogram.objects.mesh import round_trip_over_mesh
from haptogram.objects.shapes import MeshSurface

DATA = Path(__file__).parents[2] / "data"
CENTER_M = (0.0, 0.0, 0.12)


def two_balls():
    """Two bodies that do not touch, one far larger."""
    large, small = trimesh.creation.icosphere(2, 0.03), trimesh.creation.icosphere(2, 0.01)
    small.apply_translation((0.06, 0, 0))
    return trimesh.util.concatenate([large, small])


def half_ball():
    """A surface with a rim."""
    ball = trimesh.creation.icosphere(3, 0.04)
    ball.update_faces(ball.triangles_center[:, 2] < 0.0)
    ball.remove_unreferenced_vertices()
    return ball


MESHES = {
    "box": trimesh.creation.box((0.06, 0.04, 0.03)),
    "sphere": trimesh.creation.icosphere(3, 0.04),
    "open": half_ball(),
    "flat": trimesh.Trimesh(
        [[0, 0, 0], [0.08, 0, 0], [0.08, 0.05, 0], [0, 0.05, 0]], [[0, 1, 2], [0, 2, 3]]
    ),
}
every_mesh = pytest.mark.parametrize("mesh", MESHES.values(), ids=MESHES)


def steps_of(points):
    """Every step, also the one from the last point back to the first."""
    return np.linalg.norm(points - np.roll(points, 1, axis=0), axis=1)


def distance_from(mesh, points):
    """Distance of every point from the nearest triangle: brute force, as the meshes are small."""
    triangles = np.repeat(mesh.triangles[None], len(points), axis=0).reshape(-1, 3, 3)
    targets = np.repeat(points, len(mesh.triangles), axis=0)
    nearest = trimesh.triangles.closest_point(triangles, targets)
    apart = np.linalg.norm(nearest - targets, axis=1)
    return apart.reshape(len(points), -1).min(axis=1)


@every_mesh
@pytest.mark.parametrize("resolution_m", [0.010, 0.005])
def test_points_lie_on_the_surface(mesh, resolution_m):
    assert distance_from(mesh, MeshSurface(mesh).sample(resolution_m)).max() < 1e-12


@every_mesh
@pytest.mark.parametrize("resolution_m", [0.010, 0.005, 0.002])
def test_there_are_as_many_points_as_squares_of_a_resolution(mesh, resolution_m):
    count = len(MeshSurface(mesh).sample(resolution_m))
    # Around a flat piece that is a few resolutions wide, a point stands for half a square outside.
    edge = 1.0 + 2.0 * resolution_m / math.sqrt(mesh.area)
    assert 0.85 < count / (mesh.area / resolution_m**2) < 1.1 * edge


@every_mesh
@pytest.mark.parametrize("resolution_m", [0.010, 0.005, 0.002])
def test_points_are_spread_evenly(mesh, resolution_m):
    points = MeshSurface(mesh).sample(resolution_m)
    nearest = cKDTree(points).query(points, k=2)[0][:, 1] / resolution_m
    assert nearest.min() > 0.75
    assert nearest.max() < 1.6
    # No hole either: the surface is nowhere further than that from a point.
    anywhere, _ = trimesh.sample.sample_surface(mesh, 2000, seed=1)
    assert cKDTree(points).query(anywhere)[0].max() < 1.35 * resolution_m


@every_mesh
@pytest.mark.parametrize("resolution_m", [0.010, 0.005, 0.002])
def test_the_way_round_has_no_long_jump_and_closes(mesh, resolution_m):
    steps = steps_of(MeshSurface(mesh).sample(resolution_m)) / resolution_m
    assert steps.max() < 4.5
    assert steps.mean() < 1.7


@pytest.mark.parametrize("width_m", [1e-2, 1e-3, 1e-4, 1e-6])
@pytest.mark.parametrize("resolution_m", [0.010, 0.005, 0.002])
def test_a_thin_surface_has_no_gaps(width_m, resolution_m):
    """A strip of 200 mm: its area has room for few points, its length for many."""
    corners = [[0, 0, 0], [0.2, 0, 0], [0.2, width_m, 0], [0, width_m, 0]]
    strip = MeshSurface(trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]]))
    places = np.sort(strip.sample(resolution_m)[:, 0])
    gaps = np.diff(np.concatenate([[0.0], places, [0.2]]))
    assert gaps.max() < 2.5 * resolution_m


def test_a_thread_that_is_too_long_is_refused():
    corners = [[0, 0, 0], [20.0, 0, 0], [20.0, 1e-9, 0]]
    with pytest.raises(ConfigurationError, match="points at this resolution, must be 200000"):
        MeshSurface(trimesh.Trimesh(corners, [[0, 1, 2]])).sample(1e-5)


def test_bodies_apart_are_joined_by_few_jumps():
    points = MeshSurface(two_balls()).sample(0.003)
    gap_m = 0.06 - 0.03 - 0.01
    steps = steps_of(points)
    on_small = points[:, 0] > 0.04
    assert on_small.any()
    assert (on_small != np.roll(on_small, 1)).sum() == 2  # there and back
    assert steps.max() < gap_m + 4.5 * 0.003
    assert (steps > 4.5 * 0.003).sum() <= 4


def test_every_body_is_joined_to_the_nearest_one():
    rng = np.random.default_rng(3)
    clusters = [np.add(rng.uniform(-0.5, 0.5, (30, 3)), (10.0 * n, 0, 0)) for n in range(5)]
    points = np.concatenate(clusters)
    # Were all joined to the first one, a step would go from the last to it, 40 away.
    assert steps_of(points[round_trip_over_mesh(points)]).max() < 25.0


@given(st.integers(1, 60), st.integers(0, 2**32 - 1))
def test_the_way_round_visits_every_point_once(count, seed):
    points = np.random.default_rng(seed).normal(size=(count, 3))
    assert sorted(round_trip_over_mesh(points)) == list(range(count))


@given(st.integers(3, 200))
def test_a_row_of_points_is_walked_out_and_back(count):
    row = np.outer(np.arange(count), (1.0, 0.0, 0.0))
    assert steps_of(row[round_trip_over_mesh(row)]).max() <= 3.0


def test_the_way_round_begins_at_the_lowest_point():
    points = MeshSurface(MESHES["sphere"]).sample(0.005)
    assert points[0, 2] == points[:, 2].min()


@every_mesh
def test_sampling_a_mesh_repeats_exactly(mesh):
    surface = MeshSurface(mesh)
    np.testing.assert_array_equal(surface.sample(0.005), surface.sample(0.005))


# --- Files --------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["cube.stl", "cube.obj", "cube.ply"])
def test_a_file_is_in_millimetres_and_put_where_it_is_wanted(name):
    surface = MeshSurface.from_file(DATA / name, center_m=CENTER_M)  # a cube of 20 mm
    np.testing.assert_allclose(surface.mesh.bounds, np.add(CENTER_M, [[-0.01] * 3, [0.01] * 3]))
    points = surface.sample(0.002)
    sides = np.abs(points - CENTER_M).max(axis=1)
    np.testing.assert_allclose(sides, 0.01, atol=1e-8)  # an STL file holds 32-bit floats


def test_a_file_in_another_unit_stays_where_it_is():
    surface = MeshSurface.from_file(DATA / "cube.stl", unit_m=1.0)
    np.testing.assert_allclose(surface.mesh.bounds, [[0, 0, 0], [20, 20, 20]])


def test_all_formats_give_the_same_surface():
    areas = [
        MeshSurface.from_file(DATA / f"cube.{kind}").mesh.area for kind in ("stl", "obj", "ply")
    ]
    np.testing.assert_allclose(areas, 6 * 0.02**2, rtol=1e-6)


def write(path, text):
    path.write_text(text)
    return path


POINT_CLOUD = """ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
end_header
0 0 0
1 0 0
0 1 0
"""
FLAT_TO_NOTHING = "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n"  # three points on one line
NO_VERTEX = POINT_CLOUD.replace(
    "end_header", "element face 1\nproperty list uchar int vertex_indices\nend_header"
)
NOT_FINITE = "v 0 0 0\nv 1 0 0\nv 0 nan 0\nv 1 1 0\nf 1 2 3\nf 1 2 4\n"


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("cloud.ply", POINT_CLOUD, "no surface"),
        ("flat.obj", FLAT_TO_NOTHING, "no surface"),
        ("nan.obj", NOT_FINITE, "not finite"),
        ("above.ply", NO_VERTEX + "3 0 1 7\n", "a triangle has the vertex 7, must be 0 to 2"),
        ("below.ply", NO_VERTEX + "3 0 1 -1\n", "a triangle has the vertex -1, must be 0 to 2"),
        ("empty.obj", "", "the file is empty"),
        ("empty.stl", "", "the file is empty"),
        ("noise.stl", "solid of nothing", "no surface|not a mesh"),
        ("noise.ply", "ply?", "not a mesh"),
        ("table.csv", "1,2,3\n", "not a mesh"),
    ],
)
def test_a_file_without_a_surface_is_refused(tmp_path, name, text, message):
    path = write(tmp_path / name, text)
    with pytest.raises(ConfigurationError, match=message) as caught:
        MeshSurface.from_file(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("name", "message"), [("nowhere.stl", "no such file"), (".", "a folder")])
def test_no_file_is_refused(tmp_path, name, message):
    with pytest.raises(ConfigurationError, match=message):
        MeshSurface.from_file(tmp_path / name)


@pytest.mark.parametrize("suffix", [".stl", ".obj", ".ply"])
def test_bytes_of_any_kind_are_refused_in_plain_words(tmp_path, suffix):
    noise = np.random.default_rng(1)
    for number in range(20):
        path = tmp_path / f"{number}{suffix}"
        path.write_bytes(noise.bytes(int(noise.integers(1, 300))))
        with pytest.raises(ConfigurationError) as caught:
            MeshSurface.from_file(path)
        message = str(caught.value).removeprefix(f"{path}: ")
        assert message.startswith(("not a mesh that can be read as ", "the mesh has "))


def test_a_file_that_cannot_be_opened_is_refused_with_the_reason(tmp_path, monkeypatch):
    path = write(tmp_path / "locked.stl", "solid")

    def locked(*_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(type(path), "open", locked)
    with pytest.raises(ConfigurationError, match=r"locked\.stl.*: there is no permission"):
        MeshSurface.from_file(path)


def test_without_the_extra_the_message_names_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "trimesh", None)  # as if it were not installed
    with pytest.raises(ConfigurationError, match=r"need trimesh: pip install .*\[mesh\]'"):
        MeshSurface.from_file(DATA / "cube.stl")


@pytest.mark.parametrize("unit_m", [0.0, -1e-3, math.nan, math.inf])
def test_a_unit_that_is_none_is_refused(unit_m):
    with pytest.raises(ConfigurationError, match="unit_m"):
        MeshSurface.from_file(DATA / "cube.stl", unit_m=unit_m)


def test_a_centre_that_is_none_is_refused():
    with pytest.raises(ConfigurationError, match="center_m"):
        MeshSurface.from_file(DATA / "cube.stl", center_m=(0, 0, math.nan))


@pytest.mark.parametrize(
    ("resolution_m", "message"),
    [
        (0.0, "must be 1e-05 to 100"),
        (math.nan, "must be 1e-05 to 100"),
        (0.061, "not be more than the object's 60 mm"),
        (2e-5, "or fewer"),
    ],
)
def test_a_mesh_refuses_what_it_cannot_be_sampled_at(resolution_m, message):
    with pytest.raises(ConfigurationError, match=message):
        MeshSurface(MESHES["box"]).sample(resolution_m)
