"""SonicSurface's boards: primary and secondary, one or two face to face, and the tactile firmware.

Source: upnalab/SonicSurface 0c7b689, ``Firmware/FPGA primary``, ``FPGA secondary`` and ``FPGA
tactile modulation``. After power-up the registers of primary and secondary hold the code 0: every
emitter sounds, in phase, until the first swap. Those of the tactile firmware hold 16, which is off
there.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from haptogram.acoustics import Calibration, TransducerArray
from haptogram.acoustics.arrays import FloatArray
from haptogram.acoustics.model.boards.grids import SONICSURFACE as ONE_SONICSURFACE
from haptogram.acoustics.model.boards.grids import SONICSURFACE_STACK
from haptogram.settings.option import Settings, option
from haptogram_protocol.dialects import sonicsurface as wire

from ..board.events import Modulation
from .double_buffer import DoubleBuffer, Registers
from .emulation import Emulation

MODULATION_AT_POWER_UP: Final = 10
_EMITTERS: Final = wire.CHANNELS
_TICKS_HZ: Final = 640_000  # tactile firmware: one emitter is switched every (step + 1)

_IN_TIME, _LATE = "in-time", "late"
_PRIMARY: Final = Registers(wire.RULES, steps=32, width=16)


def sonicsurface_dialect_triangle(step: int) -> Modulation:
    """Return the modulation of the tactile firmware: emitters go one by one, and come back."""
    on = np.minimum(np.arange(2 * _EMITTERS), np.arange(2 * _EMITTERS, 0, -1))
    samples = (on * 255 // _EMITTERS).astype(np.uint8).tobytes()
    return Modulation(_TICKS_HZ / (step + 1), samples)


_TACTILE: Final = Registers(
    wire.TACTILE_RULES,
    steps=wire.TACTILE_STEPS,
    width=wire.TACTILE_WIDTH,
    at_power_up=wire.OFF,
    correction=wire.TACTILE_CORRECTION,
    modulation=sonicsurface_dialect_triangle,
)


@dataclass(frozen=True, kw_only=True)
class ShiftRegisters(Settings):
    """Options of every firmware."""

    last_bit: str = option(
        _IN_TIME,
        unit="NAME",
        choices=(_IN_TIME, _LATE),
        help="when the last bit of each shift register comes: in time, or one step late, as the "
        "pins of the firmware have it in simulators",
    )

    def of_firmware(self, registers: Registers) -> Registers:
        """Return the *registers* of a firmware, with these options."""
        return dataclasses.replace(registers, late=self.last_bit == _LATE)


@dataclass(frozen=True, kw_only=True)
class Stack(ShiftRegisters):
    """Options of primary and secondary firmware."""

    boards: int = option(1, unit="N", low=1, high=2, help="1: a primary; 2: also a secondary")


def sonicsurface_dialect_mounting(array: TransducerArray) -> Calibration:
    """Return the mounting phases of the tactile board's emitters, which its correction undoes."""
    added = np.frombuffer(wire.TACTILE_CORRECTION, np.uint8).astype(np.float64)
    phases_rad: FloatArray = -math.tau / 32 * added
    return Calibration(np.ones(_EMITTERS), phases_rad, array.positions_m)


SONICSURFACE: Final = Emulation.of(
    wire.SONICSURFACE,
    lambda options, now_us: DoubleBuffer(options.of_firmware(_PRIMARY), options.boards, now_us),
    layout=lambda options: SONICSURFACE_STACK if options.boards == 2 else ONE_SONICSURFACE,
    options=Stack,
)
TACTILE: Final = Emulation.of(
    wire.TACTILE,
    lambda options, now_us: DoubleBuffer(
        options.of_firmware(_TACTILE), 1, now_us, MODULATION_AT_POWER_UP
    ),
    options=ShiftRegisters,
    mounting=sonicsurface_dialect_mounting,
)
EMULATIONS: Final = (SONICSURFACE, TACTILE)
