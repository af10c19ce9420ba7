"""The host's end of a chain of Ultraino's Arduino boards."""

from __future__ import annotations

from ....errors import LocalProtocolError
from ...codec import OneWayHostEnd, Operation, no_dialect_bytes_for
from .firmware import ArduinoFirmware
from .line_bytes import COMMAND, SWAP, durations_to_pairs
from .operations import CommitDurations, Restart, SetDurations, SetPattern, Swap


class ArduinoHostEnd(OneWayHostEnd):
    """The host's end: the bytes of operations; what a chain sends back is ignored.

    Parameters
    ----------
    firmware : ArduinoFirmware
        Firmware of the boards.
    boards : int
        Boards in the chain.
    """

    def __init__(self, firmware: ArduinoFirmware, boards: int = 1) -> None:
        super().__init__()
        self._firmware = firmware
        self._boards = boards

    def send(self, message: Operation) -> bytes:
        """Return the bytes of *message*.

        Raises
        ------
        LocalProtocolError
            If the firmware has no such operation, board or room.
        """
        firmware = self._firmware
        if isinstance(message, SetPattern):
            return self._pattern(message)
        if isinstance(message, SetDurations) and firmware.durations:
            if not 1 <= len(message.periods) <= firmware.durations:
                raise LocalProtocolError(
                    f"{len(message.periods)} durations; there are 1 to {firmware.durations}"
                )
            return durations_to_pairs(message.periods)
        if isinstance(message, Swap):
            return SWAP
        if isinstance(message, CommitDurations if firmware.durations else Restart):
            return COMMAND
        raise no_dialect_bytes_for(message, firmware.wire)

    def _pattern(self, message: SetPattern) -> bytes:
        if not 0 <= message.board < self._boards:
            raise LocalProtocolError(f"board {message.board}; the chain has {self._boards}")
        if len(message.slots) > self._firmware.pattern_bytes:
            raise LocalProtocolError(
                f"pattern of {len(message.slots)} bytes; it has {self._firmware.pattern_bytes}"
            )
        hops = message.board + 1
        return bytes(
            half for slot in message.slots for half in (slot & 0xF0 | hops, slot << 4 & 0xF0 | hops)
        )
