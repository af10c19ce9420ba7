"""The settings of the object that is displayed, and of its modulation."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from haptogram.settings.frozen import dataclass

from .arguments import did_you_mean
from .option import SettingError, Settings, option

SHAPES: Final = ("hemisphere", "sphere", "circle", "line", "point")
MESH_SUFFIXES: Final = (".stl", ".obj", ".ply")
#: Units of the lengths in a mesh file, in metres: the file does not say which it has.
UNITS_M: Final = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254}
MOST_MM: Final = 10_000.0  # largest coordinate
MODULATIONS: Final = ("am", "lm", "stm")  # those of haptogram.objects.modulation, which takes numpy


@dataclass(frozen=True, kw_only=True)
class ShapeConfig(Settings):
    """A shape or a mesh, where it is, and how densely it is sampled."""

    object: str = option(
        "hemisphere",
        unit="SHAPE",
        help=f"{', '.join(SHAPES)}, or a mesh file ({', '.join(MESH_SUFFIXES)})",
    )
    resolution_mm: float = option(5.0, unit="MM", low=0.1, high=100.0, help="spacing of the points")
    radius_mm: float = option(
        50.0, unit="MM", low=0.1, high=500.0, help="radius of the shape; half the length of a line"
    )
    center_mm: tuple[float, float, float] = option(
        (0.0, 0.0, 100.0),
        unit="X,Y,Z",
        low=-MOST_MM,
        high=MOST_MM,
        help="centre of the shape above the array",
    )
    unit: str = option("mm", choices=tuple(UNITS_M), help="unit of the lengths in a mesh file")

    def __post_init__(self) -> None:
        """Check the values, and that the object is a shape or a mesh file."""
        super().__post_init__()
        if self.object not in SHAPES and Path(self.object).suffix.lower() not in MESH_SUFFIXES:
            raise SettingError(
                "object",
                f"is {self.object!r}; known are {', '.join(SHAPES)} and a mesh file "
                f"({', '.join(MESH_SUFFIXES)}){did_you_mean(self.object, SHAPES)}",
            )


@dataclass(frozen=True, kw_only=True)
class ModulationConfig(Settings):
    """Modulation of the focus, and the time for which each point is held."""

    modulation: str | None = option(
        None,
        choices=MODULATIONS,
        help="modulation by which the object is felt: am, amplitude; lm, lateral; stm, along the "
        "object in rounds, at constant speed; 'haptogram modulation' shows what arrives",
    )
    modulation_hz: float = option(
        200.0,
        unit="HZ",
        low=0.01,
        high=20_000.0,
        help="frequency of am and lm; rounds per second of stm; at most half the frame rate",
    )
    depth: float = option(
        1.0,
        unit="SHARE",
        high=1.0,
        help="depth of am: 1 swings between full force and none, 0 not at all; the force is the "
        "sine, not the pressure",
    )
    shift_mm: tuple[float, float, float] = option(
        (3.0, 0.0, 0.0),
        unit="X,Y,Z",
        low=-MOST_MM,
        high=MOST_MM,
        help="vector of lm by which the focus swings to both sides",
    )
    dwell_ms: float | None = option(
        None,
        unit="MS",
        low=0.01,
        high=60_000.0,
        help="time for which each point is held, in whole frames",
        absent="one frame",
    )
