"""The host's end of a chain of Ultraino's Arduino boards, and the pattern that shows phases."""

from __future__ import annotations

from collections.abc import Sequence

from ....errors import LocalProtocolError
from ...codec import Codes, Display, OneWayHostEnd, Operation, no_dialect_bytes_for
from .line_bytes import COMMAND, SWAP, durations_to_pairs
from .operations import CommitDurations, Restart, SetDurations, SetPattern, Swap
from .slots import ArduinoFirmware, Pulse


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
        """Return the bytes on the line that write a pattern to one board of the chain.

        LocalProtocolError if there is no such board, or its memory is shorter than the pattern.
        """
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


_ONE_PATTERN = b"\x01\x00"  # durations: a period of the first pattern, and no other one


class SlotDisplay(Display):
    """Codes as slot bytes for each board of a chain.

    Parameters
    ----------
    firmware : ArduinoFirmware
        Positions of the channels in the slot bytes.
    boards : int
        Boards of the chain.
    """

    def __init__(self, firmware: ArduinoFirmware, boards: int) -> None:
        count, connected = len(firmware.pins), firmware.connected
        super().__init__(boards * count, firmware.steps)
        self.options = {"boards": boards}
        self._firmware = firmware
        unconnected = [
            channel
            for channel, pin in enumerate(firmware.pins)
            if connected and not connected[pin // 8] >> pin % 8 & 1
        ]
        self.unconnected = frozenset(
            board * count + channel for board in range(boards) for channel in unconnected
        )

    def frame(self, codes: Codes) -> list[Operation]:
        """Return the pattern of each board, its duration, and the swap that shows it."""
        count, half = len(self._firmware.pins), self.steps // 2
        pulses = [Pulse(0, 0) if code is None else Pulse(code, half) for code in codes]
        made: list[Operation] = [
            SetPattern(first // count, 0, self._firmware.slots(pulses[first : first + count]))
            for first in range(0, self.channels, count)
        ]
        if self._firmware.durations:
            made += [SetDurations(_ONE_PATTERN), CommitDurations()]
        return [*made, Swap()]

    def read(self, operations: Sequence[Operation]) -> list[int | None] | None:
        """Return the codes of the patterns that the last swap shows."""
        written, shown = dict[int, bytes](), dict[int, bytes]()
        for operation in operations:
            if isinstance(operation, SetPattern) and not operation.pattern:
                written[operation.board] = operation.slots
            elif isinstance(operation, Swap):
                shown, written = written, {}
        if len(shown) * len(self._firmware.pins) < self.channels:
            return None
        pulses = [
            pulse for _, slots in sorted(shown.items()) for pulse in self._firmware.pulses(slots)
        ]
        return [pulse.code if pulse is not None and pulse.width else None for pulse in pulses]
