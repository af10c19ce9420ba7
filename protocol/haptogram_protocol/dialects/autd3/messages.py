"""Messages of the link of AUTD3: operations of the client, and replies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from ..codec import Operation, Reply
from .frame import Autd3DeviceFrame, Autd3DeviceState
from .operations import autd3_error_text

VERSION: Final = 1  # of the link, in autd3 38


@dataclass(frozen=True, slots=True)
class Pose:
    """Position of a device's first element in millimetres, and its rotation w, x, y, z."""

    position: tuple[float, float, float]
    rotation: tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class Hello(Operation):
    """The client names the version of the link."""

    version: int = VERSION


@dataclass(frozen=True, slots=True)
class Open(Operation):
    """The client names its devices."""

    devices: tuple[Pose, ...]


@dataclass(frozen=True, slots=True)
class Update(Operation):
    """The client moves its devices; their number stays that of :class:`Open`."""

    devices: tuple[Pose, ...]


@dataclass(frozen=True, slots=True)
class Write(Operation):
    """A frame for each device."""

    frames: tuple[Autd3DeviceFrame, ...]


@dataclass(frozen=True, slots=True)
class Read(Operation):
    """The client asks what every device answers."""


@dataclass(frozen=True, slots=True)
class Close(Operation):
    """The client ends the link."""


@dataclass(frozen=True, slots=True)
class Undecodable(Operation):
    """Nothing can be understood from here on; *reason* is for a :class:`Autd3Refused`."""

    reason: str


@dataclass(frozen=True, slots=True)
class Accepted(Reply):
    """The board did what it was asked."""


@dataclass(frozen=True, slots=True)
class Autd3Refused(Reply):
    """The board did not, and says why."""

    reason: str

    @property
    def refusal(self) -> str | None:
        """The reason."""
        return self.reason


@dataclass(frozen=True, slots=True)
class Autd3States(Reply):
    """Answers of all devices."""

    devices: tuple[Autd3DeviceState, ...]

    @property
    def refusal(self) -> str | None:
        """The first error of a device."""
        for number, device in enumerate(self.devices):
            if device.error:
                return f"device {number} answers {autd3_error_text(device.error)}"
        return None
