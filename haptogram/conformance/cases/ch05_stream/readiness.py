"""HG-5.7, HG-5.8: when a frame is ready, its margin, and what follows from that."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from haptogram_protocol.messages import (
    Feature,
    FocalPoint,
    Message,
    Mute,
    Ping,
    Points,
    Pong,
    StatusReply,
    TraceMode,
)

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.capabilities import TRACE_MODES
from ...client.latching import (
    ClientLatch,
    latch_now,
    latches_received_from_board,
    send_between_pings,
)
from ...client.stream_kinds import points_of_stream_kind, stream_kinds
from ...outcome import SELF_REPORTED, check, check_equal, require

_MOST_US: Final = 100_000
_TRIES: Final = 6
_POINT: Final = FocalPoint(10_000, 5_000, 150_000, 8_000, 0)
_WINDOWS_US: Final = (0, 1, 30, 5_000, 100_000)
_WALL_WINDOWS_US: Final = (5_000, 100_000)  # where no frame arrives to the microsecond
_AIMS: Final = 3  # frames sent for one margin, each with the error of the one before


@case("HG-5.7/9")
def readiness_takes_a_short_lead(board: BoardClient) -> None:
    """latch_lead_us and point_time_us are at most 100 ms"""
    for name in ("latch_lead_us", "point_time_us"):
        got_us = getattr(board.identity, name)
        check(got_us <= _MOST_US, f"{name} is {got_us}, must be {_MOST_US} or less")


def _kinds_of_ready_frames(board: BoardClient) -> list[tuple[Message, int]]:
    """Return a frame of each kind, and how many points the board has to compute for it."""
    kinds: list[tuple[Message, int]] = [(board.flat_phases(), 0)]
    if board.has(Feature.POINTS):
        kinds += [(Points((_POINT,) * n), n) for n in sorted({1, board.most_points})]
    return kinds


@case("HG-5.8/1-ready", evidence=SELF_REPORTED)
def latches_frames_when_ready(board: BoardClient) -> None:
    """frames as soon as complete, of each kind: latched when they are ready"""
    board.arm()
    for message, points in _kinds_of_ready_frames(board):
        for _ in range(_TRIES):
            around_us = send_between_pings(board, message)
            board.clock.wait_latched()
            got_us = board.last_latch_us()
            ready_us = board.clock.ready_us(0, points)
            least_us, most_us = (
                board.clock.on_carrier(board.clock.ready_us(t_us, points)) for t_us in around_us
            )
            check(
                least_us <= got_us <= most_us,
                f"{message.TYPE.name} of {points} points, latched {got_us - around_us[1]} µs after "
                f"the PING behind it came; ready it is {ready_us} µs after its arrival",
            )


@case("HG-5.8/1-computed", needs=Feature.POINTS, evidence=SELF_REPORTED)
def readies_frames_one_after_the_other(board: BoardClient) -> None:
    """two frames of points as soon as complete: the board computes the second behind the first"""
    board.arm()
    most = board.most_points
    message = Points((_POINT,) * most)
    for _ in range(_TRIES):
        board.clock.wait_latched()
        board.arm_anew()  # or the hold of the last latch may end before these are computed
        first, second = (board.link.stream_wire(message) for _ in range(2))
        ping, seq = board.link.request_wire(Ping(0))
        since = board.link.mark()
        board.link.send(ping, first, second)
        answer = board.link.answer_to(Ping.TYPE, seq, since)
        from_us = board.clock.unwrap(board.link.reply_in(answer, Pong, Ping.TYPE).t_rx_us)
        board.clock.wait_latched()
        board.clock.wait_latched()
        got_us = board.last_latch_us()
        least_us = board.clock.on_carrier(board.clock.ready_us(from_us, 2 * most))
        check(
            got_us >= least_us,
            f"the second frame of {most} points was latched {got_us - from_us} µs after the PING "
            f"before both; {board.clock.ready_us(0, 2 * most)} µs are due",
        )


@case("HG-5.7/5-margin", evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def lateness_counts_from_readiness(board: BoardClient) -> None:
    """frames for times around the end of the late window: dropped_late beyond it, else latched"""
    board.require_no_status()
    board.arm()
    window_us = board.config.late_window_us
    for message, points in _kinds_of_ready_frames(board):
        if not board.clock.can_be_in_time(points):
            continue  # no such frame is ever in time
        for ahead_us in range(-200, 201, 80):
            board.clock.wait_latched()
            before = board.status().counters
            now_us = board.clock.device_us() + board.wire.limits.lead_us // 8
            t_us = board.clock.ready_us(now_us, points) - window_us + ahead_us
            board.link.stream(message, t_us)
            board.clock.wait_until(board.clock.on_carrier(t_us + window_us) + board.clock.lead_us)
            after = board.status()
            dropped = after.counters.dropped_late - before.dropped_late
            latched = after.counters.latched - before.latched
            late = after.margin_min_us < -window_us
            check_equal(
                (after.margins, dropped, latched),
                (1, int(late), int(not late)),
                f"{message.TYPE.name} of {points} points, margin {after.margin_min_us} µs, ready "
                f"{board.clock.ready_us(0, points)} µs after it came, late window {window_us} µs: "
                f"margins {after.margins}, dropped_late {dropped}, latched {latched}",
            )


@case("HG-5.7/8", evidence=SELF_REPORTED)
def counts_accepted_stream_frames(board: BoardClient) -> None:
    """accepted = latched + flushed + queued, over frames latched, flushed, dropped, waiting"""
    good = board.flat_phases()
    board.link.stream(good)  # not armed: dropped
    board.arm()
    first = board.status()
    for _ in range(3):
        latch_now(board, good)
    t_us = board.clock.soon_us(bytes(3000), ahead_us=50_000)
    wires = [board.link.stream_wire(good, t_us + 1000 * number) for number in range(3)]
    board.link.send(*wires, board.link.stream_wire(good, t_us))  # the last one is not in order
    _check_accepted_stream_frames(first, board.status(), 6, queued=3)
    latch_now(board, good)  # flushes three
    _check_accepted_stream_frames(first, board.status(), 7, queued=0)
    t_us = board.clock.soon_us(bytes(3000), ahead_us=50_000)
    board.link.send(*(board.link.stream_wire(good, t_us + 1000 * number) for number in range(2)))
    board.link.barrier()  # or MUTE may overtake them
    board.link.ask(Mute())
    _check_accepted_stream_frames(first, board.status(), 9, queued=0)


def _check_accepted_stream_frames(
    first: StatusReply, now: StatusReply, accepted: int, queued: int
) -> None:
    grown = {
        name: (getattr(now.counters, name) - getattr(first.counters, name)) & 0xFFFFFFFF
        for name in ("accepted", "latched", "flushed")
    }
    check_equal(now.queued, queued, f"{queued} frames wait, queued is {now.queued}")
    check_equal(grown["accepted"], accepted, f"{accepted} frames were accepted; counted {grown}")
    total = grown["latched"] + grown["flushed"] + now.queued
    check_equal(
        grown["accepted"], total, f"accepted, latched and flushed: {grown}, queued {queued}"
    )


# --- Lateness by the microsecond: the board names the margin --------------------------------------


def _margins_around_lateness_us(board: BoardClient, window_us: int) -> list[int]:
    """Return the margins at and beside every border: in time, a carrier period, the late window.

    At a wall clock, where no frame arrives to the microsecond, those at the borders.
    """
    carrier_us = board.clock.carrier_us
    steps = board.sample((0, -1, 1))
    borders = (0, carrier_us, -carrier_us, -window_us)
    return sorted({border + step for border in borders for step in steps})


def _settings_of_late_window(board: BoardClient) -> Iterator[tuple[int, TraceMode]]:
    """Yield late windows and trace modes: every window, and every mode in turn."""
    modes = [mode for feature, mode in TRACE_MODES if board.has(feature)] or [TraceMode.OFF]
    windows_us = _WINDOWS_US if board.wire.is_virtual else _WALL_WINDOWS_US
    for number, window_us in enumerate(windows_us):
        yield window_us, modes[number % len(modes)]


@case("HG-5.7/6-borders", needs=Feature.CONFIG, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_lateness_has_its_borders(board: BoardClient) -> None:
    """margins 1 µs around 0, a carrier period, the late window: in time, late and LATE, or
    dropped
    """
    delays_us: dict[str, int] = {}  # from the PING before a frame to the frame, by kind
    late = 0
    for window_us, mode in _settings_of_late_window(board):
        board.hello()
        board.arm(late_window_us=window_us, trace_mode=mode)
        for kind in stream_kinds(board):
            message = kind.make()  # one for all: another may be longer on the line
            points = points_of_stream_kind(message)
            if not board.clock.can_be_in_time(points):
                continue  # no such frame is ever in time
            for due_us in _margins_around_lateness_us(board, window_us):
                for _ in board.sample(range(_AIMS)):
                    got_us = _judge_lateness(board, kind.name, message, due_us, delays_us)
                    late += -window_us <= got_us < 0
                    if got_us == due_us:
                        break
    require(late > 0, "the host hit no late window with any frame")


def _judge_lateness(
    board: BoardClient, kind: str, message: Message, due_us: int, delays_us: dict[str, int]
) -> int:
    """Send a frame for a margin of *due_us*; FAILED unless it fares as the margin it had demands.

    Returns
    -------
    int
        The margin that it had.
    """
    window_us, mode = board.config.late_window_us, board.config.trace_mode
    points = points_of_stream_kind(message)
    board.clock.wait_latched()
    before, since = board.status().counters, board.link.mark()
    delay_us = delays_us.get(kind, board.wire.limits.lead_us // 8)
    t_us = board.clock.ready_us(board.clock.device_us(), points) + delay_us + due_us
    index = board.link.stream_next
    wire = board.link.stream_wire(message, t_us)
    board.link.send(wire)
    board.clock.wait_latched()
    board.clock.wait_until(t_us + board.clock.lead_us + 2 * board.clock.carrier_us)
    after = board.status()
    got_us = after.margin_min_us
    delays_us[kind] = delay_us + due_us - got_us
    ready_us = board.clock.ready_us(0, points)
    name = f"{kind}, margin {got_us} µs, ready {ready_us} µs after it came, window {window_us} µs"
    told = (after.margins, after.margin_mean_us)
    check_equal(told, (1, got_us), f"{name}: margins {told[0]}, margin_mean_us {told[1]}")
    dropped, is_late = got_us < -window_us, -window_us <= got_us < 0
    names = ("accepted", "latched", "late", "dropped_late")
    counted = [(getattr(after.counters, n) - getattr(before, n)) & 0xFFFFFFFF for n in names]
    due = [int(not dropped), int(not dropped), int(is_late), int(dropped)]
    check(counted == due, f"{name}: {', '.join(names)} count {counted}, due is {due}")
    if mode is not TraceMode.OFF:
        traced = [t for t in latches_received_from_board(board, since, mode) if t.index == index]
        _check_late_flag(traced, name, dropped=dropped, late=is_late)
    return got_us


def _check_late_flag(traced: list[ClientLatch], name: str, *, dropped: bool, late: bool) -> None:
    flags = [latch.late for latch in traced]
    check_equal(flags, [] if dropped else [late], f"{name}: the trace has LATE {flags}")
