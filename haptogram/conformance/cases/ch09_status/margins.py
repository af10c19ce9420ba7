"""HG-9.3: the arrival margins that STATUS tells, and what begins them anew."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from haptogram_protocol.messages import (
    Arm,
    Feature,
    GetStatus,
    Hello,
    Message,
    Mute,
    Status,
    StatusReply,
)

from ...case import case
from ...client.board_client import BoardClient
from ...client.latching import send_between_pings
from ...client.playback import send_phases_to_store_if_supported
from ...client.stream_kinds import points_of_stream_kind, stream_kinds, valid_requests_to_send
from ...outcome import SELF_REPORTED, CaseEndedError, check, check_fields, named
from ..ch05_stream.every_drop import DROPS, frames_to_drop

_MS: Final = 1000
_MANY: Final = 300  # margins of 9.9 s: their sum needs more than 31 bits
_SEQUENCE: Final = 5
_AHEAD_US: Final = 400_000
#: Counters of steps 13 to 16 of HG-3.8.
_WITH_MARGIN: Final = ("dropped_order", "dropped_full", "dropped_future", "dropped_late")


def _send_ahead(board: BoardClient, good: Message, ahead_us: Sequence[int]) -> int:
    """Send frames so far ahead of now, and return the time that this was."""
    base_us = board.clock.device_us()
    board.link.send(*(board.link.stream_wire(good, base_us + ahead) for ahead in ahead_us))
    return base_us


def _check_margins(
    status: StatusReply, number: int, least_us: int, mean_us: int, later_us: int
) -> None:
    check_fields(status, "STATUS_REPLY", margins=number)
    for name, got, due in (
        ("margin_min_us", status.margin_min_us, least_us),
        ("margin_mean_us", status.margin_mean_us, mean_us),
    ):
        is_due = due - later_us - 1 <= got <= due + 1
        check(is_due, f"{name} is {got}, due is {due} less at most {later_us}")


def _judge_margins_of(board: BoardClient, good: Message, margins: Sequence[int]) -> None:
    """FAILED unless STATUS tells of frames with these margins, once, and of none before them."""
    board.hello()
    board.arm()
    board.status()
    _check_margins(board.status(), 0, 0, 0, 0)
    base_us = _send_ahead(board, good, margins)
    board.link.stream(good)  # IMMEDIATE: no margin; flushes
    found = board.status()
    number = len(margins)
    sent_us = board.wire.period_us((number + 1) * len(board.link.stream_wire(good, 0, seq=0)))
    later_us = board.clock.device_us() - base_us + sent_us
    ready_us = board.clock.ready_us(0)
    mean_us = sum(margins) // number - ready_us
    _check_margins(found, number, min(margins) - ready_us, mean_us, later_us)
    _check_margins(board.status(), 0, 0, 0, 0)


@case("HG-9.3/1", evidence=SELF_REPORTED)
def status_tells_margins(board: BoardClient) -> None:
    """margins of 3 frames in time and one too late: number, least and mean; then they begin anew"""
    board.require_no_status()
    # The last one, in disorder, is dropped and counted.
    _judge_margins_of(board, board.flat_phases(), (200_000, 300_000, 400_000, -1_000_000))


@case("HG-9.3/1-widths", evidence=SELF_REPORTED)
def status_tells_wide_margins(board: BoardClient) -> None:
    """margins of up to 35 minutes, early, late and mixed, of 1 to 300 frames: sums of 32 bits
    fail
    """
    board.require_no_status()
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
        _judge_margins_of(board, good, margins)


@case("HG-9.3/1-ready", evidence=SELF_REPORTED)
def margins_count_from_ready(board: BoardClient) -> None:
    """the margin of frames of each kind is t_apply less the time at which they are ready"""
    board.require_no_status()
    board.arm()
    for message in (kind.make() for kind in stream_kinds(board)):
        board.clock.wait_latched()
        t_us = board.clock.soon_us(bytes(2000), ahead_us=500 * _MS)
        board.status()
        from_us, to_us = send_between_pings(board, message, t_us)
        due_us = t_us - from_us - board.clock.ready_us(0, points_of_stream_kind(message))
        _check_margins(board.status(), 1, due_us, due_us, to_us - from_us)
        board.link.ask(Mute())  # or the next frame would not be in order
        board.arm()


@case("HG-9.3/1-requests", evidence=SELF_REPORTED)
def every_request_keeps_margins(board: BoardClient) -> None:
    """margins outlive every request but GET_STATUS: a new session, MUTE, PLAY and all the others"""
    board.require_no_status()
    send_phases_to_store_if_supported(board, _SEQUENCE, frames=2)
    messages = [m for m in valid_requests_to_send(board, _SEQUENCE) if not isinstance(m, GetStatus)]
    every: list[Message] = [Mute(), Arm(), *messages, board.hello_message(board.new_nonce())]
    try:
        _check_margins_behind(board, every)
    except CaseEndedError:
        for message in every:  # which one was it?
            with named(f"behind {message.TYPE.name}"):
                _check_margins_behind(board, [message])
        raise


def _check_margins_behind(board: BoardClient, messages: list[Message]) -> None:
    """FAILED unless the margins of three frames are those sent, behind *messages*."""
    board.hello()
    board.arm()
    board.status()
    # The last one is dropped.
    base_us = _send_ahead(board, board.flat_phases(), (_AHEAD_US, 3 * _AHEAD_US, 2 * _AHEAD_US))
    board.link.barrier()
    passed_us = board.clock.ready_us(board.clock.device_us() - base_us)
    for message in messages:
        if isinstance(message, Hello):
            board.hello()
        else:
            board.link.ask_at_once(message)
    least_us, mean_us = (n * _AHEAD_US - board.clock.ready_us(0) for n in (1, 2))
    _check_margins(board.status(), 3, least_us, mean_us, passed_us)


@case("HG-9.3/1-drops", evidence=SELF_REPORTED)
def every_dropped_margin(board: BoardClient) -> None:
    """frames dropped for order, room, horizon or lateness have a margin, those before step 13
    none
    """
    kind = stream_kinds(board)[0]
    for drop in DROPS:
        _, wires = frames_to_drop(board, drop, kind)
        board.status()  # margins begin anew
        board.link.send(*wires)
        due = len(wires) if drop.counter in _WITH_MARGIN else 0
        board.check_status(f"{len(wires)} frames {drop.summary}", margins=due)
        board.link.ask(Mute())


@case("HG-9.3/1-status", needs=Feature.CONFIG, evidence=SELF_REPORTED)
def every_status_restarts_margins(board: BoardClient) -> None:
    """the margins begin anew with STATUS as with STATUS_REPLY: of frames before it nothing is
    left
    """
    board.arm(status_period_ms=board.quick_status_ms)
    board.status()
    since = board.link.mark()
    board.link.stream(board.flat_phases(), board.clock.ahead_us(_AHEAD_US))
    timeout_us = 3000 * board.quick_status_ms
    board.due_event(Status, since, timeout_us)
    board.due_event(Status, board.link.mark(), timeout_us)
    # The frame may have come behind the first one; it is told of once.
    told = [status.margins for _, status in board.link.events(Status, since)]
    told.append(board.status().margins)
    check(sum(told) == 1, f"one frame was sent; the margins of STATUS tell of {told} frames")
