"""HG-4.9, HG-4.10: the reply of every type is remembered, whatever comes before its repetition."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from haptogram_protocol.messages import (
    DriveKind,
    ErrorCode,
    Feature,
    GetGeometry,
    Message,
    ReadDrive,
    ReadTrace,
    Stop,
    TraceMode,
)
from haptogram_protocol.rules import UPLOADS

from ...case import case
from ...client.board_client import BoardClient
from ...client.playback import (
    PERIOD_US,
    play_now,
    send_phases_that_fit,
    shortest_period_to_play_us,
)
from ...client.stream_kinds import refused_requests_to_send
from ...judge.repetition import (
    CHUNKS_BETWEEN,
    MUTES_BETWEEN,
    REFUSALS_BETWEEN,
    Between,
    every_request_to_repeat,
    flags_of_repetition,
    judge_repeated_reply,
)

_SEQUENCE: Final = 4
_FILLED_US: Final = 1_000_000


def _largest_remembered_request(board: BoardClient) -> Iterator[Message]:
    """Yield the requests whose replies are as long as the board makes them."""
    yield GetGeometry(0, 0xFFFF)
    for feature, kind in (
        (Feature.READ_LATCHED, DriveKind.LATCHED),
        (Feature.READ_RADIATED, DriveKind.RADIATED),
    ):
        if board.has(feature):
            yield ReadDrive(kind, 0, 0xFFFF)
    if board.has(Feature.TRACE_RING):
        yield ReadTrace(0, 0xFFFF)


def _fill_ring_for_remembered_reply(board: BoardClient) -> None:
    """Latch so often in a second at most that the ring fills a frame, if the board can."""
    if not board.has(Feature.TRACE_RING | Feature.CONFIG | Feature.SEQUENCE_PHASES):
        return
    board.configure(trace_mode=TraceMode.RING)
    board.arm()
    period_us = shortest_period_to_play_us(board, PERIOD_US // 4)
    play_now(board, _SEQUENCE, loops=100, period_us=period_us)
    board.wire.idle(min(250 * period_us, _FILLED_US))
    board.link.ask(Stop())


def _judge_remembered_reply(board: BoardClient, betweens: dict[str, Between]) -> None:
    """FAILED unless every request gets its reply again behind each of *betweens*."""
    for message in every_request_to_repeat(board):
        board.arm()
        wire, seq = board.link.request_wire(message, flags=flags_of_repetition(message))
        since = board.link.mark()
        board.link.send(wire)
        first = board.link.answer_to(message.TYPE, seq, since)
        for name, send in betweens.items():
            send(board)
            judge_repeated_reply(board, wire, seq, first, f"{message.TYPE.name} and {name}")


@case("HG-4.10/1-kept")
def remembered_reply_outlives_idempotent_requests(board: BoardClient) -> None:
    """a reply of every type, refusals too, is still remembered after MUTE and UPLOAD_CHUNK"""
    betweens = dict(MUTES_BETWEEN)
    if board.identity.features & UPLOADS:
        betweens |= CHUNKS_BETWEEN
    _judge_remembered_reply(board, betweens)


@case("HG-4.9/4-types")
def remembered_reply_outlives_refusals(board: BoardClient) -> None:
    """a reply of every type, refusals too, is still remembered after each refusal of steps 5 to
    11
    """
    _judge_remembered_reply(board, REFUSALS_BETWEEN)


@case("HG-4.9/1-replies")
def every_reply_is_remembered(board: BoardClient) -> None:
    """refused requests, and those with the longest replies, get the same bytes again"""
    if board.has(Feature.SEQUENCE_PHASES):
        send_phases_that_fit(board, _SEQUENCE, frames=2)
        _fill_ring_for_remembered_reply(board)
    board.arm()
    for message in [*refused_requests_to_send(board), *_largest_remembered_request(board)]:
        with board.counting(repeated=2, requests=1, frames=3):
            wire, seq = board.link.request_wire(message, flags=flags_of_repetition(message))
            since = board.link.mark()
            board.link.send(wire)
            first = board.link.answer_to(message.TYPE, seq, since)
            for _ in range(2):
                judge_repeated_reply(board, wire, seq, first, message.TYPE.name)
        board.link.refused(
            message, ErrorCode.SEQUENCE_REUSED, seq, seq=seq, flags=flags_of_repetition(message)
        )
