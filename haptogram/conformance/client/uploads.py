"""Uploads, one chunk after the other."""

from __future__ import annotations

import zlib
from typing import Final

from haptogram_protocol.messages import (
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

_LARGEST_CHUNK: Final = 1024


def upload_to_board(
    board: BoardClient, kind: UploadKind, target: int, data: bytes, points: int = 0
) -> None:
    """Upload *data* and commit it; FAILED if the board refuses a step."""
    begin_upload(board, kind, target, data, points)
    send_chunks(board, data)
    board.link.call(UploadCommit(target), UploadCommitReply)


def begin_upload(
    board: BoardClient, kind: UploadKind, target: int, data: bytes, points: int = 0
) -> UploadBeginReply:
    """Announce an upload of *data*; FAILED if the board refuses."""
    begin = UploadBegin(kind, points, target, len(data), zlib.crc32(data))
    return board.link.call(begin, UploadBeginReply)


def send_chunks(board: BoardClient, data: bytes) -> None:
    """Send *data* in chunks, each after the reply to the one before."""
    size = max(1, min(board.identity.max_chunk, _LARGEST_CHUNK))
    for start in range(0, len(data), size):
        chunk = UploadChunk(start, data[start : start + size])
        received = board.link.call(chunk, UploadChunkReply).received
        due = start + len(chunk.data)
        check(received == due, f"UPLOAD_CHUNK_REPLY says {received} bytes, sent were {due}")
