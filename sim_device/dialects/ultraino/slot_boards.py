"""A chain of Ultraino's Arduino boards: patterns of slots that they run along, period by period."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics.model.pulses import PulseDrive
from haptogram_protocol.dialects.codec import Operation, Reply
from haptogram_protocol.dialects.ultraino.arduino import operations
from haptogram_protocol.dialects.ultraino.arduino.operations import ArduinoFirmware
from haptogram_protocol.dialects.ultraino.arduino.slots import ArduinoSlotLayout

from ...board.events import PulseLatch
from ..unit import LatchingUnit
from .playlist import PERIOD_US, ArduinoPlaylist

POWER_UP: Final = "power-up"
CYCLES: Final = 396  # of the processor, in a period of MEGA64
_CYCLES_OF_A_PORT: Final = 30 / 9  # from the first of ten ports to the last


@dataclass(frozen=True)
class Outputs:
    """The ports of a board.

    Attributes
    ----------
    firmware : ArduinoFirmware
        What it has room for.
    layout : ArduinoSlotLayout
        Where the bit of a channel stands in the bytes of a slot.
    connected : bytes
        For each port the outputs that are set up as such; empty: all.
    shows_one : bool
        True if a commit of durations chooses the pattern to show (the animation firmware), and
        not for how long patterns last.
    is_staggered : bool
        Whether ports are written one after another, the last one 30 cycles after the first.
    """

    firmware: ArduinoFirmware
    layout: ArduinoSlotLayout
    connected: bytes = b""
    shows_one: bool = False
    is_staggered: bool = False


class SlotBoards(LatchingUnit):
    """All boards of a chain; see :class:`~..unit.Unit`.

    They radiate from power-up on: in the first half of the slots every output is high. Patterns
    overwrite what their buffer held, byte by byte. As long as a list of patterns is the same, only
    its first whole pass is latched pattern by pattern; what follows is that again.

    Source: asiermarzo/Ultraino, ``DriverMEGA.ino`` 3ad4bdf, ``DriverMEGAAnim.ino`` and
    ``DriverNano16.ino`` 6411b27.

    Parameters
    ----------
    outputs : Outputs
        The firmware and its ports.
    boards : int
        Boards in the chain.
    now_us : int
        Device time at power-up.

    Attributes
    ----------
    counters : Counter
        ``patterns_beyond_memory``: a pattern to show that the boards have no room for.
    """

    def __init__(self, outputs: Outputs, boards: int, now_us: int) -> None:
        super().__init__()
        self._outputs = outputs
        firmware, layout = outputs.firmware, outputs.layout
        shape = boards, firmware.patterns, layout.steps, layout.ports
        self._shown, self._next = np.zeros(shape, np.uint8), np.zeros(shape, np.uint8)
        self._shown[:, 0, : layout.steps // 2] = 0xFF
        self._boot_us = now_us
        self._playlist = ArduinoPlaylist(firmware.patterns, counts=not outputs.shows_one)
        self._durations = bytearray(self._playlist.durations)  # for the next commit
        self._handlers: dict[type[Operation], Callable[[Any, int], None]] = {
            operations.SetPattern: self._set_pattern,
            operations.SetDurations: self._set_durations,
            operations.CommitDurations: self._commit_durations,
            operations.Swap: self._swap,
        }
        self._latch(POWER_UP, now_us)

    def take(self, operation: Operation, t_us: int) -> list[Reply]:
        """Do *operation*; return what the last board sends on."""
        if isinstance(operation, operations.Forward):
            return [operation]
        if (handler := self._handlers.get(type(operation))) is not None:
            handler(operation, t_us)
        return []

    def next_event_us(self) -> int | None:
        """Return when the next pattern of the first pass begins, or None."""
        period = self._playlist.next_change()
        return None if period is None else self._boot_us + period * PERIOD_US

    def advance_to(self, t_us: int) -> list[Reply]:
        """Go on to the pattern that is due."""
        if self._playlist.advance_to(self._period(t_us)):
            self._latch("pattern", t_us)
        return []

    def _period(self, t_us: int) -> int:
        return (t_us - self._boot_us) // PERIOD_US

    def _set_pattern(self, operation: operations.SetPattern, _: int) -> None:
        pattern = self._next[operation.board, operation.pattern].reshape(-1)
        pattern[: len(operation.slots)] = np.frombuffer(operation.slots, np.uint8)

    def _set_durations(self, operation: operations.SetDurations, _: int) -> None:
        self._durations[: len(operation.periods)] = operation.periods

    def _commit_durations(self, _: operations.CommitDurations, t_us: int) -> None:
        self._playlist.skip_to(self._period(t_us))
        if not self._outputs.shows_one:
            self._playlist.commit(bytes(self._durations))
        elif self._durations[0] >= self._outputs.firmware.patterns:
            self.counters["patterns_beyond_memory"] += 1
        else:
            self._playlist.show(self._durations[0])
            self._latch("shown", t_us)

    def _swap(self, _: operations.Swap, t_us: int) -> None:
        self._playlist.skip_to(self._period(t_us))
        self._playlist.restart()
        self._shown, self._next = self._next, self._shown
        self._latch("swap", t_us)

    def _latch(self, cause: str, t_us: int) -> None:
        pattern = self._playlist.pointer
        pulses = PulseDrive.of_levels(self._levels(self._shown[:, pattern]))
        self._latches.append(PulseLatch(t_us, pulses, cause, index=pattern))

    def _levels(self, slots: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Return the (steps, channels of all boards) levels of (boards, steps, ports) *slots*."""
        if self._outputs.connected:
            slots = slots & np.frombuffer(self._outputs.connected, np.uint8)
        outputs = np.unpackbits(slots, axis=2, bitorder="little").astype(np.bool_)
        pins = np.array(self._outputs.layout.pins)
        if self._outputs.is_staggered:
            begins = np.rint(np.arange(len(outputs[0])) * (CYCLES / len(outputs[0])))
            cycles = np.arange(CYCLES)[:, None] - np.rint(pins // 8 * _CYCLES_OF_A_PORT)
            slots_of = np.searchsorted(begins, cycles % CYCLES, side="right") - 1
            return np.concatenate([board[slots_of, pins] for board in outputs], axis=1)
        return np.concatenate(list(outputs[:, :, pins]), axis=1)
