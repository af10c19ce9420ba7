"""HG-8.1, HG-8.5: READ_TRACE of every span, over holes too; traces that no divider thins."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from typing import Final

from haptogram_protocol.framing import HEADER_BYTES, MAX_BODY_BYTES
from haptogram_protocol.messages import (
    Feature,
    LatchKey,
    Mute,
    ReadTrace,
    Stop,
    StopReply,
    TraceMode,
    TraceRecord,
    TraceReply,
)

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.latching import full_client_drive, latch_now, latches_received_from_board
from ...client.playback import play_out, send_phases_to_store, shortest_period_to_play_us
from ...outcome import SELF_REPORTED, check, check_equal

_SEQUENCE: Final = 7
_FRAMES: Final = 3
_LATCHES: Final = 402
_LAST: Final = 0xFFFFFFFF
_FIT: Final = (MAX_BODY_BYTES - HEADER_BYTES - TraceReply.LAYOUT.size) // TraceRecord.LAYOUT.size
_OTHER_MODES: Final = (
    (Feature(0), TraceMode.OFF),
    (Feature.TRACE, TraceMode.CRC),
    (Feature.TRACE_DRIVE, TraceMode.DRIVE),
)
#: What happens between two trace modes.
_BETWEEN: Final = ("nothing", "a playback", "MUTE", "an upload", "DISARM")
_NEEDS: Final = Feature.TRACE_RING | Feature.CONFIG | Feature.SEQUENCE_PHASES


def _spans_of_ring(oldest: int, following: int) -> Iterator[tuple[int, int]]:
    """Yield (first, count) at and around every edge of the ring, and of 32 bits."""
    middle = (oldest + following) // 2
    firsts = {0, 1, oldest, oldest + 1, middle, following - 1, following, following + 1}
    firsts |= {oldest - 1, 0x7FFFFFFF, 0x80000000, _LAST - 1, _LAST}
    for first in sorted(first for first in firsts if first >= 0):
        for count in (0, 1, 2, _FIT - 1, _FIT, _FIT + 1, 300, 0xFFFF):
            yield first, count


@case("HG-8.5/2-spans", needs=_NEEDS, evidence=SELF_REPORTED)
def every_span_of_the_ring(board: BoardClient) -> None:
    """READ_TRACE of spans at every edge of a ring that has turned over: those, as many as fit"""
    ring = board.identity.trace_ring
    board.configure(trace_mode=TraceMode.RING)
    send_phases_to_store(board, _SEQUENCE, frames=_FRAMES)
    board.arm()
    index = latch_now(board)
    turns_over = board.thorough and ring < 6000
    loops = -(-(max(_LATCHES, ring + 7) if turns_over else _LATCHES) // _FRAMES)
    play_out(
        board, _SEQUENCE, _FRAMES, loops=loops, period_us=shortest_period_to_play_us(board, 200)
    )
    total = loops * _FRAMES + 1
    oldest = max(0, total - ring)
    for first, count in _spans_of_ring(oldest, total):
        reply = board.link.call(ReadTrace(first, count), TraceReply)
        name = f"READ_TRACE of {count} from {first}"
        edges = (reply.oldest, reply.next)
        check_equal(edges, (oldest, total), f"{name}: oldest and next are {edges}")
        due = list(range(max(first, oldest), min(first + count, total)))[:_FIT]
        got = [record.number for record in reply.records]
        check(
            got == due, f"{name}: {len(got)} records from {got[:1]}, due {len(due)} from {due[:1]}"
        )
        for record in reply.records:
            key = _trace_key(record.number, index)
            check(record.key == key, f"{name}: latch {record.number} is {record.key}, due {key}")


def _trace_key(number: int, index: int) -> LatchKey:
    if number == 0:
        return LatchKey(0, 0, index)
    loop, frame = divmod(number - 1, _FRAMES)
    return LatchKey(_SEQUENCE, loop, frame)


class _RingWithHoles:
    """Latches of one session in several trace modes: the ring lacks those of some.

    Whether it keeps, over the modes between, what it held before is the board's own choice.
    """

    def __init__(self, board: BoardClient) -> None:
        self.board = board
        self.due: list[tuple[LatchKey, int]] = []  # key and CRC of each latch of the session
        self.registers = send_phases_to_store(board, _SEQUENCE, frames=_FRAMES)

    def latch(self) -> None:
        """Latch a random drive of the stream."""
        registers = self.board.random_registers()
        index = latch_now(self.board, self.board.phases(registers))
        self._add(LatchKey(0, 0, index), registers)

    def _add(self, key: LatchKey, registers: bytes) -> None:
        self.due.append((key, zlib.crc32(full_client_drive(registers))))

    def play(self) -> None:
        """Play the sequence to its end, and stop what plays no longer."""
        play_out(self.board, _SEQUENCE, _FRAMES)
        for index, registers in enumerate(self.registers):
            self._add(LatchKey(_SEQUENCE, 0, index), registers)
        self.board.link.call(Stop(), StopReply)

    def go_through(self, event: str) -> None:
        """Let something happen between two trace modes."""
        if event == "MUTE":
            self.board.link.ask(Mute())
        elif event == "DISARM":
            self.board.disarm()
        elif event == "an upload":
            self.registers = send_phases_to_store(self.board, _SEQUENCE, frames=_FRAMES)
        elif event == "a playback":
            self.play()
        self.board.arm()

    def check_spans(self, name: str, least: int) -> None:
        """FAILED unless each READ_TRACE shows what the ring holds: the latches from *least* on."""
        total = len(self.due)
        whole = self._read(name, 0, 0xFFFF)
        held = [record.number for record in whole.records]
        check(
            held == sorted(set(held)) and held[-(total - least) :] == list(range(least, total)),
            f"{name}: the ring holds the latches {held}, due are {least} to {total - 1}, each once",
        )
        check_equal(whole.oldest, held[0], f"{name}: oldest is {whole.oldest}, held are {held}")
        for record in whole.records:
            got = (record.key, record.crc)
            check(
                got == self.due[record.number],
                f"{name}: latch {record.number} is told as (key, crc) {got}, it was "
                f"{self.due[record.number]}",
            )
        for first in range(total + 2):
            for count in (1, 2, total - least, total):
                numbers = [record.number for record in self._read(name, first, count).records]
                due = [number for number in held if first <= number < first + count]
                text = f"{name}: READ_TRACE of {count} from {first} shows {numbers}"
                check(numbers == due, f"{text}; of {held} these are {due}")

    def _read(self, name: str, first: int, count: int) -> TraceReply:
        reply = self.board.link.call(ReadTrace(first, count), TraceReply)
        following = len(self.due)
        check_equal(reply.next, following, f"{name}: {following} latches, next is {reply.next}")
        return reply


@case("HG-8.5/2-holes", needs=_NEEDS, evidence=SELF_REPORTED)
def every_span_of_a_ring_with_holes(board: BoardClient) -> None:
    """READ_TRACE before, in, over and behind latches of other modes, MUTE, DISARM, playback,
    upload
    """
    others = [mode for feature, mode in _OTHER_MODES if board.has(feature)]
    for turn in range(len(_BETWEEN) if board.thorough else 1):
        board.hello()
        ring, name = _RingWithHoles(board), "RING"
        board.configure(trace_mode=TraceMode.RING)
        board.arm()
        ring.latch()
        ring.latch()
        for number, mode in enumerate(others):
            event = _BETWEEN[(turn + number) % len(_BETWEEN)]
            board.configure(trace_mode=mode)
            ring.latch()
            ring.go_through(event)
            least = len(ring.due)
            board.configure(trace_mode=TraceMode.RING)
            ring.latch()
            if number % 2 == 0:
                ring.go_through(_BETWEEN[turn - number])
                ring.latch()
            name += f", {mode.name} with {event}, RING"
            ring.check_spans(name, least)


@case(
    "HG-8.1/1-divider",
    needs=Feature.CONFIG | Feature.SEQUENCE_PHASES,
    evidence=SELF_REPORTED,
    depth=Depth.DEFAULT,
)
def a_divider_is_of_drive_traces_alone(board: BoardClient) -> None:
    """in modes CRC and RING every latch of stream and playback is told, whatever trace_divider
    is
    """
    send_phases_to_store(board, _SEQUENCE, frames=_FRAMES)
    for feature, mode in ((Feature.TRACE, TraceMode.CRC), (Feature.TRACE_RING, TraceMode.RING)):
        if not board.has(feature):
            continue
        board.hello()
        board.configure(trace_mode=mode, trace_divider=3)
        board.arm()
        since = board.link.mark()
        due = [(0, latch_now(board)) for _ in range(4)]
        play_out(board, _SEQUENCE, _FRAMES)
        due += [(_SEQUENCE, number) for number in range(_FRAMES)]
        got = [
            (latch.sequence, latch.index)
            for latch in latches_received_from_board(board, since, mode)
        ]
        check(got == due, f"mode {mode.name}, trace_divider 3: told are {got}, due {due}")
