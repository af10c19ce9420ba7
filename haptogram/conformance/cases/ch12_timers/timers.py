"""HG-12.1, HG-12.2, HG-12.3, HG-12.4, HG-12.5, HG-12.6: timers of board and host."""

from __future__ import annotations

from typing import Final

from haptogram_protocol.messages import (
    Disarm,
    Feature,
    Mute,
    PlaybackEnded,
    StateChanged,
)

from ...case import Depth, case, case_about_host
from ...client.board_client import BoardClient
from ...client.capabilities import PLAYS
from ...client.latching import latch_now, latch_timed
from ...client.playback import play_now, send_phases_that_fit
from ...client.stream_kinds import valid_requests_to_send
from ...client.uploads import SEQUENCES
from ...judge.timers import HOLD, LEASE, judge_status_period, judged_mute_by_timer
from ...outcome import check

_MS: Final = 1000
_STALE_MS: Final = 150
_RAMP_MS: Final = 100


host_times = case_about_host("HG-12.6/1")


host_gives_up = case_about_host("HG-12.6/2")


@case("HG-12.1/1", needs=Feature.CONFIG, depth=Depth.DEFAULT)
def timers_are_exact(board: BoardClient) -> None:
    """hold and STATUS come within 1 ms of their time"""
    for hold_ms in (50, 137):
        since = board.arm(hold_ms=hold_ms)
        start_us = latch_timed(board)
        HOLD.judge(board, since, start_us, hold_ms)
    period_ms = board.quick_status_ms + 10
    board.configure(status_period_ms=period_ms)
    since = board.link.mark()
    board.wire.idle_beyond(6 * period_ms * _MS)
    judge_status_period(board, since, period_ms, 5, "6 periods")


@case("HG-12.2/1", needs=Feature.CONFIG)
def lease_runs_out(board: BoardClient) -> None:
    """without a frame the board is muted host_timeout_ms later"""
    for timeout_ms in map(board.clock.timer_ms, (80, 200)):
        board.arm(host_timeout_ms=timeout_ms)
        latch_now(board)
        start_us, since = board.clock.device_us(), board.link.mark()
        LEASE.judge(board, since, start_us, timeout_ms)


@case("HG-12.2/2", needs=Feature.CONFIG)
def hold_timer_waits_for_a_latch(board: BoardClient) -> None:
    """between ARM and the first latch the hold does not run, the lease does"""
    board.arm(hold_ms=30, host_timeout_ms=250)
    start_us, since = board.clock.device_us(), board.link.mark()
    LEASE.judge(board, since, start_us, 250)


@case("HG-12.2/2-ended", needs=Feature.CONFIG, depth=Depth.DEFAULT)
def hold_timer_is_not_taken_up_again(board: BoardClient) -> None:
    """behind each end of a held drive, ARM and every other request start no hold"""
    for end in (Mute(), Disarm(), None):
        board.arm(hold_ms=_STALE_MS)
        latch_now(board)
        board.link.ask(end) if end else board.hello()
        since, name = board.arm(), end.TYPE.name if end else "HELLO"
        for message in valid_requests_to_send(board, SEQUENCES[0]):
            if message.TYPE.name not in ("DISARM", "PLAY"):
                board.link.ask(message)
        board.wire.idle((_STALE_MS + 50) * _MS)
        told = [event.reason.name for _, event in board.link.events(StateChanged, since)]
        text = f"muted by {', '.join(told)} behind {name} and ARM, before any latch"
        check(not told, f"{text}: a hold runs that no latch began")


@case("HG-12.3/1", needs=Feature.CONFIG)
def hold_timer_runs_from_the_last_latch(board: BoardClient) -> None:
    """the hold runs from the last of several latches"""
    since = board.arm(hold_ms=150)
    for _ in range(4):
        latch_now(board)
        board.wire.idle(60 * _MS)
    start_us = board.last_latch_us()
    HOLD.judge(board, since, start_us, 150, "hold_ms = 150 after the last latch")


@case("HG-12.4/1", needs=PLAYS, depth=Depth.DEFAULT)
def lease_is_back_after_playback(board: BoardClient) -> None:
    """from the end of a playback on the lease is host_timeout_ms again"""
    board.configure(host_timeout_ms=150, hold_ms=5000)
    send_phases_that_fit(board, 1, frames=2)
    since = board.arm()
    play_now(board, 1, loops=150, period_us=1000, unattended_ms=5000)
    name = "a playback of 300 ms, longer than host_timeout_ms"
    ended, _ = board.due_event(PlaybackEnded, since, 600 * _MS, name)
    LEASE.judge(board, since, board.clock.unwrap(ended.time_us), 150, "after the playback")


@case("HG-12.5/1", needs=Feature.CONFIG, depth=Depth.DEFAULT)
def the_first_timer_wins(board: BoardClient) -> None:
    """the timer that runs out first mutes, in both orders"""
    for timer, hold_ms, lease_ms in ((HOLD, 60, 120), (LEASE, 160, 80)):
        hold_ms, lease_ms = map(board.clock.timer_ms, (hold_ms, lease_ms))
        since = board.arm(hold_ms=hold_ms, host_timeout_ms=lease_ms, ramp_ms=_RAMP_MS)
        with board.counting(timeouts=1):
            latch_now(board)
            start_us = board.clock.device_us()
            header, _ = judged_mute_by_timer(board, since, 600 * _MS, timer.reason)
        took_ms = (board.clock.unwrap(header.time_us) - start_us) / _MS
        most = min(hold_ms, lease_ms) + _RAMP_MS * board.has(Feature.AMPLITUDE) + 1
        check(took_ms <= most, f"muted after {took_ms:.1f} ms, {most} ms is the most")
