"""The elements of one real array as they were measured: gain, phase and place."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Final, Self

import numpy as np

from haptogram.acoustics.arrays import (
    MAX_TRANSDUCERS,
    BoolArray,
    ComplexArray,
    FloatArray,
    as_float_vector,
    as_point_array,
    read_only_array,
)
from haptogram.acoustics.model.csv_rows import read_element_rows
from haptogram.acoustics.model.geometry import MAX_COORDINATE_M, TransducerArray
from haptogram.errors import ConfigurationError, refusals_of, writing_file
from haptogram.settings.arguments import check_number, shown_argument
from haptogram.settings.frozen import dataclass, field

HEADER: Final = ("element", "gain", "phase_rad", "x_mm", "y_mm", "z_mm")
MAX_GAIN: Final = 10.0
MAX_PHASE_RAD: Final = 2.0 * math.pi
_MAX_DISPLACEMENT_M: Final = 0.010  # an element further from its place is that of another array
_MM: Final = 1e3
_LIMITS: Final = {
    "gain": (0.0, MAX_GAIN),
    "phase_rad": (-MAX_PHASE_RAD, MAX_PHASE_RAD),
    **dict.fromkeys(HEADER[3:], (-MAX_COORDINATE_M * _MM, MAX_COORDINATE_M * _MM)),
}


@dataclass(frozen=True, eq=False, slots=True)
class Calibration:
    """Gain, phase and place of each element, as they were measured.

    Attributes
    ----------
    gain : (N,) numpy.ndarray
        Amplitude of each element over that of the model's transducer, 0 (dead) to 10; read-only.
    phase_rad : (N,) numpy.ndarray
        Lag of each element behind its command, in radians of the carrier, -2 pi to 2 pi;
        read-only.
    positions_m : (N, 3) numpy.ndarray
        Its centre, in metres, in the coordinates of the array; read-only.
    name : str
        Name in errors: the file of the calibration.
    lines : tuple of int
        The line of each element in that file; empty without one.
    response : (N,) numpy.ndarray of complex128
        gain e^{+j phase}, by which the weight of each element is multiplied; read-only.

    Raises
    ------
    ConfigurationError
        Shapes that do not fit each other, a value that is not finite or out of its range, or no
        element that radiates.

    Examples
    --------
    >>> aged = Calibration(np.full(256, 0.9), np.zeros(256), array.positions_m)
    >>> new = pressure(model, weights, [target])
    >>> old = pressure(model.calibrated(aged), weights, [target])
    >>> f"{abs(old / new)[0]:.2f}"
    '0.90'
    """

    gain: FloatArray
    phase_rad: FloatArray
    positions_m: FloatArray
    name: str = "calibration"
    lines: tuple[int, ...] = ()
    response: ComplexArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        positions = as_point_array("positions_m", self.positions_m).copy()
        gain = as_float_vector("gain", self.gain, len(positions)).copy()
        phase = as_float_vector("phase_rad", self.phase_rad, len(positions)).copy()
        if not 1 <= len(gain) <= MAX_TRANSDUCERS:
            raise ConfigurationError(
                f"{self.name}: {len(gain)} elements, must be 1 to {MAX_TRANSDUCERS}"
            )
        for column, values in (("gain", gain), ("phase_rad", phase)):
            for extreme in (values.min(), values.max()):
                check_number(f"{self.name}: {column}", extreme, *_LIMITS[column])
        if not gain.any():
            raise ConfigurationError(
                f"{self.name}: the gain of all {len(gain)} elements is 0, must be above 0 for one"
            )
        response = gain * np.exp(1j * phase)
        for name, array in (
            ("gain", gain),
            ("phase_rad", phase),
            ("positions_m", positions),
            ("response", response),
        ):
            read_only_array(array)
            object.__setattr__(self, name, array)

    @classmethod
    def of(cls, source: Calibration | str | Path) -> Calibration:
        """Return *source*, or the calibration in the file of that name.

        Raises
        ------
        ConfigurationError
            Neither of both, or as :meth:`from_file`.
        """
        if isinstance(source, str | Path):
            return cls.from_file(source)
        if not isinstance(source, Calibration):
            raise ConfigurationError(
                f"calibration is {shown_argument(source)}, must be a Calibration or the name of a "
                "file"
            )
        return source

    @classmethod
    def from_file(cls, path: str | Path) -> Self:
        """Read a CSV file with the header ``element,gain,phase_rad,x_mm,y_mm,z_mm``.

        One line for each element, in any order; elements count from 0. Blank lines and lines that
        start with ``#`` are skipped.

        Raises
        ------
        ConfigurationError
            Names the file, and the line where there is one.
        """
        rows = read_element_rows(Path(path), "calibration")
        found: dict[int, tuple[int, list[float]]] = {}
        for number, cells in _calibration_body(path, rows):
            element, values = _calibration_row(f"{path}:{number}", cells)
            if element in found:
                raise ConfigurationError(
                    f"{path}:{number}: element {element} is given twice, first in line "
                    f"{found[element][0]}"
                )
            found[element] = number, values
        missing = set(range(max(found) + 1)) - found.keys()
        if missing:
            raise ConfigurationError(
                f"{path}: element {min(missing)} is missing; each from 0 to {max(found)} must be "
                "there once"
            )
        ordered = [found[element] for element in range(len(found))]
        table = np.array([values for _, values in ordered])
        lines = tuple(number for number, _ in ordered)
        return cls(table[:, 0], table[:, 1], table[:, 2:] / _MM, str(path), lines)

    def to_file(self, path: str | Path) -> None:
        """Write the file that :meth:`from_file` reads.

        Raises
        ------
        ConfigurationError
            If it cannot be written.
        """
        table = np.column_stack([self.gain, self.phase_rad, _MM * self.positions_m])
        rows = [f"{n},{','.join(map(repr, values))}" for n, values in enumerate(table.tolist())]
        with writing_file(path, "calibration"):
            Path(path).write_text("\n".join([",".join(HEADER), *rows, ""]), encoding="utf-8")

    @property
    def count(self) -> int:
        """Number of elements."""
        return len(self.gain)

    @property
    def heard(self) -> BoolArray:
        """(N,) of bool: which elements radiate at all."""
        return self.gain > 0.0

    def moved(self, array: TransducerArray) -> TransducerArray:
        """Return *array* with its elements where they were measured.

        Raises
        ------
        ConfigurationError
            The array has not as many elements; one is more than 10 mm from its place in it, or
            closer than 0.1 mm to another one.
        """
        self._check(array)
        with refusals_of(f"{self.name}:"):
            return array.measured(self.positions_m)

    def _check(self, array: TransducerArray) -> None:
        """Raise ConfigurationError unless all elements of *array* are there, each within 10 mm.

        Neither more nor fewer; the distance is between the calibrated and the array's place.
        """
        elements = f"the array has the elements 0 to {array.count - 1}"
        if self.count < array.count:
            raise ConfigurationError(f"{self.name}: element {self.count} is missing; {elements}")
        if self.count > array.count:
            raise ConfigurationError(
                f"{self._where(array.count)}: element {array.count} is too many; {elements}"
            )
        away_m = np.linalg.norm(self.positions_m - array.positions_m, axis=1)
        worst = int(away_m.argmax())
        if away_m[worst] > _MAX_DISPLACEMENT_M:
            x, y, z = _MM * array.positions_m[worst] + 0.0
            raise ConfigurationError(
                f"{self._where(worst)}: element {worst} is {away_m[worst] * _MM:.4g} mm from its "
                f"place in the array, ({x:g}, {y:g}, {z:g}) mm, must be at most "
                f"{_MAX_DISPLACEMENT_M * _MM:g} mm: in a grid, element n is ix * ny + iy"
            )

    def _where(self, element: int) -> str:
        """Return the file name and line of an element, for error messages."""
        return f"{self.name}:{self.lines[element]}" if self.lines else self.name

    def describe(self, nominal: TransducerArray) -> str:
        """Return in one line how far the elements are from equal ones in their places."""
        away_m = np.linalg.norm(self.positions_m - nominal.positions_m, axis=1)
        return (
            f"gains from {self.gain.min():.3g} to {self.gain.max():.3g}, phases from "
            f"{self.phase_rad.min():.3g} to {self.phase_rad.max():.3g} rad, elements up to "
            f"{away_m.max() * _MM:.3g} mm from their places"
        )


def _calibration_body(
    path: str | Path, rows: Sequence[tuple[int, list[str]]]
) -> list[tuple[int, list[str]]]:
    """Return the rows below the header; raise ConfigurationError if it is wrong or none follow."""
    if not rows:
        raise ConfigurationError(f"{path}: the file is empty, must begin with {','.join(HEADER)}")
    (number, header), *body = rows
    if tuple(header) != HEADER:
        raise ConfigurationError(
            f"{path}:{number}: the header is {','.join(header)!r}, must be {','.join(HEADER)!r}: "
            "phases are in radians, positions in mm"
        )
    if not body:
        raise ConfigurationError(f"{path}: 0 elements, must be 1 to {MAX_TRANSDUCERS}")
    return body


def _calibration_row(where: str, cells: list[str]) -> tuple[int, list[float]]:
    """Return an element's number, and its gain, phase (rad) and place (mm), from a row's cells.

    Raises ConfigurationError, naming *where* and the limit, for a wrong number of cells or a value
    out of its limits.
    """
    if len(cells) != len(HEADER):
        raise ConfigurationError(f"{where}: {len(cells)} values, must be {len(HEADER)}")
    element, *others = cells
    if not (element.isascii() and element.isdecimal()) or float(element) >= MAX_TRANSDUCERS:
        raise ConfigurationError(
            f"{where}: element is {element[:40]!r}, must be a whole number from 0 to "
            f"{MAX_TRANSDUCERS - 1}"
        )
    return int(element), [
        check_number(
            f"{where}: {name}", _calibration_number(f"{where}: {name}", cell), *_LIMITS[name]
        )
        for name, cell in zip(HEADER[1:], others, strict=True)
    ]


def _calibration_number(name: str, cell: str) -> float:
    """Return a cell as float; raise ConfigurationError if it is no number."""
    try:
        return float(cell)
    except ValueError as error:
        raise ConfigurationError(f"{name} is {cell[:40]!r}, must be a number") from error
