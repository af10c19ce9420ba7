"""HG-3.6, HG-7.6, HG-7.7, HG-7.8: playback: loops, periods, starts, and every end of it."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable
from typing import Final, TypeAlias

from haptogram_protocol import messages as m
from haptogram_protocol.state import MuteReason, OutputState

from ...case import Depth, case
from ...client import latching, playback, uploads
from ...client.board_client import BoardClient
from ...client.capabilities import PLAYS
from ...client.stream_kinds import random_points_to_send
from ...judge.refused_requests import STORED
from ...judge.timers import UNATTENDED, judged_mute_by_timer
from ...outcome import SELF_REPORTED, check, check_equal, check_fields, fail, require
from ..ch05_stream.every_drop import OUTPUT_STATES, PLAYING_SLOWLY, WAITS

_MS: Final = 1000
_NEEDS: Final = m.Feature.SEQUENCE_PHASES
_SEQUENCE: Final = 0x8001
_WIDTHS: Final = (8, 15, 16, 24, 31, 32)
_SEEN: Final = 12  # latches after which a playback of very many frames is stopped
_LOOK_MS: Final = 60
_SLOW_US: Final = 9_500_000
_FRAMES: Final = 3
_AHEAD_US: Final = 3_000_000
_ALONE_MS: Final = 120
_SHORT_LEASE_MS: Final = 60
PlaybackAct: TypeAlias = Callable[[BoardClient], object]
#: What ends a playback, but for its last frame and the timers.
ENDS_OF_PLAYBACK: Final[dict[str, PlaybackAct]] = {
    "STOP": BoardClient.stop,
    "MUTE": BoardClient.mute,
    "MUTE without a session": lambda board: board.mute(session=0),
    "DISARM": lambda board: board.link.ask(m.Disarm()),
    "a new session": BoardClient.hello,
}


@case("HG-7.6/1", needs=_NEEDS)
def refuses_playback_in_wrong_state(board: BoardClient) -> None:
    """PLAY during a playback is refused with BAD_STATE, of no stored sequence and 0 with
    NOT_FOUND
    """
    playback.send_phases_that_fit(board, 1, frames=2)
    play = playback.play_request(board, 1, loops=1)
    board.link.refused(play, m.ErrorCode.BAD_STATE, 0, flags=0x10)
    board.arm()
    for absent in (0, 0xFFF7):  # 0: how a board may mark a free place
        unknown = playback.play_request(board, absent, loops=1)
        board.link.refused(unknown, m.ErrorCode.NOT_FOUND, flags=0x10)
    playback.play_now(board, 1, loops=0)
    board.link.refused(play, m.ErrorCode.BAD_STATE, 1, flags=0x10)


@case("HG-7.6/2", needs=_NEEDS)
def checks_the_times_of_playback(board: BoardClient) -> None:
    """periods, unattended times and starts out of bounds are refused with BAD_VALUE"""
    playback.send_phases_that_fit(board, 1, frames=2)
    board.arm()
    identity = board.identity
    least_us = playback.least_period_us(board)
    bad = m.ErrorCode.BAD_VALUE
    play = playback.play_request(board, 1, loops=1, unattended_ms=100)
    period, alone = m.Play.WIRE["period_us"].offset, m.Play.WIRE["unattended_ms"].offset
    if least_us > 1:
        board.link.refused(m.Play(1, least_us - 1, 1, 100), bad, period, flags=0x10)
    for alone_ms in {0, min(identity.max_unattended_ms + 1, 2**32)} - {2**32}:
        wrong = dataclasses.replace(play, unattended_ms=alone_ms)
        board.link.refused(wrong, bad, alone, flags=0x10)
    board.link.refused(play, bad, 0, time_us=board.clock.device_us() - 1000)
    beyond_us = board.clock.beyond_us(1_000_000)
    if beyond_us is not None:
        board.link.refused(play, bad, 0, time_us=board.clock.device_us() + beyond_us)
    since = board.link.mark()
    playback.play_now(board, 1, loops=1, period_us=least_us)
    board.due_event(m.PlaybackEnded, since, 2 * least_us + 50 * _MS)


@case("HG-7.6/2-ready", needs=m.Feature.SEQUENCE_POINTS)
def playback_leaves_time_to_compute(board: BoardClient) -> None:
    """a start before the first frame is ready, and a period too short for its points, are
    refused
    """
    points = board.most_points
    frame = random_points_to_send(board, points).serialize()
    uploads.upload_to_board(board, m.UploadKind.POINTS, 1, 2 * frame, points)
    board.arm()
    bad, period = m.ErrorCode.BAD_VALUE, m.Play.WIRE["period_us"].offset
    usual_us = playback.period_to_play(board, points)
    soon_us = board.clock.ready_us(board.clock.device_us(), points) - 1
    board.link.refused(m.Play(1, usual_us, 1, 1000), bad, 0, time_us=soon_us)
    least_us = points * board.identity.point_time_us
    if least_us * board.identity.max_playback_rate_hz > 1_000_000:
        board.link.refused(m.Play(1, least_us - 1, 1, 1000), bad, period, flags=0x10)
    since = board.link.mark()
    playback.play_at(board, 1, board.clock.soon_us(bytes(100)), loops=1, period_us=usual_us)
    board.due_event(m.PlaybackEnded, since, 2 * usual_us + board.clock.lead_us + 50 * _MS)


@case("HG-7.6/3", needs=_NEEDS, evidence=SELF_REPORTED)
def playback_flushes_the_queue(board: BoardClient) -> None:
    """PLAY, at once and for a time behind them, flushes 3 queued frames"""
    playback.send_phases_to_store(board, 1, frames=2)
    for plays_later in (False, True):
        board.arm_anew()
        t_us = board.clock.soon_us(bytes(2000), ahead_us=10_000)
        with board.counting(flushed=3, latched=2):
            for number in range(3):
                board.link.stream(board.flat_phases(), t_us + 1000 * number)
            board.clock.end_exchange()
            if plays_later:
                playback.play_at(board, 1, t_us + 4000, loops=1)
            else:
                playback.play_now(board, 1, loops=1)
            board.clock.wait_until(t_us + 4000)
            playback.let_play(board, 5)


@case("HG-7.6/4", needs=_NEEDS | m.Feature.CONFIG, evidence=SELF_REPORTED)
def plays_the_sequence_in_time(board: BoardClient) -> None:
    """60 frames whose times lie between carrier periods are each latched on the next one"""
    mode = latching.ask_for_board_latches(board)
    playback.send_phases_to_store(board, 1, frames=3)
    least_us = playback.shortest_period_to_play_us(board)
    room = board.identity.trace_ring if mode is m.TraceMode.RING else 60
    period_us = max(1003, least_us)
    loops = max(1, min(20, room // 3, playback.most_periods_to_play(board, period_us) // 3))
    judge_playback(board, mode, 1, 3, loops, period_us)


def judge_playback(
    board: BoardClient,
    mode: m.TraceMode,
    sequence: int,
    frames: int,
    loops: int,
    period_us: int,
    start_us: int | None = None,
) -> None:
    """FAILED unless each frame of a playback is latched once, in time, and the end is told.

    It begins at *start_us*; None: soon, between two carrier periods.
    """
    since, total = board.arm(), frames * loops
    if start_us is None:
        start_us = board.clock.soon_us(bytes(100), ahead_us=5003)
    playback.play_at(board, sequence, start_us, loops=loops, period_us=period_us)
    board.clock.idle_until(start_us)
    event = playback.await_playback_end(board, since, total * period_us)
    due = [
        (sequence, n // frames, n % frames, board.clock.on_carrier(start_us + n * period_us))
        for n in range(total)
    ]
    seen = latching.latches_received_from_board(board, since, mode)
    got = [(latch.sequence, latch.loop, latch.index, latch.t_us) for latch in seen]
    check_equal(got, due, f"(sequence, loop, index, time) of {total} latches")
    check_fields(event, "PLAYBACK_ENDED", sequence=sequence, loops=loops, frames=total)


@case("HG-7.6/5", needs=_NEEDS | m.Feature.CONFIG)
def playback_may_be_left_alone(board: BoardClient) -> None:
    """a playback outlives host_timeout_ms, and is muted after unattended_ms: UNATTENDED"""
    alone_ms = min(120, board.identity.max_unattended_ms)
    require(alone_ms > 100, "max_unattended_ms is too short to tell it from host_timeout_ms")
    UNATTENDED.judge_whole(board, alone_ms, host_timeout_ms=60)


@case("HG-7.6/6", needs=_NEEDS, depth=Depth.DEFAULT)
def playback_loops_until_it_is_ended(board: BoardClient) -> None:
    """with loops = 0 a sequence plays until STOP, DISARM, MUTE or a new session ends it"""
    for name, end in ENDS_OF_PLAYBACK.items():
        frames = judge_ended_playback(board, end, name, 50).frames
        check(frames >= 40, f"{frames} frames were latched in 50 periods")


@case("HG-7.7/1", needs=_NEEDS)
def stop_ends_the_playback(board: BoardClient) -> None:
    """STOP ends a playback; the board stays ARMED and holds the drive"""
    judge_ended_playback(board, _stop_and_stay_armed, "STOP")


def _stop_and_stay_armed(board: BoardClient) -> None:
    """Send STOP; FAILED unless the board stays ARMED."""
    reply = board.link.call(m.Stop(), m.StopReply)
    check_fields(reply, "STOP_REPLY", state=OutputState.ARMED)
    board.check_status("STOP", state=OutputState.ARMED)


def judge_ended_playback(
    board: BoardClient, end: PlaybackAct, name: str, periods: int = 5
) -> m.PlaybackEnded:
    """FAILED unless *end*, after so many periods, ends a playback, which is told; return that."""
    frames = playback.phases_that_fit(board, _FRAMES)
    playback.send_phases_to_store(board, 1, frames=frames)
    since = board.arm()
    playback.play_now(board, 1, loops=0)
    playback.let_play(board, periods)
    check(not board.link.events(m.PlaybackEnded, since), "it ended by itself")
    end(board)
    _, event = board.due_event(m.PlaybackEnded, since, 20 * _MS, f"{name} in a playback")
    judge_end_told(board, since, 1, frames, event.frames, name)
    board.arm()
    with board.counting(latched=0):
        playback.wait_for_no_latch(board, 10 * _MS)
    return event


@case("HG-7.7/2")
def stop_without_playback(board: BoardClient) -> None:
    """STOP without a playback is answered with STOP_REPLY"""
    board.need_any(m.Feature.SEQUENCE_PHASES | m.Feature.SEQUENCE_POINTS)
    since = board.link.mark()
    reply = board.link.call(m.Stop(), m.StopReply)
    check_fields(reply, "STOP_REPLY", state=board.status().state)
    check(not board.link.events(m.PlaybackEnded, since), "PLAYBACK_ENDED without a playback")


@case("HG-7.8/1", needs=_NEEDS)
def tells_the_end_of_playback(board: BoardClient) -> None:
    """one PLAYBACK_ENDED tells each end of a playback: by itself, by STOP, MUTE and DISARM"""
    playback.send_phases_to_store(board, 4, frames=3)
    since = board.arm()
    playback.play_out(board, 4, 3, loops=2)
    judge_end_told(board, since, 4, 3, 6)
    for name, end in ENDS_OF_PLAYBACK.items():
        judge_ended_playback(board, end, name)


def judge_end_told(
    board: BoardClient, since: int, sequence: int, frames: int, latched: int, name: str = ""
) -> None:
    """FAILED unless one PLAYBACK_ENDED tells of so many latches of a sequence of *frames*."""
    board.link.barrier()
    events = [event for _, event in board.link.events(m.PlaybackEnded, since)]
    told = [(event.sequence, event.frames, event.loops) for event in events]
    text = f"{name and name + ': '}PLAYBACK_ENDED tells of (sequence, frames, loops) {told}"
    check_equal(told, [(sequence, latched, latched // frames)], text)


@case("HG-7.8/2", needs=_NEEDS)
def streams_after_playback(board: BoardClient) -> None:
    """after the last frame the board is ARMED and latches stream frames"""
    playback.send_phases_that_fit(board, 1, frames=2)
    board.arm()
    playback.play_out(board, 1, 2)
    with board.counting(latched=1):
        latching.latch_now(board)
    board.check_status("after a playback", state=OutputState.ARMED)


def _playback_period_us(board: BoardClient) -> int:
    """Return the usual playback period in µs, or the board's shortest one if that is longer."""
    return playback.shortest_period_to_play_us(board, playback.PERIOD_US)


def _playback_loop_numbers(frames: int) -> list[int]:
    """Return loop counts at which the loops, or all their frames, reach or pass 2^8 to 2^32.

    There are *frames* in a loop.

    Examples
    --------
    >>> _playback_loop_numbers(1)[:2]
    [256, 257]
    """
    numbers = {0xFFFFFFFF}
    for width in _WIDTHS:
        numbers |= {1 << width, (1 << width) + 1, -(-(1 << width) // frames)}
    return sorted(number for number in numbers if number * frames > _SEEN and number < 1 << 32)


def _latches_of_playback(
    board: BoardClient, frames: int, loops: int, period_us: int, look_us: int
) -> int:
    """Play for *look_us*, stop; return the number of latches.  FAILED if it ended by itself."""
    board.arm()
    since, before = board.link.mark(), board.status().counters
    start_us = board.wire.now_us()
    playback.play_now(board, _SEQUENCE, loops=loops, period_us=period_us)
    board.wire.idle(look_us)
    for _, event in board.link.events(m.PlaybackEnded, since):
        text = f"{loops} loops of {frames} frames, {period_us} µs apart, end"
        fail(f"{text} after {event.frames} frames")
    board.stop()
    if look_us < period_us:
        board.wire.check_not_after(start_us + period_us, "STOP within a period")
    return board.counted_since(before)["latched"]


@case(
    "HG-7.6/4-loops", needs=m.Feature.SEQUENCE_PHASES, evidence=SELF_REPORTED, depth=Depth.DEFAULT
)
def every_number_of_loops_goes_on(board: BoardClient) -> None:
    """loops of every width of 1, 2 and 3 frames do not end after the first few frames"""
    period_us = _playback_period_us(board)
    playback.require_time_to_play(board, (_SEEN + 1) * period_us)
    for frames in (1, 2, 3):
        playback.send_phases_to_store(board, _SEQUENCE, frames=frames)
        for loops in _playback_loop_numbers(frames):
            latched = _latches_of_playback(board, frames, loops, period_us, _SEEN * period_us)
            text = f"{loops} loops of {frames} frames: {latched} latches in {_SEEN} periods"
            check(latched >= _SEEN - 1, text)


def _playback_periods_us() -> list[int]:
    """Return playback periods in µs, 200 ms to 32 bits: 10 ms above 2^b times 1, 100 and 1000."""
    edges = {unit << width for unit in (1, 100, 1000) for width in _WIDTHS} | {0xFFFFFFF0}
    return sorted(edge + 10 * _MS for edge in edges if 200 * _MS <= edge < (1 << 32) - 10 * _MS)


@case("HG-7.6/4-periods", needs=PLAYS, evidence=SELF_REPORTED)
def every_long_period_is_kept(board: BoardClient) -> None:
    """periods of every width up to 2^32 µs: no second frame comes soon after the first"""
    playback.send_phases_to_store(board, _SEQUENCE, frames=3)
    board.configure(hold_ms=10_000)
    periods = _playback_periods_us()
    for period_us in periods if board.thorough else periods[-2:]:
        latched = _latches_of_playback(board, 3, 1, period_us, _LOOK_MS * _MS)
        check_equal(latched, 1, f"a period of {period_us} µs: {latched} latches in {_LOOK_MS} ms")


@case("HG-7.6/4-long", needs=PLAYS, evidence=SELF_REPORTED, wall_depth=Depth.FULL)
def every_frame_of_a_long_playback_is_in_time(board: BoardClient) -> None:
    """one playback of more than 2^32 µs: each frame at its time, past 2^31 and 2^32 µs too"""
    frames = 4  # 38 s at a wall clock
    if board.wire.is_virtual:
        frames += (1 << 32) // _SLOW_US
    playback.send_phases_to_store(board, _SEQUENCE, frames=2)
    board.configure(hold_ms=10_000)
    alone_ms = min(60_000, board.identity.max_unattended_ms)
    text = f"frames are {_SLOW_US} µs apart; max_unattended_ms is {alone_ms}"
    require(alone_ms * _MS >= 2 * _SLOW_US, text)
    since = board.arm()
    start_us = board.clock.ahead_us(board.clock.ready_us(20 * _MS))
    playback.play_at(
        board, _SEQUENCE, start_us, loops=0, period_us=_SLOW_US, unattended_ms=alone_ms
    )
    for number in range(frames):
        due_us = board.clock.on_carrier(start_us + number * _SLOW_US)
        board.clock.wait_before(due_us)  # unattended, as it may be
        board.clock.wait_until(due_us + _MS)
        if board.link.events(m.PlaybackEnded, since):
            fail(f"the playback ended before frame {number}")
        late_us = board.last_latch_us() - due_us
        text = f"frame {number}, {number * _SLOW_US / 1e6:.1f} s after the start"
        check_equal(late_us, 0, f"{text}: latched {late_us:+d} µs off")
    board.stop()
    board.due_event(m.PlaybackEnded, since, 100 * _MS)
    judge_end_told(board, since, _SEQUENCE, 2, frames)


@case("HG-7.6/2-starts", needs=PLAYS, evidence=SELF_REPORTED, wall_depth=Depth.FULL)
def every_playback_start_is_kept(board: BoardClient) -> None:
    """starts up to the horizon ahead are taken; the first frame is latched then and not before"""
    playback.send_phases_to_store(board, _SEQUENCE, frames=1)
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
        period_us = _playback_period_us(board)
        playback.play_at(
            board, _SEQUENCE, start_us, loops=1, period_us=period_us, unattended_ms=alone_ms
        )
        board.clock.wait_before(start_us - 30 * _MS)
        early = board.counted_since(before)["latched"]
        in_time = board.clock.device_us() < start_us
        board.clock.wait_until(start_us + _MS)
        late_us = board.last_latch_us() - start_us
        check(not (early and in_time), f"a start {ahead_us} µs ahead: latched before it")
        check_equal(late_us, 0, f"a start {ahead_us} µs ahead: latched {late_us:+d} µs off")


@case("HG-7.6/2-late", needs=PLAYS)
def every_passed_start_is_refused(board: BoardClient) -> None:
    """starts that have passed are refused with detail 0, whatever late_window_us is"""
    playback.send_phases_to_store(board, _SEQUENCE, frames=1)
    for window_us in (0, 20_000, 100_000):
        board.arm(late_window_us=window_us)
        for late_us in (1, 1000, 15_000, 70_000, 1_000_000):
            start_us, period_us = board.clock.device_us() - late_us, _playback_period_us(board)
            play = playback.play_request(
                board, _SEQUENCE, loops=1, period_us=period_us, unattended_ms=100
            )
            board.link.refused(play, m.ErrorCode.BAD_VALUE, 0, time_us=start_us)


# --- Ended at every moment ---------------------------------------------------------------------


def _playback_in_a_later_frame(board: BoardClient) -> None:
    """Play a sequence without end, and wait until it is past its first pass."""
    period_us = playback.period_to_play(board)
    playback.play_now(board, STORED, loops=0, period_us=period_us)
    for _ in range(2 * (_FRAMES + 2)):
        board.wire.idle(period_us // 2)
        board.link.ask(m.GetStatus())  # a slow board is not left alone for so long


#: Moments of a playback, with the least number of frames that it has latched.
_MOMENTS: Final[dict[str, tuple[PlaybackAct, int]]] = {
    "that waits for its start": (OUTPUT_STATES[WAITS], 0),
    "in its first frame": (OUTPUT_STATES[PLAYING_SLOWLY], 1),
    "in a later frame": (_playback_in_a_later_frame, _FRAMES + 1),
}
#: Every moment with every end.
_ENDED_AT: Final = tuple(itertools.product(_MOMENTS.items(), ENDS_OF_PLAYBACK.items()))


@case("HG-7.8/1-ends", needs=PLAYS, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_playback_end_is_told(board: BoardClient) -> None:
    """one PLAYBACK_ENDED tells of a playback that waits, in its first frame and later, by every
    end
    """
    playback.send_phases_to_store(board, STORED, frames=_FRAMES)
    for (moment, (bring, least)), (name, end) in _ENDED_AT:
        board.arm()
        since, before = board.link.mark(), board.status().counters
        bring(board)
        end(board)
        latched = board.counted_since(before)["latched"]
        text = f"a playback {moment}, ended by {name}"
        judge_end_told(board, since, STORED, _FRAMES, latched, text)
        check(latched >= least, f"{text}: {latched} latches")


@case("HG-7.6/4-again", needs=PLAYS, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_playback_begins_with_its_first_frame(board: BoardClient) -> None:
    """behind a playback that was ended at any moment, by every end, the next begins with frame 0"""
    mode = latching.ask_for_board_latches(board)
    playback.send_phases_to_store(board, STORED, frames=_FRAMES)
    period_us = board.clock.on_carrier(playback.period_to_play(board))
    for (moment, (bring, _)), (name, end) in _ENDED_AT:
        board.arm()
        bring(board)
        end(board)
        board.arm()
        since, asked_us = board.link.mark(), board.clock.device_us()
        playback.play_now(board, STORED, loops=1, period_us=period_us)
        most_us = board.clock.on_carrier(board.clock.ready_us(board.clock.device_us()))
        playback.await_playback_end(board, since, _FRAMES * period_us)
        seen = latching.latches_received_from_board(board, since, mode)[-_FRAMES:]
        text = f"PLAY behind one {moment} that {name} has ended"
        got = [(latch.loop, latch.index) for latch in seen]
        due = [(0, index) for index in range(_FRAMES)]
        check_equal(got, due, f"{text}: (loop, index) of its latches")
        # The last latch before may be of the same carrier period (HG-5.8/3).
        in_time = asked_us <= seen[0].t_us <= most_us + board.clock.carrier_us
        check(in_time, f"{text}: its first frame is latched {seen[0].t_us - asked_us} µs later")


@case("HG-3.6/4-playback", needs=PLAYS, depth=Depth.DEFAULT)
def every_playback_end_of_a_session_is_event_0(board: BoardClient) -> None:
    """the event that a new session causes by ending a playback has the number 0, the next one 1"""
    playback.send_phases_to_store(board, STORED, frames=_FRAMES)
    period_ms = board.quick_status_ms
    for moment, (bring, _) in _MOMENTS.items():
        since = board.arm(status_period_ms=period_ms)
        wait_us = 3 * period_ms * _MS
        board.link.await_event(m.Status, since, wait_us)  # this session has an event
        bring(board)
        since = board.link.mark()
        board.hello()
        board.link.await_event(m.Status, board.link.mark(), wait_us)  # none of the old session
        pieces = [piece for piece in board.wire.received[since:] if piece.is_event]
        seen = [
            (type(piece.message).__name__, piece.header.seq)
            for piece in pieces
            if piece.header is not None and piece.header.session == board.link.session
        ]
        due = [("PlaybackEnded", 0), ("Status", 1)]
        check_equal(seen[:2], due, f"a new session and a playback {moment}: events {seen[:2]}")


@case("HG-7.6/5-config", needs=PLAYS)
def every_lease_leaves_a_playback_its_time(board: BoardClient) -> None:
    """SET_CONFIG while a sequence plays or waits: unattended_ms still stands for host_timeout_ms"""
    playback.send_phases_to_store(board, STORED, frames=_FRAMES)
    alone_ms = min(_ALONE_MS, board.identity.max_unattended_ms)
    for is_waiting in (False, True) if board.thorough else (False,):
        board.configure()
        board.arm()
        if is_waiting:
            playback.play_later(board, STORED, _AHEAD_US, unattended_ms=alone_ms)
        else:
            playback.play_now(board, STORED, loops=0, period_us=50 * _MS, unattended_ms=alone_ms)
        since = board.link.mark()
        board.configure(host_timeout_ms=_SHORT_LEASE_MS)
        judged_mute_by_timer(board, since, 2 * alone_ms * _MS, MuteReason.UNATTENDED)
