"""Uploads, one chunk after the other."""

from __future__ import annotations

import zlib
from collections.abc import Iterable
from typing import Final, TypeAlias

from haptogram_protocol.messages import (
    Error,
    ErrorCode,
    UploadBegin,
    UploadBeginReply,
    UploadChunk,
    UploadChunkReply,
    UploadCommit,
    UploadCommitReply,
    UploadKind,
)

from ..outcome import check
from .board_client import BoardClient

#: Every sequence that cases store, but those of a case that fills the store: a board may have room
#: for few, and none can be deleted.
SEQUENCES: Final = (1, 2, 3, 4, 5, 6, 7, 0x0101, 0x0201, 0x8001)
_LARGEST_CHUNK: Final = 1024


def upload_to_board(
    board: BoardClient, kind: UploadKind, target: int, data: bytes, points: int = 0
) -> None:
    """Upload *data* and commit it; FAILED if the board refuses a step."""
    begin_upload(board, kind, target, data, points)
    send_upload_chunks(board, data)
    board.link.call(UploadCommit(target), UploadCommitReply)
    if kind is UploadKind.CORRECTION:
        board.correction = data


def begin_upload(
    board: BoardClient, kind: UploadKind, target: int, data: bytes, points: int = 0
) -> UploadBeginReply:
    """Announce an upload of *data*; FAILED if the board refuses."""
    begin = UploadBegin(kind, points, target, len(data), zlib.crc32(data))
    return board.link.call(begin, UploadBeginReply)


def send_upload_chunks(board: BoardClient, data: bytes) -> None:
    """Send *data* in chunks, each after the reply to the one before."""
    size = max(1, min(board.identity.max_chunk, _LARGEST_CHUNK))
    for start in range(0, len(data), size):
        chunk = UploadChunk(start, data[start : start + size])
        received = board.link.call(chunk, UploadChunkReply).received
        due = start + len(chunk.data)
        check(received == due, f"UPLOAD_CHUNK_REPLY says {received} bytes, sent were {due}")


def gaps_in_uploaded_chunks(came: bytes | bytearray) -> int:
    """Return the gaps of HG-7.3 in a map that has a 1 for every byte that came."""
    return sum(1 for run in bytes(came).rstrip(b"\x00").split(b"\x01") if run)


Piece: TypeAlias = tuple[int, int]  # index of its first byte, and of the one behind it


def send_upload_in_pieces(board: BoardClient, data: bytes, pieces: Iterable[Piece]) -> list[Piece]:
    """Send pieces of *data*, and return those that the board refused for the gaps they would leave.

    FAILED if another piece is refused, or a reply does not tell what is there.
    """
    came, refused = bytearray(len(data)), []
    window = board.identity.upload_window
    for start, stop in pieces:
        after = bytearray(came)
        after[start:stop] = b"\x01" * (stop - start)
        answer = board.link.ask(UploadChunk(start, data[start:stop]))
        if isinstance(answer.message, Error) and gaps_in_uploaded_chunks(after) > window:
            error = board.link.error_in(answer, UploadChunk.TYPE, ErrorCode.TOO_LARGE)
            check(error.detail >= window, f"{error.detail} gaps at most; the window is {window}")
            refused.append((start, stop))
            continue
        reply = board.link.reply_in(answer, UploadChunkReply, UploadChunk.TYPE)
        came = after
        due = came.find(0) if 0 in came else len(data)
        check(reply.received == due, f"{reply.received} bytes without a gap are there, not {due}")
    return refused
