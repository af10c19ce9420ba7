"""Phases on Ultraino's Arduino boards: one pattern, a pulse of half a period for each channel."""

from __future__ import annotations

from collections.abc import Sequence

from ...codec import Codes, Display, Operation
from .operations import CommitDurations, SetDurations, SetPattern, Swap
from .slots import ArduinoSlotLayout, Pulse

ONE_PATTERN = b"\x01\x00"  # durations: a period of the first pattern, and no other one


class SlotDisplay(Display):
    """Codes as slot bytes for each board of a chain.

    Parameters
    ----------
    layout : ArduinoSlotLayout
        Positions of the channels in the slot bytes.
    boards : int
        Boards of the chain.
    durations : bytes
        Durations that come with each frame; empty: the firmware knows none.
    connected : bytes
        For each port the outputs that are connected; empty: all.
    """

    def __init__(
        self,
        layout: ArduinoSlotLayout,
        boards: int,
        *,
        durations: bytes = b"",
        connected: bytes = b"",
    ) -> None:
        super().__init__(boards * len(layout.pins), layout.steps)
        self.options = {"boards": boards}
        self._layout, self._durations = layout, durations
        count = len(layout.pins)
        unconnected = [
            channel
            for channel, pin in enumerate(layout.pins)
            if connected and not connected[pin // 8] >> pin % 8 & 1
        ]
        self.unconnected = frozenset(
            board * count + channel for board in range(boards) for channel in unconnected
        )

    def frame(self, codes: Codes) -> list[Operation]:
        """Return the pattern of each board, its duration, and the swap that shows it."""
        count, half = len(self._layout.pins), self.steps // 2
        pulses = [Pulse(0, 0) if code is None else Pulse(code, half) for code in codes]
        made: list[Operation] = [
            SetPattern(first // count, 0, self._layout.slots(pulses[first : first + count]))
            for first in range(0, self.channels, count)
        ]
        if self._durations:
            made += [SetDurations(self._durations), CommitDurations()]
        return [*made, Swap()]

    def read(self, operations: Sequence[Operation]) -> list[int | None] | None:
        """Return the codes of the patterns that the last swap shows."""
        written, shown = dict[int, bytes](), dict[int, bytes]()
        for operation in operations:
            if isinstance(operation, SetPattern) and not operation.pattern:
                written[operation.board] = operation.slots
            elif isinstance(operation, Swap):
                shown, written = written, {}
        if len(shown) * len(self._layout.pins) < self.channels:
            return None
        pulses = [
            pulse for _, slots in sorted(shown.items()) for pulse in self._layout.pulses(slots)
        ]
        return [pulse.code if pulse is not None and pulse.width else None for pulse in pulses]
