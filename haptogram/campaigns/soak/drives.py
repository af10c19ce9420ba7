"""A fixed set of drives, streamed one after the other, and the latch that each must give."""

from __future__ import annotations

import random
from typing import Any, Final, TypeAlias

from haptogram_protocol.messages import Drives, Phases

_COUNT: Final = 61  # prime, so that it meets every phase of what repeats
_FULL: Final = 255
_AMPLITUDES_EVERY: Final = 8

_Registers: TypeAlias = tuple[bytes, bytes]  # phases and amplitudes, 8 bits each


class SoakDrives:
    """Drives of random codes: no half of one is a half of another.

    Parameters
    ----------
    transducers : int
        Of the board.
    """

    def __init__(self, transducers: int) -> None:
        source = random.Random(_COUNT)
        made = [_make_soak_drives(number, transducers, source) for number in range(_COUNT)]
        self._messages = [message for message, _ in made]
        self._registers = [registers for _, registers in made]

    def message(self, index: int) -> Phases | Drives:
        """Return the stream frame with the unwrapped sequence number *index*."""
        return self._messages[index % _COUNT]

    def is_drive(self, index: int, drive: Any) -> bool:
        """Return True if the latched *drive* equals that of frame *index*, code by code."""
        codes = drive.phase_codes.tobytes(), drive.amplitude_codes.tobytes()
        return codes == self._registers[index % _COUNT]


def _make_soak_drives(
    number: int, count: int, source: random.Random
) -> tuple[Phases | Drives, _Registers]:
    """Return a frame and its registers; some have amplitudes."""
    codes = source.randbytes(count)
    if number % _AMPLITUDES_EVERY == 0:
        amplitudes = source.randbytes(count)
        return Drives(codes + amplitudes), (codes, amplitudes)
    return Phases(codes), (codes, bytes([_FULL]) * count)
