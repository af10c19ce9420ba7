"""HG-3.4, HG-9.1, HG-9.3: what STATUS tells of the stream, behind every request and playback."""

from __future__ import annotations

from typing import Final

from haptogram_protocol.annotation.frames import annotated_frame_text
from haptogram_protocol.messages import (
    Arm,
    Feature,
    Flag,
    GetStatus,
    Hello,
    Message,
    Mute,
    Play,
    Status,
    Trace,
    TraceMode,
    TracePlayback,
    signed_difference,
)

from ...case import case
from ...client.board_client import BoardClient
from ...client.latching import latch_now
from ...client.playback import play_out, send_phases_that_fit, send_phases_to_store_if_supported
from ...client.stream_kinds import stream_kinds, valid_requests_to_send
from ...outcome import SELF_REPORTED, check
from ..ch05_stream.every_drop import DROPS, frames_to_drop

_SEQUENCE: Final = 5
_AHEAD_US: Final = 400_000
#: Counters of steps 13 to 16 of HG-3.8.
_WITH_MARGIN: Final = ("dropped_order", "dropped_full", "dropped_future", "dropped_late")


@case("HG-9.3/1-requests", evidence=SELF_REPORTED)
def status_margins_outlive_requests(board: BoardClient) -> None:
    """margins outlive every request but GET_STATUS: a new session, MUTE, PLAY and all the others"""
    board.require_no_status()
    send_phases_to_store_if_supported(board, _SEQUENCE, frames=2)
    messages = [m for m in valid_requests_to_send(board, _SEQUENCE) if not isinstance(m, GetStatus)]
    every: list[Message] = [Mute(), Arm(), *messages, board.hello_message(board.new_nonce())]
    if _status_margins_behind(board, every):
        return
    for message in every:  # which one was it?
        check(_status_margins_behind(board, [message]), f"{message.TYPE.name} changes the margins")
    check(False, "margins of 3 frames are gone after every request but GET_STATUS")


@case("HG-3.4/3-late", needs=Feature.CONFIG)
def status_is_never_late(board: BoardClient) -> None:
    """behind a late latch no frame but its trace has LATE: no reply, no refusal, no STATUS"""
    send_phases_to_store_if_supported(board, _SEQUENCE, frames=2)
    trace = TraceMode.CRC if board.has(Feature.TRACE) else TraceMode.OFF
    period_ms = board.quick_status_ms
    board.configure(late_window_us=100_000, status_period_ms=period_ms, trace_mode=trace)
    board.arm()
    since = board.link.mark()
    late_us = board.late_time_us(5000)
    board.link.stream(board.flat_phases(), late_us)
    board.clock.wait_latched()
    board.wire.idle_beyond(1200 * period_ms)
    for message in [*valid_requests_to_send(board, _SEQUENCE), Mute()]:
        board.link.ask_at_once(message)
    for piece in board.wire.received[since:]:
        allowed = Flag.LATE if isinstance(piece.message, Trace | TracePlayback) else 0
        flags = piece.header.flags if piece.header is not None else 0
        check(not flags & ~allowed, f"flags {flags:#04x} in {annotated_frame_text(piece.piece)}")


@case("HG-9.1/2-playback", needs=Feature.SEQUENCE_PHASES, evidence=SELF_REPORTED)
def last_seq_in_status_is_of_the_stream(board: BoardClient) -> None:
    """a playback moves last_latch_us and not last_seq, which is of the last stream frame"""
    send_phases_that_fit(board, _SEQUENCE, frames=3)
    board.arm()
    index = latch_now(board)
    first = board.status()
    play_out(board, _SEQUENCE, 3, loops=3)
    second = board.status()
    check(second.last_seq == index, f"after a playback last_seq is {second.last_seq}, not {index}")
    apart_us = signed_difference(second.last_latch_us, first.last_latch_us, 32)
    check(apart_us > 0, f"a playback of 9 frames moved last_latch_us by {apart_us} µs")
    latch_now(board)
    third = board.status()
    check(third.last_seq == index + 1, f"last_seq is {third.last_seq}, not {index + 1}")


@case("HG-9.3/1-drops", evidence=SELF_REPORTED)
def every_drop_has_its_margin_in_status(board: BoardClient) -> None:
    """frames dropped for order, room, horizon or lateness have a margin, those before step 13
    none
    """
    kind = stream_kinds(board)[0]
    for drop in DROPS:
        _, wires = frames_to_drop(board, drop, kind)
        board.status()  # margins begin anew
        board.link.send(*wires)
        found, due = board.status().margins, len(wires) if drop.counter in _WITH_MARGIN else 0
        check(
            found == due,
            f"{len(wires)} frames {drop.summary}: the margins tell of {found}, {due} have one",
        )
        board.link.ask(Mute())


@case("HG-9.3/1-status", needs=Feature.CONFIG, evidence=SELF_REPORTED)
def status_and_its_reply_restart_margins(board: BoardClient) -> None:
    """the margins begin anew with STATUS as with STATUS_REPLY: of frames before it nothing is
    left
    """
    board.configure(status_period_ms=board.quick_status_ms)
    board.arm()
    board.status()
    since = board.link.mark()
    t_us = board.clock.ahead_us(_AHEAD_US)
    board.link.stream(board.flat_phases(), t_us)
    timeout_us = 3000 * board.quick_status_ms
    board.due_event(Status, since, timeout_us)
    board.due_event(Status, board.link.mark(), timeout_us)
    # The frame may have come behind the first one; it is told of once.
    told = [status.margins for _, status in board.link.events(Status, since)]
    told.append(board.status().margins)
    check(sum(told) == 1, f"one frame was sent; the margins of STATUS tell of {told} frames")


def _status_margins_behind(board: BoardClient, messages: list[Message]) -> bool:
    """Return whether the margins of three frames are those sent, behind *messages*."""
    board.hello()
    board.arm()
    board.status()
    now_us = board.clock.device_us()
    for ahead_us in (_AHEAD_US, 3 * _AHEAD_US, 2 * _AHEAD_US):  # the last one is dropped
        board.link.stream(board.flat_phases(), now_us + ahead_us)
    board.link.barrier()
    passed_us = board.clock.ready_us(board.clock.device_us() - now_us)
    for message in messages:
        flags = Flag.IMMEDIATE if isinstance(message, Play) else 0
        if isinstance(message, Hello):
            board.hello()
        else:
            board.link.ask(message, flags=flags)
    found = board.status()
    least_us, mean_us = (n * _AHEAD_US - board.clock.ready_us(0) for n in (1, 2))
    return (
        found.margins == 3
        and least_us - passed_us <= found.margin_min_us <= least_us
        and mean_us - passed_us - 1 <= found.margin_mean_us <= mean_us
    )
