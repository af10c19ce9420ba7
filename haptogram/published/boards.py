"""The open boards."""

from __future__ import annotations

import dataclasses
from typing import Final

from haptogram.acoustics import AcousticModel, CircularPiston, Medium, PointSource, Transducer
from haptogram.acoustics.model.boards import grids
from haptogram.acoustics.model.boards.bowls import TINYLEV as TINYLEV_LAYOUT
from haptogram.acoustics.model.boards.grids import INTERACTLAB as INTERACTLAB_LAYOUT
from haptogram.acoustics.model.boards.grids import SONICSURFACE as SONICSURFACE_LAYOUT
from haptogram.acoustics.model.boards.layout import BoardLayout
from haptogram.published.figures import (
    Preset,
    PublishedFigure,
    Quantity,
    published_element_count,
    published_extent_mm,
    published_pressure_rms_pa,
    published_quantised_share,
)

# AUTD3 takes 4.386 Pa m peak for a T4010A1, which is 3.10 Pa m RMS: the strength of our default.
_STRENGTH_PA_M: Final = 3.10


def _row_centre_mm(model: AcousticModel) -> float:
    """Return the distance |y| of the array's centre from the origin, in mm."""
    return 1e3 * abs(float(model.array.centre_m[1]))


SONICSURFACE: Final = Preset(
    "sonicsurface",
    "SonicSurface: open 16 x 16 board of 10.5 mm pitch, elements in the order of its wire",
    "R. Morales et al., Appl. Sci. 11, 2981 (2021); github.com/upnalab/SonicSurface",
    "element map of its repository, all 256 entries",
    lambda: AcousticModel(grids.sonicsurface(), Medium.air(), Transducer(CircularPiston(4.5e-3))),
    (0.0, 0.0, 0.15),
    (
        published_element_count("256 (16 x 16)", "its repository"),
        PublishedFigure(
            "centre of the rows off the origin",
            Quantity(_row_centre_mm, "mm"),
            "2.0 mm",
            "its repository",
        ),
        PublishedFigure(
            "side of the array",
            published_extent_mm(0, 1e3 * grids.SONICSURFACE_PITCH_M),
            f"{16 * grids.SONICSURFACE_PITCH_M * 1e3:g} mm (16 x 10.5)",
            "its repository",
        ),
        PublishedFigure(
            "|p| with 8 phase steps",
            published_quantised_share((0.02, 0.01, 0.15), 3),
            "'diminishing returns beyond 8'",
            "Appl. Sci. 11, 2981",
        ),
        PublishedFigure(
            "|p| with its 32 phase steps", published_quantised_share((0.02, 0.01, 0.15), 5)
        ),
    ),
    SONICSURFACE_LAYOUT,
)

_AUTD: Final = "pyautd3_emulator 36.0.2, run"
AUTD: Final = Preset(
    "autd3",
    "AUTD3: one unit of 249 elements at 10.16 mm",
    "github.com/shinolab/autd3-rs",
    "its source: 18 x 14 grid less three places",
    lambda: AcousticModel(
        grids.autd_unit(), Medium(340.0, 1.2041), Transducer(PointSource(), _STRENGTH_PA_M)
    ),
    (0.0, 0.0, 0.15),
    (
        published_element_count("249", "its source"),
        PublishedFigure(
            "pressure at a focus 150 mm above",
            published_pressure_rms_pa((0.0, 0.0, 0.15)),
            "4727 Pa RMS",
            _AUTD,
            "as there: no directivity, no absorption, c = 340 m/s",
        ),
    ),
    grids.AUTD3,
)


def _preset_of_layout(
    layout: BoardLayout, source: str, count: str, *figures: PublishedFigure
) -> Preset:
    """Return a board of 4.5 mm pistons whose typical focus is 100 mm above its middle."""
    piston = Transducer(CircularPiston(4.5e-3))
    return Preset(
        layout.name,
        layout.title,
        source,
        layout.source,
        lambda: AcousticModel(layout.array(), Medium.air(), piston),
        (0.0, 0.0, 0.1),
        (published_element_count(count, "its array file"), *figures),
        layout,
    )


_OFF_ORIGIN: Final = PublishedFigure(
    "centre of the rows off the origin",
    Quantity(_row_centre_mm, "mm"),
    "0 mm",
    "its array file",
    "2 mm from where SonicSurface's own program has it",
)
_ULTRAINO: Final = "A. Marzo et al., IEEE Trans. UFFC 65(1) (2018); github.com/asiermarzo/Ultraino"
ULTRAINO: Final = _preset_of_layout(
    grids.ULTRAINO_SONICSURFACE, _ULTRAINO, "256 (16 x 16)", _OFF_ORIGIN
)
FLAT8: Final = _preset_of_layout(grids.ULTRAINO_FLAT8, _ULTRAINO, "64 (8 x 8)")
INTERACTLAB: Final = _preset_of_layout(
    INTERACTLAB_LAYOUT, "github.com/RMResearch/OpenMPD_Hardware", "256 (16 x 16)"
)
TINYLEV: Final = dataclasses.replace(
    _preset_of_layout(
        TINYLEV_LAYOUT, "A. Marzo et al., Rev. Sci. Instrum. 88, 085105 (2017)", "72"
    ),
    focus_m=(0.0, 0.0, 0.02),
)
