"""A fixed set of drives, streamed one after the other, and the latch that each must give."""

from __future__ import annotations

import random
from typing import Any, Final, TypeAlias

from haptogram_protocol.messages import Drives, PhaseFormat, Phases, pack_phases

_COUNT: Final = 61  # prime, so that it meets every phase of what repeats
_FULL: Final = 255
_AMPLITUDES_EVERY: Final = 8
_SIX_BITS: Final = 5  # one of them: it is costly to unpack

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
    """Return a frame and its registers; some are of another format than most."""
    codes, full = source.randbytes(count), bytes([_FULL]) * count
    if number % _AMPLITUDES_EVERY == 0:
        amplitudes = source.randbytes(count)
        return Drives(PhaseFormat.BITS_8, 0, codes + amplitudes), (codes, amplitudes)
    bits = PhaseFormat.BITS_6 if number == _SIX_BITS else PhaseFormat.BITS_8
    shift = PhaseFormat.BITS_8 - bits  # HG-5.2/7: missing low bits are 0
    registers = bytes(code >> shift << shift for code in codes)
    packed = pack_phases(bytes(code >> shift for code in codes), bits)
    return Phases(bits, 0, packed), (registers, full)
