"""SonicSurface, 256 emitters: primary, secondary and tactile firmware.

A frame is FE, 256 codes and FD: 258 bytes at 230 400 baud, 8N1; one build has 1 462 857 baud. The
board never answers. Source: upnalab/SonicSurface 0c7b689, ``Distribute.vhd`` and ``PhaseLine.vhd``
of the three firmwares; clients: ``Python/SonicSurface.py`` 666c2dd.

Primary and secondary
    C0 selects the primary, C1 the secondary; both listen after power-up. 96 and 97 stop and start
    the clocks of the shift registers. Any other byte is a code, masked to 5 bits. FD works on a
    board that does not listen too, and gives the previous pattern back when it comes twice.
Tactile
    A0 to BF set the step of the amplitude modulation; C0, C1, 96 and 97 are codes. The board adds
    :data:`TACTILE_CORRECTION` to every code that is not off, and radiates half the resolution:
    code >> 1 in 16 slots of a period.

Not known: the channel of a phase correction for code number 256 and later of a frame.
"""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Sequence
from typing import Final

from .codec import Codes, Dialect, Operation
from .fpga_bytes.board_end import FpgaBoardEnd
from .fpga_bytes.host_end import FpgaDisplay, FpgaHostEnd
from .fpga_bytes.operations import Begin, Clocks, FpgaByteRules, ModulationStep, Select, Swap

CHANNELS: Final = 256
OFF: Final = 32
TACTILE_STEPS: Final = 16  # of a period at the outputs of the tactile firmware,
TACTILE_WIDTH: Final = 7  # and of its pulses

RULES: Final = FpgaByteRules(
    "sonicsurface",
    CHANNELS,
    OFF,
    {
        0xFE: Begin(),
        0xFD: Swap(),
        0x96: Clocks(False),
        0x97: Clocks(True),
        0xC0: Select(0),
        0xC1: Select(1),
    },
)
TACTILE_RULES: Final = FpgaByteRules(
    "sonicsurface-tactile",
    CHANNELS,
    OFF,
    {0xFE: Begin(), 0xFD: Swap(), **{0xA0 + step: ModulationStep(step) for step in range(32)}},
)

# Steps of 1/32 period that the tactile firmware adds, in the order of the wire: near 16 for
# emitters that are mounted the other way round. "FPGA tactile modulation/src/Distribute.vhd",
# PHASE_CORRECTION, 0c7b689.
TACTILE_CORRECTION: Final = bytes.fromhex(
    "000e0f1f0f0f00001001011d0f0f11011f110f1f1e1f0d1e0012121e0f0e1f0e"
    "1e0f00000f0f010001110d1d0f00000000101f1e1f001f001000100f1e0e1100"
    "0e1f1e0d1e0e0e1e0f01000d1f1f1f1f0e1f011d1f000f0e1000001f00110f0e"
    "000f1e1000110011110f000e00100200120001000f12011112001010110e0101"
    "0e0f011e110e02101f03110e10110100011e001e000e0f0f0d1e1f0f1f000000"
    "001f1f0e1f1f100012110100101f1e1e1000120e00100e021013011e1f100f01"
    "1010031e0f1f1f000001111f02101000000d100e100e1f0d0d1f0f0f0f101e0f"
    "00101f1f01000f12001f010f0100000e0f0110000f121e011302101e0f0f0101"
)


class _TactileDisplay(FpgaDisplay):
    """The tactile firmware: it is sent codes that its own correction turns into those meant."""

    level = math.sin(math.pi * TACTILE_WIDTH / TACTILE_STEPS)
    mounting = tuple(-added / OFF for added in TACTILE_CORRECTION)

    def __init__(self) -> None:
        super().__init__(TACTILE_RULES, TACTILE_STEPS)

    def frame(self, codes: Codes) -> list[Operation]:
        pairs = zip(codes, TACTILE_CORRECTION, strict=True)
        sent = [None if code is None else (2 * code - added) % OFF for code, added in pairs]
        return super().frame(sent)

    def read(self, operations: Sequence[Operation]) -> list[int | None] | None:
        codes = super().read(operations)
        if codes is None:
            return None
        pairs = zip(codes, TACTILE_CORRECTION, strict=True)
        return [None if code is None else (code + added) % OFF // 2 for code, added in pairs]


SONICSURFACE: Final = Dialect(
    name="sonicsurface",
    title="SonicSurface, primary and secondary firmware",
    bauds=(230_400, 1_462_857),
    steps=32,
    channels=CHANNELS,
    frame_bytes=lambda boards: CHANNELS + 2 if boards == 1 else (CHANNELS + 1) * boards + 2,
    board=functools.partial(FpgaBoardEnd, RULES),
    host=functools.partial(FpgaHostEnd, RULES),
    signature=re.compile(rb"(?<![\xa0-\xbf])\xfe(?:[\xc0\xc1]?[\x00-\x20]{256}){1,2}\xfd"),
    display=lambda boards: FpgaDisplay(RULES, 32, boards),
    layout="sonicsurface",
)
TACTILE: Final = Dialect(
    name="sonicsurface-tactile",
    title="SonicSurface, tactile firmware",
    bauds=(230_400,),
    steps=32,
    channels=CHANNELS,
    frame_bytes=lambda boards: (CHANNELS + 2) * boards,
    board=functools.partial(FpgaBoardEnd, TACTILE_RULES),
    host=functools.partial(FpgaHostEnd, TACTILE_RULES),
    signature=re.compile(
        rb"[\xa0-\xbf]\xfe[\x00-\x20]{256}\xfd|\xfe[\x00-\x20]{256}\xfd[\xa0-\xbf]"
    ),
    display=lambda _: _TactileDisplay(),
    layout="sonicsurface",
)
DIALECTS: Final = (SONICSURFACE, TACTILE)
