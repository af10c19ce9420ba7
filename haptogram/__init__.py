"""Host of the Haptogram harness: drives an ultrasonic phased array and verifies what it radiated.

Names are imported when they are asked for: whoever wants only the acoustics pays for no more.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from .acoustics import Calibration
    from .driver import Driver
    from .errors import (
        ConfigurationError,
        DeviceError,
        HaptogramError,
        LinkError,
        VerificationError,
    )
    from .record_file import RecordFile, read_records
    from .records import Evidence, Focus, Intended, Observation
    from .tactile import Circle, Hemisphere, Line, MeshSurface, Point, Sphere
    from .verification import RunVerdict, Tolerance, Uncertainty, verify_run
    from .virtual_board import VirtualBoard

__version__ = "0.1.0"

_HOME: Final = {
    "Calibration": "acoustics",
    "Circle": "tactile",
    "ConfigurationError": "errors",
    "DeviceError": "errors",
    "Driver": "driver",
    "Evidence": "records",
    "Focus": "records",
    "HaptogramError": "errors",
    "Hemisphere": "tactile",
    "Intended": "records",
    "Line": "tactile",
    "LinkError": "errors",
    "MeshSurface": "tactile",
    "Observation": "records",
    "Point": "tactile",
    "RecordFile": "record_file",
    "RunVerdict": "verification",
    "Sphere": "tactile",
    "Tolerance": "verification",
    "Uncertainty": "verification",
    "VerificationError": "errors",
    "VirtualBoard": "virtual_board",
    "read_records": "record_file",
    "verify_run": "verification",
}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f".{_HOME[name]}", __name__), name)


__all__ = [
    "Calibration",
    "Circle",
    "ConfigurationError",
    "DeviceError",
    "Driver",
    "Evidence",
    "Focus",
    "HaptogramError",
    "Hemisphere",
    "Intended",
    "Line",
    "LinkError",
    "MeshSurface",
    "Observation",
    "Point",
    "RecordFile",
    "RunVerdict",
    "Sphere",
    "Tolerance",
    "Uncertainty",
    "VerificationError",
    "VirtualBoard",
    "read_records",
    "verify_run",
]
