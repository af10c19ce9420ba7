"""Triangle meshes: reading, points spread evenly over the surface, a short way round them."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics.arrays import FloatArray
from haptogram.errors import ConfigurationError, missing_extra
from haptogram.machine.files import check_file_has_content

if TYPE_CHECKING:
    import trimesh
    from scipy.sparse import csr_array

Indices: TypeAlias = NDArray[np.intp]

_CANDIDATES_PER_POINT: Final = 8  # random points, of which an even subset is kept
_LEAST_SPACING: Final = 0.75  # least distance, in resolutions; thinning then leaves one per square
_NEIGHBOURS: Final = 8  # neighbours of a point: enough for the shortest tree on an even surface


def read_mesh(path: Path) -> trimesh.Trimesh:
    """Return the mesh in an STL, OBJ or PLY file, in the unit of the file.

    Raises
    ------
    ConfigurationError
        If the file cannot be read, holds no surface, or the extra ``mesh`` is not installed.
    """
    try:
        import trimesh
    except ImportError as error:
        raise missing_extra(f"{path}: meshes need trimesh", "mesh") from error
    check_file_has_content(path, "object")
    try:
        # Unprocessed: processing drops triangles that are not finite without a word.
        source = _mesh_as_text(path) if path.suffix.lower() == ".obj" else path
        kind = path.suffix[1:].lower()
        # A cloud of points has no faces.
        mesh: Any = trimesh.load_mesh(source, file_type=kind, process=False)
    except Exception as error:  # the parsers of the formats raise whatever they meet
        raise ConfigurationError(
            f"{path}: not a mesh that can be read as {path.suffix[1:].upper()}; export it anew"
        ) from error
    if not isinstance(mesh, trimesh.Trimesh) or not len(mesh.faces):
        raise ConfigurationError(f"{path}: the mesh has no surface")
    low, high, vertices = int(mesh.faces.min()), int(mesh.faces.max()), len(mesh.vertices)
    if low < 0 or high >= vertices:
        raise ConfigurationError(
            f"{path}: a triangle has the vertex {low if low < 0 else high}, must be 0 to "
            f"{vertices - 1}"
        )
    if not np.isfinite(mesh.vertices).all():
        raise ConfigurationError(f"{path}: the mesh has a vertex that is not finite")
    with np.errstate(over="ignore"):  # of vertices at 1e300
        area = float(mesh.area)
    if not area > 0.0:
        raise ConfigurationError(f"{path}: the mesh has no surface: its area is {area:g}")
    return mesh


def _mesh_as_text(path: Path) -> io.StringIO:
    """Return the text of an OBJ file, whose names and comments may be in any encoding."""
    return io.StringIO(path.read_text(encoding="utf-8", errors="replace"))


def even_mesh_points(mesh: trimesh.Trimesh, count: int, resolution_m: float) -> FloatArray:
    """Return about *count* points of the surface, none much nearer than a resolution to another.

    Random points, always the same ones, are taken in turn, unless one that is already there is too
    near (dart throwing).
    """
    import trimesh
    from scipy.spatial import cKDTree

    sampled, _ = trimesh.sample.sample_surface(mesh, _CANDIDATES_PER_POINT * count, seed=0)
    candidates: FloatArray = np.asarray(sampled, dtype=np.float64)
    tree = cKDTree(candidates)
    free = np.ones(len(candidates), dtype=np.bool_)
    kept: list[int] = []
    for index in range(len(candidates)):
        if free[index]:
            kept.append(index)
            free[tree.query_ball_point(candidates[index], _LEAST_SPACING * resolution_m)] = False
    return candidates[kept]


def round_trip_over_mesh(points: FloatArray) -> Indices:
    """Return an order of (T, 3) points without long jumps, back to the first one at the end.

    Going through a tree, visiting the nodes of even depth before what hangs on them and those of
    odd depth after it, takes at most three edges per step (Knuth, The Art of Computer Programming
    7.2.1.6, "prepostorder").  No tree has shorter edges than the shortest one that spans the
    points: over an even surface the longest step is about three resolutions.  Going to the nearest
    point that is left is shorter on average, but leaves jumps of half the object.
    """
    edges = _mesh_spanning_tree(points)
    neighbours: list[list[int]] = [[] for _ in points]
    for one, other in edges:
        neighbours[one].append(other)
        neighbours[other].append(one)
    lowest = int(np.lexsort((points[:, 0], points[:, 1], points[:, 2]))[0])
    return np.fromiter(_prepostorder(neighbours, lowest), dtype=np.intp, count=len(points))


def _prepostorder(neighbours: list[list[int]], root: int) -> Iterator[int]:
    """Yield the nodes of a tree, in pre-order at even and in post-order at odd depth.

    *neighbours* holds those of each node; the *root* has depth 0.
    """
    # Node, where it hangs, whether its depth is odd, whether all that hangs on it has been visited.
    to_do = [(root, root, False, False)]
    while to_do:
        node, parent, odd, finished = to_do.pop()
        if finished:
            yield node
            continue
        if odd:
            to_do.append((node, parent, odd, True))
        else:
            yield node
        to_do += [(n, node, not odd, False) for n in neighbours[node] if n != parent]


def _mesh_spanning_tree(points: FloatArray) -> list[tuple[int, int]]:
    """Return the edges, as pairs of indices, of the shortest tree over *points* (K, 3).

    An edge leads to one of the 8 nearest points; bodies that these leave apart are joined by
    bridges.
    """
    from scipy.sparse.csgraph import connected_components, minimum_spanning_tree

    graph = _mesh_neighbour_graph(points)
    bodies, body_of = connected_components(graph, directed=False)
    tree = minimum_spanning_tree(graph).tocoo()
    edges = list(zip(tree.row.tolist(), tree.col.tolist(), strict=True))
    if bodies > 1:
        edges += _mesh_bridges(points, [np.flatnonzero(body_of == body) for body in range(bodies)])
    return edges


def _mesh_neighbour_graph(points: FloatArray) -> csr_array:
    """Return the sparse distances from each point to itself and its 8 nearest neighbours."""
    from scipy.sparse import csr_array
    from scipy.spatial import cKDTree

    count = len(points)
    near = min(_NEIGHBOURS + 1, count)  # each point is its own nearest
    distances, others = cKDTree(points).query(points, k=np.arange(1, near + 1))
    rows = np.repeat(np.arange(count), near)
    return csr_array((distances.ravel(), (rows, others.ravel())), shape=(count, count))


def _mesh_bridges(points: FloatArray, bodies: list[Indices]) -> Iterator[tuple[int, int]]:
    """Yield an edge that joins each body after the first to the nearest earlier body.

    The nearest body is the one with the nearest centre; the edge joins their nearest points.
    """
    from scipy.spatial import cKDTree

    centres = np.array([points[body].mean(axis=0) for body in bodies])
    trees = [cKDTree(points[body]) for body in bodies]
    for number in range(1, len(bodies)):
        apart = np.linalg.norm(centres[:number] - centres[number], axis=1)
        nearest = int(apart.argmin())
        distances, others = trees[nearest].query(points[bodies[number]])
        best = int(distances.argmin())
        yield int(bodies[number][best]), int(bodies[nearest][others[best]])
