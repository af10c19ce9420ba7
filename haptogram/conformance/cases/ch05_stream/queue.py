"""HG-5.5, HG-5.6, HG-5.7: numbers of stream frames, which are queued, and which are dropped."""

from __future__ import annotations

from typing import Final

from haptogram_protocol.messages import Feature, Phases

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.latching import (
    latch_now,
)
from ...outcome import SELF_REPORTED, check, check_equal, require
from .every_drop import judge_first_drop
from .every_replaced_frame import flush_queue, queue_flushes

_MAX_LATE_US: Final = 100_000  # HG-7.1


@case("HG-5.5/1", evidence=SELF_REPORTED)
def drops_duplicates_of_the_stream(board: BoardClient) -> None:
    """frames 1 to 32 before the expected one are counted in duplicate and not latched"""
    board.arm()
    for _ in range(20):
        latch_now(board)
    behind = (1, 2, 3, 15, 16, 17, 31, 32)
    with board.counting(duplicate=len(behind), latched=1):
        for back in behind:
            board.link.stream(board.flat_phases(), seq=board.link.stream_next - back)
        board.clock.wait_latched(0)
        latch_now(board)


@case("HG-5.5/2", evidence=SELF_REPORTED)
def counts_stream_gaps(board: BoardClient) -> None:
    """frames ahead by 1 to 65 503, as behind a cut of the line, add to gap and are latched at
    once
    """
    board.arm()
    for ahead in (1, 15, 16, 255, 256, 300, 32_767, 32_768, 40_000, 65_503):
        board.link.stream_next += ahead
        with board.counting(gap=ahead, latched=1):
            latch_now(board)


@case("HG-5.6/1", evidence=SELF_REPORTED)
def stream_numbers_are_used_up(board: BoardClient) -> None:
    """frames dropped for type, flags, length, state and time use up their numbers"""
    good = board.flat_phases()
    board.link.stream(good)  # not armed: dropped_state
    board.arm()
    past_us = board.clock.device_us() - 1_000_000
    beyond_us = board.clock.beyond_us(10_000_000)
    dropped = {
        "unknown_type": board.link.stream_raw(0x3B, b""),
        "unsupported": board.link.stream_wire(good, flags=0x40),
        "bad_length": board.link.stream_raw(Phases.TYPE, good.serialize() + b"\x00"),
        "dropped_late": board.link.stream_wire(good, past_us),
    }
    if beyond_us is not None:
        at_us = board.clock.device_us() + beyond_us
        dropped["dropped_future"] = board.link.stream_wire(good, at_us)
    with board.counting(latched=1, **dict.fromkeys(dropped, 1)):
        board.link.send(*dropped.values())
        latch_now(board, good)
    used = range(board.link.stream_next - 1 - len(dropped), board.link.stream_next)
    with board.counting(duplicate=len(used)):
        for seq in used:
            board.link.stream(good, seq=seq)


# --- The queue ------------------------------------------------------------------------------------


@case("HG-5.7/1", evidence=SELF_REPORTED)
def drops_stream_frames_unless_armed(board: BoardClient) -> None:
    """frames while DISARMED and MUTED are counted in dropped_state"""
    t_us = board.clock.soon_us(bytes(2000))
    with board.counting(dropped_state=2, latched=0):
        board.link.stream(board.flat_phases())
        board.link.stream(board.flat_phases(), t_us)
        board.clock.wait_until(t_us)
    board.arm()
    board.link.ask_raw(0x42)
    with board.counting(dropped_state=1, latched=0):
        latch_now(board)


@case("HG-5.7/2", evidence=SELF_REPORTED)
def queue_keeps_its_order(board: BoardClient) -> None:
    """frames not after the last queued one are counted in dropped_order"""
    board.arm()
    t_us = board.clock.soon_us(board.bytes_of_frames(5), ahead_us=20_000)
    good = board.flat_phases()
    with board.counting(dropped_order=3, latched=2):
        board.link.stream(good, t_us)
        for early_us in (0, 1, 10_000):
            board.link.stream(good, t_us - early_us)
        board.link.stream(good, t_us + 1000)
        board.clock.wait_until(t_us + 2000)


@case("HG-5.7/2-empty", needs=Feature.CONFIG, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def an_empty_queue_has_no_order(board: BoardClient) -> None:
    """behind a frame that is latched or flushed the queue is empty: no earlier time is out of
    order
    """
    is_soon = board.clock.ready_us(0) <= _MAX_LATE_US // 2
    require(is_soon, "a frame for a time before the last latch is ready behind the late window")
    board.configure(late_window_us=_MAX_LATE_US)
    flushes = queue_flushes(board)
    for name in ("a latch", *flushes):
        board.arm()
        t_us = board.clock.soon_us(bytes(4000), ahead_us=10_000)
        board.link.stream(board.flat_phases(), t_us)
        if name in flushes:
            flush_queue(board, flushes[name], name)
        else:
            board.clock.wait_until(t_us + board.clock.carrier_us)
        earlier_us = min(t_us - 50, board.late_time_us(50))
        before = board.status().counters
        board.link.stream(board.flat_phases(), earlier_us)
        last_us = earlier_us + _MAX_LATE_US - board.clock.ready_us(0)
        board.clock.require_before(last_us, "a late frame", board.clock.device_us())
        board.clock.wait_latched()
        text = f"a frame, {name}, and one for an earlier time"
        due = {"late": 1, "latched": 1, "dropped_order": 0, "dropped_late": 0}
        board.check_counted(before, text, due)


@case("HG-5.7/3", evidence=SELF_REPORTED)
def queue_holds_its_depth(board: BoardClient) -> None:
    """queue_depth frames are queued and latched; one more is dropped_full"""
    depth = board.depth_to_fill()
    board.arm()
    good = board.shortest_stream()
    times = board.times_in_queue(depth + 1)
    with board.counting(dropped_full=1, latched=depth):
        for t_us in times:
            board.link.stream(good, t_us)
        queued = board.status().queued
        board.clock.wait_until(times[-1])
        check_equal(queued, depth, f"{depth} frames wait, queued is {queued}")


@case("HG-5.7/4", evidence=SELF_REPORTED)
def queue_has_its_horizon(board: BoardClient) -> None:
    """a frame beyond max_horizon_us is dropped_future, one 1% nearer is queued"""
    board.arm()
    horizon_us = board.identity.max_horizon_us
    size = len(board.link.stream_wire(board.flat_phases(), 0, seq=0))
    now_us = board.clock.device_us()
    sent_us = board.wire.period_us(10 * size) + 20_000 + 2 * board.wire.limits.lead_us
    ahead_us = (horizon_us + sent_us, 2 * horizon_us, 2**31 - 1)
    beyond_us = [us for us in ahead_us if horizon_us < us < 2**31]  # later ones have passed
    can_wait = board.clock.can_be_in_time()
    with board.counting(dropped_future=len(beyond_us), flushed=int(can_wait)):
        for us in beyond_us:
            board.link.stream(board.flat_phases(), now_us + us)
        if can_wait:
            near_us = now_us + horizon_us - horizon_us // 100
            board.link.stream(board.flat_phases(), near_us)
        board.link.barrier()
        board.disarm()


@case("HG-5.7/5", evidence=SELF_REPORTED)
def drops_late_stream_frames(board: BoardClient) -> None:
    """frames 1 µs to 1 s later than late_window_us are dropped_late, none is latched"""
    judge_first_drop(board, "HG-5.7/5")


@case("HG-5.7/7")
def queue_horizon_is_below_half_the_clock(board: BoardClient) -> None:
    """max_horizon_us is less than 2^31"""
    horizon_us = board.identity.max_horizon_us
    check(0 < horizon_us < 2**31, f"max_horizon_us is {horizon_us}")
