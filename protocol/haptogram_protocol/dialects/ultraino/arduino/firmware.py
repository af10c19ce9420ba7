"""Capacities of the firmwares of Ultraino's Arduino boards."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

MAX_BOARDS: Final = 14  # ArduinoMEGA64.java: 15 boards and more are refused


@dataclass(frozen=True)
class ArduinoFirmware:
    """Capacities of a firmware.

    Attributes
    ----------
    wire : str
        Name of the wire in messages.
    pattern_bytes : int
        Slot bytes of a pattern.
    patterns : int
        Patterns of a buffer.
    durations : int
        Durations; 0 if the firmware does not know them.
    """

    wire: str
    pattern_bytes: int
    patterns: int
    durations: int

    @property
    def half_bytes(self) -> int:
        """Bytes of a pattern on the wire."""
        return 2 * self.pattern_bytes


MEGA64_FIRMWARE: Final = ArduinoFirmware(
    "ultraino-mega64", pattern_bytes=100, patterns=32, durations=32
)
NANO16_FIRMWARE: Final = ArduinoFirmware(
    "ultraino-nano16", pattern_bytes=32, patterns=1, durations=0
)
NANO8_FIRMWARE: Final = ArduinoFirmware("ultraino-nano8", pattern_bytes=24, patterns=1, durations=0)
