"""HG-3.6, HG-12.1: times and timers across 2^32 µs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from haptogram_protocol.messages import (
    DriveKind,
    Feature,
    PlaybackEnded,
    PlayReply,
    TraceMode,
)
from haptogram_protocol.state import MuteReason

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.latching import latch_now, latches_received_from_board, read_back
from ...client.playback import play_now, play_request, send_phases_that_fit, send_phases_to_store
from ...client.stream_kinds import stream_kinds
from ...judge.timers import judge_mute_time, judge_status_period, judged_mute_by_timer
from ...outcome import SELF_REPORTED, CaseEndedError, check, check_equal
from ..ch05_stream.every_drop import DROPS, judge_drop

_MS: Final = 1000
_WRAP_US: Final = 2**32
_SEQUENCE: Final = 4
_FRAMES: Final = 6
_PLAYS: Final = Feature.CONFIG | Feature.TRACE | Feature.SEQUENCE_PHASES


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
            try:
                judge_drop(board, drop, kind)
            except CaseEndedError as error:
                text = f"{side} 2^32 µs, frames {drop.summary}: {error}"
                raise CaseEndedError(error.behaviour, text) from None
        if side == "before" and board.has(_PLAYS):
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


# --- Timers ------------------------------------------------------------------------------------


def _lease_across_wrap(board: BoardClient) -> tuple[MuteReason, int]:
    board.arm(host_timeout_ms=200)
    return MuteReason.HOST_SILENT, board.clock.device_us()


def _hold_across_wrap(board: BoardClient) -> tuple[MuteReason, int]:
    board.arm(hold_ms=200)
    latch_now(board)
    status = board.status()
    start_us = board.clock.unwrap(status.last_latch_us)
    if board.has(Feature.READ_LATCHED):
        shown = read_back(board, DriveKind.LATCHED).reply.t_latch_us
        check_equal(
            shown, status.last_latch_us, f"READ_DRIVE: latched at {shown}, STATUS disagrees"
        )
    return MuteReason.HOLD_EXPIRED, start_us


def _ramp_of_timer_across_wrap(board: BoardClient) -> tuple[MuteReason, int]:
    board.arm(hold_ms=20, ramp_ms=180)
    latch_now(board)
    return MuteReason.HOLD_EXPIRED, board.last_latch_us()


def _unattended_across_wrap(board: BoardClient) -> tuple[MuteReason, int]:
    send_phases_that_fit(board, _SEQUENCE, frames=2)
    board.arm(host_timeout_ms=20)
    play_now(board, _SEQUENCE, loops=0, unattended_ms=200)
    return MuteReason.UNATTENDED, board.clock.device_us()


_TIMERS: Final[tuple[tuple[Callable[[BoardClient], tuple[MuteReason, int]], Feature], ...]] = (
    (_lease_across_wrap, Feature(0)),
    (_hold_across_wrap, Feature(0)),
    (_ramp_of_timer_across_wrap, Feature.AMPLITUDE),
    (_unattended_across_wrap, Feature.SEQUENCE_PHASES),
)


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
    for start, needs in _TIMERS:
        if not board.has(needs):
            continue
        board.configure(host_timeout_ms=10_000)
        wrap_us = _wait_before_timer_wrap(board, 100 * _MS)
        since = board.link.mark()
        reason, start_us = start(board)
        header, _ = judged_mute_by_timer(board, since, 500 * _MS, reason)
        judge_mute_time(board, start_us, header, 200, f"{reason.name} across {wrap_us} µs")
        if not board.wire.is_virtual:
            return
    period_ms = board.quick_status_ms
    wrap_us = _wait_before_timer_wrap(board, 5 * period_ms * _MS // 2)
    board.configure(status_period_ms=period_ms)
    since = board.link.mark()
    board.wire.idle(6 * period_ms * _MS)
    judge_status_period(board, since, period_ms, 5, f"6 periods across {wrap_us} µs")
