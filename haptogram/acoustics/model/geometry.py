"""Positions and normals of the transducers.

Element n = ix * ny + iy; the origin of a grid is its centre and +z the emission side. Wherever an
array is moved and however it is turned, limits and searches follow its own axes.
"""

from __future__ import annotations

import dataclasses
import math
import os
import re
import zlib
from pathlib import Path
from typing import Final, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from haptogram.acoustics.arrays import (
    MAX_TRANSDUCERS,
    FloatArray,
    as_coordinates,
    as_float_array,
    as_point_array,
    check_array_magnitudes,
    read_only_array,
)
from haptogram.acoustics.model.csv_rows import read_element_rows
from haptogram.acoustics.model.own_axes import array_axes, mean_array_normal
from haptogram.errors import ConfigurationError, refusals_of
from haptogram.settings.arguments import check_positive, check_whole
from haptogram.settings.frozen import dataclass, field

_WIRE_UNIT: Final = 32767  # of a normal in an i16
MIN_SPACING_M: Final = 0.1e-3
MAX_COORDINATE_M: Final = 100.0  # keeps micrometres far inside an int32
DEFAULT_PITCH_M: Final = 0.010
_ROUNDING_M: Final = 1e-9  # a point of the plane of a turned array is not behind it
_NO_ROTATION: Final = 1e-9  # largest difference of R R^T from 1: rounding of a computed rotation

_GRID = re.compile(r"(\d{1,5})\s*[xX]\s*(\d{1,5})")
_HEADERS = (["x", "y", "z"], ["x", "y", "z", "nx", "ny", "nz"])


@dataclass(frozen=True, eq=False, slots=True)
class TransducerArray:
    """An array of transducers.

    Attributes
    ----------
    positions_m : (N, 3) numpy.ndarray
        Centres of the elements, in metres; read-only.
    normals : (N, 3) numpy.ndarray
        Unit vectors of the emission axes; read-only. Any non-zero length is accepted.
    grid_shape : tuple of int or None
        (nx, ny) of a rectangular grid with ``n = ix * ny + iy``.
    pitch_m : float or None
        Spacing of a rectangular grid, in metres.
    bounds_m : (2, 3) numpy.ndarray
        Least and largest coordinates of the element centres, in metres; read-only.
    centre_m : (3,) numpy.ndarray
        Centroid of the element centres, in metres; read-only.
    fronts : (U, 4) numpy.ndarray
        The half-spaces that the elements face, one for each direction, the middle one first: a row
        (n, d) holds the points where n x + d >= 0, in metres and with a nanometre to spare;
        read-only.
    axes : (3, 3) numpy.ndarray
        The array's own x, y and z, a right-handed frame of unit vectors in the world; read-only.
        z is the normal of the plane or line that the elements lie in, on the side they look to;
        where they lie in none, or look along it, the mean of the normals; where these nearly cancel
        out, the line along which they look at each other, or the one that they look at from all
        around, upwards. x runs along the rows, by the numbers of a grid's elements; without rows, x
        and y are those of the world, turned by the least angle that brings the world's z to this
        one. So an array that faces +z with its rows along the world's axes has exactly those.

    Raises
    ------
    ConfigurationError
        No element or more than 1024, a value that is not finite or beyond 100 m, a zero normal, or
        two elements closer than 0.1 mm.

    Examples
    --------
    >>> square = TransducerArray.grid(2, 2, pitch_m=0.01)
    >>> square.count, square.positions_m.tolist()
    (4, [[-0.005, -0.005, 0.0], [-0.005, 0.005, 0.0], [0.005, -0.005, 0.0], [0.005, 0.005, 0.0]])
    """

    positions_m: FloatArray = field(repr=False)
    normals: FloatArray = field(repr=False)
    grid_shape: tuple[int, int] | None = None
    pitch_m: float | None = None
    bounds_m: FloatArray = field(init=False, repr=False)
    centre_m: FloatArray = field(init=False, repr=False)
    fronts: FloatArray = field(init=False, repr=False)
    axes: FloatArray = field(init=False, repr=False)
    _wire_normals: NDArray[np.int16] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        positions = as_point_array("positions_m", self.positions_m).copy()
        _check_element_count(len(positions))
        if np.abs(positions).max() > MAX_COORDINATE_M:
            worst = float(np.abs(positions).max())
            raise ConfigurationError(
                f"a coordinate is {worst:g} m, at most {MAX_COORDINATE_M:g} m from the origin"
            )
        normals = _unit_element_normals(as_point_array("normals", self.normals), len(positions))
        _check_element_spacing(positions)
        if self.grid_shape is not None and math.prod(self.grid_shape) != len(positions):
            raise ConfigurationError(
                f"grid {self.grid_shape} does not hold {len(positions)} elements"
            )
        for name, array in (
            ("positions_m", positions),
            ("normals", normals),
            ("bounds_m", np.array([positions.min(axis=0), positions.max(axis=0)])),
            ("centre_m", positions.mean(axis=0)),
            ("fronts", _element_fronts(positions, normals)),
            ("axes", array_axes(positions, normals, self.grid_shape)),
            ("_wire_normals", np.rint(normals * _WIRE_UNIT).astype(np.int16)),
        ):
            read_only_array(array)
            object.__setattr__(self, name, array)

    @classmethod
    def grid(cls, nx: int, ny: int, *, pitch_m: float = DEFAULT_PITCH_M) -> Self:
        """Return a planar nx-by-ny grid, centred on the origin and facing +z."""
        nx, ny = (check_whole("side of the grid", n, 1, MAX_TRANSDUCERS) for n in (nx, ny))
        _check_element_count(nx * ny)
        check_positive("pitch_m", pitch_m)
        ix, iy = np.meshgrid(np.arange(nx), np.arange(ny), indexing="ij")
        x = (ix.ravel() - (nx - 1) / 2) * pitch_m
        y = (iy.ravel() - (ny - 1) / 2) * pitch_m
        positions = np.stack([x, y, np.zeros_like(x)], axis=1)
        return cls(positions, _normals_facing_up(nx * ny), (nx, ny), float(pitch_m))

    @classmethod
    def from_positions(cls, positions_m: ArrayLike, normals: ArrayLike | None = None) -> Self:
        """Return an array of any shape; without *normals* every element faces +z."""
        positions = as_point_array("positions_m", positions_m)
        faces = (
            _normals_facing_up(len(positions))
            if normals is None
            else as_point_array("normals", normals)
        )
        return cls(positions, faces)

    @classmethod
    def from_wire(cls, positions_um: ArrayLike, normals: ArrayLike) -> Self:
        """Return the array of whole micrometres and normals in 1/32767: HG-4.3/6.

        Its digest is that of these numbers, though normals of another length become unit vectors.
        """
        given = as_point_array("normals", normals)
        check_array_magnitudes("normals", given, _WIRE_UNIT + 1.0)
        array = cls.from_positions(as_float_array("positions_um", positions_um) / 1e6, given)
        kept = given.astype(np.int16)
        read_only_array(kept)
        object.__setattr__(array, "_wire_normals", kept)
        return array

    @classmethod
    def from_file(cls, path: str | Path) -> Self:
        """Read a CSV file with the header ``x,y,z`` or ``x,y,z,nx,ny,nz``, one element per line.

        Positions are in millimetres; normals may have any length. Blank lines and lines that start
        with ``#`` are skipped.

        Raises
        ------
        ConfigurationError
            Names the file, and the line where there is one.
        """
        rows = _read_position_rows(Path(path))
        table = np.array(rows, dtype=np.float64)
        normals = table[:, 3:] if table.shape[1] == 6 else None
        with refusals_of(f"{path}:"):
            return cls.from_positions(table[:, :3] * 1e-3, normals)

    @classmethod
    def parse(cls, text: str, *, pitch_m: float = DEFAULT_PITCH_M) -> Self:
        """Return the grid that *text* names ("16x16"), else the array in the file of that name."""
        match = _GRID.fullmatch(text.strip())
        if match:
            return cls.grid(int(match[1]), int(match[2]), pitch_m=pitch_m)
        try:
            return cls.from_file(text)
        except ConfigurationError as error:
            if Path(text).suffix or os.path.exists(text):
                raise
            raise ConfigurationError(f"{error}; a grid is written NXxNY, such as 16x16") from error

    def moved(self, rotation: ArrayLike, shift_m: ArrayLike = (0.0, 0.0, 0.0)) -> Self:
        """Return this array turned around the origin, then shifted; its own axes turn with it.

        What has directions in the world beside the array, such as the width of a
        :class:`.directivities.RectangularPiston`, has to be turned as well.

        Parameters
        ----------
        rotation : (3, 3) array_like
            R: a point x goes to R x + shift.
        shift_m : (3,) array_like
            In metres.

        Raises
        ------
        ConfigurationError
            A matrix that is no rotation, to 1e-9; a value that is not finite; an element beyond
            100 m.
        """
        turn, shift = _as_array_rotation(rotation), as_coordinates("shift_m", shift_m)
        positions, normals = self.positions_m @ turn.T + shift, self.normals @ turn.T
        array = type(self)(positions, normals, self.grid_shape, self.pitch_m)
        return _array_with_axes(array, self.axes @ turn.T)

    def measured(self, positions_m: ArrayLike) -> Self:
        """Return this array with its elements at (N, 3) *positions_m*; its own axes stay.

        Raises
        ------
        ConfigurationError
            As of the class.
        """
        array = dataclasses.replace(self, positions_m=as_point_array("positions_m", positions_m))
        return _array_with_axes(array, self.axes)

    def local_m(self, points_m: FloatArray) -> FloatArray:
        """Return (..., 3) points of the world along the array's own axes, from its centre."""
        return (points_m - self.centre_m) @ self.axes.T

    def world_m(self, local_m: FloatArray) -> FloatArray:
        """Return the places in the world of (..., 3) points along the array's own axes."""
        return local_m @ self.axes + self.centre_m

    @property
    def is_upright(self) -> bool:
        """True if the array's own axes are those of the world."""
        return bool((self.axes == np.eye(3)).all())

    @property
    def count(self) -> int:
        """Number of transducers."""
        return len(self.positions_m)

    @property
    def facing(self) -> FloatArray:
        """(3,) unit vector along the mean of the normals; the array's own z if they cancel out."""
        direction = mean_array_normal(self.normals)
        return self.axes[2] if direction is None else direction

    @property
    def half_extent_m(self) -> FloatArray:
        """(3,) half of the span of the element centres along the array's own axes, in metres."""
        half: FloatArray = np.ptp(self.positions_m @ self.axes.T, axis=0) / 2
        return half

    @property
    def aperture_radius_m(self) -> float:
        """Largest distance of an element centre from the centroid plus half a pitch, in metres.

        An array without a pitch takes half the distance of its closest pair instead.
        """
        radius = float(np.linalg.norm(self.positions_m - self.centre_m, axis=1).max())
        spacing = (
            self.pitch_m if self.pitch_m is not None else _closest_elements(self.positions_m)[0]
        )
        return radius + (spacing / 2 if np.isfinite(spacing) else 0.0)

    def positions_um(self) -> NDArray[np.int32]:
        """Return the (N, 3) positions in micrometres, rounded: the form that the wire carries."""
        return np.rint(self.positions_m * 1e6).astype(np.int32)

    def on_wire(self) -> Self:
        """Return the array as a host learns it: micrometres, and normals in 1/32767: HG-4.3/6."""
        if self.grid_shape is not None and self.pitch_m is not None:
            nx, ny = self.grid_shape
            grid = type(self).grid(nx, ny, pitch_m=round(self.pitch_m * 1e6) / 1e6)
            if grid.digest() == self.digest():
                return grid
        return type(self).from_wire(self.positions_um(), self._wire_normals)

    def digest(self) -> int:
        """Return the u32 CRC-32 over the elements in order, 18 bytes each.

        An element is its position (um, '<i4') and its normal (x 32767, '<i2'): HG-4.3/6.
        """
        records = np.empty(self.count, dtype=[("position", "<i4", 3), ("normal", "<i2", 3)])
        records["position"] = self.positions_um()
        records["normal"] = self._wire_normals
        return zlib.crc32(records.tobytes())


def _as_array_rotation(rotation: ArrayLike) -> FloatArray:
    """Return *rotation* as a (3, 3) matrix; raise ConfigurationError if it is not a rotation.

    A mirroring is none.
    """
    turn = as_float_array("rotation", rotation)
    if turn.shape != (3, 3):
        raise ConfigurationError(f"rotation has shape {turn.shape}, must be (3, 3)")
    check_array_magnitudes("rotation", turn, 2.0)
    error = float(np.abs(turn @ turn.T - np.eye(3)).max())
    if error > _NO_ROTATION:
        raise ConfigurationError(
            f"rotation R is none: R R^T is off 1 by {error:.3g}, must be {_NO_ROTATION:g} at most; "
            "its rows must be unit vectors at right angles"
        )
    if np.linalg.det(turn) < 0.0:
        raise ConfigurationError(
            "rotation mirrors: its determinant is -1, must be 1; turn the sign of a row"
        )
    return turn


_Array = TypeVar("_Array", bound=TransducerArray)


def _array_with_axes(array: _Array, axes: FloatArray) -> _Array:
    """Set the own axes of a new *array*, in place of those derived; return the array."""
    read_only_array(axes)
    object.__setattr__(array, "axes", axes)
    return array


def _normals_facing_up(count: int) -> FloatArray:
    """Return (count, 3) normals along +z."""
    return np.tile(np.array([0.0, 0.0, 1.0]), (count, 1))


def _check_element_count(count: int) -> None:
    """Refuse a number of elements below 1 or above 1024."""
    if not 1 <= count <= MAX_TRANSDUCERS:
        raise ConfigurationError(f"array of {count} transducers, must be 1 to {MAX_TRANSDUCERS}")


def _unit_element_normals(normals: FloatArray, count: int) -> FloatArray:
    """Return the normals (count, 3) scaled to length 1; refuse one shorter than 1e-9."""
    if normals.shape != (count, 3):
        raise ConfigurationError(f"normals have shape {normals.shape}, must be ({count}, 3)")
    lengths = np.linalg.norm(normals, axis=1)
    if lengths.min() < 1e-9:
        raise ConfigurationError(f"normal of element {int(lengths.argmin())} has no direction")
    unit: FloatArray = normals / lengths[:, None]
    return unit


def _element_fronts(positions: FloatArray, normals: FloatArray) -> FloatArray:
    """Return the planes (K, 4), one for each direction that elements face, through the rearmost.

    A plane a, b, c, d has the points with a x + b y + c z + d > 0 in front. The direction nearest
    to the mean comes first.
    """
    planes = np.column_stack([normals, _ROUNDING_M - (normals * positions).sum(axis=1)])
    rear_first = planes[np.argsort(-planes[:, 3], kind="stable")]
    _, first = np.unique(np.round(rear_first[:, :3], 9) + 0.0, axis=0, return_index=True)
    fronts = rear_first[first]
    middle_first = np.argsort(-(fronts[:, :3] @ normals.sum(axis=0)), kind="stable")
    return np.ascontiguousarray(fronts[middle_first])


def _closest_elements(positions: FloatArray) -> tuple[float, int, int]:
    """Return the distance (m; infinite for one element) and the indices of the closest pair."""
    best = (np.inf, 0, 0)
    for n in range(1, len(positions)):  # one row at a time: 1024 x 1024 x 3 would take 25 MB
        squares = ((positions[:n] - positions[n]) ** 2).sum(axis=1)
        other = int(squares.argmin())
        if squares[other] < best[0]:
            best = (float(squares[other]), other, n)
    return (float(np.sqrt(best[0])), best[1], best[2])


def _check_element_spacing(positions: FloatArray) -> None:
    """Refuse elements that are 0.1 mm or less apart."""
    distance, first, second = _closest_elements(positions)
    if distance <= MIN_SPACING_M:
        raise ConfigurationError(
            f"elements {first} and {second} are {distance * 1e3:.3g} mm apart, "
            f"must be more than {MIN_SPACING_M * 1e3:g} mm"
        )


def _read_position_rows(path: Path) -> list[list[float]]:
    """Return the rows below the header of a CSV file: positions, and normals if the header has any.

    Raises ConfigurationError for another header or none, and if no row follows.
    """
    lines = read_element_rows(path, "array")
    if not lines:
        raise ConfigurationError(f"{path}: no elements")
    (number, header), body = lines[0], lines[1:]
    if [name.lower() for name in header] not in _HEADERS:
        raise ConfigurationError(
            f"{path}:{number}: header is {','.join(header)!r}, must be x,y,z or x,y,z,nx,ny,nz"
        )
    if not body:
        raise ConfigurationError(f"{path}: no elements")
    return [_read_position_row(f"{path}:{number}", cells, len(header)) for number, cells in body]


def _read_position_row(where: str, cells: list[str], width: int) -> list[float]:
    """Return the numbers of a row; raise ConfigurationError unless they are *width* finite ones.

    The error begins with *where*.
    """
    if len(cells) != width:
        raise ConfigurationError(f"{where}: {len(cells)} values, must be {width}")
    try:
        values = [float(cell) for cell in cells]
        return [float(value) for value in as_float_array("value", values)]
    except ValueError as error:
        raise ConfigurationError(f"{where}: {error}") from error
