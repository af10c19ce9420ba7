"""HG-9.4, HG-9.5, HG-9.6: room for frames, and frames that give way on the uplink."""

from __future__ import annotations

import itertools
from typing import Final

from haptogram_protocol.messages import (
    Feature,
    GetGeometry,
    Ping,
    Pong,
)

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.playback import flood_with_traces
from ...outcome import SELF_REPORTED, check

_ASKED: Final = 40


@case(
    "HG-9.4/1",
    "stream frames of free_bytes bytes, sent without a pause, are all counted",
    evidence=SELF_REPORTED,
)
def free_bytes_are_free(board: BoardClient) -> None:
    frames = board.link.stream_wire(board.flat_phases())
    count = max(1, board.status().free_bytes // len(frames))
    with board.counting(dropped_state=count):
        board.link.send(
            frames, *(board.link.stream_wire(board.flat_phases()) for _ in range(count - 1))
        )
        board.wire.idle(board.wire.line_us(count * len(frames)))


@case("HG-9.5/1", "events count up without a gap, even where traces were dropped at the board")
def drops_no_numbers(board: BoardClient) -> None:
    board.need(Feature.TRACE_DRIVE | Feature.SEQUENCE_PHASES | Feature.CONFIG)
    since = board.link.mark()
    flood_with_traces(board)
    numbers = [
        piece.header.seq
        for piece in board.wire.received[since:]
        if piece.is_event and piece.header is not None
    ]
    gaps = [(b - a) & 0xFFFF for a, b in itertools.pairwise(numbers) if (b - a) & 0xFFFF != 1]
    check(not gaps, f"between events that follow each other: steps of {gaps[:5]}")


@case(
    "HG-9.6/1",
    "40 GET_GEOMETRY without a pause: whole frames come, then the board answers as before",
    depth=Depth.DEFAULT,
)
def bounds_its_output(board: BoardClient) -> None:
    wires = [board.link.request_wire(GetGeometry(0, 0xFFFF))[0] for _ in range(_ASKED)]
    since = board.link.mark()
    board.link.send(*wires)
    board.wire.idle(board.wire.line_us(_ASKED * 4200))
    broken = [piece for piece in board.wire.received[since:] if piece.fault]
    check(not broken, f"a frame came in pieces: {broken[0].fault if broken else ''}")
    board.link.call(Ping(3), Pong)
    check(board.status().free_bytes > 0, "free_bytes is 0 although nothing waits")
