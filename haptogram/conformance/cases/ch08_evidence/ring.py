"""HG-8.5: the trace ring: what it keeps, and READ_TRACE of every span of it, over holes too."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from haptogram_protocol.framing import HEADER_BYTES, MAX_BODY_BYTES
from haptogram_protocol.messages import (
    Feature,
    LatchKey,
    Mute,
    Stop,
    StopReply,
    TraceMode,
    TraceRecord,
    TraceReply,
)

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.capabilities import trace_modes
from ...client.latching import drive_crc, latch_now, latch_random, read_ring
from ...client.playback import play_out, send_phases_to_store, shortest_period_to_play_us
from ...outcome import SELF_REPORTED, check, check_equal

_RING_TRIED: Final = 6000  # latches: a longer ring is not filled
_FILLED_US: Final = 60_000_000  # nor one that takes longer
_SEQUENCE: Final = 7
_FRAMES: Final = 3
_LATCHES: Final = 402
_LAST: Final = 0xFFFFFFFF
_FIT: Final = (MAX_BODY_BYTES - HEADER_BYTES - TraceReply.LAYOUT.size) // TraceRecord.LAYOUT.size
#: What happens between two trace modes.
_BETWEEN: Final = ("nothing", "a playback", "MUTE", "an upload", "DISARM")
_RING: Final = Feature.TRACE_RING | Feature.CONFIG
_PLAYED_RING: Final = _RING | Feature.SEQUENCE_PHASES


@case("HG-8.5/1", needs=_RING, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def ring_keeps_the_last(board: BoardClient) -> None:
    """the ring keeps the last trace_ring latches, numbered from 0, and forgets the oldest"""
    size = board.identity.trace_ring
    check(size > 0, "TRACE_RING is advertised, trace_ring is 0")
    board.arm(trace_mode=TraceMode.RING)
    total = _fill_trace_ring(board, size)
    reply, due = read_ring(board), (max(0, total - size), total)
    got = (reply.oldest, reply.next)
    check(got == due, f"{total} latches, room for {size}: oldest and next are {got}, due {due}")


def _fill_trace_ring(board: BoardClient, size: int) -> int:
    """Latch a few more drives than the ring holds, if that can be done; return how many."""
    period_us, loops = shortest_period_to_play_us(board, 100), size // 2 + 3
    is_long = size > _RING_TRIED or 2 * loops * period_us > _FILLED_US
    if is_long or not board.has(Feature.SEQUENCE_PHASES):
        return len(latch_random(board, 20))
    send_phases_to_store(board, 2, frames=2)
    play_out(board, 2, 2, loops=loops, period_us=period_us)
    return 2 * loops


@case("HG-8.5/1-modes", needs=_RING, evidence=SELF_REPORTED)
def ring_counts_every_mode(board: BoardClient) -> None:
    """latches while trace_mode is another one have their numbers: the ring goes on behind them"""
    modes = trace_modes(board, *TraceMode)
    board.hello()
    total = 0
    for mode in [*modes, *reversed(modes)]:
        board.arm(trace_mode=mode)
        latch_now(board, board.flat_phases(total))
        index = latch_now(board, board.flat_phases(total + 1))
        total += 2
        reply = read_ring(board)
        check_equal(reply.next, total, f"{mode.name}: next of TRACE_REPLY is {reply.next}")
        if mode is TraceMode.RING:
            last = [(record.number, record.key.index) for record in reply.records[-2:]]
            due = [(total - 2, index - 1), (total - 1, index)]
            check(last == due, f"the ring ends with (number, index) {last}, due is {due}")


# --- Spans -------------------------------------------------------------------------------------


@case("HG-8.5/2", needs=_RING, evidence=SELF_REPORTED)
def trace_ring_is_read(board: BoardClient) -> None:
    """READ_TRACE of some, none and all records shows numbers, keys and CRCs, oldest first"""
    board.arm(trace_mode=TraceMode.RING)
    first = board.link.stream_next
    drives = latch_random(board, 9)
    for start, count in ((0, 9), (2, 3), (8, 100), (9, 5), (0, 0), (4, 1)):
        reply = read_ring(board, start, count)
        numbers = [item.number for item in reply.records]
        check_equal(
            numbers, list(range(9))[start : start + count], f"{count} from {start}: {numbers}"
        )
        for item in reply.records:
            key = LatchKey(0, 0, first + item.number)
            check(item.key == key, f"latch {item.number} has the key {item.key}, due is {key}")
            crc = drive_crc(drives[item.number])
            check_equal(item.crc, crc, f"latch {item.number} has the CRC of another drive")


def _spans_of_ring(oldest: int, following: int) -> Iterator[tuple[int, int]]:
    """Yield (first, count) at and around every edge of the ring, and of 32 bits."""
    middle = (oldest + following) // 2
    firsts = {0, 1, oldest, oldest + 1, middle, following - 1, following, following + 1}
    firsts |= {oldest - 1, 0x7FFFFFFF, 0x80000000, _LAST - 1, _LAST}
    for first in sorted(first for first in firsts if first >= 0):
        for count in (0, 1, 2, _FIT - 1, _FIT, _FIT + 1, 300, 0xFFFF):
            yield first, count


@case("HG-8.5/2-spans", needs=_PLAYED_RING, evidence=SELF_REPORTED)
def every_ring_span(board: BoardClient) -> None:
    """READ_TRACE of spans at every edge of a ring that has turned over: those, as many as fit"""
    ring = board.identity.trace_ring
    send_phases_to_store(board, _SEQUENCE, frames=_FRAMES)
    board.arm(trace_mode=TraceMode.RING)
    index = latch_now(board)
    turns_over = board.thorough and ring < _RING_TRIED
    loops = -(-(max(_LATCHES, ring + 7) if turns_over else _LATCHES) // _FRAMES)
    period_us = shortest_period_to_play_us(board, 200)
    play_out(board, _SEQUENCE, _FRAMES, loops=loops, period_us=period_us)
    total = loops * _FRAMES + 1
    oldest = max(0, total - ring)
    for first, count in _spans_of_ring(oldest, total):
        reply = read_ring(board, first, count)
        name = f"READ_TRACE of {count} from {first}"
        edges = (reply.oldest, reply.next)
        check_equal(edges, (oldest, total), f"{name}: oldest and next are {edges}")
        due = list(range(max(first, oldest), min(first + count, total)))[:_FIT]
        got = [record.number for record in reply.records]
        text = f"{name}: {len(got)} records from {got[:1]}, due {len(due)} from {due[:1]}"
        check(got == due, text)
        for record in reply.records:
            key = _played_key(record.number, index)
            check(record.key == key, f"{name}: latch {record.number} is {record.key}, due {key}")


def _played_key(number: int, index: int) -> LatchKey:
    """Return the key of a latch behind the stream frame *index*, which is number 0."""
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
        key = LatchKey(0, 0, self.board.link.stream_next)
        self.due += [(key, drive_crc(codes)) for codes in latch_random(self.board, 1)]

    def go_through(self, event: str) -> None:
        """Let something happen between two trace modes."""
        board = self.board
        if event == "MUTE":
            board.link.ask(Mute())
        elif event == "DISARM":
            board.disarm()
        elif event == "an upload":
            self.registers = send_phases_to_store(board, _SEQUENCE, frames=_FRAMES)
        elif event == "a playback":
            play_out(board, _SEQUENCE, _FRAMES)
            keys = (LatchKey(_SEQUENCE, 0, index) for index in range(_FRAMES))
            self.due += zip(keys, map(drive_crc, self.registers), strict=True)
            board.link.call(Stop(), StopReply)  # what plays no longer
        board.arm()

    def check_spans(self, name: str, least: int) -> None:
        """FAILED unless each READ_TRACE shows what the ring holds: the latches from *least* on."""
        total = len(self.due)
        whole = self._read(name, 0, 0xFFFF)
        held = [record.number for record in whole.records]
        is_due = held == sorted(set(held)) and held[least - total :] == list(range(least, total))
        text = f"{name}: the ring holds the latches {held}"
        check(is_due, f"{text}, due are {least} to {total - 1}, each once")
        check_equal(whole.oldest, held[0], f"{name}: oldest is {whole.oldest}, held are {held}")
        for record in whole.records:
            got, due = (record.key, record.crc), self.due[record.number]
            text = f"{name}: latch {record.number} is told as (key, crc) {got}, it was {due}"
            check(got == due, text)
        for first in range(total + 2):
            for count in (1, 2, total - least, total):
                numbers = [record.number for record in self._read(name, first, count).records]
                wanted = [number for number in held if first <= number < first + count]
                text = f"{name}: READ_TRACE of {count} from {first} shows {numbers}"
                check(numbers == wanted, f"{text}; of {held} these are {wanted}")

    def _read(self, name: str, first: int, count: int) -> TraceReply:
        reply, following = read_ring(self.board, first, count), len(self.due)
        check_equal(reply.next, following, f"{name}: {following} latches, next is {reply.next}")
        return reply


@case("HG-8.5/2-holes", needs=_PLAYED_RING, evidence=SELF_REPORTED)
def every_span_with_holes(board: BoardClient) -> None:
    """READ_TRACE before, in, over and behind latches of other modes, MUTE, DISARM, playback,
    upload
    """
    others = trace_modes(board, TraceMode.OFF, TraceMode.CRC, TraceMode.DRIVE)
    for turn in range(len(_BETWEEN) if board.thorough else 1):
        board.hello()
        ring, name = _RingWithHoles(board), "RING"
        board.arm(trace_mode=TraceMode.RING)
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
