"""HG-7.6: loops, periods, starts and frames of every width, up to 32 bits and beyond."""

from __future__ import annotations

from typing import Final

from haptogram_protocol.messages import (
    ErrorCode,
    Feature,
    PlaybackEnded,
    PlayReply,
    Stop,
    StopReply,
)

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.capabilities import PLAYS
from ...client.playback import (
    PERIOD_US,
    play_now,
    play_request,
    require_time_to_play,
    send_phases_to_store,
    shortest_period_to_play_us,
)
from ...outcome import SELF_REPORTED, check, check_equal, fail, require

_MS: Final = 1000
_SEQUENCE: Final = 0x8001
_WIDTHS: Final = (8, 15, 16, 24, 31, 32)
_SEEN: Final = 12  # latches after which a playback of very many frames is stopped
_LOOK_MS: Final = 60
_SLOW_US: Final = 9_500_000


def _playback_period_us(board: BoardClient) -> int:
    return shortest_period_to_play_us(board, PERIOD_US)


def _playback_loop_numbers(frames: int) -> list[int]:
    """Return numbers of loops at which loops, or all frames, are just over 2^b.

    Examples
    --------
    >>> _playback_loop_numbers(1)[:2]
    [256, 257]
    """
    numbers = {0xFFFFFFFF}
    for width in _WIDTHS:
        numbers |= {1 << width, (1 << width) + 1, -(-(1 << width) // frames)}
    return sorted(number for number in numbers if number * frames > _SEEN and number < 1 << 32)


@case("HG-7.6/4-loops", needs=Feature.SEQUENCE_PHASES, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def many_playback_loops_go_on(board: BoardClient) -> None:
    """loops of every width of 1, 2 and 3 frames do not end after the first few frames"""
    period_us = _playback_period_us(board)
    require_time_to_play(board, (_SEEN + 1) * period_us)
    for frames in (1, 2, 3):
        send_phases_to_store(board, _SEQUENCE, frames=frames)
        for loops in _playback_loop_numbers(frames):
            board.arm()
            since, before = board.link.mark(), board.status().counters
            play_now(board, _SEQUENCE, loops=loops, period_us=period_us)
            board.wire.idle(_SEEN * period_us)
            name = f"{loops} loops of {frames} frames"
            if board.link.events(PlaybackEnded, since):
                event = board.link.events(PlaybackEnded, since)[0][1]
                fail(f"{name} end after {event.frames} frames")
            board.link.call(Stop(), StopReply)
            latched = board.counted_since(before)["latched"]
            check(latched >= _SEEN - 1, f"{name}: {latched} latches in {_SEEN} periods")


def _playback_periods_us() -> list[int]:
    """Return periods just over 2^b us, ms and tenths of ms, up to 32 bits, of 200 ms and more."""
    edges = {unit << width for unit in (1, 100, 1000) for width in _WIDTHS} | {0xFFFFFFF0}
    return sorted(edge + 10 * _MS for edge in edges if 200 * _MS <= edge < (1 << 32) - 10 * _MS)


@case("HG-7.6/4-periods", needs=PLAYS, evidence=SELF_REPORTED)
def long_playback_periods_are_long(board: BoardClient) -> None:
    """periods of every width up to 2^32 µs: no second frame comes soon after the first"""
    send_phases_to_store(board, _SEQUENCE, frames=3)
    board.configure(hold_ms=10_000)
    periods = _playback_periods_us()
    for period_us in periods if board.thorough else periods[-2:]:
        board.arm()
        with board.counting(latched=1):
            since, start_us = board.link.mark(), board.wire.now_us()
            play_now(board, _SEQUENCE, loops=1, period_us=period_us)
            board.wire.idle(_LOOK_MS * _MS)
            if board.link.events(PlaybackEnded, since):
                fail(f"a period of {period_us} µs: all 3 frames within {_LOOK_MS} ms")
            board.link.call(Stop(), StopReply)
            board.wire.check_not_after(start_us + period_us, "STOP within a period")


@case(
    "HG-7.6/4-long", needs=PLAYS, evidence=SELF_REPORTED, depth=Depth.DEFAULT, wall_depth=Depth.FULL
)
def long_playbacks_stay_in_time(board: BoardClient) -> None:
    """one playback of more than 2^32 µs: each frame at its time, past 2^31 and 2^32 µs too"""
    frames = 4  # 38 s at a wall clock
    if board.wire.is_virtual:
        frames += (1 << 32) // _SLOW_US
    send_phases_to_store(board, _SEQUENCE, frames=2)
    board.configure(hold_ms=10_000)
    alone_ms = min(60_000, board.identity.max_unattended_ms)
    text = f"frames are {_SLOW_US} µs apart; max_unattended_ms is {alone_ms}"
    require(alone_ms * _MS >= 2 * _SLOW_US, text)
    since = board.arm()
    start_us = board.clock.ahead_us(board.clock.ready_us(20 * _MS))
    play = play_request(board, _SEQUENCE, loops=0, period_us=_SLOW_US, unattended_ms=alone_ms)
    board.link.call(play, PlayReply, time_us=start_us)
    for number in range(frames):
        due_us = board.clock.on_carrier(start_us + number * _SLOW_US)
        board.clock.wait_until(due_us + _MS)
        if board.link.events(PlaybackEnded, since):
            fail(f"the playback ended before frame {number}")
        status = board.status()
        got_us = board.clock.unwrap(status.last_latch_us)
        on_s = number * _SLOW_US / 1e6
        text = f"frame {number}, {on_s:.1f} s after the start: latched at {got_us} µs, due {due_us}"
        check(got_us == due_us, text)
    board.link.call(Stop(), StopReply)
    found = board.link.await_event(PlaybackEnded, since, 100 * _MS)
    told = None if found is None else (found[1].loops, found[1].frames)
    check_equal(told, (frames // 2, frames), f"{frames} frames: PLAYBACK_ENDED says {told}")


@case(
    "HG-7.6/2-starts",
    needs=PLAYS,
    evidence=SELF_REPORTED,
    depth=Depth.DEFAULT,
    wall_depth=Depth.FULL,
)
def every_playback_start_is_kept(board: BoardClient) -> None:
    """starts up to the horizon ahead are taken; the first frame is latched then and not before"""
    send_phases_to_store(board, _SEQUENCE, frames=1)
    horizon_us = board.identity.max_horizon_us
    aheads = {70 * _MS, 600 * _MS, horizon_us - 200 * _MS}
    aheads |= {(1 << width) + 50 * _MS for width in (15, 16, 20, 23, 24, 31)}
    alone_ms = min(60_000, board.identity.max_unattended_ms)
    most_us = min(horizon_us, alone_ms * _MS)
    least_us = board.clock.ready_us(20 * _MS)  # a start before that is refused
    for ahead_us in sorted(ahead for ahead in aheads if least_us < ahead < most_us):
        board.disarm()  # no hold runs
        board.arm()
        start_us = board.clock.on_carrier(board.clock.device_us() + ahead_us)
        before = board.status().counters
        play = play_request(
            board, _SEQUENCE, loops=1, period_us=_playback_period_us(board), unattended_ms=alone_ms
        )
        board.link.call(play, PlayReply, time_us=start_us)
        board.clock.wait_before(start_us - 30 * _MS)
        early = board.counted_since(before)["latched"]
        in_time = board.clock.device_us() < start_us
        board.clock.wait_until(start_us + _MS)
        got_us = board.last_latch_us()
        check(not (early and in_time), f"a start {ahead_us} µs ahead: latched before it")
        check_equal(
            got_us, start_us, f"a start {ahead_us} µs ahead: latched at {got_us - start_us:+d} µs"
        )


@case("HG-7.6/2-late", needs=PLAYS)
def passed_playback_starts_are_refused(board: BoardClient) -> None:
    """starts that have passed are refused with detail 0, whatever late_window_us is"""
    send_phases_to_store(board, _SEQUENCE, frames=1)
    for window_us in (0, 20_000, 100_000):
        board.arm(late_window_us=window_us)
        for late_us in (1, 1000, 15_000, 70_000, 1_000_000):
            start_us = board.clock.device_us() - late_us
            play = play_request(
                board, _SEQUENCE, loops=1, period_us=_playback_period_us(board), unattended_ms=100
            )
            board.link.refused(play, ErrorCode.BAD_VALUE, 0, time_us=start_us)
