"""HG-7.3, HG-7.5, HG-8.6: every span, every order of chunks."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from typing import Final

from haptogram_protocol.messages import (
    DriveKind,
    DriveReply,
    ErrorCode,
    Feature,
    GeometryReply,
    GetGeometry,
    ReadDrive,
    TraceMode,
    UploadChunk,
    UploadChunkReply,
    UploadCommit,
    UploadCommitReply,
    UploadKind,
)

from ...case import case
from ...client.board_client import BoardClient
from ...client.latching import full_client_drive, latch_now, latches_received_from_board, read_back
from ...client.playback import play_out
from ...client.stream_kinds import stream_kinds
from ...client.uploads import begin_upload, send_upload_in_pieces
from ...outcome import SELF_REPORTED, check

_SEQUENCE: Final = 3
_PIECES: Final = 12  # chunks of an upload
_OVERLAP: Final = 3  # bytes that come twice
_HOUR_US: Final = 3_600_000_000
_Chunks = list[tuple[int, int]]


def _spans_of_geometry(count: int) -> list[tuple[int, int]]:
    """Return (first, count) at and around every edge of an array of *count*."""
    firsts = {0, 1, count // 2, count - 1} & set(range(count))
    counts = {0, 1, 2, count - 1, count, count + 1, 0xFFFF}
    return sorted((first, number) for first in firsts for number in counts if number >= 0)


@case(
    "HG-7.5/1",
    "GET_GEOMETRY of spans at and around every edge shows the elements that the whole shows",
    variant="spans",
)
def every_span_of_the_geometry(board: BoardClient) -> None:
    whole, total = board.read_geometry(), board.identity.transducers
    for first, count in _spans_of_geometry(total):
        reply = board.link.call(GetGeometry(first, count), GeometryReply)
        due = whole[first : first + count]
        check((reply.total, reply.first) == (total, first), f"from {first}: {reply.first}")
        short = len(reply.elements) < min(len(due), 200)  # a frame holds more than these
        same = list(reply.elements) == due[: len(reply.elements)]
        check(same and not short, f"GET_GEOMETRY of {count} from {first} shows other elements")
    for first in (total, 0xFFFF):
        board.link.refused(GetGeometry(first, 1), ErrorCode.NOT_FOUND, total)


@case(
    "HG-8.6/1",
    "READ_DRIVE of spans at and around every edge shows the codes that the whole shows",
    variant="spans",
    needs=Feature.READ_LATCHED,
    evidence=SELF_REPORTED,
)
def every_span_of_drive_and_geometry(board: BoardClient) -> None:
    frame = stream_kinds(board)[-1].make()  # with amplitudes that differ, where it can
    kinds = [DriveKind.LATCHED]
    if board.has(Feature.READ_RADIATED):
        kinds.append(DriveKind.RADIATED)
    for kind in kinds:
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
            check(
                (reply.first, reply.data) == (first, due),
                f"READ_DRIVE({kind.name}) of {count} from {first} shows other codes",
            )
            check(reply.key == whole.reply.key, f"READ_DRIVE from {first} names another latch")


def _upload_chunks_forwards(chunks: _Chunks) -> _Chunks:
    return chunks


def _upload_chunks_backwards(chunks: _Chunks) -> _Chunks:
    return chunks[::-1]


def _upload_chunks_odd_first(chunks: _Chunks) -> _Chunks:
    return chunks[1::2] + chunks[::2]


def _upload_chunks_from_middle(chunks: _Chunks) -> _Chunks:
    middle = len(chunks) // 2
    return chunks[middle:] + chunks[:middle][::-1]


def _upload_chunks_overlapping(chunks: _Chunks) -> _Chunks:
    return [
        (max(0, start - _OVERLAP), stop)
        for start, stop in chunks[::3] + chunks[1::3] + chunks[2::3]
    ]


_ORDERS: Final[tuple[Callable[[_Chunks], _Chunks], ...]] = (
    _upload_chunks_forwards,
    _upload_chunks_backwards,
    _upload_chunks_odd_first,
    _upload_chunks_from_middle,
    _upload_chunks_overlapping,
)


@case(
    "HG-7.3/1",
    "12 chunks forwards, backwards, every second first, from the middle, overlapping: all is there",
    variant="orders",
    needs=Feature.SEQUENCE_PHASES | Feature.TRACE | Feature.CONFIG,
    evidence=SELF_REPORTED,
)
def every_order_of_upload_chunks(board: BoardClient) -> None:
    count = board.identity.transducers
    frames = max(3, -(-2 * _PIECES // count))
    for order in _ORDERS:
        name = order.__name__.strip("_").replace("_", " ")
        drives = [board.random.randbytes(count) for _ in range(frames)]
        data = b"".join(drives)
        size = min(-(-len(data) // _PIECES), board.identity.max_chunk - _OVERLAP)
        chunks = [(at, min(at + size, len(data))) for at in range(0, len(data), size)]
        begin_upload(board, UploadKind.PHASES, _SEQUENCE, data)
        refused = send_upload_in_pieces(board, data, order(chunks))
        for start, stop in sorted(refused):  # each begins at the first byte that is missing now
            board.link.call(UploadChunk(start, data[start:stop]), UploadChunkReply)
        taken = board.link.call(UploadCommit(_SEQUENCE), UploadCommitReply).frames
        check(taken == frames, f"{name}: {taken} frames are taken, not {frames}")
        _uploaded_chunks_play(board, name, drives)


def _uploaded_chunks_play(board: BoardClient, name: str, drives: list[bytes]) -> None:
    board.configure(trace_mode=TraceMode.CRC)
    board.arm()
    since = board.link.mark()
    play_out(board, _SEQUENCE, len(drives))
    got = [latch.crc for latch in latches_received_from_board(board, since, TraceMode.CRC)]
    due = [zlib.crc32(full_client_drive(drive)) for drive in drives]
    check(got == due, f"{name}: the sequence that is played is not the one uploaded")
