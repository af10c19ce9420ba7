"""Ultraino's FPGA boards: SimpleFPGA, SimpleFPGA_128 and ChainedFPGA.

No board answers, and the client ignores what comes. Source of the bytes: asiermarzo/Ultraino
3d5a02a, ``AcousticFieldSim/src/acousticfield3d/protocols/SimpleFPGA.java``, ``SimpleFPGA_128.java``
and ``ChainedFPGA.java``. Source of what a board does: the HDL of SonicSurface (see
:mod:`..sonicsurface`), which is the one that is published.

SimpleFPGA
    FE and 256 codes at 230 400 baud; FB and 256 amplitudes of 0 to 16 behind them if an amplitude
    is strictly between 0 and 0.99; FD apart. The published HDL knows neither FB nor FC: FB and the
    amplitudes fall through as codes, over the phases. ``fb="amplitude"`` makes a board that takes
    amplitudes, and FC.
SimpleFPGA_128
    FE, 72 codes of 128 steps (80h is off) and FD: 74 bytes at 1 500 000 baud.
ChainedFPGA
    For each board C0 + number and 256 codes, without FE; FD apart.

Not known, for no HDL is published: what a board with amplitudes does with an amplitude above 16
(taken as it is here) and when amplitudes show (with FD here); what the board of 128 steps does with
bytes above 80h (masked here), with codes after the last channel (dropped here), and whether it
knows 96, 97 and C0 (codes here); what the third board of a chain and later ones do (C0 + number
selects each here, as it does the first two).
"""

from __future__ import annotations

import functools
import re
from typing import Final, TypeVar

from ...errors import LocalProtocolError
from ..codec import Dialect, Operation
from ..fpga_bytes.board_end import FpgaBoardEnd
from ..fpga_bytes.host_end import FpgaDisplay, FpgaHostEnd
from ..fpga_bytes.operations import (
    Begin,
    BeginAmplitudes,
    Clocks,
    FpgaByteRules,
    Select,
    Swap,
    ToggleMultiplex,
)

CHANNELS: Final = 256
CHANNELS_128: Final = 72
MAX_BOARDS: Final = 16  # C0 to CF
FALLS_THROUGH: Final = "falls-through"  # what the published HDL does with FB

_COMMON: Final[dict[int, Operation]] = {0xFD: Swap(), 0x96: Clocks(False), 0x97: Clocks(True)}
_SIMPLE: Final = {0xFE: Begin(), 0xC0: Select(0), 0xC1: Select(1), **_COMMON}
RULES: Final = {
    FALLS_THROUGH: FpgaByteRules("ultraino-fpga", CHANNELS, 32, _SIMPLE),
    "amplitude": FpgaByteRules(
        "ultraino-fpga",
        CHANNELS,
        32,
        {**_SIMPLE, 0xFB: BeginAmplitudes(), 0xFC: ToggleMultiplex()},
        amplitude_limit=16,
    ),
}
RULES_128: Final = FpgaByteRules(
    "ultraino-fpga-128", CHANNELS_128, 128, {0xFE: Begin(), 0xFD: Swap()}, wraps=False
)


_End = TypeVar("_End", FpgaBoardEnd, FpgaHostEnd)


def _simple_ultraino_end(end: type[_End], *, fb: str = FALLS_THROUGH) -> _End:
    """Return an end of the wire to one FPGA, whose firmware treats the byte FB as *fb* says."""
    if fb not in RULES:
        raise LocalProtocolError(f"fb={fb!r}; it is one of {', '.join(map(repr, RULES))}")
    return end(RULES[fb])


def _chained_ultraino_end(end: type[_End], *, boards: int = 2) -> _End:
    """Return an end of the wire to a chain of *boards* FPGAs."""
    return end(chained_ultraino_rules(boards), boards)


def chained_ultraino_rules(boards: int) -> FpgaByteRules:
    """Return the rules of a chain of *boards*, 1 to 16."""
    if not 1 <= boards <= MAX_BOARDS:
        raise LocalProtocolError(f"a chain of {boards} boards; it has 1 to {MAX_BOARDS}")
    # The published HDL reacts to C0 and C1 on every board, alone or not.
    numbers = range(max(2, boards))
    commands = {0xC0 + number: Select(number) for number in numbers}
    return FpgaByteRules(
        "ultraino-fpga-chained",
        CHANNELS,
        32,
        {**commands, 0xFE: Begin(), **_COMMON},
        starts=False,
    )


SIMPLE: Final = Dialect(
    name="ultraino-fpga",
    title="Ultraino SimpleFPGA",
    bauds=(230_400,),
    steps=32,
    channels=CHANNELS,
    frame_bytes=lambda boards: (CHANNELS + 2) * boards,
    board=functools.partial(_simple_ultraino_end, FpgaBoardEnd),
    host=functools.partial(_simple_ultraino_end, FpgaHostEnd),
    signature=re.compile(rb"(?<![\xa0-\xbf])\xfe[\x00-\x20]{256}(?:\xfb[\x00-\x10]{256})?\xfd"),
    display=lambda _: FpgaDisplay(RULES[FALLS_THROUGH], 32),
    layout="ultraino-sonicsurface",
)
SIMPLE_128: Final = Dialect(
    name="ultraino-fpga-128",
    title="Ultraino SimpleFPGA_128",
    bauds=(1_500_000,),
    steps=128,
    channels=CHANNELS_128,
    frame_bytes=lambda boards: (CHANNELS_128 + 2) * boards,
    board=functools.partial(FpgaBoardEnd, RULES_128),
    host=functools.partial(FpgaHostEnd, RULES_128),
    signature=re.compile(rb"\xfe[\x00-\x80]{72}\xfd"),
    display=lambda _: FpgaDisplay(RULES_128, 128),
    layout="tinylev",
)
CHAINED: Final = Dialect(
    name="ultraino-fpga-chained",
    title="Ultraino ChainedFPGA",
    bauds=(230_400,),
    steps=32,
    channels=CHANNELS,
    frame_bytes=lambda boards: (CHANNELS + 1) * boards + 1,
    board=functools.partial(_chained_ultraino_end, FpgaBoardEnd),
    host=functools.partial(_chained_ultraino_end, FpgaHostEnd),
    signature=re.compile(rb"(?<!\xfe)(?:[\xc0-\xcf][\x00-\x20]{256})+\xfd"),
    display=lambda boards: FpgaDisplay(chained_ultraino_rules(boards), 32, boards),
    layout="ultraino-sonicsurface-stack",
)
DIALECTS: Final = (SIMPLE, SIMPLE_128, CHAINED)
