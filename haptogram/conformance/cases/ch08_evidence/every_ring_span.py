"""HG-8.1, HG-8.2, HG-8.5: READ_TRACE of every span, and keys of every width."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from haptogram_protocol.framing import HEADER_BYTES, MAX_BODY_BYTES
from haptogram_protocol.messages import (
    Feature,
    LatchKey,
    ReadTrace,
    TraceMode,
    TraceRecord,
    TraceReply,
)

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.latching import latch_now, latches_received_from_board
from ...client.playback import play_out, send_phases_to_store, shortest_period_to_play_us
from ...outcome import SELF_REPORTED, check

_SEQUENCE: Final = 7
_FRAMES: Final = 3
_LATCHES: Final = 402
_LAST: Final = 0xFFFFFFFF
_FIT: Final = (MAX_BODY_BYTES - HEADER_BYTES - TraceReply.LAYOUT.size) // TraceRecord.LAYOUT.size
_LOOPS: Final = 66_000
_NEEDS: Final = Feature.TRACE_RING | Feature.CONFIG | Feature.SEQUENCE_PHASES


def _spans_of_ring(oldest: int, following: int) -> Iterator[tuple[int, int]]:
    """Yield (first, count) at and around every edge of the ring, and of 32 bits."""
    middle = (oldest + following) // 2
    firsts = {0, 1, oldest, oldest + 1, middle, following - 1, following, following + 1}
    firsts |= {oldest - 1, 0x7FFFFFFF, 0x80000000, _LAST - 1, _LAST}
    for first in sorted(first for first in firsts if first >= 0):
        for count in (0, 1, 2, _FIT - 1, _FIT, _FIT + 1, 300, 0xFFFF):
            yield first, count


@case(
    "HG-8.5/2",
    "READ_TRACE of spans at every edge of a ring that has turned over: those, as many as fit",
    variant="spans",
    needs=_NEEDS,
    evidence=SELF_REPORTED,
)
def every_span_of_the_ring(board: BoardClient) -> None:
    ring = board.identity.trace_ring
    board.configure(trace_mode=TraceMode.RING)
    send_phases_to_store(board, _SEQUENCE, frames=_FRAMES)
    board.arm()
    index = latch_now(board, board.flat_phases())
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
        check(edges == (oldest, total), f"{name}: oldest and next are {edges}")
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


@case(
    "HG-8.2/1",
    "in a playback of 66000 passes the keys count on: loops of more than 16 bits",
    variant="loops",
    needs=_NEEDS,
    evidence=SELF_REPORTED,
    depth=Depth.DEFAULT,
    wall_depth=Depth.FULL,
)
def loops_are_counted_on_in_trace_keys(board: BoardClient) -> None:
    board.configure(trace_mode=TraceMode.RING)
    send_phases_to_store(board, _SEQUENCE, frames=1)
    board.arm()
    play_out(board, _SEQUENCE, 1, loops=_LOOPS, period_us=shortest_period_to_play_us(board))
    reply = board.link.call(ReadTrace(_LOOPS - 3, 3), TraceReply)
    got = [(record.number, record.key.loop, record.key.index) for record in reply.records]
    due = [(number, number, 0) for number in range(_LOOPS - 3, _LOOPS)]
    check(got == due, f"(number, loop, index) of the last latches are {got}, due {due}")


@case(
    "HG-8.1/1",
    "in modes CRC and RING every latch of stream and playback is told, whatever trace_divider is",
    variant="divider",
    needs=Feature.CONFIG | Feature.SEQUENCE_PHASES,
    evidence=SELF_REPORTED,
    depth=Depth.DEFAULT,
)
def a_divider_is_of_drive_traces_alone(board: BoardClient) -> None:
    send_phases_to_store(board, _SEQUENCE, frames=_FRAMES)
    for feature, mode in ((Feature.TRACE, TraceMode.CRC), (Feature.TRACE_RING, TraceMode.RING)):
        if not board.has(feature):
            continue
        board.hello()
        board.configure(trace_mode=mode, trace_divider=3)
        board.arm()
        since = board.link.mark()
        due = [(0, latch_now(board, board.flat_phases())) for _ in range(4)]
        play_out(board, _SEQUENCE, _FRAMES)
        due += [(_SEQUENCE, number) for number in range(_FRAMES)]
        got = [
            (latch.sequence, latch.index)
            for latch in latches_received_from_board(board, since, mode)
        ]
        check(got == due, f"mode {mode.name}, trace_divider 3: told are {got}, due {due}")
