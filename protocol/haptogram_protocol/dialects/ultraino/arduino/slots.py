"""Firmware of Ultraino's Arduino boards: slot bytes and the pulses that they are, there and back.

A pattern says for each slot of the period which outputs are high, a byte for each port of eight.
Source: asiermarzo/Ultraino 3d5a02a, ``protocols/ArduinoMEGA64.java`` (PORT_MAPPING) and
``DeviceConnection.java`` (``calcSignals01``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from ....errors import LocalProtocolError


@dataclass(frozen=True, slots=True)
class Pulse:
    """One pulse in a period.

    Attributes
    ----------
    code : int
        Slot of the rising edge.
    width : int
        Slots that are high.
    """

    code: int
    width: int


@dataclass(frozen=True)
class ArduinoFirmware:
    """A firmware: its capacities, and the places of the channels' bits in the bytes of a slot.

    Attributes
    ----------
    wire : str
        Name of the wire in messages.
    steps : int
        Slots in a period.
    ports : int
        Bytes of a slot.
    pins : tuple of int
        For each channel the number of its output: port times 8 plus bit.
    patterns : int
        Patterns of a buffer.
    durations : int
        Durations; 0 if the firmware does not know them.
    connected : bytes
        For each port the outputs that are connected; empty: all.
    """

    wire: str
    steps: int
    ports: int
    pins: tuple[int, ...]
    patterns: int = 1
    durations: int = 0
    connected: bytes = b""

    @property
    def pattern_bytes(self) -> int:
        """Slot bytes of a pattern."""
        return self.steps * self.ports

    @property
    def half_bytes(self) -> int:
        """Bytes of a pattern on the wire."""
        return 2 * self.pattern_bytes

    def pulses(self, slots: bytes) -> list[Pulse | None]:
        """Return the pulse of each channel; None for a channel that has not exactly one.

        A channel that is always high has ``Pulse(0, steps)``, one that is always low
        ``Pulse(0, 0)``. Missing slot bytes are low.
        """
        whole = slots.ljust(self.pattern_bytes, b"\0")
        return [self._pulse(whole, pin) for pin in self.pins]

    def slots(self, pulses: Sequence[Pulse]) -> bytes:
        """Return the slot bytes in which each channel has its pulse.

        Raises
        ------
        LocalProtocolError
            If there are not as many pulses as channels, or a pulse does not fit the period.
        """
        if len(pulses) != len(self.pins):
            raise LocalProtocolError(f"{len(pulses)} pulses; there are {len(self.pins)} channels")
        filled = bytearray(self.pattern_bytes)
        for pin, pulse in zip(self.pins, pulses, strict=True):
            if not (0 <= pulse.code < self.steps and 0 <= pulse.width <= self.steps):
                raise LocalProtocolError(f"{pulse}; a period has {self.steps} slots")
            for slot in range(pulse.code, pulse.code + pulse.width):
                filled[slot % self.steps * self.ports + pin // 8] |= 1 << pin % 8
        return bytes(filled)

    def _pulse(self, slots: bytes, pin: int) -> Pulse | None:
        """Return the pulse (rise and width, in steps) of a pin in one carrier period.

        None if it has several. *slots* has a byte for each port of 8 pins, step by step.
        """
        levels = [port >> pin % 8 & 1 for port in slots[pin // 8 :: self.ports]]
        width = sum(levels)
        if width in (0, self.steps):
            return Pulse(0, width)
        rises = [at for at, level in enumerate(levels) if level and not levels[at - 1]]
        return Pulse(rises[0], width) if len(rises) == 1 else None


_PORT_MAPPING: Final = """
    51 52 53 54 28 29 30 31 47 46 45 44 43 42 41 40 56 57 58 59 48 49 72 69 39 38 37 36 35 34 33 32
    21 23 65 63  9 11 13 15 20 22 64 66  8 10 12 14 24 25 26 27 16 17 18 19  7  6  5  4  3  2  1  0
"""
MEGA64_FIRMWARE: Final = ArduinoFirmware(
    "ultraino-mega64", 10, 10, tuple(map(int, _PORT_MAPPING.split())), patterns=32, durations=32
)
# DDRC = 0b00111111, DDRD = 0b11111100: 12 outputs of 16, DriverNano16.ino, 6411b27.
NANO16_FIRMWARE: Final = ArduinoFirmware(
    "ultraino-nano16", 16, 2, tuple(range(16)), connected=bytes([0b00111111, 0b11111100])
)
NANO8_FIRMWARE: Final = ArduinoFirmware("ultraino-nano8", 24, 1, tuple(range(8)))
