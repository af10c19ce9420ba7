"""The patterns that an Arduino board takes for the buffer that does not radiate."""

from __future__ import annotations

from typing import Final

from ...codec import Operation
from .firmware import ArduinoFirmware
from .operations import SetPattern

_HIGH_NIBBLE: Final = b"".join(b"%x" % (byte >> 4) for byte in range(256))  # as hexadecimal digit


class PatternMemory:
    """Half slot bytes that a board has taken since its last swap.

    Attributes
    ----------
    patterns : int
        Whole patterns.
    halves : bytearray
        Halves of the pattern that has not ended.
    beyond : int
        Halves that there was no room for.
    """

    def __init__(self, board: int, firmware: ArduinoFirmware) -> None:
        self._board, self._limit, self._size = board, firmware.patterns, firmware.half_bytes
        self.patterns = self.beyond = 0
        self.halves = bytearray()

    @property
    def whole(self) -> int:
        """Patterns that came since the last swap, those that there is no room for as well."""
        return self.patterns + self.beyond // self._size

    @property
    def is_partial(self) -> bool:
        """True if the last pattern has not ended."""
        return bool(self.halves or self.beyond % self._size)

    def take(self, halves: bytes, found: list[Operation]) -> int:
        """Add *halves*, and patterns that end to *found*; return how many there is no room for."""
        size = self._size
        lost = len(self.halves) + len(halves) - (self._limit - self.patterns) * size
        if lost > 0:
            self.beyond += lost
            halves = halves[:-lost]
        self.halves += halves
        while len(self.halves) >= size:
            self._emit_pattern(self.halves[:size], found)
            del self.halves[:size]
        return max(0, lost)

    def restart(self, found: list[Operation]) -> bool:
        """Begin with slot 0; add the pattern that has not ended, and return True if there is one.

        Patterns that there is no room for are forgotten.
        """
        is_short = bool(self.halves)
        if is_short:
            self._emit_pattern(self.halves, found)
            self.halves.clear()
        self.patterns = self.beyond = 0
        return is_short

    def _emit_pattern(self, halves: bytearray, found: list[Operation]) -> None:
        """Append a decoded pattern to *found*."""
        digits = halves.translate(_HIGH_NIBBLE).decode("ascii")
        slots = bytes.fromhex(digits + "0" * (len(digits) % 2))
        found.append(SetPattern(self._board, self.patterns, slots))
        self.patterns += 1
