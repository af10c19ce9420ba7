"""Ultraino's FPGA boards: SimpleFPGA, SimpleFPGA_128 and ChainedFPGA.

They do what the published HDL does, that of SonicSurface (see :mod:`..double_buffer`). Not known,
as no HDL is published: what the board of 128 steps radiates at power-up (code 0 here, as the
other), and whether a frame without amplitudes is at full amplitude (it is here).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from haptogram.acoustics.model.boards.grids import ULTRAINO_SONICSURFACE, ULTRAINO_STACK
from haptogram.acoustics.model.boards.layout import BoardLayout
from haptogram.settings.option import Settings, option
from haptogram_protocol.dialects.ultraino import fpga as wire

from ..double_buffer import DoubleBuffer, Registers
from ..emulation import Emulation

_WIDTH, _WIDTH_128 = 16, 64  # half a period


@dataclass(frozen=True, kw_only=True)
class Amplitudes(Settings):
    """Options of SimpleFPGA."""

    fb: str = option(
        wire.FALLS_THROUGH,
        unit="NAME",
        choices=tuple(wire.RULES),
        help="what the board does with FB and the amplitudes behind it",
    )


@dataclass(frozen=True, kw_only=True)
class FpgaChain(Settings):
    """Options of ChainedFPGA."""

    boards: int = option(2, unit="N", low=1, high=wire.MAX_BOARDS, help="boards of the chain")


def _simple_ultraino_unit(options: Amplitudes, now_us: int) -> DoubleBuffer:
    """Return the unit of one FPGA, which treats the byte FB as its options say."""
    return DoubleBuffer(Registers(wire.RULES[options.fb], 32, _WIDTH), 1, now_us)


def _chained_ultraino_unit(options: FpgaChain, now_us: int) -> DoubleBuffer:
    """Return the unit of a chain of FPGAs."""
    registers = Registers(wire.chained_ultraino_rules(options.boards), 32, _WIDTH)
    return DoubleBuffer(registers, options.boards, now_us)


def _chained_ultraino_layout(options: FpgaChain) -> BoardLayout:
    """Return the layout of one board, or of a stack."""
    return ULTRAINO_SONICSURFACE if options.boards == 1 else ULTRAINO_STACK


SIMPLE: Final = Emulation.of(
    wire.SIMPLE,
    _simple_ultraino_unit,
    end=lambda options: wire.SIMPLE.board(fb=options.fb),
    options=Amplitudes,
)
SIMPLE_128: Final = Emulation.of(
    wire.SIMPLE_128,
    lambda _, now_us: DoubleBuffer(Registers(wire.RULES_128, 128, _WIDTH_128), 1, now_us),
)
CHAINED: Final = Emulation.of(
    wire.CHAINED, _chained_ultraino_unit, layout=_chained_ultraino_layout, options=FpgaChain
)
EMULATIONS: Final = (SIMPLE, SIMPLE_128, CHAINED)
