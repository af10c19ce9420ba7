"""HG-8.5: the trace ring."""

from __future__ import annotations

import zlib
from typing import Final

from haptogram_protocol.messages import (
    Feature,
    LatchKey,
    ReadTrace,
    TraceMode,
    TraceReply,
)

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.capabilities import ALL_MODES
from ...client.latching import full_client_drive, latch_now
from ...client.playback import (
    play_out,
    send_phases_to_store,
    shortest_period_to_play_us,
)
from ...outcome import SELF_REPORTED, check, check_equal

_RING_TRIED: Final = 6000  # latches: a longer ring is not filled
_FILLED_US: Final = 60_000_000  # nor one that takes longer


@case(
    "HG-8.5/1",
    needs=Feature.TRACE_RING | Feature.CONFIG,
    evidence=SELF_REPORTED,
    depth=Depth.DEFAULT,
)
def trace_ring_keeps_the_last(board: BoardClient) -> None:
    """the ring keeps the last trace_ring latches, numbered from 0, and forgets the oldest"""
    size = board.identity.trace_ring
    check(size > 0, "TRACE_RING is advertised, trace_ring is 0")
    board.configure(trace_mode=TraceMode.RING)
    board.arm()
    total = _fill_trace_ring(board, size)
    reply = board.link.call(ReadTrace(0, 0xFFFF), TraceReply)
    due = (max(0, total - size), total)
    got = (reply.oldest, reply.next)
    check(got == due, f"{total} latches, room for {size}: oldest and next are {got}, due {due}")


def _fill_trace_ring(board: BoardClient, size: int) -> int:
    """Latch a few more drives than the ring holds, if that can be done; return how many."""
    period_us, loops = shortest_period_to_play_us(board, 100), size // 2 + 3
    is_long = size > _RING_TRIED or 2 * loops * period_us > _FILLED_US
    if is_long or not board.has(Feature.SEQUENCE_PHASES):
        for _ in range(20):
            latch_now(board)
        return 20
    send_phases_to_store(board, 2, frames=2)
    play_out(board, 2, 2, loops=loops, period_us=period_us)
    return 2 * loops


@case("HG-8.5/2", needs=Feature.TRACE_RING | Feature.CONFIG, evidence=SELF_REPORTED)
def trace_ring_is_read(board: BoardClient) -> None:
    """READ_TRACE of some, none and all records shows numbers, keys and CRCs, oldest first"""
    board.configure(trace_mode=TraceMode.RING)
    board.arm()
    first = board.link.stream_next
    drives = [board.random_registers() for _ in range(9)]
    for registers in drives:
        latch_now(board, board.phases(registers))
    for start, count in ((0, 9), (2, 3), (8, 100), (9, 5), (0, 0), (4, 1)):
        reply = board.link.call(ReadTrace(start, count), TraceReply)
        numbers = [item.number for item in reply.records]
        due = list(range(9))[start : start + count]
        check_equal(numbers, due, f"{count} from {start}: {numbers}")
        for item in reply.records:
            key = LatchKey(0, 0, first + item.number)
            check(item.key == key, f"latch {item.number} has the key {item.key}, due is {key}")
            crc = zlib.crc32(full_client_drive(drives[item.number]))
            check_equal(item.crc, crc, f"latch {item.number} has the CRC of another drive")


@case("HG-8.5/1-modes", needs=Feature.TRACE_RING | Feature.CONFIG, evidence=SELF_REPORTED)
def trace_ring_counts_latches_of_every_mode(board: BoardClient) -> None:
    """latches while trace_mode is another one have their numbers: the ring goes on behind them"""
    modes = [mode for feature, mode in ALL_MODES if board.has(feature)]
    board.hello()
    total = 0
    for mode in [*modes, *reversed(modes)]:
        board.configure(trace_mode=mode)
        board.arm()
        latch_now(board, board.flat_phases(total))
        index = latch_now(board, board.flat_phases(total + 1))
        total += 2
        reply = board.link.call(ReadTrace(0, 0xFFFF), TraceReply)
        check_equal(reply.next, total, f"{mode.name}: {total} latches, the next is {reply.next}")
        if mode is TraceMode.RING:
            last = [(record.number, record.key.index) for record in reply.records[-2:]]
            due = [(total - 2, index - 1), (total - 1, index)]
            check(last == due, f"the ring ends with (number, index) {last}, due is {due}")
