"""HG-7.5, HG-8.6: every span."""

from __future__ import annotations

from typing import Final

from haptogram_protocol.messages import (
    DriveReply,
    ErrorCode,
    Feature,
    GeometryReply,
    GetGeometry,
    ReadDrive,
)

from ...case import case
from ...client.board_client import BoardClient
from ...client.capabilities import drive_kinds
from ...client.latching import latch_now, read_back
from ...client.stream_kinds import stream_kinds
from ...outcome import SELF_REPORTED, check, check_equal

_HOUR_US: Final = 3_600_000_000


def _spans_of_geometry(count: int) -> list[tuple[int, int]]:
    """Return (first, count) at and around every edge of an array of *count*."""
    firsts = {0, 1, count // 2, count - 1} & set(range(count))
    counts = {0, 1, 2, count - 1, count, count + 1, 0xFFFF}
    return sorted((first, number) for first in firsts for number in counts if number >= 0)


@case("HG-7.5/1-spans")
def every_span_of_the_geometry(board: BoardClient) -> None:
    """GET_GEOMETRY of spans at and around every edge shows the elements that the whole shows"""
    whole, total = board.read_geometry(), board.identity.transducers
    for first, count in _spans_of_geometry(total):
        reply = board.link.call(GetGeometry(first, count), GeometryReply)
        due = whole[first : first + count]
        check_equal((reply.total, reply.first), (total, first), f"from {first}: {reply.first}")
        short = len(reply.elements) < min(len(due), 200)  # a frame holds more than these
        same = list(reply.elements) == due[: len(reply.elements)]
        check(same and not short, f"GET_GEOMETRY of {count} from {first} shows other elements")
    for first in (total, 0xFFFF):
        board.link.refused(GetGeometry(first, 1), ErrorCode.NOT_FOUND, total)


@case("HG-8.6/1-spans", needs=Feature.READ_LATCHED, evidence=SELF_REPORTED)
def every_span_of_drive_and_geometry(board: BoardClient) -> None:
    """READ_DRIVE of spans at and around every edge shows the codes that the whole shows"""
    frame = stream_kinds(board)[-1].make()  # with amplitudes that differ, where it can
    for kind in drive_kinds(board):
        latched_us, total = -_HOUR_US, board.identity.transducers
        for first, count in _spans_of_geometry(total):
            if board.wire.now_us() - latched_us > 250 * board.config.hold_ms:
                board.arm_anew()
                latched_us = board.wire.now_us()
                latch_now(board, frame)
                whole = read_back(board, kind)
            reply = board.link.call(ReadDrive(kind, first, count), DriveReply)
            end = min(first + count, total)
            due = whole.phases[first:end] + whole.amplitudes[first:end]
            text = f"READ_DRIVE({kind.name}) of {count} from {first} shows other codes"
            check_equal((reply.first, reply.data), (first, due), text)
            check_equal(reply.key, whole.reply.key, f"READ_DRIVE from {first} names another latch")
