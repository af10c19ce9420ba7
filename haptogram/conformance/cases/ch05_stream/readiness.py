"""HG-5.7, HG-5.8: when a frame is ready, its margin, and what follows from that."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from typing import Final

from haptogram_protocol import messages as m

from ...case import Depth, case
from ...client import latching
from ...client.board_client import BoardClient
from ...client.capabilities import TRACE_MODES
from ...client.recording import counter_steps
from ...client.stream_kinds import (
    StreamKind,
    points_of_stream_kind,
    random_points_to_send,
    stream_kinds,
)
from ...outcome import SELF_REPORTED, check, check_equal, check_fields, require

_MOST_US: Final = 100_000
_TRIES: Final = 6
_WINDOWS_US: Final = (0, 1, 30, 5_000, 100_000)
_WALL_WINDOWS_US: Final = (5_000, 100_000)  # where no frame arrives to the microsecond
_AIMS: Final = 3  # frames sent for one margin, each with the error of the one before


@case("HG-5.7/9")
def readiness_takes_a_short_lead(board: BoardClient) -> None:
    """latch_lead_us and point_time_us are at most 100 ms"""
    for name in ("latch_lead_us", "point_time_us"):
        got_us = getattr(board.identity, name)
        check(got_us <= _MOST_US, f"{name} is {got_us}, must be {_MOST_US} or less")


@case("HG-5.8/1-ready", evidence=SELF_REPORTED)
def latches_frames_when_ready(board: BoardClient) -> None:
    """frames as soon as complete, of each kind: latched when they are ready"""
    board.arm()
    for kind in stream_kinds(board):
        for _ in range(_TRIES):
            message = kind.make()
            points = points_of_stream_kind(message)
            around_us = latching.send_between_pings(board, message)
            board.clock.wait_latched()
            got_us = board.last_latch_us()
            ready = (board.clock.ready_us(t_us, points) for t_us in around_us)
            least_us, most_us = map(board.clock.on_carrier, ready)
            text = f"{kind.name}, latched {got_us - around_us[1]} µs after the PING behind it came"
            ready_us = board.clock.ready_us(0, points)
            text += f"; ready it is {ready_us} µs after its arrival"
            check(least_us <= got_us <= most_us, text)


@case("HG-5.8/1-computed", needs=m.Feature.POINTS, evidence=SELF_REPORTED)
def readies_frames_one_after_the_other(board: BoardClient) -> None:
    """two frames of points as soon as complete: the board computes the second behind the first"""
    board.arm()
    most = board.most_points
    message = random_points_to_send(board, most)
    for _ in range(_TRIES):
        board.clock.wait_latched()
        board.arm_anew()  # or the hold of the last latch may end before these are computed
        first, second = (board.link.stream_wire(message) for _ in range(2))
        (answer,) = board.link.exchange(board.link.request_wire(m.Ping(0))[0], first, second)
        from_us = board.clock.unwrap(board.link.reply_in(answer, m.Pong).t_rx_us)
        board.clock.wait_latched()
        board.clock.wait_latched()
        got_us = board.last_latch_us()
        least_us = board.clock.on_carrier(board.clock.ready_us(from_us, 2 * most))
        text = f"the second frame of {most} points, latched at {got_us} µs, due is {least_us} µs"
        check(got_us >= least_us, f"{text}; the PING before both came at {from_us} µs")


@case("HG-5.7/8", evidence=SELF_REPORTED)
def counts_accepted_stream_frames(board: BoardClient) -> None:
    """accepted = latched + flushed + queued, over frames latched, flushed, dropped, waiting"""
    good = board.flat_phases()
    board.link.stream(good)  # not armed: dropped
    board.arm()
    first = board.status()
    for _ in range(3):
        latching.latch_now(board, good)
    t_us = board.clock.soon_us(bytes(3000), ahead_us=50_000)
    wires = [board.link.stream_wire(good, t_us + 1000 * number) for number in range(3)]
    board.link.send(*wires, board.link.stream_wire(good, t_us))  # the last one is not in order
    _check_accepted_stream_frames(first, board.status(), 6, queued=3)
    latching.latch_now(board, good)  # flushes three
    _check_accepted_stream_frames(first, board.status(), 7, queued=0)
    t_us = board.clock.soon_us(bytes(3000), ahead_us=50_000)
    board.link.send(*(board.link.stream_wire(good, t_us + 1000 * number) for number in range(2)))
    board.link.barrier()  # or MUTE may overtake them
    board.mute()
    _check_accepted_stream_frames(first, board.status(), 9, queued=0)


def _check_accepted_stream_frames(
    first: m.StatusReply, now: m.StatusReply, accepted: int, queued: int
) -> None:
    """FAILED unless *accepted* frames came from *first* to *now*: latched, flushed, or *queued*."""
    grown = counter_steps(first.counters, now.counters)
    check_fields(now, f"{accepted} frames accepted: STATUS_REPLY", queued=queued)
    told = grown["accepted"], grown["latched"] + grown["flushed"] + now.queued
    check_equal(told, (accepted, accepted), "accepted; and latched, flushed and queued together")


# --- Lateness: the board names the margin ---------------------------------------------------------


@case("HG-5.7/5-window", needs=m.Feature.CONFIG, evidence=SELF_REPORTED)
def drops_frames_beyond_the_late_window(board: BoardClient) -> None:
    """with a window of 100 ms a frame 0.5 s late is dropped_late"""
    board.arm(late_window_us=_MOST_US)
    _judge_margins(board, stream_kinds(board)[:1], (-500_000,))


@case("HG-5.7/6", needs=m.Feature.CONFIG, evidence=SELF_REPORTED)
def latches_frames_within_the_late_window(board: BoardClient) -> None:
    """with a window of 100 ms a frame 5 ms late is latched, counted in late, LATE in its trace"""
    mode = latching.ask_for_board_latches_if_supported(board)
    board.arm(late_window_us=_MOST_US, trace_mode=mode)
    late = _judge_margins(board, stream_kinds(board)[:1], (-5000, 1000))
    require(late > 0, "the host hit no late window")


@case("HG-5.7/5-margin", evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def lateness_counts_from_readiness(board: BoardClient) -> None:
    """frames for times around the end of the late window: dropped_late beyond it, else latched"""
    board.require_no_status()
    board.arm()
    window_us = board.config.late_window_us
    _judge_margins(board, stream_kinds(board), range(-200 - window_us, 201 - window_us, 80))


@case("HG-5.7/5-windows", needs=m.Feature.CONFIG, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_late_window_of_the_queue(board: BoardClient) -> None:
    """windows of 20, 66, 100 ms: frames 0.4 times so late, at the very border, 1.5 times so late"""
    for window_us in (20_000, 66_000, _MOST_US):
        board.arm(late_window_us=window_us)
        late_us = (window_us * 2 // 5, *range(window_us - 3, window_us + 4), window_us * 3 // 2)
        _judge_margins(board, stream_kinds(board)[:1], [-us for us in late_us])


@case("HG-5.7/6-types", needs=m.Feature.CONFIG, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_format_is_streamed_late(board: BoardClient) -> None:
    """late frames of every message and format, in every trace: LATE, and only of these"""
    for mode in _modes_of_trace(board):
        for kind in stream_kinds(board):
            since = board.arm(late_window_us=_MOST_US, trace_mode=mode)
            first = latching.latch_now(board, kind.make())
            late = _judge_margins(board, [kind], (-_MOST_US // 2,))
            require(late > 0, "the host hit no late window")
            last = latching.latch_now(board, kind.make())
            if mode is not m.TraceMode.OFF:
                latches = latching.latches_received_from_board(board, since, mode)
                others = [latch.late for latch in latches if latch.index in (first, last)]
                text = f"{kind.name} at once, before and behind a late one, trace {mode.name}"
                check_equal(others, [False, False], f"{text}: LATE is {others}")


@case("HG-5.7/6-borders", needs=m.Feature.CONFIG, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_lateness_has_its_borders(board: BoardClient) -> None:
    """margins 1 µs around 0, a carrier period, the late window: in time, late and LATE, or
    dropped
    """
    late, modes = 0, itertools.cycle(_modes_of_trace(board))
    windows_us = _WINDOWS_US if board.wire.is_virtual else _WALL_WINDOWS_US
    for window_us, mode in zip(windows_us, modes, strict=False):
        board.hello()
        board.arm(late_window_us=window_us, trace_mode=mode)
        late += _judge_margins(board, stream_kinds(board), _margins_around_borders_us(board))
    require(late > 0, "the host hit no late window with any frame")


def _modes_of_trace(board: BoardClient) -> list[m.TraceMode]:
    """Return the trace modes that the board has; OFF without any."""
    return [mode for feature, mode in TRACE_MODES if board.has(feature)] or [m.TraceMode.OFF]


def _margins_around_borders_us(board: BoardClient) -> list[int]:
    """Return margins in µs at each limit and 1 µs beside it, sorted.

    Limits are 0, one carrier period early or late, and the late window.  At a wall clock, where no
    frame arrives to the microsecond, only the limits themselves.
    """
    carrier_us = board.clock.carrier_us
    borders = (0, carrier_us, -carrier_us, -board.config.late_window_us)
    return sorted({border + step for border in borders for step in board.sample((0, -1, 1))})


def _judge_margins(
    board: BoardClient, kinds: Iterable[StreamKind], margins_us: Iterable[int]
) -> int:
    """FAILED unless frames due *margins_us* after they are ready are latched or, too late, dropped.

    A negative margin is late; too late is beyond the late window.  Kinds that are never in time are
    left out.

    Returns
    -------
    int
        How many were late, within the late window.
    """
    late = 0
    for kind in kinds:
        message = kind.make()  # one for all: another may be longer on the line
        if not board.clock.can_be_in_time(points_of_stream_kind(message)):
            continue  # no such frame is ever in time
        delay_us = board.wire.limits.lead_us // 8  # from the PING before a frame to the frame
        for due_us in margins_us:
            for _ in board.sample(range(_AIMS)):
                got_us = _judge_margin(board, kind.name, message, delay_us + due_us)
                delay_us += due_us - got_us
                late += -board.config.late_window_us <= got_us < 0
                if got_us == due_us:
                    break
    return late


def _judge_margin(board: BoardClient, kind: str, message: m.Message, ahead_us: int) -> int:
    """FAILED unless a frame due some *ahead_us* after it is ready is latched or, too late, dropped.

    Too late is beyond the late window; *kind* names the frame in a finding.

    Returns
    -------
    int
        The margin that it had in µs, by STATUS; negative: late.
    """
    window_us, mode = board.config.late_window_us, board.config.trace_mode
    if not board.has(m.Feature.CONFIG):
        board.arm_anew()  # or the hold of the last latch may end before this one
    board.clock.wait_latched()
    before, since, index = board.status().counters, board.link.mark(), board.link.stream_next
    t_us = board.clock.ready_us(board.clock.device_us(), points_of_stream_kind(message)) + ahead_us
    board.link.stream(message, t_us)
    board.clock.wait_latched()
    board.clock.wait_until(t_us + board.clock.lead_us + 2 * board.clock.carrier_us)
    after = board.status()
    got_us = after.margin_min_us
    ready_us = board.clock.ready_us(0, points_of_stream_kind(message))
    name = f"{kind}, margin {got_us} µs, ready {ready_us} µs after it came, window {window_us} µs"
    check_fields(after, f"{name}: STATUS_REPLY", margins=1, margin_mean_us=got_us)
    dropped, late = got_us < -window_us, -window_us <= got_us < 0
    due = {"accepted": not dropped, "latched": not dropped, "late": late, "dropped_late": dropped}
    steps = counter_steps(before, after.counters)
    check_equal({counter: steps[counter] for counter in due}, due, f"{name}: counted")
    if mode is not m.TraceMode.OFF:
        traced = [
            t for t in latching.latches_received_from_board(board, since, mode) if t.index == index
        ]
        flags = [latch.late for latch in traced]
        check_equal(flags, [] if dropped else [late], f"{name}: the trace has LATE {flags}")
    return got_us
