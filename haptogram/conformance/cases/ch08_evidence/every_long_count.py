"""HG-3.6, HG-8.4: latches and events of one session beyond 2^16."""

from __future__ import annotations

from typing import Final

from haptogram_protocol.messages import Feature, TraceDrive, TraceMode

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.playback import play_out, send_phases_to_store, shortest_period_to_play_us
from ...outcome import SELF_REPORTED, check, not_observed

_SEQUENCE: Final = 7
_LATCHES: Final = (1 << 16) + 465
_DIVIDER: Final = 1000  # no divisor of 2^16
_TRACE_BYTES: Final = 50  # on the line, at most
_EVENTS: Final = (1 << 16) + 100
_RUN: Final = _EVENTS // 6 + 1  # in one playback, of which the host keeps every trace
_LONGEST_US: Final = 60_000_000  # of a run at a wall clock
_NEEDS: Final = Feature.CONFIG | Feature.SEQUENCE_PHASES


@case(
    "HG-8.4/1",
    "of 66000 latches since SET_CONFIG each 1000th is traced, those behind 2^16 too",
    variant="many",
    needs=_NEEDS | Feature.TRACE_DRIVE,
    evidence=SELF_REPORTED,
    depth=Depth.DEFAULT,
    wall_depth=Depth.FULL,
)
def many_latches_are_traced_in_step(board: BoardClient) -> None:
    send_phases_to_store(board, _SEQUENCE, frames=1)
    board.configure(trace_mode=TraceMode.DRIVE, trace_divider=_DIVIDER)
    board.arm()
    since = board.link.mark()
    play_out(board, _SEQUENCE, 1, loops=_LATCHES, period_us=shortest_period_to_play_us(board))
    got = [(event.key.loop, event.key.index) for _, event in board.link.events(TraceDrive, since)]
    due = [(loop, 0) for loop in range(0, _LATCHES, _DIVIDER)]
    wrong = [pair for pair in zip(got, due, strict=False) if pair[0] != pair[1]]
    check(
        got == due,
        f"{len(got)} of {len(due)} latches are traced; (loop, index) seen and due {wrong[:1]}",
    )


@case(
    "HG-3.6/2",
    "66000 events of a session count up by 1, over 0xFFFF",
    variant="wrap",
    needs=_NEEDS | Feature.TRACE,
    evidence=SELF_REPORTED,
    depth=Depth.FULL,
)
def event_sequence_numbers_wrap(board: BoardClient) -> None:
    period_us = shortest_period_to_play_us(board, board.wire.line_us(_TRACE_BYTES))
    lasts_us = _EVENTS * period_us
    if board.wire.limits.slack_us and lasts_us > _LONGEST_US:
        not_observed(f"{_EVENTS} events take {lasts_us / 1e6:.0f} s on this line")
    send_phases_to_store(board, _SEQUENCE, frames=1)
    board.hello()
    board.configure(trace_mode=TraceMode.CRC)
    board.arm()
    number = 0
    while number < _EVENTS:
        since = board.link.mark()
        play_out(board, _SEQUENCE, 1, loops=_RUN, period_us=period_us)
        board.link.barrier()
        events = [piece for piece in board.wire.received[since:] if piece.is_event]
        check(len(events) > 1, f"no TRACE_PLAYBACK of {_RUN} latches")
        for piece in events:
            assert piece.header is not None  # is_event
            got, due = piece.header.seq, number & 0xFFFF
            check(got == due, f"event {number} of the session has seq {got}, due is {due}")
            number += 1
        board.wire.begin_case()  # forgets these pieces
