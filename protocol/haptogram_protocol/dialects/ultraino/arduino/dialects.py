"""The dialects of Ultraino's Arduino boards: ends, bytes of a frame, signature."""

from __future__ import annotations

import functools
import re
from typing import Final

from ...codec import Dialect
from .board_end import ArduinoBoardEnd
from .host_end import ArduinoHostEnd, SlotDisplay
from .line_bytes import BYTES_OF_DURATION, COMMAND, DURATION_BYTES, OTHER_HOPS, PARTS, SWAP
from .slots import MEGA64_FIRMWARE, NANO8_FIRMWARE, NANO16_FIRMWARE, ArduinoFirmware


def _arduino_frame_bytes(firmware: ArduinoFirmware, boards: int) -> int:
    """Return how many bytes a whole frame takes on the line.

    It is one pattern for each of *boards*, the durations with their commit, and the swap.
    """
    durations = 2 * BYTES_OF_DURATION + len(COMMAND) if firmware.durations else 0
    return firmware.half_bytes * boards + durations + len(SWAP)


def _arduino_dialect(firmware: ArduinoFirmware, title: str, layout: str) -> Dialect:
    """Return the dialect of an Arduino firmware, with an expression that its frames match.

    *title* describes it; *layout* names the array that it drives.
    """
    ours = PARTS[1].removesuffix(b"+")
    pattern = b"(?<!%b)(?:%b{%d})+" % (ours, ours, firmware.half_bytes)
    others = b"(?:%b{%d})*" % (OTHER_HOPS, firmware.half_bytes)
    ending = b"\x00"
    if firmware.durations:
        ending = b"(?:[%b]{4})+\x10\x00" % re.escape(DURATION_BYTES)
    return Dialect(
        name=firmware.wire,
        title=title,
        bauds=(115_200,),
        steps=firmware.steps,
        channels=len(firmware.pins),
        frame_bytes=functools.partial(_arduino_frame_bytes, firmware),
        board=functools.partial(ArduinoBoardEnd, firmware),
        host=functools.partial(ArduinoHostEnd, firmware),
        signature=re.compile(pattern + others + ending, re.DOTALL),
        display=functools.partial(SlotDisplay, firmware),
        layout=layout,
    )


MEGA64: Final = _arduino_dialect(MEGA64_FIRMWARE, "Ultraino Arduino MEGA64", "ultraino-flat8")
NANO16: Final = _arduino_dialect(NANO16_FIRMWARE, "Ultraino Arduino Nano16", "ultraino-nano16")
NANO8: Final = _arduino_dialect(NANO8_FIRMWARE, "Ultraino Arduino Nano8", "ultraino-nano8")
DIALECTS: Final = (MEGA64, NANO8, NANO16)
