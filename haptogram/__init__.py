"""Host of the Haptogram harness: drives an ultrasonic phased array and verifies what it radiated.

There are 16 rooms, because the root of the errors, the composition root and the entry point are
modules alone.
Names are imported when they are asked for, so that a program that needs only the acoustics pays
for no more.  docs/api.md says which names are public and by which rule they may change.

Examples
--------
>>> import sim_device
>>> from haptogram import *
>>> sim_device.register_url_handler()
>>> url = "haptogram://?clock=virtual&array=8x8&seed=1"
"""

from __future__ import annotations

TYPE_CHECKING = False  # without typing: Ctrl-C is answered once .start is loaded

if TYPE_CHECKING:
    from typing import Any, Final

    from .acoustics import Calibration
    from .driver.dialect_driver import DialectDriver
    from .driver.driver import Driver
    from .errors import (
        ConfigurationError,
        DeviceError,
        HaptogramError,
        LinkError,
        VerificationError,
    )
    from .evidence.virtual_board import VirtualBoard
    from .objects.shapes import Circle, Hemisphere, Line, MeshSurface, Point, Sphere
    from .records.frame import Evidence, Focus, Intended, Observation
    from .report.figures import PictureField, field_on_plane
    from .verification import (
        FrameVerdict,
        RunVerdict,
        Tolerance,
        Uncertainty,
        judge,
        verify_run,
    )

__version__ = "0.3.0"

_LATER: Final = {
    "acoustics": "Calibration",
    "driver.dialect_driver": "DialectDriver",
    "driver.driver": "Driver",
    "errors": "ConfigurationError DeviceError HaptogramError LinkError VerificationError",
    "evidence.virtual_board": "VirtualBoard",
    "objects.shapes": "Circle Hemisphere Line MeshSurface Point Sphere",
    "records.frame": "Evidence Focus Intended Observation",
    "report.figures": "PictureField field_on_plane",
    "verification": "FrameVerdict RunVerdict Tolerance Uncertainty judge verify_run",
}
_HOME: Final = {name: module for module, names in _LATER.items() for name in names.split()}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    import importlib

    return getattr(importlib.import_module(f".{_HOME[name]}", __name__), name)


def __dir__() -> list[str]:
    return sorted(__all__)


__all__ = [
    "Calibration",
    "Circle",
    "ConfigurationError",
    "DeviceError",
    "DialectDriver",
    "Driver",
    "Evidence",
    "Focus",
    "FrameVerdict",
    "HaptogramError",
    "Hemisphere",
    "Intended",
    "Line",
    "LinkError",
    "MeshSurface",
    "Observation",
    "PictureField",
    "Point",
    "RunVerdict",
    "Sphere",
    "Tolerance",
    "Uncertainty",
    "VerificationError",
    "VirtualBoard",
    "field_on_plane",
    "judge",
    "verify_run",
]
