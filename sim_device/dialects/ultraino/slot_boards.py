"""A chain of Ultraino's Arduino boards: patterns of slots that they run along, period by period."""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics.model.pulses import PulseDrive
from haptogram_protocol.dialects.codec import Operation, Reply
from haptogram_protocol.dialects.ultraino.arduino import operations
from haptogram_protocol.dialects.ultraino.arduino.slots import ArduinoFirmware

from ...board.clock import earliest_board_time
from ...board.events import CarrierState, PulseLatch
from ..unit import LatchingUnit, Unit

POWER_UP: Final = "power-up"
CYCLES: Final = 396  # processor cycles in a period of MEGA64
_CYCLES_OF_A_PORT: Final = 30 / 9  # processor cycles from one of the ten ports to the next
PERIOD_US: Final = 25
_COUNTER: Final = 256  # currentPeriods is a byte
UPLOAD: Final = "upload"  # cause of a latch: bytes begin to arrive, or no more do
_HALVED: Final = "pins_at_half_carrier"


class SlotBoards(LatchingUnit):
    """All boards of a chain; see :class:`~..unit.Unit`.

    They radiate from power-up on: in the first half of the slots every output is high. Patterns
    overwrite what their buffer held, byte by byte. As long as a list of patterns is the same, only
    its first whole pass is latched pattern by pattern; what follows is that again.

    Source: asiermarzo/Ultraino, ``DriverMEGA.ino`` 3ad4bdf, ``DriverMEGAAnim.ino`` and
    ``DriverNano16.ino`` 6411b27.

    Parameters
    ----------
    firmware : ArduinoFirmware
        The firmware and its ports.
    boards : int
        Boards in the chain.
    now_us : int
        Device time at power-up.
    shows_one : bool, keyword-only
        True if a commit of durations chooses the pattern to show (the animation firmware), and
        not for how long patterns last.
    is_staggered : bool, keyword-only
        Whether ports are written one after another, the last one 30 cycles after the first.

    Attributes
    ----------
    counters : Counter
        ``patterns_beyond_memory``: a pattern to show that the boards have no room for.
    """

    def __init__(
        self,
        firmware: ArduinoFirmware,
        boards: int,
        now_us: int,
        *,
        shows_one: bool = False,
        is_staggered: bool = False,
    ) -> None:
        super().__init__()
        self._firmware, self._shows_one, self._is_staggered = firmware, shows_one, is_staggered
        shape = boards, firmware.patterns, firmware.steps, firmware.ports
        self._shown, self._next = np.zeros(shape, np.uint8), np.zeros(shape, np.uint8)
        self._shown[:, 0, : firmware.steps // 2] = 0xFF
        self._boot_us = now_us
        self._playlist = ArduinoPlaylist(firmware.patterns, counts=not shows_one)
        self._durations = bytearray(self._playlist.durations)  # for the next commit
        self._handlers = {
            operations.SetPattern: self._set_pattern,
            operations.SetDurations: self._set_durations,
            operations.CommitDurations: self._commit_durations,
            operations.Swap: self._swap,
        }
        self._latch(POWER_UP, now_us)

    def take(self, operation: Operation, t_us: int) -> Sequence[Reply | bytes]:
        """Do *operation*; return what the last board sends on."""
        if isinstance(operation, operations.Forward):
            return [operation]
        return super().take(operation, t_us)

    def next_event_us(self) -> int | None:
        """Return when the next pattern of the first pass begins, or None."""
        period = self._playlist.next_change()
        return None if period is None else self._boot_us + period * PERIOD_US

    def advance_to(self, t_us: int) -> list[Reply]:
        """Go on to each pattern that is due."""
        while (due_us := self.next_event_us()) is not None and due_us <= t_us:
            if self._playlist.advance_to(self._period(due_us)):
                self._latch("pattern", due_us)
        return []

    def _period(self, t_us: int) -> int:
        """Return the number of the carrier period at *t_us*, counted from power-up."""
        return (t_us - self._boot_us) // PERIOD_US

    def _set_pattern(self, operation: operations.SetPattern, _: int) -> None:
        """Write levels of a pattern, step by step of the period, to a board's hidden buffer."""
        pattern = self._next[operation.board, operation.pattern].reshape(-1)
        pattern[: len(operation.slots)] = np.frombuffer(operation.slots, np.uint8)

    def _set_durations(self, operation: operations.SetDurations, _: int) -> None:
        """Keep the durations of the patterns until they are committed."""
        self._durations[: len(operation.periods)] = operation.periods

    def _commit_durations(self, _: operations.CommitDurations, t_us: int) -> None:
        """Apply the durations that were kept.

        Where the firmware shows one pattern alone, the first duration is the number of this
        pattern.
        """
        self._playlist.skip_to(self._period(t_us))
        if not self._shows_one:
            self._playlist.commit(bytes(self._durations))
        elif self._durations[0] >= self._firmware.patterns:
            self.counters["patterns_beyond_memory"] += 1
        else:
            self._playlist.show(self._durations[0])
            self._latch("shown", t_us)

    def _swap(self, _: operations.Swap, t_us: int) -> None:
        """Show the written patterns from the first one on, and latch."""
        self._playlist.skip_to(self._period(t_us))
        self._playlist.restart()
        self._shown, self._next = self._next, self._shown
        self._latch("swap", t_us)

    def _latch(self, cause: str, t_us: int) -> None:
        """Append a latch of the pattern that the boards show."""
        pattern = self._playlist.pointer
        pulses = PulseDrive.of_levels(self._levels(self._shown[:, pattern]))
        self._latches.append(PulseLatch(t_us, pulses, cause, index=pattern))

    def _levels(self, slots: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Return the levels (steps, channels of all boards) of the outputs in a carrier period.

        *slots* (boards, steps, ports): the bits of a byte are the 8 pins of a port. With ports that
        switch one after another the steps are processor cycles.
        """
        if self._firmware.connected:
            slots = slots & np.frombuffer(self._firmware.connected, np.uint8)
        outputs = np.unpackbits(slots, axis=2, bitorder="little").astype(np.bool_)
        pins = np.array(self._firmware.pins)
        if self._is_staggered:
            begins = np.rint(np.arange(len(outputs[0])) * (CYCLES / len(outputs[0])))
            cycles = np.arange(CYCLES)[:, None] - np.rint(pins // 8 * _CYCLES_OF_A_PORT)
            slots_of = np.searchsorted(begins, cycles % CYCLES, side="right") - 1
            return np.concatenate([board[slots_of, pins] for board in outputs], axis=1)
        return np.concatenate(list(outputs[:, :, pins]), axis=1)


class ArduinoPlaylist:
    """The pattern that is shown in each period of the carrier, counted from power-up.

    The firmware counts a pattern's periods and then takes the next pattern, or the first one behind
    the last duration that is not 0. A swap sets the pointer of the output back and not these two
    counters, so that patterns and durations do not belong together until the list begins anew. A
    duration of 0 in the first place, or one that is shortened below the periods that have passed,
    lasts until the counter of 8 bits comes round. ``DriverMEGA.ino``, asiermarzo/Ultraino 3ad4bdf.

    Parameters
    ----------
    patterns : int
        Patterns that there is room for.
    counts : bool
        True if the firmware counts periods; one that does not shows a pattern until it is told.

    Attributes
    ----------
    durations : bytes
        Periods of each pattern; the first 0 after the first pattern ends the list.
    pointer : int
        The pattern that is shown.
    """

    def __init__(self, patterns: int, *, counts: bool = True) -> None:
        self._counts = counts
        self.durations = bytes([1]) + bytes(patterns - 1)
        self.pointer = 0
        self._pattern = 0  # whose duration counts
        self._passed = 0  # of its periods, before the one at _at
        self._at = 0
        self._passes_to_tell = 0

    def next_change(self) -> int | None:
        """Return the period in which another pattern is shown next, or None.

        None also comes after the first whole pass: all others are the same.
        """
        if not (self._counts and self._passes_to_tell) or self._is_constant:
            return None
        return self._at + self._left

    def advance_to(self, period: int) -> bool:
        """Go on to the change at *period*; return whether the output changed."""
        before = self.pointer
        while self._at + self._left <= period:
            self._at += self._left
            self._complete()
            if not self._pattern:
                self._passes_to_tell = max(0, self._passes_to_tell - 1)
                break
        return self.pointer != before

    def skip_to(self, period: int) -> None:
        """Go on to *period* without reporting the changes on the way."""
        if not self._counts:
            return
        cycle = self._cycle()
        while (left := self._left) <= period - self._at:
            self._at += left
            self._complete()
            if not self._pattern:
                self._at += (period - self._at) // cycle * cycle
        self._passed += period - self._at
        self._at = period

    def commit(self, durations: bytes) -> None:
        """Take other durations from now on."""
        self.durations = durations
        self._passes_to_tell = 2

    def restart(self) -> None:
        """Show the first pattern; the counters go on."""
        self.pointer = 0
        self._passes_to_tell = 2

    def show(self, pattern: int) -> None:
        """Show *pattern*; this firmware counts no periods."""
        self.pointer = pattern

    @property
    def _left(self) -> int:
        """Return how many carrier periods the present pattern has left, at least 1."""
        return (self.durations[self._pattern] - self._passed - 1) % _COUNTER + 1

    @property
    def _is_constant(self) -> bool:
        """Return True if only the first pattern is ever shown."""
        return not (self.pointer or self._pattern) and self._is_last(0)

    def _is_last(self, pattern: int) -> bool:
        """Return True if the next pattern has no duration, so that the first one follows."""
        return pattern + 1 == len(self.durations) or not self.durations[pattern + 1]

    def _complete(self) -> None:
        """Advance to the next pattern; return to the first one after the last."""
        self._passed = 0
        if self._is_last(self._pattern):
            self._pattern = self.pointer = 0
        else:
            self._pattern += 1
            self.pointer += 1

    def _cycle(self) -> int:
        """Return the length of the playlist in carrier periods."""
        periods, pattern = self.durations[0] or _COUNTER, 0
        while not self._is_last(pattern):
            pattern += 1
            periods += self.durations[pattern]
        return periods


class UnsteadyUnit(LatchingUnit):
    """A unit whose processor makes the carrier as well; see :class:`~..unit.Unit`.

    Parameters
    ----------
    unit : Unit
        The emulated boards with a steady carrier.
    usual : CarrierState
        The carrier while no byte arrives.
    is_disturbed : bool
        Whether bytes that arrive draw periods out.
    """

    def __init__(self, unit: Unit, usual: CarrierState, *, is_disturbed: bool) -> None:
        super().__init__()
        self.counters = unit.counters
        self._unit, self._usual, self._is_disturbed = unit, usual, is_disturbed
        self._carrier = usual
        self._changes: deque[tuple[int, CarrierState]] = deque()
        self._collect()

    def hear(self, begin_us: float, end_us: float) -> None:
        """Draw the periods out while bytes arrive."""
        if not self._is_disturbed:
            return
        if self._changes and self._changes[-1][0] >= math.floor(begin_us):
            self._changes.pop()  # back to back
        else:
            self._changes.append((math.ceil(begin_us), CarrierState.DRAWN_OUT))
        self._changes.append((math.floor(end_us), self._usual))

    def take(self, operation: Operation, t_us: int) -> Sequence[Reply | bytes]:
        """Do *operation*; return what the boards answer."""
        replies = self._unit.take(operation, t_us)
        self._collect()
        return replies

    def next_event_us(self) -> int | None:
        """Return when the boards, or the carrier, next change by themselves."""
        change_us = self._changes[0][0] if self._changes else None
        return earliest_board_time(self._unit.next_event_us(), change_us)

    def advance_to(self, t_us: int) -> Sequence[Reply | bytes]:
        """Let everything happen that is due up to *t_us*."""
        replies: list[Reply | bytes] = []
        while self._changes and self._changes[0][0] <= t_us:
            changed_us, self._carrier = self._changes.popleft()
            replies += self._unit.advance_to(changed_us)
            self._collect()
            again = dataclasses.replace(self._shown, t_latch_us=changed_us, cause=UPLOAD)
            self._keep(again)
        replies += self._unit.advance_to(t_us)
        self._collect()
        return replies

    def _collect(self) -> None:
        """Take all latches of the unit."""
        for latch in self._unit.take_latches():
            self._keep(latch)

    def _keep(self, latch: PulseLatch) -> None:
        """Append a latch with the present state of the carrier; count it if that is HALVED."""
        if self._carrier is CarrierState.HALVED:
            self.counters[_HALVED] += 1
        self._shown = dataclasses.replace(latch, carrier=self._carrier)
        self._latches.append(self._shown)
