"""The boards' end of a line of FPGAs, and what it counts of their frames."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from ..codec import Operation, Reply, no_dialect_bytes_for
from . import operations
from .cursor import FpgaChannelCursor


@dataclass(slots=True)
class _FramesSinceSwap:
    """Frames that no swap has shown yet.

    Attributes
    ----------
    replaced : list of int
        For each board the whole frames ahead of the one that began last.
    frame_bytes : int
        Bytes of the frame that began last.
    without_commit : int
        Whole frames that are counted as such.
    outside : int
        Codes since the last start or swap, if there was no start.
    beyond : int
        Codes after the last channel since then.
    """

    replaced: list[int]
    frame_bytes: int = 0
    without_commit: int = 0
    outside: int = 0
    beyond: int = 0


class FpgaBoardEnd:
    """The board's end of the line that one or several boards listen to.

    Codes are given when the byte behind them is a command, or when the last channel has its own.

    Parameters
    ----------
    rules : FpgaByteRules
        Meaning of the bytes.
    boards : int
        Boards on the line; all listen until the first :class:`~.operations.Select`.

    Attributes
    ----------
    counters : Counter
        ``codes_out_of_range`` (taken as the board masks them), ``codes_outside_frame`` (before a
        start), ``codes_beyond_array``, ``codes_unheard`` (no board listened), ``frames_short``
        (swapped before the last channel), ``frames_cut_short`` (by another start),
        ``frames_without_commit`` (whole, but another start came and no swap) and
        ``frames_without_start`` (whole after a swap: the codes reach their channels all the same).
        Without :attr:`~.rules.FpgaByteRules.starts`, selecting a board starts its frame.
    """

    commit: Final = "FDh"

    def __init__(self, rules: operations.FpgaByteRules, boards: int = 1) -> None:
        self.counters: Counter[str] = Counter()
        self._rules = rules
        self._cursor = FpgaChannelCursor(boards)
        self._run = bytearray()
        self._frames = _FramesSinceSwap([0] * boards)
        self._fitting: dict[operations.FpgaCodes, bytes] = {
            kind: bytes(range(rules.limit(kind) + 1))
            for kind in (operations.SetPhases, operations.SetAmplitudes)
        }
        self._counts: dict[type[Operation], Callable[[Any], None]] = {
            operations.Begin: self._count_begin,
            operations.BeginAmplitudes: self._count_begin_amplitudes,
            operations.Select: self._count_select,
            operations.Swap: self._count_swap,
        }

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
        return self._frames.frame_bytes if lacks else 0

    @property
    def uncommitted(self) -> int:
        """Whole frames since the last swap, for the board that has most of them."""
        return max(map(self._whole_frames, range(len(self._cursor.written))))

    def receive_data(self, data: bytes) -> list[Operation]:
        """Return the operations that *data* completes."""
        found: list[Operation] = []
        commands, at = self._rules.commands, 0
        for match in self._rules.pattern.finditer(data):
            here = match.start()
            if here > at:
                self._take_codes(data[at:here], found)
            if self._run:
                self._emit_run(found)
            operation = commands[data[here]]
            self._count_command(operation)
            self._cursor.command(operation)
            found.append(operation)
            at = here + 1
        if at < len(data):
            self._take_codes(data[at:], found)
        return found

    def next_frame_end(self, data: bytes, at: int) -> int:
        """Return the index after the next command."""
        match = self._rules.pattern.search(data, at)
        return match.end() if match else len(data)

    def send(self, message: Reply) -> bytes:
        """Raise LocalProtocolError: these boards never answer."""
        raise no_dialect_bytes_for(message, self._rules.wire)

    # --- frames ----------------------------------------------------------------------------------

    def _count_command(self, operation: Operation) -> None:
        """Count a begin, select or swap in its own way; any other as a byte of the frame.

        Outside of a frame any other is not counted.
        """
        if (count := self._counts.get(type(operation))) is not None:
            count(operation)
        elif self._frames.frame_bytes:
            self._frames.frame_bytes += 1

    def _count_begin(self, _: operations.Begin) -> None:
        """Count the frame before as incomplete or without commit, now that a new one begins."""
        cursor, frames = self._cursor, self._frames
        if cursor.listening:
            self._count_end_of_frame(cursor.listening[0])  # those that listen are alike
        for board in cursor.listening:
            frames.replaced[board] = self._whole_frames(board)
        frames.frame_bytes = 1 if cursor.at else frames.frame_bytes + 1
        frames.outside = frames.beyond = 0

    def _count_begin_amplitudes(self, _: operations.BeginAmplitudes) -> None:
        """Count a frame of phases that is cut short by amplitudes."""
        if 0 < self._cursor.at < self._rules.channels:
            self.counters["frames_cut_short"] += 1
        if self._frames.frame_bytes:
            self._frames.frame_bytes += 1

    def _count_select(self, operation: operations.Select) -> None:
        """Count the selected board's frame as without commit, where frames have no start byte."""
        if not self._rules.starts and operation.board < len(self._cursor.written):
            self._count_end_of_frame(operation.board)
        self._frames.frame_bytes += 1

    def _count_end_of_frame(self, board: int) -> None:
        """Count in errors how the last frame of *board* ended, if it was never shown.

        It was cut short, or is whole and was not committed.
        """
        whole = self._whole_frames(board)
        if 0 < self._cursor.written[board] < self._rules.channels:
            self.counters["frames_cut_short"] += 1
        elif whole > self._frames.without_commit:
            self.counters["frames_without_commit"] += whole - self._frames.without_commit
            self._frames.without_commit = whole

    def _count_swap(self, _: operations.Swap) -> None:
        """Count short frames, and whole frames without a start or commit, at a swap."""
        frames, channels = self._frames, self._rules.channels
        if any(0 < count < channels for count in self._cursor.written):
            self.counters["frames_short"] += 1
        elif frames.outside and not frames.outside % channels and self.uncommitted == 1:
            self.counters["codes_outside_frame"] -= frames.outside
            self.counters["frames_without_start"] += 1
        elif frames.without_commit and frames.beyond and not frames.beyond % channels:
            self.counters["codes_beyond_array"] -= frames.beyond  # they were whole frames
        self._frames = _FramesSinceSwap([0] * len(frames.replaced))

    def _whole_frames(self, board: int) -> int:
        """Return the number of complete frames of *board* since the last swap."""
        return self._frames.replaced[board] + self._cursor.written[board] // self._rules.channels

    # --- codes -----------------------------------------------------------------------------------

    def _take_codes(self, codes: bytes, found: list[Operation]) -> None:
        """Collect *codes* for the next channels; append a run that is complete to *found*.

        A run, one operation, ends at the last channel. Codes that no board listens to are counted
        and dropped.
        """
        cursor, channels = self._cursor, self._rules.channels
        self._frames.frame_bytes += len(codes)
        if not cursor.listening:
            self.counters["codes_unheard"] += len(codes)
            return
        at = cursor.at
        self._count_codes(codes, at)
        if not self._rules.wraps:
            codes = codes[: max(0, channels - at)]
        while codes:
            room = channels - at % channels
            part, codes = codes[:room], codes[room:]
            self._run += part
            at += len(part)
            cursor.advance_to(at)
            if len(part) == room:
                self._emit_run(found)

    def _count_codes(self, codes: bytes, at: int) -> None:
        """Count *codes* out of range, before a start byte, or beyond the last channel.

        The first of them is for channel *at*.
        """
        rules, frames, cursor = self._rules, self._frames, self._cursor
        if strange := codes.translate(None, self._fitting[cursor.kind]):
            self.counters["codes_out_of_range"] += len(strange)
        if rules.starts and not cursor.started:
            frames.outside += len(codes)
            self.counters["codes_outside_frame"] += len(codes)
        if (beyond := min(len(codes), at + len(codes) - rules.channels)) > 0:
            frames.beyond += beyond
            self.counters["codes_beyond_array"] += beyond

    def _emit_run(self, found: list[Operation]) -> None:
        """Append the collected codes to *found* as one operation, and begin a new run."""
        cursor, rules = self._cursor, self._rules
        codes = bytes(self._run)
        first = (cursor.at - len(codes)) % rules.channels
        if cursor.kind is operations.SetPhases:
            codes = codes.translate(rules.taken)
        found.append(cursor.kind(cursor.listening, first, codes))
        self._run.clear()
