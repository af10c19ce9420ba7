"""The byte rules that the FPGAs of SonicSurface and Ultraino share: codes, and bytes that command.

A byte of :attr:`FpgaByteRules.commands` is a command wherever it stands; every other byte is the
code of the next channel. There is no length and no checksum, so a lost byte shifts the channels
behind it until the next start or swap, here as on the boards.

Source: upnalab/SonicSurface, ``Firmware/FPGA primary/src/Distribute.vhd`` and ``PhaseLine.vhd``,
0c7b689.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, TypeAlias

from ..errors import LocalProtocolError
from .codec import OneWayHostEnd, Operation, Reply, no_dialect_bytes_for

__all__ = [
    "Begin",
    "BeginAmplitudes",
    "Clocks",
    "FpgaBoardEnd",
    "FpgaByteRules",
    "FpgaHostEnd",
    "ModulationStep",
    "Select",
    "SetAmplitudes",
    "SetPhases",
    "Swap",
    "ToggleMultiplex",
    "masked_register_codes",
]


@dataclass(frozen=True, slots=True)
class Begin(Operation):
    """The boards that listen write channel 0 next."""


@dataclass(frozen=True, slots=True)
class BeginAmplitudes(Operation):
    """The boards that listen take amplitudes, channel 0 next."""


@dataclass(frozen=True, slots=True)
class SetPhases(Operation):
    """Codes for the buffer that does not radiate.

    Attributes
    ----------
    boards : tuple of int
        The boards that take the codes.
    first : int
        Channel of the first code.
    codes : bytes
        Delay of the rising edge in steps of a period, or the code that means off, for each channel.
    """

    boards: tuple[int, ...]
    first: int
    codes: bytes


@dataclass(frozen=True, slots=True)
class SetAmplitudes(Operation):
    """Widths of the pulses, in steps of a period, as :class:`SetPhases` has codes."""

    boards: tuple[int, ...]
    first: int
    codes: bytes


@dataclass(frozen=True, slots=True)
class Swap(Operation):
    """Every board swaps its two buffers, listening or not, and writes channel 0 next."""


@dataclass(frozen=True, slots=True)
class Select(Operation):
    """*board* listens from now on, and no other."""

    board: int


@dataclass(frozen=True, slots=True)
class Clocks(Operation):
    """The clocks of the shift registers run, or stand still."""

    on: bool


@dataclass(frozen=True, slots=True)
class ModulationStep(Operation):
    """Step of the amplitude modulation, 0 to 31."""

    step: int


@dataclass(frozen=True, slots=True)
class ToggleMultiplex(Operation):
    """Quick multiplexing is switched on or off."""


_CodesOf: TypeAlias = type[SetPhases] | type[SetAmplitudes]


def masked_register_codes(off: int) -> bytes:
    """Return the code of each data byte in a register of *off* steps: masked, *off* apart."""
    return bytes(off if byte == off else byte & (off - 1) for byte in range(256))


@dataclass(frozen=True)
class FpgaByteRules:
    """Meanings of the bytes of one firmware.

    Attributes
    ----------
    wire : str
        Name of the wire in messages.
    channels : int
        Channels of a board; code number *channels* goes to channel 0 again.
    off : int
        Code of a channel that is off; smaller ones are delays.
    commands : mapping
        Operation of every byte that is no code.
    starts : bool
        Whether codes belong behind :class:`Begin`; others are taken as well, and counted.
    wraps : bool
        Whether a code too many goes to channel 0 again; otherwise it is not taken.
    amplitude_limit : int
        Largest amplitude.
    """

    wire: str
    channels: int
    off: int
    commands: Mapping[int, Operation]
    starts: bool = True
    wraps: bool = True
    amplitude_limit: int = 0
    taken: bytes = field(init=False)
    pattern: re.Pattern[bytes] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "taken", masked_register_codes(self.off))
        found = re.compile(b"[" + re.escape(bytes(sorted(self.commands))) + b"]")
        object.__setattr__(self, "pattern", found)

    def limit(self, kind: _CodesOf) -> int:
        """Return the largest code that *kind* may hold."""
        return self.off if kind is SetPhases else self.amplitude_limit


class _Cursor:
    """The boards that listen, and the codes that each has taken since its channel 0."""

    def __init__(self, boards: int) -> None:
        if boards < 1:
            raise LocalProtocolError(f"{boards} boards; a wire has at least one")
        self.listening = tuple(range(boards))  # s_boardEnable is '1' at power-up
        self.written = [0] * boards
        self.kind: _CodesOf = SetPhases
        self.started = False

    @property
    def at(self) -> int:
        """Codes that the listening boards have taken: all alike, for only power-up has several."""
        return self.written[self.listening[0]] if self.listening else 0

    def command(self, operation: Operation) -> None:
        if isinstance(operation, Select):
            self.listening = (operation.board,) if operation.board < len(self.written) else ()
        elif isinstance(operation, Swap):
            self.written = [0] * len(self.written)
            self.kind, self.started = SetPhases, False
        elif isinstance(operation, Begin | BeginAmplitudes) and self.listening:
            self.advance_to(0)
            self.kind = SetPhases if isinstance(operation, Begin) else SetAmplitudes
            self.started = True

    def advance_to(self, written: int) -> None:
        for board in self.listening:
            self.written[board] = written


class FpgaBoardEnd:
    """The board's end of the line that one or several boards listen to.

    Codes are given when the byte behind them is a command, or when the last channel has its own.

    Parameters
    ----------
    rules : FpgaByteRules
        What bytes mean.
    boards : int
        Boards on the line; all listen until the first :class:`Select`.

    Attributes
    ----------
    counters : Counter
        ``codes_out_of_range`` (taken as the board masks them), ``codes_outside_frame`` (before a
        start), ``codes_beyond_array``, ``codes_unheard`` (no board listened), ``frames_short``
        (swapped before the last channel), ``frames_cut_short`` (by another start),
        ``frames_without_commit`` (whole, but another start came and no swap) and
        ``frames_without_start`` (whole behind a swap: the codes reach their channels all the same).
        Without :attr:`FpgaByteRules.starts`, selecting a board starts its frame.
    """

    commit: Final = "FDh"

    def __init__(self, rules: FpgaByteRules, boards: int = 1) -> None:
        self.counters: Counter[str] = Counter()
        self._rules = rules
        self._cursor = _Cursor(boards)
        self._run = bytearray()
        self._frame_bytes = 0  # of the frame that began last
        self._replaced = [0] * boards  # whole frames since the last swap, ahead of that one
        self._without_commit = 0  # of these, counted
        self._outside = 0  # codes since the last start or swap, if there was no start
        self._beyond = 0  # codes behind the last channel since then

    @property
    def pending(self) -> int:
        """Codes that wait for the end of their run: fewer than the channels of a board."""
        return len(self._run)

    @property
    def unfinished(self) -> int:
        """Bytes of the frame that has begun and lacks channels of a board that it has begun."""
        cursor, channels = self._cursor, self._rules.channels
        is_empty = cursor.started and not any(cursor.written)
        lacks = is_empty or any(count % channels for count in cursor.written)
        return self._frame_bytes if lacks else 0

    @property
    def uncommitted(self) -> int:
        """Whole frames since the last swap, for the board that has most of them."""
        return max(map(self._whole, range(len(self._replaced))))

    def receive_data(self, data: bytes) -> list[Operation]:
        """Return the operations that *data* completes."""
        found: list[Operation] = []
        at = 0
        for match in self._rules.pattern.finditer(data):
            here = match.start()
            if here > at:
                self._take(data[at:here], found)
            self._end_run(found)
            self._command(self._rules.commands[data[here]], found)
            at = here + 1
        if at < len(data):
            self._take(data[at:], found)
        return found

    def next_frame_end(self, data: bytes, at: int) -> int:
        """Return the index behind the next command."""
        match = self._rules.pattern.search(data, at)
        return match.end() if match else len(data)

    def send(self, message: Reply) -> bytes:
        """Raise LocalProtocolError: these boards never answer."""
        raise no_dialect_bytes_for(message, self._rules.wire)

    def _command(self, operation: Operation, found: list[Operation]) -> None:
        ended = self._ended_by(operation)
        self._count_frame(operation, ended)
        if isinstance(operation, Swap):
            self._frame_bytes = self._without_commit = 0
            self._replaced = [0] * len(self._replaced)
        elif isinstance(operation, Begin):
            for board in ended:
                self._replaced[board] = self._whole(board)
            written = any(self._cursor.written[board] for board in ended)
            self._frame_bytes = 1 if written else self._frame_bytes + 1
        elif self._frame_bytes or isinstance(operation, Select):
            self._frame_bytes += 1
        self._cursor.command(operation)
        found.append(operation)

    def _whole(self, board: int) -> int:
        """Return the whole frames that *board* has taken since the last swap."""
        return self._replaced[board] + self._cursor.written[board] // self._rules.channels

    def _ended_by(self, operation: Operation) -> Sequence[int]:
        """Return the boards whose frame ends with *operation*."""
        boards = range(len(self._replaced))
        if isinstance(operation, Swap):
            return boards
        if isinstance(operation, Begin | BeginAmplitudes):
            return self._cursor.listening
        if isinstance(operation, Select) and not self._rules.starts:
            return boards[operation.board : operation.board + 1]
        return ()

    def _count_frame(self, operation: Operation, ended: Sequence[int]) -> None:
        """Count the frame of the boards *ended* if channels, start or commit are missing."""
        channels, swaps = self._rules.channels, isinstance(operation, Swap)
        counts = [self._cursor.written[board] for board in ended]
        whole = max(map(self._whole, ended), default=0)
        if any(0 < count < channels for count in counts):
            self.counters["frames_short" if swaps else "frames_cut_short"] += 1
        elif swaps and whole == 1 and self._outside and not self._outside % channels:
            self.counters["codes_outside_frame"] -= self._outside
            self.counters["frames_without_start"] += 1
        elif swaps and self._without_commit and self._beyond and not self._beyond % channels:
            self.counters["codes_beyond_array"] -= self._beyond  # they were whole frames
        elif isinstance(operation, Begin | Select) and whole > self._without_commit:
            self.counters["frames_without_commit"] += whole - self._without_commit
            self._without_commit = whole
        if isinstance(operation, Swap | Begin):
            self._outside = self._beyond = 0

    def _take(self, codes: bytes, found: list[Operation]) -> None:
        """Put *codes* behind the run, which ends with every last channel."""
        cursor, channels = self._cursor, self._rules.channels
        self._frame_bytes += len(codes)
        if not cursor.listening:
            self.counters["codes_unheard"] += len(codes)
            return
        self._count_strange(codes)
        if not self._rules.wraps:
            codes = codes[: max(0, channels - cursor.at)]
        while codes:
            room = channels - cursor.at % channels
            part, codes = codes[:room], codes[room:]
            self._run += part
            cursor.advance_to(cursor.at + len(part))
            if len(part) == room:
                self._end_run(found)

    def _count_strange(self, codes: bytes) -> None:
        cursor, rules = self._cursor, self._rules
        fitting = bytes(range(rules.limit(cursor.kind) + 1))
        beyond = min(len(codes), cursor.at + len(codes) - rules.channels)
        outside = len(codes) if rules.starts and not cursor.started else 0
        self._outside += outside
        self._beyond += max(0, beyond)
        for kind, count in (
            ("codes_out_of_range", len(codes.translate(None, fitting))),
            ("codes_outside_frame", outside),
            ("codes_beyond_array", beyond),
        ):
            if count > 0:
                self.counters[kind] += count

    def _end_run(self, found: list[Operation]) -> None:
        if not self._run:
            return
        cursor, rules = self._cursor, self._rules
        codes = bytes(self._run)
        first = (cursor.at - len(codes)) % rules.channels
        if cursor.kind is SetPhases:
            codes = codes.translate(rules.taken)
        found.append(cursor.kind(cursor.listening, first, codes))
        self._run.clear()


class FpgaHostEnd(OneWayHostEnd):
    """The host's end of the line: the bytes of operations, and boards that never answer.

    Parameters
    ----------
    rules : FpgaByteRules
        What bytes mean.
    boards : int
        Boards on the line.
    """

    def __init__(self, rules: FpgaByteRules, boards: int = 1) -> None:
        super().__init__()
        self._rules = rules
        self._cursor = _Cursor(boards)
        self._bytes: Final = {operation: byte for byte, operation in rules.commands.items()}

    def send(self, message: Operation) -> bytes:
        """Return the bytes of *message*.

        Raises
        ------
        LocalProtocolError
            If codes are out of range or would not reach the boards and channels that they name.
        """
        if isinstance(message, SetPhases | SetAmplitudes):
            self._check(message)
            self._cursor.advance_to(self._cursor.at + len(message.codes))
            return message.codes
        if message not in self._bytes:
            raise no_dialect_bytes_for(message, self._rules.wire)
        self._cursor.command(message)
        return bytes([self._bytes[message]])

    def _check(self, message: SetPhases | SetAmplitudes) -> None:
        cursor, rules = self._cursor, self._rules
        limit = rules.limit(type(message))
        if message.codes and max(message.codes) > limit:
            raise LocalProtocolError(
                f"code {max(message.codes)} for {rules.wire}; the largest one is {limit}"
            )
        if type(message) is not cursor.kind or message.boards != cursor.listening:
            raise LocalProtocolError(
                f"{type(message).__name__} for boards {message.boards}; on the line boards "
                f"{cursor.listening} listen for {cursor.kind.__name__}: select and begin first"
            )
        if message.first != cursor.at % rules.channels or len(message.codes) > (
            rules.channels - message.first
        ):
            raise LocalProtocolError(
                f"{len(message.codes)} codes from channel {message.first} on; the boards write "
                f"channel {cursor.at % rules.channels} next and have {rules.channels} channels"
            )
