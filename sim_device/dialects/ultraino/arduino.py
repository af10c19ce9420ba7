"""Ultraino's Arduino boards: MEGA64 with the usual and the animation firmware, Nano16, Nano8.

No array is published for the Nano boards; the grids here are assumed. The firmware of Nano8 is not
published either: it is Nano16's here, with 24 slots of one port.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from haptogram.settings.option import Settings, option
from haptogram_protocol.dialects.codec import Dialect
from haptogram_protocol.dialects.ultraino.arduino import dialects, operations, slots

from ...board.events import CarrierState
from ..emulation import Emulation
from ..unit import Unit
from .slot_boards import SlotBoards, UnsteadyUnit

_USUAL, _ANIMATION = "usual", "animation"
_AT_ONCE, _STAGGERED = "at-once", "staggered"
_40_KHZ, _20_KHZ = "40kHz", "20kHz"
_STEADY, _DRAWN_OUT = "steady", "drawn-out"
_BOARDS_HELP: Final = "boards of the chain; the elements of each follow those of the one before"


@dataclass(frozen=True, kw_only=True)
class ArduinoChain(Settings):
    """Options of a chain of Nano boards."""

    boards: int = option(1, unit="N", low=1, high=operations.MAX_BOARDS, help=_BOARDS_HELP)


@dataclass(frozen=True, kw_only=True)
class Mega64Chain(ArduinoChain):
    """Options of a chain of MEGA64 boards."""

    firmware: str = option(
        _USUAL,
        unit="NAME",
        choices=(_USUAL, _ANIMATION),
        help="DriverMEGA, or DriverMEGAAnim, whose first duration chooses the pattern",
    )
    ports: str = option(
        _AT_ONCE,
        unit="NAME",
        choices=(_AT_ONCE, _STAGGERED),
        help="written at once, or one after another: port J 30 cycles (27 degrees) after port A",
    )
    carrier: str = option(
        _40_KHZ,
        unit="NAME",
        choices=(_40_KHZ, _20_KHZ),
        help="that of the author's build, or of one that misses every second sync",
    )
    upload: str = option(
        _STEADY,
        unit="NAME",
        choices=(_STEADY, _DRAWN_OUT),
        help="the carrier while bytes arrive: as ever, or with periods that are drawn out (-6 dB)",
    )


def _arduino_emulation(
    dialect: Dialect, firmware: slots.ArduinoFirmware, options: type[ArduinoChain] = ArduinoChain
) -> Emulation:
    """Return the emulation of an Arduino firmware, with units of one or more boards.

    *options*: class of the options that a unit takes.
    """

    def unit(options: ArduinoChain, now_us: int) -> Unit:
        if not isinstance(options, Mega64Chain):
            return SlotBoards(firmware, options.boards, now_us)
        animated, staggered = options.firmware == _ANIMATION, options.ports == _STAGGERED
        boards = SlotBoards(
            firmware, options.boards, now_us, shows_one=animated, is_staggered=staggered
        )
        usual = CarrierState.HALVED if options.carrier == _20_KHZ else CarrierState.STEADY
        is_disturbed = options.upload == _DRAWN_OUT
        if not is_disturbed and usual is CarrierState.STEADY:
            return boards
        return UnsteadyUnit(boards, usual, is_disturbed=is_disturbed)

    return Emulation.of(dialect, unit, options=options, numbered_by="driverPinNumber")


MEGA64: Final = _arduino_emulation(dialects.MEGA64, slots.MEGA64_FIRMWARE, Mega64Chain)
NANO16: Final = _arduino_emulation(dialects.NANO16, slots.NANO16_FIRMWARE)
NANO8: Final = _arduino_emulation(dialects.NANO8, slots.NANO8_FIRMWARE)
EMULATIONS: Final = (MEGA64, NANO8, NANO16)
