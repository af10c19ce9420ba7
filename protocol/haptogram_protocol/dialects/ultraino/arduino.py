"""Ultraino's Arduino boards: MEGA64 with the usual and the animation firmware, Nano16 and Nano8.

A byte of a pattern holds four bits of it in its high nibble; its low nibble counts the boards of
the chain down to 1, and the board that finds 1 keeps it. All else goes on to the next board; what
the last one sends comes back to the host, which ignores it. 115 200 baud, 8N1.

====================  ============================================================================
00                    swap the buffers, write slot 0 next; sent on
hhhhnnnn, n = 1       half a slot byte: high half first
hhhhnnnn, n >= 2      sent on as byte - 1
dd110000              MEGA64: two bits of a duration, high ones first; sent on
10                    MEGA64: take the durations; Nano16: write slot 0 next; sent on
any other             sent on as byte - 1
====================  ============================================================================

A pattern of MEGA64 is 10 slots of 10 port bytes, 200 bytes on the wire; with the durations 1 and 0,
10h and 00h the frame has 210 bytes, that of 4 boards 810. Source: asiermarzo/Ultraino,
``DriverBoards/ArduinoMega64/firmware/DriverMEGA/DriverMEGA.ino`` 3ad4bdf,
``DriverMEGAAnim/DriverMEGAAnim.ino`` and ``DriverBoards/DriverNano16/DriverNano16.ino`` 6411b27;
clients: ``protocols/ArduinoMEGA64.java`` and others, 3d5a02a.
``DriverMEGAStatic.ino`` takes the same bytes, but has room for 8 patterns and 8 durations only; it
has no dialect here.

Not known: what MEGA64 and Nano16 do behind the end of their memory (32 patterns, 32 durations, one
pattern), where the firmware writes on without a check (nothing is taken here); the firmware of
Nano8 (as Nano16's here, with 24 slots of one port).
"""

from __future__ import annotations

import functools
import re
from collections import Counter
from dataclasses import dataclass
from typing import Final

from ...errors import LocalProtocolError
from ..codec import Dialect, OneWayHostEnd, Operation, Reply, no_dialect_bytes_for
from .operations import CommitDurations, Forward, Restart, SetDurations, SetPattern, Swap
from .slot_display import ONE_PATTERN, SlotDisplay
from .slots import MEGA64_LAYOUT, NANO8_LAYOUT, NANO16_CONNECTED, NANO16_LAYOUT, SlotLayout

__all__ = [
    "MAX_BOARDS",
    "MEGA64",
    "MEGA64_FIRMWARE",
    "NANO8",
    "NANO8_FIRMWARE",
    "NANO16",
    "NANO16_FIRMWARE",
    "ArduinoBoardEnd",
    "ArduinoFirmware",
    "ArduinoHostEnd",
    "mega64_frame",
]

MAX_BOARDS: Final = 14  # ArduinoMEGA64.java: 15 boards and more are refused
_SWAP: Final = b"\x00"
_COMMAND: Final = b"\x10"
_DURATION_BYTES: Final = bytes([0x30, 0x70, 0xB0, 0xF0])
_BYTES_OF_DURATION: Final = 4


@dataclass(frozen=True)
class ArduinoFirmware:
    """Capacities of a firmware.

    Attributes
    ----------
    wire : str
        Name of the wire in messages.
    pattern_bytes : int
        Slot bytes of a pattern.
    patterns : int
        Patterns of a buffer.
    durations : int
        Durations; 0 if the firmware does not know them.
    """

    wire: str
    pattern_bytes: int
    patterns: int
    durations: int

    @property
    def half_bytes(self) -> int:
        """Bytes of a pattern on the wire."""
        return 2 * self.pattern_bytes


MEGA64_FIRMWARE: Final = ArduinoFirmware(
    "ultraino-mega64", pattern_bytes=100, patterns=32, durations=32
)
NANO16_FIRMWARE: Final = ArduinoFirmware(
    "ultraino-nano16", pattern_bytes=32, patterns=1, durations=0
)
NANO8_FIRMWARE: Final = ArduinoFirmware("ultraino-nano8", pattern_bytes=24, patterns=1, durations=0)

_HIGH_NIBBLE: Final = b"".join(b"%x" % (byte >> 4) for byte in range(256))  # as hexadecimal digit
_PARTS: Final = {
    hops: rb"[" + b"".join(re.escape(bytes([high << 4 | hops])) for high in range(16)) + rb"]+"
    for hops in range(1, 16)
}
_OTHER_HOPS: Final = b"[" + re.escape(bytes(b for b in range(256) if b & 0x0F > 1)) + b"]"
# Group n: bytes of a pattern with n hops to go; 16 durations, 17 swap, 18 command; else strange.
_TOKENS: Final = re.compile(
    b"|".join(
        b"(" + part + b")"
        for part in (
            *_PARTS.values(),
            rb"[" + re.escape(_DURATION_BYTES) + rb"]+",
            _SWAP,
            _COMMAND,
            rb"[\x20\x40-\x60\x80-\xa0\xc0-\xe0]",
        )
    ),
    re.DOTALL,
)
_DURATION, _SWAPPED, _COMMANDED = 16, 17, 18
_ACTS: Final = re.compile(rb"[" + re.escape(_SWAP + _COMMAND) + rb"]")


class _Memory:
    """Half slot bytes that a board has taken since its last swap."""

    def __init__(self, board: int, firmware: ArduinoFirmware) -> None:
        self._board = board
        self._firmware = firmware
        self.patterns = 0
        self.halves = bytearray()
        self.beyond = 0

    @property
    def room(self) -> int:
        """Halves that still fit."""
        whole = (self._firmware.patterns - self.patterns) * self._firmware.half_bytes
        return whole - len(self.halves)

    @property
    def whole(self) -> int:
        """Patterns that came since the last swap, those that there is no room for as well."""
        return self.patterns + self.beyond // self._firmware.half_bytes

    @property
    def is_partial(self) -> bool:
        """True if the last pattern has not ended."""
        return bool(self.halves or self.beyond % self._firmware.half_bytes)

    def take(self, halves: bytes, found: list[Operation]) -> None:
        lost = max(0, len(halves) - self.room)
        self.beyond += lost
        self.halves += halves[: len(halves) - lost]
        size = self._firmware.half_bytes
        while len(self.halves) >= size:
            self._give(self.halves[:size], found)
            del self.halves[:size]

    def restart(self, found: list[Operation]) -> None:
        if self.halves:
            self._give(self.halves, found)
            self.halves.clear()
        self.patterns = self.beyond = 0

    def _give(self, halves: bytearray, found: list[Operation]) -> None:
        digits = halves.translate(_HIGH_NIBBLE).decode("ascii")
        slots = bytes.fromhex(digits + "0" * (len(digits) % 2))
        found.append(SetPattern(self._board, self.patterns, slots))
        self.patterns += 1


class ArduinoBoardEnd:
    """The end of a chain of boards: what they take, and what the last one sends.

    Patterns are given when their last half is there, or when a swap cuts them short.

    Parameters
    ----------
    firmware : ArduinoFirmware
        What the boards run.
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
        if not 1 <= boards <= MAX_BOARDS:
            raise LocalProtocolError(f"a chain of {boards} boards; it has 1 to {MAX_BOARDS}")
        self.counters: Counter[str] = Counter()
        self._firmware = firmware
        self._boards = boards
        self._memories = [_Memory(board, firmware) for board in range(boards)]
        self._durations = bytearray()
        self._uncommitted = False
        self._frame_bytes = 0
        self._commanded = 0  # frames since the last swap that ended with a command,
        self._patterns_by_then = 0  # and their patterns

    @property
    def pending(self) -> int:
        """Bytes of patterns and durations that have not ended."""
        return sum(len(memory.halves) for memory in self._memories) + len(self._durations)

    @property
    def unfinished(self) -> int:
        """Bytes of the frame that has begun and whose pattern or duration has not ended."""
        is_partial = any(memory.is_partial for memory in self._memories)
        is_cut = len(self._durations) % _BYTES_OF_DURATION
        return self._frame_bytes if is_partial or is_cut else 0

    @property
    def uncommitted(self) -> int:
        """Whole frames since the last swap: with durations, those behind their command."""
        patterns = self._patterns
        if not self._firmware.durations:
            return patterns
        return self._commanded + (patterns > self._patterns_by_then)

    @property
    def _patterns(self) -> int:
        """Whole patterns since the last swap, for the board that has most of them."""
        return max(memory.whole for memory in self._memories)

    def receive_data(self, data: bytes) -> list[Operation]:
        """Return the operations that *data* completes, :class:`Forward` among them."""
        found: list[Operation] = []
        for match in _TOKENS.finditer(data):
            kind, part = match.lastindex or 0, match.group()
            self._frame_bytes += len(part)
            if kind < _DURATION:
                self._take_halves(kind, part, found)
            elif kind == _SWAPPED:
                self._swap(found)
            elif kind == _COMMANDED:
                self._command(found)
            elif kind == _DURATION and self._firmware.durations:
                self._take_durations(part, found)
            else:
                self._pass_on_strange(part, found)
        return found

    def next_frame_end(self, data: bytes, at: int) -> int:
        """Return the index behind the next swap or command."""
        match = _ACTS.search(data, at)
        return match.end() if match else len(data)

    def send(self, message: Reply) -> bytes:
        """Return the byte that the last board sends on."""
        if isinstance(message, Forward):
            return bytes([message.byte & 0xFF])
        raise no_dialect_bytes_for(message, self._firmware.wire)

    def _take_halves(self, hops: int, halves: bytes, found: list[Operation]) -> None:
        if hops > self._boards:
            self.counters["bytes_beyond_chain"] += len(halves)
            found += [Forward(byte - self._boards) for byte in halves]
            return
        memory = self._memories[hops - 1]
        if lost := max(0, len(halves) - memory.room):
            self.counters["halves_beyond_memory"] += lost
        memory.take(halves, found)

    def _swap(self, found: list[Operation]) -> None:
        self._count_frames()
        self._frame_bytes = self._commanded = self._patterns_by_then = 0
        for memory in self._memories:
            memory.restart(found)
        self._end_durations(found)
        if self._uncommitted:
            self.counters["durations_without_commit"] += 1
            self._uncommitted = False
        found += [Swap(), Forward(_SWAP[0])]

    def _count_frames(self) -> None:
        """Count what the frames since the last swap lack."""
        if any(memory.halves for memory in self._memories):
            self.counters["frames_short"] += 1
        if (unshown := self.uncommitted - 1) > 0:
            self.counters["frames_without_commit"] += unshown
            if not self.unfinished:  # what had no room were whole frames
                beyond = sum(memory.beyond for memory in self._memories)
                self.counters["halves_beyond_memory"] -= beyond

    def _command(self, found: list[Operation]) -> None:
        self._frame_bytes = 0
        if self._firmware.durations:
            self._end_durations(found)
            self._commanded += self._patterns > self._patterns_by_then
            self._patterns_by_then = self._patterns
            self._uncommitted = False
            found.append(CommitDurations())
        else:
            for memory in self._memories:
                memory.restart(found)
            found.append(Restart())
        found.append(Forward(_COMMAND[0]))

    def _take_durations(self, part: bytes, found: list[Operation]) -> None:
        room = _BYTES_OF_DURATION * self._firmware.durations - len(self._durations)
        if len(part) > room:
            self.counters["durations_beyond_memory"] += len(part) - room
        self._durations += part[:room]
        found += map(Forward, part)

    def _end_durations(self, found: list[Operation]) -> None:
        if not self._durations:
            return
        if len(self._durations) % _BYTES_OF_DURATION:
            self.counters["durations_short"] += 1
        found.append(SetDurations(_durations_from_pairs(bytes(self._durations))))
        self._durations.clear()
        self._uncommitted = True

    def _pass_on_strange(self, part: bytes, found: list[Operation]) -> None:
        """Send on as byte - 1, which the boards behind do once more; 14 of them never find a 1."""
        self.counters["bytes_strange"] += len(part)
        found += [Forward(byte - self._boards) for byte in part]


class ArduinoHostEnd(OneWayHostEnd):
    """The host's end: the bytes of operations; what a chain sends back is ignored.

    Parameters
    ----------
    firmware : ArduinoFirmware
        What the boards run.
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
            return _durations_to_pairs(message.periods)
        if isinstance(message, Swap):
            return _SWAP
        if isinstance(message, CommitDurations if firmware.durations else Restart):
            return _COMMAND
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


def mega64_frame(patterns: list[bytes], durations: bytes = ONE_PATTERN) -> list[Operation]:
    """Return the operations of a frame of MEGA64 from the slot bytes of each board of a chain."""
    return [
        *(SetPattern(board, 0, slots) for board, slots in enumerate(patterns)),
        SetDurations(durations),
        CommitDurations(),
        Swap(),
    ]


def _arduino_frame_bytes(firmware: ArduinoFirmware, boards: int) -> int:
    """Return the bytes of one pattern for each board, its durations, their commit and the swap."""
    durations = 2 * _BYTES_OF_DURATION + len(_COMMAND) if firmware.durations else 0
    return firmware.half_bytes * boards + durations + len(_SWAP)


def _durations_from_pairs(pairs: bytes) -> bytes:
    """Return the durations of bytes that hold two bits each, high ones first."""
    padded = pairs + b"\0" * (-len(pairs) % _BYTES_OF_DURATION)
    return bytes(
        padded[at] & 0xC0
        | padded[at + 1] >> 2 & 0x30
        | padded[at + 2] >> 4 & 0x0C
        | padded[at + 3] >> 6
        for at in range(0, len(padded), _BYTES_OF_DURATION)
    )


def _durations_to_pairs(durations: bytes) -> bytes:
    return bytes(0x30 | value << up & 0xC0 for value in durations for up in (0, 2, 4, 6))


def _arduino_dialect(
    firmware: ArduinoFirmware, title: str, layout: SlotLayout, connected: bytes = b""
) -> Dialect:
    def board(*, boards: int = 1) -> ArduinoBoardEnd:
        return ArduinoBoardEnd(firmware, boards)

    def host(*, boards: int = 1) -> ArduinoHostEnd:
        return ArduinoHostEnd(firmware, boards)

    def display(boards: int) -> SlotDisplay:
        durations = ONE_PATTERN if firmware.durations else b""
        return SlotDisplay(layout, boards, durations=durations, connected=connected)

    ours = _PARTS[1].removesuffix(b"+")
    pattern = b"(?<!%b)(?:%b{%d})+" % (ours, ours, firmware.half_bytes)
    others = b"(?:%b{%d})*" % (_OTHER_HOPS, firmware.half_bytes)
    ending = b"\x00"
    if firmware.durations:
        ending = b"(?:[%b]{4})+\x10\x00" % re.escape(_DURATION_BYTES)
    return Dialect(
        name=firmware.wire,
        title=title,
        bauds=(115_200,),
        steps=layout.steps,
        channels=len(layout.pins),
        frame_bytes=functools.partial(_arduino_frame_bytes, firmware),
        board=board,
        host=host,
        signature=re.compile(pattern + others + ending, re.DOTALL),
        display=display,
    )


MEGA64: Final = _arduino_dialect(MEGA64_FIRMWARE, "Ultraino Arduino MEGA64", MEGA64_LAYOUT)
NANO16: Final = _arduino_dialect(
    NANO16_FIRMWARE, "Ultraino Arduino Nano16", NANO16_LAYOUT, NANO16_CONNECTED
)
NANO8: Final = _arduino_dialect(NANO8_FIRMWARE, "Ultraino Arduino Nano8", NANO8_LAYOUT)
