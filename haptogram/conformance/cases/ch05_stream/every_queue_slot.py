"""HG-5.2, HG-5.7, HG-5.9: the queue at every format: slots, times ahead, late frames, IMMEDIATE."""

from __future__ import annotations

import zlib
from typing import Final

from haptogram_protocol.messages import Feature, Flag, Message, Mute, TraceMode

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.drive_paths import registers_asked_for
from ...client.latching import ask_for_board_latches, latch_now, latches_received_from_board
from ...client.stream_kinds import StreamKind, stream_kinds
from ...outcome import SELF_REPORTED, check, check_equal, require
from .every_drop import fill_queue

_WINDOW_US: Final = 100_000
_WAITING: Final = 3
_STEP_US: Final = 200
_BATCH_US: Final = 300_000  # of the line, for frames that are sent at once
_OVER_US: Final = 15_000  # beyond a power of two
_LOOK_US: Final = 20_000
_AHEAD_US: Final = 400_000


@case("HG-5.9/1-types", evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_format_is_streamed_at_once(board: BoardClient) -> None:
    """IMMEDIATE frames of every message and format flush the queue, whatever their time_us"""
    good = board.flat_phases()
    for kind in stream_kinds(board):
        board.hello()
        board.arm()
        t_us = board.clock.soon_us(bytes(4000), ahead_us=1_000_000)
        for number in range(_WAITING):
            board.link.stream(good, t_us + 1000 * number)
        for past_us in (0, 1, 2**30, -(2**30)):
            waiting = board.status().queued
            with board.counting(flushed=waiting, latched=1, late=0):
                board.link.stream(kind.make(), t_us - past_us, flags=Flag.IMMEDIATE)
                board.clock.wait_latched()
        check_equal(board.status().queued, 0, f"{kind.name}: frames wait behind IMMEDIATE")


@case("HG-5.9/1-full", evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_format_flushes_a_full_queue(board: BoardClient) -> None:
    """IMMEDIATE frames of every message and format flush a full queue, and are latched"""
    depth = board.depth_to_fill()
    board.arm()
    for kind in stream_kinds(board):
        fill_queue(board, depth)
        waiting = board.status().queued
        board.clock.end_exchange()
        check_equal(waiting, depth, f"{depth} frames wait, queued is {waiting}")
        with board.counting(flushed=depth, latched=1):
            index = latch_now(board, kind.make())
        found = board.status()
        told = (found.queued, found.last_seq)
        check(told == (0, index), f"{kind.name}: queued and last_seq {told}, due are {(0, index)}")


def _arrival_of_frame_us(board: BoardClient) -> int:
    """Return when PHASES that are sent now come, by the rate of the line."""
    size = len(board.link.stream_wire(board.flat_phases(), 0, seq=0))
    board.clock.device_us()
    return board.clock.device_estimate_us() + board.wire.period_us(size)


# --- Slots and times ---------------------------------------------------------------------------


def _queued_codes_in_turn(kinds: list[StreamKind]) -> list[StreamKind]:
    """Return every kind of codes, each behind the one that sets amplitudes."""
    graded = [kind for kind in kinds if kind.name == "DRIVES"]
    full = [kind for kind in kinds if kind.name.startswith("PHASES")]
    return [kind for each in full for kind in (*graded, each)]


@case("HG-5.2/6-slots", needs=Feature.CONFIG, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_queue_slot_is_written_whole(board: BoardClient) -> None:
    """through every slot of the queue DRIVES, then PHASES of every format: each as it was sent"""
    depth = board.depth_to_fill()
    mode = ask_for_board_latches(board)
    room = board.identity.trace_ring if mode is TraceMode.RING else depth
    board.arm()
    for kind in _queued_codes_in_turn(stream_kinds(board)):
        sent: dict[int, int] = {}
        seen: dict[int, int] = {}
        while len(sent) < depth:
            since = board.link.mark()
            _queue_some_stream_frames(board, kind, min(room, depth - len(sent)), sent)
            latches = latches_received_from_board(board, since, mode)
            seen |= {latch.index: latch.crc for latch in latches}
        lost = sent.keys() - seen.keys()
        check(not lost, f"{kind.name}: {len(lost)} of {len(sent)} queued frames are not latched")
        wrong = sum(seen[index] != crc for index, crc in sent.items())
        check_equal(wrong, 0, f"{kind.name}: {wrong} of {len(sent)} drives are not those sent")


def _queue_some_stream_frames(
    board: BoardClient, kind: StreamKind, most: int, sent: dict[int, int]
) -> None:
    """Queue up to *most* frames, wait until they are latched; add the CRC of each by its number."""
    messages: list[Message] = []
    for _ in range(most):
        messages.append(kind.make())
        if not board.wire.carries(len(messages) * len(messages[0].serialize()), _BATCH_US):
            break
    room = bytes(sum(len(message.serialize()) + 20 for message in messages))
    start_us, step_us = board.clock.soon_us(room), board.clock.on_carrier(_STEP_US)
    wires = []
    within = (board.clock.device_us() + board.identity.max_horizon_us - start_us) // step_us
    messages = messages[: max(1, within)]
    for place, message in enumerate(messages):
        registers = registers_asked_for(board, message)
        assert registers is not None  # codes
        sent[board.link.stream_next] = zlib.crc32(b"".join(registers))
        wires.append(board.link.stream_wire(message, start_us + place * step_us))
    board.link.send(*wires)
    board.clock.wait_until(start_us + len(messages) * step_us)


@case("HG-5.7/4-border", evidence=SELF_REPORTED)
def the_horizon_of_the_queue_is_sharp(board: BoardClient) -> None:
    """frames at the very border of the horizon wait or are dropped, by their margin"""
    horizon_us = board.identity.max_horizon_us
    is_beyond = board.clock.beyond_us(4) is not None
    require(is_beyond, f"a t_apply beyond the horizon of {horizon_us} µs has passed")
    is_within = board.clock.can_be_in_time()
    require(is_within, f"no frame for within the horizon of {horizon_us} µs is ready in time")
    for off_us in range(-3, 4):
        board.arm()
        before = board.status().counters
        t_us = _arrival_of_frame_us(board) + horizon_us + off_us
        board.link.stream(board.flat_phases(), t_us)
        found = board.status()
        dropped = (found.counters.dropped_future - before.dropped_future) & 0xFFFFFFFF
        ahead_us = board.clock.ready_us(found.margin_min_us)  # the margin is of the ready frame
        within = ahead_us <= horizon_us
        due = (int(within), int(not within))
        check_equal(
            (found.queued, dropped),
            due,
            f"a frame {ahead_us} µs ahead, the horizon is {horizon_us} µs: queued "
            f"{found.queued}, dropped {dropped}",
        )
        board.link.ask(Mute())


@case("HG-5.7/4-lengths", evidence=SELF_REPORTED)
def far_frames_wait_in_the_queue(board: BoardClient) -> None:
    """frames due just above every power of two of microseconds wait, up to the horizon"""
    board.arm()
    most_us = board.identity.max_horizon_us - _AHEAD_US
    lengths = [(1 << bits) + _OVER_US for bits in range(16, 31)]
    least_us = board.clock.ready_us(_LOOK_US)
    ahead_us = [us for us in lengths if least_us < us < most_us][: board.identity.queue_depth]
    text = f"max_horizon_us is {board.identity.max_horizon_us}: no wait of 2^16 µs fits"
    require(bool(ahead_us), text)
    size = len(board.link.stream_wire(board.flat_phases(), 0, seq=0))
    now_us = board.clock.device_us() + board.wire.period_us(len(ahead_us) * size)
    with board.counting(latched=0, flushed=len(ahead_us)):
        board.link.send(
            *(board.link.stream_wire(board.flat_phases(), now_us + us) for us in ahead_us)
        )
        board.wire.idle(_LOOK_US)
        queued = board.status().queued
        board.clock.require_before(now_us + ahead_us[0], "a look at frames that wait")
        check_equal(queued, len(ahead_us), f"{len(ahead_us)} frames wait, queued is {queued}")
        board.link.ask(Mute())
