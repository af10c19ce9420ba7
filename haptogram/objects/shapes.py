"""Tactile objects: the points of a 3D shape, in an order that keeps jumps small.

A focus that hops far leaves the transducers less time to follow (their envelope needs a good part
of a millisecond), so neighbouring points follow each other: along a curve as it runs, over a sphere
ring by ring, over a mesh in steps of a few resolutions (:mod:`haptogram.objects.mesh`).
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Protocol, Self, TypeAlias

import numpy as np

from haptogram.acoustics.arrays import FloatArray
from haptogram.acoustics.model.geometry import MAX_COORDINATE_M
from haptogram.errors import ConfigurationError
from haptogram.objects.mesh import even_mesh_points, read_mesh, round_trip_over_mesh
from haptogram.settings.arguments import check_argument_kind, check_number, shown_argument
from haptogram.settings.frozen import dataclass

if TYPE_CHECKING:
    import trimesh

Point3: TypeAlias = tuple[float, float, float]

MAX_POINTS: Final = 200_000
_THIN: Final = 2  # a surface that keeps so many times the points of its area is thin
_LOWEST_RESOLUTION_M: Final = 1e-5


class TactileObject(Protocol):
    """Something that can be displayed point by point."""

    def sample(self, resolution_m: float) -> FloatArray:
        """Return the (T, 3) points of one pass, in metres, neighbours about *resolution_m* apart.

        Raises
        ------
        ConfigurationError
            If the resolution is not positive, or coarser than the object.
        """


@dataclass(frozen=True, slots=True)
class Point:
    """A single point.

    Examples
    --------
    >>> Point((0.0, 0.0, 0.15)).sample(resolution_m=0.01).tolist()
    [[0.0, 0.0, 0.15]]
    """

    position_m: Point3

    def __post_init__(self) -> None:
        _check_shape_point("position_m", self.position_m)

    def sample(self, resolution_m: float) -> FloatArray:
        """Return the (1, 3) point, in metres."""
        _check_shape_resolution(resolution_m, math.inf)
        return np.array([self.position_m])


@dataclass(frozen=True, slots=True)
class Line:
    """A straight line, there and back again so that the pass closes.

    Examples
    --------
    >>> Line((0.0, 0.0, 0.15), (0.02, 0.0, 0.15)).sample(resolution_m=0.01)[:, 0].tolist()
    [0.0, 0.02, 0.01]
    """

    start_m: Point3
    end_m: Point3

    def __post_init__(self) -> None:
        _check_shape_point("start_m", self.start_m)
        _check_shape_point("end_m", self.end_m)

    def sample(self, resolution_m: float) -> FloatArray:
        """Return the (T, 3) points, in metres: out on the even ones, back on the odd ones."""
        start, end = np.array(self.start_m), np.array(self.end_m)
        length_m = float(np.linalg.norm(end - start))
        _check_shape_resolution(resolution_m, length_m)
        steps = _checked_point_count(length_m / resolution_m)
        order = _shape_there_and_back(steps + 1)
        points: FloatArray = start + (end - start) * (np.array(order)[:, None] / steps)
        return points


@dataclass(frozen=True, slots=True)
class _Round:
    """An object around a centre, with a radius, in metres."""

    radius_m: float
    center_m: Point3

    def __post_init__(self) -> None:
        check_number("radius_m", self.radius_m, _LOWEST_RESOLUTION_M, MAX_COORDINATE_M)
        _check_shape_point("center_m", self.center_m)


@dataclass(frozen=True, slots=True)
class Circle(_Round):
    """A circle in a plane parallel to the array.

    Examples
    --------
    >>> Circle(radius_m=0.02, center_m=(0.0, 0.0, 0.15)).sample(resolution_m=0.005).shape
    (25, 3)
    """

    def sample(self, resolution_m: float) -> FloatArray:
        """Return the (T, 3) points, in metres, once round."""
        _check_shape_resolution(resolution_m, 2.0 * self.radius_m)
        return np.array(self.center_m) + _ring_points(self.radius_m, 0.0, resolution_m)


@dataclass(frozen=True, slots=True)
class Sphere(_Round):
    """A whole sphere, ring by ring from the lower pole to the upper one.

    Examples
    --------
    >>> points = Sphere(radius_m=0.02, center_m=(0.0, 0.0, 0.15)).sample(resolution_m=0.01)
    >>> points[0].round(3).tolist(), points[-1].round(3).tolist()
    ([0.0, 0.0, 0.13], [-0.0, 0.0, 0.17])
    """

    def sample(self, resolution_m: float) -> FloatArray:
        """Return the (T, 3) points, in metres."""
        return np.array(self.center_m) + _spherical_cap(self.radius_m, math.pi, resolution_m)


@dataclass(frozen=True, slots=True)
class Hemisphere(_Round):
    """Half of a sphere, ring by ring from its pole to its rim.

    Attributes
    ----------
    radius_m : float
        Radius, in metres.
    center_m : tuple of 3 float
        Centre of the sphere, in metres.
    lower : bool
        Whether it is the half nearer to the array, as in the paper.

    Examples
    --------
    >>> points = Hemisphere(radius_m=0.03, center_m=(0.0, 0.0, 0.15)).sample(resolution_m=0.01)
    >>> bool(points[:, 2].max() <= 0.15)
    True
    """

    lower: bool = True

    def __post_init__(self) -> None:
        _Round.__post_init__(self)
        check_argument_kind("lower", self.lower, bool, "True or False")

    def sample(self, resolution_m: float) -> FloatArray:
        """Return the (T, 3) points, in metres."""
        points = _spherical_cap(self.radius_m, math.pi / 2.0, resolution_m)
        if not self.lower:
            points[:, 2] = -points[:, 2]
        return np.array(self.center_m) + points


@dataclass(frozen=True, slots=True, eq=False)
class MeshSurface:
    """The surface of a triangle mesh; see :meth:`from_file`.

    Examples
    --------
    >>> MeshSurface.from_file("no.stl")
    Traceback (most recent call last):
        ...
    haptogram.errors.ConfigurationError: object 'no.stl' cannot be read: there is no such file
    """

    mesh: trimesh.Trimesh

    def __post_init__(self) -> None:
        """Refuse what is no mesh, without the package that makes one."""
        if not all(hasattr(self.mesh, part) for part in ("bounds", "area", "triangles")):
            raise ConfigurationError(
                f"mesh is {shown_argument(self.mesh)}, must be a trimesh.Trimesh; "
                "MeshSurface.from_file reads one"
            )

    @classmethod
    def from_file(
        cls, path: str | Path, *, center_m: Point3 | None = None, unit_m: float = 1e-3
    ) -> Self:
        """Read an STL, OBJ or PLY file.

        Parameters
        ----------
        path : str or Path
            The file.
        center_m : tuple of 3 float, optional
            Where the centre of its bounding box shall be, in metres; by default where the file
            has it.
        unit_m : float
            Length of one unit of the file, in metres.  These formats hold none; millimetres are
            usual.

        Raises
        ------
        ConfigurationError
            If the file cannot be read, holds no surface, or the extra ``mesh`` is not installed.
        """
        check_argument_kind("path", path, (str, Path), "the name of a file")
        check_number("unit_m", unit_m, 1e-9, 1e3)
        if center_m is not None:
            _check_shape_point("center_m", center_m)
        mesh: Any = read_mesh(Path(path))  # its type hints are not complete
        mesh.apply_scale(unit_m)
        if center_m is not None:
            mesh.apply_translation(np.array(center_m) - mesh.bounds.mean(axis=0))
        return cls(mesh)

    def sample(self, resolution_m: float) -> FloatArray:
        """Return (T, 3) points spread evenly over the surface, in metres; always the same ones.

        Their order closes: the first is next to the last.
        """
        _check_shape_resolution(resolution_m, float(np.ptp(self.mesh.bounds, axis=0).max()))
        count = _checked_point_count(float(self.mesh.area) / resolution_m**2)
        points = even_mesh_points(self.mesh, count, resolution_m)
        while len(points) > _THIN * count:  # there is room for more than the area says
            count = _checked_point_count(len(points))
            points = even_mesh_points(self.mesh, count, resolution_m)
        return points[round_trip_over_mesh(points)]


def _shape_there_and_back(count: int) -> list[int]:
    """Return 0, 2, 4 ... and back over 5, 3, 1: each number is at most two from the next."""
    return [*range(0, count, 2), *reversed(range(1, count, 2))]


def _ring_points(
    radius_m: float, z_m: float, resolution_m: float, start_rad: float = 0.0
) -> FloatArray:
    """Return points (K, 3), in m, once round a circle about the z axis, from *start_rad* on.

    They are *resolution_m* apart along it, rounded so that they are evenly spaced.
    """
    count = _checked_point_count(2.0 * math.pi * radius_m / resolution_m)
    angles = start_rad + 2.0 * math.pi * np.arange(count) / count
    return np.stack(
        [radius_m * np.cos(angles), radius_m * np.sin(angles), np.full(count, z_m)], axis=1
    )


def _spherical_cap(radius_m: float, opening_rad: float, resolution_m: float) -> FloatArray:
    """Return the points (K, 3), in m, of a sphere from its lowest point to a polar angle.

    Rings a resolution apart along the meridian; each begins where the one before ended.
    """
    _check_shape_resolution(resolution_m, 2.0 * radius_m)
    _checked_point_count(
        2.0 * math.pi * (1.0 - math.cos(opening_rad)) * (radius_m / resolution_m) ** 2
    )
    rings = max(1, round(opening_rad * radius_m / resolution_m))
    parts: list[FloatArray] = []
    start_rad = 0.0
    for polar in opening_rad * np.arange(rings + 1) / rings:
        around_m = abs(radius_m * math.sin(polar))
        part = _ring_points(around_m, -radius_m * math.cos(polar), resolution_m, start_rad)
        start_rad += 2.0 * math.pi * (len(part) - 1) / len(part)
        parts.append(part)
    return np.concatenate(parts)


def _checked_point_count(wanted: float) -> int:
    """Return *wanted*, a number of points, rounded; 1 at least.

    Raises
    ------
    ConfigurationError
        If it is more than :data:`MAX_POINTS`.
    """
    if wanted > MAX_POINTS:
        raise ConfigurationError(
            f"the object would have {wanted:.3g} points at this resolution, must be {MAX_POINTS} "
            "or fewer"
        )
    return max(1, round(wanted))


def _check_shape_resolution(resolution_m: float, extent_m: float) -> None:
    """Refuse a resolution below 10 µm, or coarser than the object's *extent_m*."""
    check_number("resolution_m", resolution_m, _LOWEST_RESOLUTION_M, MAX_COORDINATE_M)
    if resolution_m > extent_m * (1.0 + 1e-9):  # a share of 1 may come out a hair above
        raise ConfigurationError(
            f"resolution is {resolution_m * 1e3:g} mm, must not be more than the object's "
            f"{extent_m * 1e3:g} mm"
        )


def _check_shape_point(name: str, point: Point3) -> None:
    """Refuse a point that is not three numbers in metres, or is beyond MAX_COORDINATE_M."""
    try:
        values = np.asarray(point)
    except ValueError:  # rows of different lengths
        values = np.empty(0)
    if values.shape != (3,) or values.dtype.kind not in "iuf":
        raise ConfigurationError(
            f"{name} is {shown_argument(point)}, must be three numbers, in metres"
        )
    if not (np.abs(values) <= MAX_COORDINATE_M).all():  # NaN is not, either
        raise ConfigurationError(
            f"{name} is {shown_argument(point)}, "
            f"must be within {MAX_COORDINATE_M:g} m of the origin"
        )
