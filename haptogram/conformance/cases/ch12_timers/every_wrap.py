"""HG-3.6, HG-12.1: times and timers across 2^32 µs."""

from __future__ import annotations

from typing import Final

from haptogram_protocol.messages import (
    Feature,
    PlaybackEnded,
    PlayReply,
    TraceMode,
)

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.capabilities import TRACED_PLAYS
from ...client.latching import latches_received_from_board, read_back
from ...client.playback import play_request, send_phases_to_store
from ...client.stream_kinds import stream_kinds
from ...judge.timers import HOLD, judge_status_period, timer_kinds
from ...outcome import SELF_REPORTED, check, check_equal, named
from ..ch05_stream.every_drop import DROPS, judge_drop

_MS: Final = 1000
_WRAP_US: Final = 2**32
_SEQUENCE: Final = 4
_FRAMES: Final = 6


def _wait_before_timer_wrap(board: BoardClient, before_us: int) -> int:
    """Wait until so long before the next wrap of the device clock; return the time of the wrap.

    Meanwhile the board is DISARMED, and asked for its time every 30 minutes, so that the host's
    unwrapped time stays right.
    """
    now_us = board.clock.device_us()
    wrap_us = -(-(now_us + before_us + 1000) // _WRAP_US) * _WRAP_US
    while (left_us := wrap_us - before_us - board.clock.device_us()) > 0:
        board.wire.idle(min(left_us, _WRAP_US // 2 - 1_000_000))
    return wrap_us


@case(
    "HG-3.6/1-sides",
    needs_reset=True,
    before_wrap_us=3_000_000,
    evidence=SELF_REPORTED,
    depth=Depth.DEFAULT,
)
def frames_on_both_sides_of_the_timer_wrap(board: BoardClient) -> None:
    """frames are dropped by the same rules on both sides of 2^32 µs; a playback starts across it"""
    board.prepare()
    kind = stream_kinds(board)[0]
    for side in ("before", "after"):
        for drop in DROPS:
            with named(f"{side} 2^32 µs, frames {drop.summary}"):
                judge_drop(board, drop, kind)
        if side == "before" and board.has(TRACED_PLAYS):
            _play_across_timer_wrap(board)
        board.clock.wait_until(_WRAP_US + 100 * _MS)


def _play_across_timer_wrap(board: BoardClient) -> None:
    """Play frames whose start lies behind the wrap, then one from before it to behind it."""
    lead_us = board.clock.ready_us(100 * _MS + 2 * board.wire.limits.lead_us)
    for offset_us in (30 * _MS, -30 * _MS):
        send_phases_to_store(board, _SEQUENCE, frames=_FRAMES)
        board.configure(trace_mode=TraceMode.CRC)
        wrap_us = _wait_before_timer_wrap(board, lead_us)
        board.arm()
        since, start_us = board.link.mark(), board.clock.on_carrier(wrap_us + offset_us)
        play = play_request(board, _SEQUENCE, loops=1, period_us=10 * _MS, unattended_ms=2000)
        board.link.call(play, PlayReply, time_us=start_us)
        name = f"a playback from {offset_us:+d} µs of the wrap on"
        board.due_event(PlaybackEnded, since, 2 * lead_us + 200 * _MS, name)
        got = [latch.t_us for latch in latches_received_from_board(board, since, TraceMode.CRC)]
        due = [board.clock.on_carrier(start_us + 10 * _MS * k) for k in range(_FRAMES)]
        check(got == due, f"{name}: latched at {got}, due {due}")
        if not board.wire.is_virtual:
            return  # at a wall clock the next wrap is 71 minutes away
        board.disarm()


@case(
    "HG-12.1/1-wrap",
    needs=Feature.CONFIG,
    needs_reset=True,
    depth=Depth.DEFAULT,
    wall_depth=Depth.FULL,
)
def timers_cross_the_wrap(board: BoardClient) -> None:
    """STATUS, lease, hold, ramp and unattended time that run across 2^32 µs end at their times"""
    board.prepare()
    board.need(Feature.CONFIG)
    for timer in timer_kinds(board):
        board.configure(host_timeout_ms=10_000)
        wrap_us = _wait_before_timer_wrap(board, 100 * _MS)
        since = board.link.mark()
        start_us = timer.start(board, 200)
        if timer is HOLD and board.has(Feature.READ_LATCHED):
            told_us, shown_us = board.status().last_latch_us, read_back(board).reply.t_latch_us
            check_equal(shown_us, told_us, f"READ_DRIVE: latched at {shown_us}, STATUS disagrees")
        timer.judge(board, since, start_us, 200, f"{timer.name} across {wrap_us} µs")
        if not board.wire.is_virtual:
            return
    period_ms = board.quick_status_ms
    wrap_us = _wait_before_timer_wrap(board, 5 * period_ms * _MS // 2)
    board.configure(status_period_ms=period_ms)
    since = board.link.mark()
    board.wire.idle(6 * period_ms * _MS)
    judge_status_period(board, since, period_ms, 5, f"6 periods across {wrap_us} µs")
