"""HG-5.4, HG-7.2, HG-7.3: uploads of every kind, number of points and size of chunks."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from typing import Final

from haptogram_protocol.messages import (
    ErrorCode,
    Feature,
    FocalPoint,
    Points,
    TraceMode,
    UploadBegin,
    UploadChunk,
    UploadChunkReply,
    UploadCommit,
    UploadCommitReply,
    UploadKind,
)
from haptogram_protocol.rules import UPLOADS

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.latching import full_client_drive, latch_now, latches_received_from_board
from ...client.playback import period_to_play, play_out
from ...client.stream_kinds import random_point_to_send
from ...client.uploads import announce_upload, begin_upload, upload_to_board
from ...outcome import SELF_REPORTED, check, check_equal, require

_SEQUENCE: Final = 4
_FRAMES: Final = 3
_PLAYED: Final = 400  # frames at most
_TRACE_BYTES: Final = 60  # on the line, at most
_SIZES: Final = (1, 2, 3, 5, 7, 8, 9, 15, 16, 17, 31, 33, 63, 64, 65, 127, 129, 255, 256, 257)


def _upload_units(board: BoardClient) -> Iterator[tuple[UploadKind, int, int]]:
    """Yield every kind and number of points that the board takes, with the bytes of a frame."""
    count, most = board.identity.transducers, board.most_points
    if board.has(Feature.SEQUENCE_PHASES):
        yield UploadKind.PHASES, 0, count
    if board.has(Feature.CORRECTION):
        yield UploadKind.CORRECTION, 0, count
    if board.has(Feature.SEQUENCE_POINTS):
        for number in range(1, most + 1):
            yield UploadKind.POINTS, number, number * FocalPoint.LAYOUT.size


@case("HG-7.2/2-kinds")
def every_upload_is_of_whole_frames(board: BoardClient) -> None:
    """1 to 3 whole frames of every kind and number of points are taken, and no broken frame"""
    board.need_any(UPLOADS)
    for kind, points, unit in _upload_units(board):
        target = int(kind is not UploadKind.CORRECTION)
        for frames in range(1, 1 + target * _FRAMES or 2):
            if frames * unit <= board.identity.max_upload_bytes:
                begin = UploadBegin(kind, points, target, frames * unit, 0)
                announce_upload(board, begin)
        near = {unit + step for step in (-16, -4, -2, -1, 1, 2, 4, 16)}
        near |= {2 * unit + step for step in (-16, -1, 1, 16)} if target else set()
        for size in sorted(size for size in near if size > 0 and size % unit):
            if size <= board.identity.max_upload_bytes:
                begin = UploadBegin(kind, points, target, size, 0)
                board.link.refused(begin, ErrorCode.BAD_LENGTH, unit)


@case(
    "HG-5.4/1-played",
    needs=Feature.POINTS | Feature.SEQUENCE_POINTS | Feature.TRACE | Feature.CONFIG,
    evidence=SELF_REPORTED,
    depth=Depth.DEFAULT,
)
def every_number_of_points_is_played(board: BoardClient) -> None:
    """3 frames of every number of points are played as they are latched from the stream"""
    board.configure(trace_mode=TraceMode.CRC)
    for number in range(1, board.most_points + 1):
        groups = [
            tuple(random_point_to_send(board, number) for _ in range(number))
            for _ in range(_FRAMES)
        ]
        frames = [Points(group) for group in groups]
        data = b"".join(frame.serialize() for frame in frames)
        upload_to_board(board, UploadKind.POINTS, _SEQUENCE, data, number)
        since = board.arm()
        for frame in frames:
            latch_now(board, frame)
        play_out(board, _SEQUENCE, _FRAMES, period_us=period_to_play(board, number))
        found = latches_received_from_board(board, since, TraceMode.CRC)
        got = [latch.crc for latch in found]
        check_equal(len(got), 2 * _FRAMES, f"{len(got)} traces of {2 * _FRAMES} latches")
        same = got[:_FRAMES] == got[_FRAMES:]
        check(same, f"frames of {number} points are played with other drives than streamed")


@case(
    "HG-7.3/1-sizes",
    needs=Feature.SEQUENCE_PHASES | Feature.TRACE | Feature.CONFIG,
    evidence=SELF_REPORTED,
    depth=Depth.DEFAULT,
)
def every_size_of_chunks_is_taken(board: BoardClient) -> None:
    """chunks of 1 byte to max_chunk, even and odd, one behind the other: what is played is whole"""
    most, count = board.identity.max_chunk, board.identity.transducers
    sizes = sorted({size for size in _SIZES if size < most} | {most - 1, most})
    room = count * min(board.identity.max_sequence_frames, _PLAYED)
    room = min(room, board.identity.max_upload_bytes)
    while sizes and sum(sizes) + count > room:
        sizes.pop()
    require(bool(sizes), f"chunks of different sizes do not fit into uploads of {room} bytes")
    frames = -(-sum(sizes) // count)
    drives = [board.random.randbytes(count) for _ in range(frames)]
    data = b"".join(drives)
    begin_upload(board, UploadKind.PHASES, _SEQUENCE, data)
    at = 0
    for size in [*sizes, *[min(sizes)] * (len(data) - sum(sizes))]:
        chunk = UploadChunk(at, data[at : at + size])
        at = board.link.call(chunk, UploadChunkReply).received
    taken = board.link.call(UploadCommit(_SEQUENCE), UploadCommitReply).frames
    check(taken == frames, f"{taken} frames are taken, not {frames}")
    since = board.arm(trace_mode=TraceMode.CRC)
    period_us = board.wire.period_us(_TRACE_BYTES, period_to_play(board))
    play_out(board, _SEQUENCE, frames, period_us=period_us)
    got = [latch.crc for latch in latches_received_from_board(board, since, TraceMode.CRC)]
    due = [zlib.crc32(full_client_drive(drive)) for drive in drives]
    check_equal(got, due, "the sequence that is played is not the one uploaded")
