"""HG-9.1, HG-9.3: STATUS, and the arrival margins in it."""

from __future__ import annotations

from typing import Final

from haptogram_protocol.messages import (
    Counters,
    Feature,
    FocalPoint,
    Message,
    Mute,
    Points,
    Status,
    StatusReply,
)

from ...case import Depth, case
from ...client.board_client import PARTS_OF_FRAMES, BoardClient
from ...client.latching import latch_now, send_between_pings
from ...judge.timers import judge_status_period
from ...outcome import SELF_REPORTED, check, check_equal

_MS: Final = 1000
_MANY: Final = 300  # margins of 9.9 s: their sum needs more than 31 bits
_ROUNDS: Final = 8


@case(
    "HG-9.1/1",
    "in 8.4 periods eight STATUS come; with status_period_ms = 0 none comes",
    depth=Depth.DEFAULT,
)
def sends_status(board: BoardClient) -> None:
    board.need(Feature.CONFIG)
    period_ms = board.quick_status_ms
    board.configure(status_period_ms=period_ms)
    since = board.link.mark()
    board.wire.idle_beyond(int(8.4 * period_ms * _MS))
    board.link.barrier()
    judge_status_period(board, since, period_ms, 8, "8.4 periods")
    board.configure(status_period_ms=0)
    since = board.link.mark()
    board.wire.idle(200 * _MS)
    check(not board.link.events(Status, since), "STATUS comes although status_period_ms is 0")


@case(
    "HG-9.1/2",
    "last_seq and last_latch_us are 0 until a latch, and again in a new session",
    evidence=SELF_REPORTED,
)
def status_begins_with_nothing(board: BoardClient) -> None:
    board.arm()
    for _ in range(2):
        found = board.status()
        got = (found.last_seq, found.last_latch_us)
        check_equal(got, (0, 0), f"before the first latch (last_seq, last_latch_us) is {got}")
        index = latch_now(board, board.flat_phases())
        found = board.status()
        check(found.last_seq == index, f"last_seq is {found.last_seq}, due is {index}")
        check(found.last_latch_us != 0, "last_latch_us is 0 after a latch")
        board.hello()
        board.arm()


@case(
    "HG-9.3/1",
    "margins of 3 frames in time and one too late: number, least and mean; then they begin anew",
    evidence=SELF_REPORTED,
)
def status_tells_margins(board: BoardClient) -> None:
    board.require_no_status()
    board.arm()
    board.status()
    empty = board.status()
    _check_margins(empty, 0, 0, 0, 0)
    good = board.flat_phases()
    base_us = board.clock.device_us()
    ahead = (200_000, 300_000, 400_000)
    size = len(board.link.stream_wire(good, 0, seq=0))
    board.link.send(*(board.link.stream_wire(good, base_us + margin) for margin in ahead))
    board.link.send(
        board.link.stream_wire(good, base_us - 1_000_000)
    )  # not after the last: dropped, counted
    board.link.send(board.link.stream_wire(good))  # IMMEDIATE: no margin; flushes
    sent_us = board.wire.period_us(size * 5)
    found = board.status()
    late_us = board.clock.device_us() - base_us
    ready_us = board.clock.ready_us(0)
    least_us, mean_us = -1_000_000 - ready_us, (sum(ahead) - 1_000_000) // 4 - ready_us
    _check_margins(found, 4, least_us, mean_us, late_us + sent_us)
    _check_margins(board.status(), 0, 0, 0, 0)


def _check_margins(
    status: StatusReply, number: int, least_us: int, mean_us: int, later_us: int
) -> None:
    check(status.margins == number, f"margins of {status.margins} frames, due are {number}")
    for name, got, due in (
        ("margin_min_us", status.margin_min_us, least_us),
        ("margin_mean_us", status.margin_mean_us, mean_us),
    ):
        check(
            due - later_us - 1 <= got <= due + 1,
            f"{name} is {got}, due is {due} less at most {later_us}",
        )


@case(
    "HG-9.3/1",
    "margins of up to 35 minutes, early, late and mixed, of 1 to 300 frames: sums of 32 bits fail",
    variant="widths",
    evidence=SELF_REPORTED,
)
def status_tells_wide_margins(board: BoardClient) -> None:
    board.require_no_status()
    board.arm()
    good = board.flat_phases() if board.identity.point_time_us else board.shortest_stream()
    most_us = 2**31 - 60_000_000
    early_us = board.identity.max_horizon_us - 100_000
    for margins in (
        [-most_us] * 3,
        [most_us] * 3,
        [most_us, -most_us, most_us],
        [-most_us, most_us, -1_000_000],
        [-70_000, -131_072, -32_768],
        [early_us] * _MANY,  # the first one is queued, the others are not after it
    ):
        board.hello()
        board.arm()
        board.status()
        base_us = board.clock.device_us()
        wires = [board.link.stream_wire(good, base_us + margin) for margin in margins]
        board.link.send(*wires)
        found = board.status()
        late_us = board.clock.device_us() - base_us + board.wire.period_us(sum(map(len, wires)))
        mean_us = sum(margins) // len(margins)
        _check_margins(found, len(margins), min(margins), mean_us, late_us + board.clock.lead_us)


@case(
    "HG-9.3/1",
    "the margin of frames of each kind is t_apply less the time at which they are ready",
    variant="ready",
    evidence=SELF_REPORTED,
)
def status_margins_count_from_ready(board: BoardClient) -> None:
    board.require_no_status()
    board.arm()
    kinds: list[tuple[Message, int]] = [(board.flat_phases(), 0)]
    if board.has(Feature.POINTS):
        most = board.most_points
        kinds.append((Points((FocalPoint(10_000, 5_000, 150_000, 8_000, 0),) * most), most))
    for message, points in kinds:
        board.clock.wait_latched()
        t_us = board.clock.soon_us(bytes(2000), ahead_us=500 * _MS)
        board.status()
        from_us, to_us = send_between_pings(board, message, t_us)
        found = board.status()
        ready_us = board.clock.ready_us(0, points)
        _check_margins(
            found, 1, t_us - from_us - ready_us, t_us - from_us - ready_us, to_us - from_us
        )
        board.link.ask(Mute())  # or the next frame would not be in order
        board.arm()


@case(
    "HG-9.1/3",
    "in STATUS and STATUS_REPLY amid a stream both sums hold: of frames, and of accepted",
    needs=Feature.CONFIG,
    evidence=SELF_REPORTED,
)
def status_tells_of_one_moment(board: BoardClient) -> None:
    board.configure(status_period_ms=board.quick_status_ms)
    board.arm()
    good = board.shortest_stream()
    since = board.link.mark()
    found: list[StatusReply | Status] = [board.status()]
    for _ in range(_ROUNDS):
        t_us = board.clock.soon_us(bytes(1000), ahead_us=_MS)
        for number in range(3):
            board.link.send(board.link.stream_wire(good, t_us + number * _MS))
            found.append(board.status())
        board.clock.wait_until(t_us + 2 * _MS)
    found += [event for _, event in board.link.events(Status, since)]
    first = found[0]
    for status in found:
        counted = {
            name: (getattr(status.counters, name) - getattr(first.counters, name)) & 0xFFFFFFFF
            for name in Counters.WIRE
        }
        parts = {name: counted[name] for name in PARTS_OF_FRAMES if counted[name]}
        check(
            (counted["frames"] - sum(parts.values())) & 0xFFFFFFFF == 0,
            f"frames has grown by {counted['frames']}, its parts by {parts}",
        )
        stream = counted["latched"] + counted["flushed"] + status.queued - first.queued
        check(
            (counted["accepted"] - stream) & 0xFFFFFFFF == 0,
            f"accepted {counted['accepted']}, latched {counted['latched']}, "
            f"flushed {counted['flushed']}, queued {status.queued}",
        )
