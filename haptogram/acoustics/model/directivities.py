"""Directivities beyond the circular piston: a rectangular piston, and a measured table.

The rectangle depends on the direction around its axis: the reference engine (``field``) looks for
``gain_towards`` and gives it directions instead of an angle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Final, NoReturn, Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from haptogram.acoustics.arrays import FloatArray, as_coordinates, as_float_array, read_only_array
from haptogram.acoustics.model.csv_rows import read_element_rows
from haptogram.acoustics.model.transducer import GRAZING
from haptogram.errors import ConfigurationError
from haptogram.settings.arguments import check_positive

MAX_GAIN: Final = 10.0

_GRAZING_DEG: Final = float(np.degrees(np.arccos(GRAZING))) - 90.0

# Nippon Ceramic T4010A1 in steps of 10 degrees, as the AUTD3 library takes it from the data sheet.
_T4010A1_DB: Final = (0.0, 0.0, 0.0, -1.0, -3.0, -6.0, -9.0, -12.0, -14.0, -15.0)


@runtime_checkable
class OrientedDirectivity(Protocol):
    """A pattern that also depends on the direction around the axis."""

    def gain_towards(
        self, directions: FloatArray, normals: FloatArray, wavenumber: float
    ) -> FloatArray:
        """Return the (M, N) gain in (M, N, 3) unit *directions* of (N, 3) unit *normals*."""


@dataclass(frozen=True, eq=False, slots=True)
class RectangularPiston:
    """A rigid rectangular piston in a baffle.

    D = sinc(k w u / 2) sinc(k h v / 2), sinc(x) = sin(x) / x, where u and v are the direction
    cosines along the width and the height (Kinsler et al., Fundamentals of Acoustics, 4th ed.,
    section 7.5, in two dimensions); 0 behind the baffle.  For an element of 1 x 5 mm at 40 kHz the
    far-field form is within 0.14 % of the Rayleigh integral from 40 mm on.

    Attributes
    ----------
    width_m, height_m : float
        Sides.
    width_axis : (3,) array_like
        Direction of the width; its part along an element's normal is taken out.  It must not be
        the normal of any element.

    Examples
    --------
    >>> piston = RectangularPiston(width_m=0.010, height_m=0.005)
    >>> piston.baffled
    True
    """

    baffled: ClassVar[bool] = True
    width_m: float
    height_m: float
    width_axis: ArrayLike = (1.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        check_positive("width_m", self.width_m)
        check_positive("height_m", self.height_m)
        axis = as_coordinates("width_axis", self.width_axis).copy()
        length = check_positive("length of width_axis", float(np.linalg.norm(axis)))
        axis /= length
        read_only_array(axis)
        object.__setattr__(self, "width_axis", axis)

    def gain(self, cos_theta: FloatArray, wavenumber: float) -> NoReturn:  # noqa: ARG002  (Directivity)
        """Refuse: the angle to the axis does not decide the gain of a rectangle.

        Raises
        ------
        ConfigurationError
            Always, so that no engine takes a rectangle for a circle in silence.
        """
        raise ConfigurationError(
            "a rectangular piston has no gain at an angle alone; use gain_towards, or an engine "
            "that does"
        )

    def gain_towards(
        self, directions: FloatArray, normals: FloatArray, wavenumber: float
    ) -> FloatArray:
        """Return the gain in given directions.

        Parameters
        ----------
        directions : (M, N, 3) numpy.ndarray
            Unit vectors from each of N elements to each of M points.
        normals : (N, 3) numpy.ndarray
            Unit normals of the elements.
        wavenumber : float
            k, in rad/m.

        Returns
        -------
        (M, N) numpy.ndarray

        Raises
        ------
        ConfigurationError
            If `width_axis` is the normal of an element.
        """
        across, along = self.side_axes(normals)
        u = np.einsum("mnk,nk->mn", directions, across)
        v = np.einsum("mnk,nk->mn", directions, along)
        # numpy's sinc is sin(pi x) / (pi x).
        half_turns = wavenumber / (2.0 * np.pi)
        gain = np.sinc(half_turns * self.width_m * u) * np.sinc(half_turns * self.height_m * v)
        ahead = np.einsum("mnk,nk->mn", directions, normals) >= GRAZING
        result: FloatArray = np.where(ahead, gain, 0.0)
        return result

    def side_axes(self, normals: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the unit vectors along width and height of each element, (N, 3) each.

        Raises
        ------
        ConfigurationError
            If `width_axis` is the normal of an element.

        Examples
        --------
        >>> RectangularPiston(0.010, 0.005).side_axes(np.array([[0.0, 0.0, 1.0]]))
        (array([[1., 0., 0.]]), array([[0., 1., 0.]]))
        """
        axis = np.asarray(self.width_axis)
        across = axis - (normals @ axis)[:, None] * normals
        length = np.linalg.norm(across, axis=1)
        if length.min() < 1e-6:
            raise ConfigurationError(
                f"width_axis {axis.tolist()} is the normal of element {int(length.argmin())}"
            )
        across = across / length[:, None]
        return across, np.cross(normals, across)


@dataclass(frozen=True, eq=False, slots=True)
class MeasuredDirectivity:
    """A measured pattern, the same all round the axis, between its angles by a monotone cubic.

    Attributes
    ----------
    angles_deg : (K,) array_like
        Angles to the axis: from 0, ascending, to at least 90 and at most 180 degrees.  Beyond the
        last one the gain is 0; a table that ends at 90 is that of an element in a baffle.
    gains : (K,) array_like
        Pressure relative to the axis; the first is 1.  A sign marks a lobe in opposite phase.

    Raises
    ------
    ConfigurationError
        Angles or gains that are not such a table.

    Examples
    --------
    >>> pattern = MeasuredDirectivity(angles_deg=[0, 30, 60, 90], gains=[1.0, 0.7, 0.25, 0.0])
    >>> round(float(pattern.gain(np.cos(np.radians([30.0])), model.wavenumber)[0]), 3)
    0.7
    >>> MeasuredDirectivity.t4010a1().baffled
    True
    """

    angles_deg: ArrayLike
    gains: ArrayLike

    def __post_init__(self) -> None:
        angles = as_float_array("angles_deg", self.angles_deg).copy()
        gains = as_float_array("gains", self.gains).copy()
        _check_directivity_table(angles, gains)
        for name, array in (("angles_deg", angles), ("gains", gains)):
            read_only_array(array)
            object.__setattr__(self, name, array)

    @classmethod
    def from_file(cls, path: str | Path) -> Self:
        """Read a CSV file with the header ``angle_deg,gain`` or ``angle_deg,gain_db``.

        Raises
        ------
        ConfigurationError
            Names the file, and the line where there is one.
        """
        header, rows = _read_directivity_table(Path(path))
        angles, gains = np.array(rows).T
        if header[1] == "gain_db":
            gains = 10.0 ** (gains / 20.0)
        try:
            return cls(angles, gains)
        except ConfigurationError as error:
            raise ConfigurationError(f"{path}: {error}") from error

    @classmethod
    def t4010a1(cls) -> Self:
        """Return the pattern of the T4010A1 transducer of the AUTD3 boards."""
        return cls(np.arange(0.0, 91.0, 10.0), 10.0 ** (np.array(_T4010A1_DB) / 20.0))

    @property
    def baffled(self) -> bool:
        """True if the table ends at 90 degrees."""
        return bool(np.asarray(self.angles_deg)[-1] <= 90.0)

    def gain(self, cos_theta: FloatArray, wavenumber: float) -> FloatArray:  # noqa: ARG002  (Directivity)
        """Return the gain at the cosine of the angle to the axis, in its shape."""
        from scipy.interpolate import PchipInterpolator  # slow to import, and only a table needs it

        angle = np.degrees(np.arccos(np.clip(cos_theta, -1.0, 1.0)))
        with np.errstate(over="ignore"):  # next to 0 a slope's inverse may be infinite, and serves
            table = PchipInterpolator(self.angles_deg, self.gains)
        last = np.asarray(self.angles_deg)[-1]
        within = angle <= last + _GRAZING_DEG
        result: FloatArray = np.where(within, table(np.minimum(angle, last)), 0.0)
        return result


def _check_directivity_table(angles: FloatArray, gains: FloatArray) -> None:
    if angles.ndim != 1 or angles.shape != gains.shape or len(angles) < 2:
        raise ConfigurationError(
            f"angles and gains have shapes {angles.shape} and {gains.shape}, "
            "must be two rows of equal length, at least 2"
        )
    steps = np.diff(angles)
    if angles[0] != 0.0 or steps.min() <= 0.0 or not 90.0 <= angles[-1] <= 180.0:
        raise ConfigurationError(
            f"angles run from {angles[0]:g} to {angles[-1]:g} degrees with a smallest step of "
            f"{steps.min():g}, must ascend from 0 to 90 ... 180"
        )
    if gains[0] != 1.0 or np.abs(gains).max() > MAX_GAIN:
        raise ConfigurationError(
            f"gain on the axis is {gains[0]:g}, must be 1; largest is {np.abs(gains).max():g}, "
            f"must be at most {MAX_GAIN:g}"
        )


def _read_directivity_table(path: Path) -> tuple[Sequence[str], list[tuple[float, float]]]:
    lines = read_element_rows(path, "directivity")
    header = lines[0][1] if lines else []
    if header not in (["angle_deg", "gain"], ["angle_deg", "gain_db"]):
        raise ConfigurationError(
            f"{path}: header is {','.join(header)!r}, must be angle_deg,gain or angle_deg,gain_db"
        )
    if len(lines) < 3:
        raise ConfigurationError(f"{path}: {len(lines) - 1} angles, must be at least 2")
    return header, [_read_directivity_row(f"{path}:{number}", cells) for number, cells in lines[1:]]


def _read_directivity_row(where: str, cells: list[str]) -> tuple[float, float]:
    try:
        angle, gain = (float(cell) for cell in cells)
    except ValueError as error:
        raise ConfigurationError(f"{where}: {','.join(cells)!r} is not two numbers") from error
    return angle, gain
