"""Table 1 of the paper, and what several readings of its text predict for it.

A reading fixes what the text leaves open.  Each gives, for every point of the hemisphere, a force
proportional to |p(focus)|^n = (sum |D_n / r_n|)^n; one scale for all sixteen averages is fitted, as
no absolute value follows from the printed constants.  The standard deviations take the same scale
and are not fitted.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from haptogram.acoustics import AcousticModel, Medium, PointSource, Transducer, TransducerArray
from haptogram.acoustics.arrays import FloatArray
from haptogram.acoustics.field.reference import propagators
from haptogram.acoustics.model.directivities import RectangularPiston
from haptogram.acoustics.model.transducer import Directivity

from .equations import PaperConstants
from .hemisphere import (
    RESOLUTIONS_M,
    paper_hemisphere,
    paper_hemisphere_by_height,
)

CONFIGURATIONS: Final = ((128, 1), (64, 2), (32, 4), (16, 8))

# (average, standard deviation) in mN: rows as CONFIGURATIONS, columns as RESOLUTIONS_M.
PRINTED: Final = (
    ((3.30, 0.38), (3.17, 0.41), (3.14, 0.46), (3.04, 0.54)),
    ((3.90, 0.96), (3.85, 0.94), (3.78, 0.83), (3.70, 0.76)),
    ((4.33, 0.67), (4.24, 0.62), (4.07, 0.53), (3.83, 0.38)),
    ((4.33, 0.97), (3.96, 0.88), (3.89, 0.66), (3.62, 0.34)),
)
TOLERANCE: Final = 0.07  # of the printed value: what counts as reproduced
_POINTS_PER_CHUNK: Final = 256


@dataclass(frozen=True, slots=True)
class Table1Reading:
    """One way to read the paper.

    Attributes
    ----------
    name, remark : str
        Short name; what speaks for it.
    spacing_m : (float, float)
        Spacing of element centres along x (M elements) and y (N elements).
    element_m : (float, float) or None
        Width and height of the pistons; None for point sources.
    exponent : float
        n in force ~ |p|^n.
    spreading : bool
        Whether an element's pressure falls off as 1/r; without it, equation (7) to the letter.
    sampling : callable
        Resolution in metres to (T, 3) points.
    """

    name: str
    remark: str
    spacing_m: tuple[float, float] = (1.4e-3, 5.4e-3)
    element_m: tuple[float, float] | None = (1e-3, 5e-3)
    exponent: float = 2.0
    spreading: bool = True
    sampling: Callable[[float], FloatArray] = field(default=paper_hemisphere)


BEST_READING: Final = Table1Reading(
    "kerf 0.4 mm, |p|^2",
    "elements of 1 x 5 mm as in the text, kerf of the FOCUS example that it follows, 1/r as in the "
    "text, radiation pressure ~ |p|^2",
)
READINGS: Final = (
    BEST_READING,
    Table1Reading("kerf 0.5 mm, |p|^2", "the spacing that the text prints", (1.5e-3, 5.5e-3)),
    Table1Reading("|p|^3", "the power of equation (8)", exponent=3.0),
    Table1Reading("|p|^1", "a force proportional to the pressure", exponent=1.0),
    Table1Reading(
        "points, |p|^1.5",
        "kerf 0.5 mm; standard deviations half as far off as in the best, still wrong; "
        "no physics has this power",
        (1.5e-3, 5.5e-3),
        None,
        1.5,
    ),
    Table1Reading(
        "rings by height", "another sampling of the sphere", sampling=paper_hemisphere_by_height
    ),
    Table1Reading(
        "10 mm elements",
        "the transducers of section 3",
        (0.010, 0.010),
        (0.010, 0.010),
    ),
    Table1Reading(
        "equations (7) and (8)",
        "to the letter: no spreading, no directivity, |p|^3",
        element_m=None,
        exponent=3.0,
        spreading=False,
    ),
)


@dataclass(frozen=True, slots=True)
class Table1Cell:
    """One cell of Table 1: printed and predicted, in mN.

    Attributes
    ----------
    configuration : (int, int)
        Elements along x and y.
    resolution_m : float
        Spacing of the points.
    points : int
        Their number.
    """

    configuration: tuple[int, int]
    resolution_m: float
    points: int
    printed_average_mn: float
    printed_deviation_mn: float
    average_mn: float
    deviation_mn: float

    @property
    def average_error(self) -> float:
        """Predicted over printed average, minus 1."""
        return self.average_mn / self.printed_average_mn - 1.0

    @property
    def deviation_error(self) -> float:
        """Predicted over printed standard deviation, minus 1."""
        return self.deviation_mn / self.printed_deviation_mn - 1.0

    @property
    def average_reproduced(self) -> bool:
        """True if the average is within 7 % of the printed one."""
        return abs(self.average_error) <= TOLERANCE

    @property
    def deviation_reproduced(self) -> bool:
        """True if the standard deviation is within 7 % of the printed one."""
        return abs(self.deviation_error) <= TOLERANCE

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        columns, rows = self.configuration
        return {
            "configuration": f"{columns}x{rows}",
            "resolution_mm": self.resolution_m * 1e3,
            "points": self.points,
            "printed_average_mn": self.printed_average_mn,
            "average_mn": self.average_mn,
            "average_error": self.average_error,
            "average_reproduced": self.average_reproduced,
            "printed_deviation_mn": self.printed_deviation_mn,
            "deviation_mn": self.deviation_mn,
            "deviation_error": self.deviation_error,
            "deviation_reproduced": self.deviation_reproduced,
        }


@dataclass(frozen=True, slots=True)
class Table1Reproduction:
    """Table 1 under one reading.

    Attributes
    ----------
    reading : Reading
        The reading.
    scale_mn : float
        The one fitted number: mN per (1/m)^exponent, or per (Pa)^exponent without spreading.
    cells : tuple of Cell
        Sixteen, row by row.
    """

    reading: Table1Reading
    scale_mn: float
    cells: tuple[Table1Cell, ...]

    @property
    def average_rms_mn(self) -> float:
        """Root mean square difference of the averages."""
        return _table_1_rms(cell.average_mn - cell.printed_average_mn for cell in self.cells)

    @property
    def deviation_rms_mn(self) -> float:
        """Root mean square difference of the standard deviations."""
        return _table_1_rms(cell.deviation_mn - cell.printed_deviation_mn for cell in self.cells)

    @property
    def worst_average_error(self) -> float:
        """Largest relative error of an average."""
        return max(abs(cell.average_error) for cell in self.cells)

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        return {
            "reading": self.reading.name,
            "remark": self.reading.remark,
            "exponent": self.reading.exponent,
            "scale_mn": self.scale_mn,
            "average_rms_mn": self.average_rms_mn,
            "deviation_rms_mn": self.deviation_rms_mn,
            "worst_average_error": self.worst_average_error,
            "averages_reproduced": sum(cell.average_reproduced for cell in self.cells),
            "deviations_reproduced": sum(cell.deviation_reproduced for cell in self.cells),
            "cells": [cell.as_dict() for cell in self.cells],
        }


def reproduce_table_1(reading: Table1Reading = BEST_READING) -> Table1Reproduction:
    """Return Table 1 as *reading* predicts it, with one scale fitted to its averages."""
    clouds = [reading.sampling(resolution) for resolution in RESOLUTIONS_M]
    forces = [
        [_table_1_amplitudes(reading, shape, points) ** reading.exponent for points in clouds]
        for shape in CONFIGURATIONS
    ]
    averages = np.array([[cell.mean() for cell in row] for row in forces])
    deviations = np.array([[cell.std() for cell in row] for row in forces])
    printed = np.array(PRINTED)[:, :, 0]
    scale = float((averages * printed).sum() / (averages**2).sum())
    cells = tuple(
        Table1Cell(
            shape,
            resolution,
            len(clouds[j]),
            *PRINTED[i][j],
            scale * float(averages[i, j]),
            scale * float(deviations[i, j]),
        )
        for i, shape in enumerate(CONFIGURATIONS)
        for j, resolution in enumerate(RESOLUTIONS_M)
    )
    return Table1Reproduction(reading, scale, cells)


def _table_1_model(reading: Table1Reading, shape: tuple[int, int]) -> AcousticModel:
    """Return the array of one configuration: lossless, k as printed, 1 Pa m peak per element."""
    constants = PaperConstants()
    columns, rows = (
        (np.arange(count) - (count - 1) / 2) * spacing
        for count, spacing in zip(shape, reading.spacing_m, strict=True)
    )
    x, y = np.meshgrid(columns, rows, indexing="ij")
    positions = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    piston: Directivity = (
        PointSource() if reading.element_m is None else RectangularPiston(*reading.element_m)
    )
    speed = 2.0 * math.pi * constants.frequency_hz / constants.wavenumber
    return AcousticModel(
        TransducerArray.from_positions(positions),
        Medium(speed, constants.density_kg_m3),
        Transducer(piston, 1.0 / math.sqrt(2.0), constants.frequency_hz),
    )


def _table_1_amplitudes(
    reading: Table1Reading, shape: tuple[int, int], points_m: FloatArray
) -> FloatArray:
    """Return |p| at each point when the array is focused on it: the sum of the magnitudes."""
    if not reading.spreading:
        constants = PaperConstants()
        level = math.sqrt(2.0) * constants.pressure_pa * math.prod(shape)
        decay: FloatArray = level * np.exp(-constants.attenuation_np_m * points_m[:, 2])
        return decay
    model = _table_1_model(reading, shape)
    chunks = range(0, len(points_m), _POINTS_PER_CHUNK)
    return np.concatenate(
        [
            np.abs(propagators(model, points_m[start : start + _POINTS_PER_CHUNK])).sum(axis=1)
            for start in chunks
        ]
    )


def _table_1_rms(values: Iterator[float]) -> float:
    return math.sqrt(float(np.mean(np.square(list(values)))))
