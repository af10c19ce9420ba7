"""The boards' end of a chain of Ultraino's Arduino boards, and what it counts of their frames."""

from __future__ import annotations

import re
from collections import Counter
from typing import Final

from ....errors import LocalProtocolError
from ...codec import Operation, Reply, no_dialect_bytes_for
from . import line_bytes, operations
from .slots import ArduinoFirmware

_HIGH_NIBBLE: Final = b"".join(b"%x" % (byte >> 4) for byte in range(256))  # as hexadecimal digit


class PatternMemory:
    """Half slot bytes that a board has taken since its last swap.

    Attributes
    ----------
    patterns : int
        Whole patterns.
    halves : bytearray
        Halves of the pattern that has not ended.
    beyond : int
        Halves that there was no room for.
    """

    def __init__(self, board: int, firmware: ArduinoFirmware) -> None:
        self._board, self._limit, self._size = board, firmware.patterns, firmware.half_bytes
        self.patterns = self.beyond = 0
        self.halves = bytearray()

    @property
    def whole(self) -> int:
        """Patterns that came since the last swap, those that there is no room for as well."""
        return self.patterns + self.beyond // self._size

    @property
    def is_partial(self) -> bool:
        """True if the last pattern has not ended."""
        return bool(self.halves or self.beyond % self._size)

    def take(self, halves: bytes, found: list[Operation]) -> int:
        """Add *halves*, and patterns that end to *found*; return how many there is no room for."""
        size = self._size
        lost = len(self.halves) + len(halves) - (self._limit - self.patterns) * size
        if lost > 0:
            self.beyond += lost
            halves = halves[:-lost]
        self.halves += halves
        while len(self.halves) >= size:
            self._emit_pattern(self.halves[:size], found)
            del self.halves[:size]
        return max(0, lost)

    def restart(self, found: list[Operation]) -> bool:
        """Begin with slot 0; add the pattern that has not ended, and return True if there is one.

        Patterns that there is no room for are forgotten.
        """
        is_short = bool(self.halves)
        if is_short:
            self._emit_pattern(self.halves, found)
            self.halves.clear()
        self.patterns = self.beyond = 0
        return is_short

    def _emit_pattern(self, halves: bytearray, found: list[Operation]) -> None:
        """Append the pattern of *halves* to *found*: two half bytes are one of its bytes."""
        digits = halves.translate(_HIGH_NIBBLE).decode("ascii")
        slots = bytes.fromhex(digits + "0" * (len(digits) % 2))
        found.append(operations.SetPattern(self._board, self.patterns, slots))
        self.patterns += 1


# Group n: bytes of a pattern with n hops to go; 16 durations, 17 swap, 18 command; else strange.
_TOKENS: Final = re.compile(
    b"|".join(
        b"(" + part + b")"
        for part in (
            *line_bytes.PARTS.values(),
            rb"[" + re.escape(line_bytes.DURATION_BYTES) + rb"]+",
            line_bytes.SWAP,
            line_bytes.COMMAND,
            rb"[\x20\x40-\x60\x80-\xa0\xc0-\xe0]",
        )
    ),
    re.DOTALL,
)
_DURATION, _SWAPPED, _COMMANDED = 16, 17, 18
_ACTS: Final = re.compile(rb"[" + re.escape(line_bytes.SWAP + line_bytes.COMMAND) + rb"]")
# Operations are values: each byte that is sent on has one object, and a swap its two.
_FORWARDS: Final = tuple(map(operations.Forward, range(256)))
_SWAP_AND_FORWARD: Final = (operations.Swap(), _FORWARDS[line_bytes.SWAP[0]])


class ArduinoBoardEnd:
    """The end of a chain of boards: what they take, and what the last one sends.

    Patterns are given when their last half is there, or when a swap cuts them short.

    Parameters
    ----------
    firmware : ArduinoFirmware
        Firmware of the boards.
    boards : int
        Boards in the chain, 1 to 14.

    Attributes
    ----------
    counters : Counter
        ``bytes_strange`` (no meaning; sent on as byte - 1), ``bytes_beyond_chain`` (for a board
        that is not there), ``halves_beyond_memory``, ``durations_beyond_memory``,
        ``frames_short`` (swapped before the end of a pattern), ``frames_without_commit`` (whole,
        but another one came and no swap), ``durations_short`` (not four bytes),
        ``durations_without_commit``.
    """

    commit: Final = "00h"

    def __init__(self, firmware: ArduinoFirmware, boards: int = 1) -> None:
        if not 1 <= boards <= operations.MAX_BOARDS:
            raise LocalProtocolError(
                f"a chain of {boards} boards; it has 1 to {operations.MAX_BOARDS}"
            )
        self.counters: Counter[str] = Counter()
        self._firmware = firmware
        self._boards = boards
        self._memories = [PatternMemory(board, firmware) for board in range(boards)]
        self._durations = bytearray()
        self._uncommitted = False
        self._frame_bytes = 0
        self._patterns = 0  # whole ones since the last swap, for the board that has most of them
        self._commanded = 0  # frames since the last swap that ended with a command,
        self._patterns_by_then = 0  # and their patterns

    @property
    def pending(self) -> int:
        """Bytes of patterns and durations that have not ended."""
        return sum(len(memory.halves) for memory in self._memories) + len(self._durations)

    @property
    def unfinished(self) -> int:
        """Bytes of the frame that has begun and whose pattern or duration has not ended."""
        return self._frame_bytes if self._is_partial else 0

    @property
    def _is_partial(self) -> bool:
        """Return True if a pattern or a duration is incomplete."""
        is_cut = len(self._durations) % line_bytes.BYTES_OF_DURATION > 0
        return is_cut or any(memory.is_partial for memory in self._memories)

    @property
    def uncommitted(self) -> int:
        """Whole frames since the last swap: with durations, those after their command."""
        if not self._firmware.durations:
            return self._patterns
        return self._commanded + (self._patterns > self._patterns_by_then)

    def receive_data(self, data: bytes) -> list[Operation]:
        """Return the operations that *data* completes, :class:`Forward` among them."""
        found: list[Operation] = []
        begin = 0  # of the frame
        for match in _TOKENS.finditer(data):
            kind, part = match.lastindex or 0, match.group()
            if kind < _DURATION:
                self._take_halves(kind, part, found)
            elif kind == _SWAPPED:
                self._swap(found)
                begin, self._frame_bytes = match.end(), 0
            elif kind == _COMMANDED:
                self._command(found)
                begin, self._frame_bytes = match.end(), 0
            elif kind == _DURATION and self._firmware.durations:
                self._take_durations(part, found)
            else:
                self._pass_on_strange(part, found)
        self._frame_bytes += len(data) - begin
        return found

    def next_frame_end(self, data: bytes, at: int) -> int:
        """Return the index after the next swap or command."""
        match = _ACTS.search(data, at)
        return match.end() if match else len(data)

    def send(self, message: Reply) -> bytes:
        """Return the byte that the last board sends on."""
        if isinstance(message, operations.Forward):
            return bytes([message.byte & 0xFF])
        raise no_dialect_bytes_for(message, self._firmware.wire)

    def _take_halves(self, hops: int, halves: bytes, found: list[Operation]) -> None:
        """Store half bytes at the board *hops* along the chain; beyond the last, forward them.

        Those beyond the chain or the board's memory are counted.
        """
        if hops > self._boards:
            self.counters["bytes_beyond_chain"] += len(halves)
            found += [_FORWARDS[byte - self._boards] for byte in halves]
            return
        memory = self._memories[hops - 1]
        if lost := memory.take(halves, found):
            self.counters["halves_beyond_memory"] += lost
        if (whole := memory.whole) > self._patterns:
            self._patterns = whole

    def _swap(self, found: list[Operation]) -> None:
        """Append a swap to *found*; count frames cut short, replaced, or without durations."""
        if (replaced := self.uncommitted - 1) > 0:
            self._count_replaced(replaced)
        if self._restart(found):
            self.counters["frames_short"] += 1
        self._end_durations(found)
        if self._uncommitted:
            self.counters["durations_without_commit"] += 1
            self._uncommitted = False
        found += _SWAP_AND_FORWARD

    def _count_replaced(self, frames: int) -> None:
        """Count complete frames that were overwritten before a swap."""
        self.counters["frames_without_commit"] += frames
        if not self._is_partial:  # halves that had no room were whole frames
            beyond = sum(memory.beyond for memory in self._memories)
            self.counters["halves_beyond_memory"] -= beyond

    def _restart(self, found: list[Operation]) -> bool:
        """Let all boards write their first pattern next; return True if one was incomplete."""
        self._patterns = self._commanded = self._patterns_by_then = 0
        are_short = [memory.restart(found) for memory in self._memories]  # every one restarts
        return any(are_short)

    def _command(self, found: list[Operation]) -> None:
        """Commit the durations; firmware without durations starts its pattern anew instead."""
        if self._firmware.durations:
            self._end_durations(found)
            self._commanded += self._patterns > self._patterns_by_then
            self._patterns_by_then = self._patterns
            self._uncommitted = False
            found.append(operations.CommitDurations())
        else:
            self._restart(found)
            found.append(operations.Restart())
        found.append(_FORWARDS[line_bytes.COMMAND[0]])

    def _take_durations(self, part: bytes, found: list[Operation]) -> None:
        """Collect bytes of durations; count and drop those beyond the memory."""
        room = line_bytes.BYTES_OF_DURATION * self._firmware.durations - len(self._durations)
        if len(part) > room:
            self.counters["durations_beyond_memory"] += len(part) - room
        self._durations += part[:room]
        found += [_FORWARDS[byte] for byte in part]

    def _end_durations(self, found: list[Operation]) -> None:
        """Append the collected durations to *found*; nothing if there are none."""
        if not self._durations:
            return
        if len(self._durations) % line_bytes.BYTES_OF_DURATION:
            self.counters["durations_short"] += 1
        found.append(
            operations.SetDurations(line_bytes.durations_from_pairs(bytes(self._durations)))
        )
        self._durations.clear()
        self._uncommitted = True

    def _pass_on_strange(self, part: bytes, found: list[Operation]) -> None:
        """Count unknown bytes, and forward them along the chain.

        Each is less by the number of boards: every board takes 1 from it.
        """
        self.counters["bytes_strange"] += len(part)
        found += [_FORWARDS[byte - self._boards] for byte in part]
