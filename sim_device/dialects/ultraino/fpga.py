"""Ultraino's FPGA boards: SimpleFPGA, SimpleFPGA_128 and ChainedFPGA.

They do what the published HDL does, that of SonicSurface (see :mod:`..double_buffer`). Not known,
as no HDL is published: what the board of 128 steps radiates at power-up (code 0 here, as the
other), and whether a frame without amplitudes is at full amplitude (it is here).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from haptogram.acoustics.model.boards.bowls import TINYLEV
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
    return DoubleBuffer(Registers(wire.RULES[options.fb], 32, _WIDTH), 1, now_us)


def _chained_ultraino_unit(options: FpgaChain, now_us: int) -> DoubleBuffer:
    registers = Registers(wire.chained_ultraino_rules(options.boards), 32, _WIDTH)
    return DoubleBuffer(registers, options.boards, now_us)


def _chained_ultraino_layout(options: FpgaChain) -> BoardLayout:
    return ULTRAINO_SONICSURFACE if options.boards == 1 else ULTRAINO_STACK


SIMPLE: Final = Emulation(
    dialect=wire.SIMPLE,
    end=lambda options: wire.SIMPLE.board(fb=options.fb),
    unit=_simple_ultraino_unit,
    layout=lambda _: ULTRAINO_SONICSURFACE,
    options=Amplitudes,
)
SIMPLE_128: Final = Emulation(
    dialect=wire.SIMPLE_128,
    end=lambda _: wire.SIMPLE_128.board(),
    unit=lambda _, now_us: DoubleBuffer(Registers(wire.RULES_128, 128, _WIDTH_128), 1, now_us),
    layout=lambda _: TINYLEV,
)
CHAINED: Final = Emulation(
    dialect=wire.CHAINED,
    end=lambda options: wire.CHAINED.board(boards=options.boards),
    unit=_chained_ultraino_unit,
    layout=_chained_ultraino_layout,
    options=FpgaChain,
    boards=lambda options: options.boards,
)
EMULATIONS: Final = (SIMPLE, SIMPLE_128, CHAINED)
