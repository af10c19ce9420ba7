"""The foci of figure 4: a concave cylindrical section of 64 x 1 elements.

The text gives no radius.  The FOCUS example that the paper follows takes r = N s / pi: 64 elements
at a spacing of 1.4 mm along a half circle of 28.5 mm radius, z = r - r cos(angle).

FOCUS bends the section along x.  Such an array lies in the plane y = 0 and cannot focus off it: at
the printed targets all elements are in phase, yet also at their mirror images, and the sound is
louder on the plane between the two.  Bent along y instead, it focuses toward the targets, with the
maximum pulled in by diffraction.  The figure's caption does not tell which it is; both are
computed.
"""

from __future__ import annotations

import math
from typing import Final, Literal, TypeAlias

import numpy as np

from haptogram.acoustics import AcousticModel, Medium, Transducer, TransducerArray
from haptogram.acoustics.model.directivities import RectangularPiston
from haptogram.errors import ConfigurationError

from .equations import PaperConstants

Bend: TypeAlias = Literal["x", "y"]

BENDS: Final[tuple[Bend, ...]] = ("x", "y")
FIGURE_4_FOCI_M: Final = ((0.0, 0.030, 0.090), (0.0, 0.060, 0.075))
FIGURE_4_ELEMENTS: Final = 64
ELEMENT_M: Final = (1e-3, 5e-3)
KERF_M: Final = 0.4e-3
# On the axis of 120 dB SPL at 0.3 m, a strong 40 kHz transducer: 6 Pa m.  The paper gives no
# usable level; pictures in Pa need one.
SOURCE_STRENGTH_PA_M: Final = 6.0
_WIDTH_AXIS: Final = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0)}


def figure_4_section(
    count: int, spacing_m: float, radius_m: float, bend: Bend = "x"
) -> TransducerArray:
    """Return *count* elements on an arc over the x or the y axis that face its centre.

    Raises
    ------
    ConfigurationError
        An arc of more than a half circle, whose elements would face away from the targets.
    """
    span = count * spacing_m / radius_m
    if span > math.pi * (1.0 + 1e-9):
        raise ConfigurationError(
            f"{count} elements of {spacing_m * 1e3:g} mm take {math.degrees(span):.4g} degrees of "
            f"a circle of {radius_m * 1e3:g} mm, at most 180"
        )
    angle = (np.arange(count) - (count - 1) / 2) * spacing_m / radius_m
    zeros = np.zeros(count)
    order = [0, 1, 2] if bend == "x" else [1, 0, 2]
    positions = radius_m * np.stack([np.sin(angle), zeros, 1.0 - np.cos(angle)], axis=1)
    normals = np.stack([-np.sin(angle), zeros, np.cos(angle)], axis=1)
    return TransducerArray.from_positions(positions[:, order], normals[:, order])


def figure_4_model(bend: Bend = "x") -> AcousticModel:
    """Return the array of figure 4, lossless as section 4.1 says, with k as printed."""
    constants = PaperConstants()
    spacing = ELEMENT_M[0] + KERF_M
    radius = FIGURE_4_ELEMENTS * spacing / math.pi
    return AcousticModel(
        figure_4_section(FIGURE_4_ELEMENTS, spacing, radius, bend),
        Medium(
            2.0 * math.pi * constants.frequency_hz / constants.wavenumber, constants.density_kg_m3
        ),
        Transducer(
            RectangularPiston(*ELEMENT_M, width_axis=_WIDTH_AXIS[bend]),
            SOURCE_STRENGTH_PA_M,
            constants.frequency_hz,
        ),
    )
