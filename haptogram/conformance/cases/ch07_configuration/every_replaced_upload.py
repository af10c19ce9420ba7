"""HG-7.4: uploads in place of others: nothing is left of their kind, their size, their bytes."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Final

from haptogram_protocol.messages import (
    ErrorCode,
    Feature,
    TraceMode,
    UploadChunk,
    UploadChunkReply,
    UploadCommit,
    UploadKind,
)

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.latching import drive_crc, played_crcs, streamed_crcs
from ...client.playback import period_to_play, send_phases_to_store
from ...client.stream_kinds import random_points_to_send
from ...client.uploads import UploadForm, upload_correction, upload_forms
from ...outcome import SELF_REPORTED, check_equal

_SEQUENCE: Final = 3
_OTHER: Final = 4
_LEAST_BYTES: Final = 40  # of an upload with pieces, if the board has room


def _replaced_forms(board: BoardClient) -> Iterator[tuple[UploadForm, int]]:
    """Yield forms, and numbers of frames, in an order in which each stands behind each."""
    found = upload_forms(board, _SEQUENCE, sorted({1, board.most_points}))
    forms = [form for form in found if form.target]
    pairs = list(zip(forms, (2, 3, 1), strict=False))
    for first, second in itertools.combinations_with_replacement(pairs, 2):
        yield from (first, second) if first == second else (first, second, first)


def _replace_upload(board: BoardClient, form: UploadForm, frames: int) -> list[int]:
    """Upload a sequence of random drives; return the CRC-32 of each, as the stream latches it."""
    if form.kind is UploadKind.PHASES:
        return list(map(drive_crc, send_phases_to_store(board, _SEQUENCE, frames=frames)))
    messages = [random_points_to_send(board, form.points) for _ in range(frames)]
    form.upload(board, b"".join(message.serialize() for message in messages))
    return streamed_crcs(board, messages)


@case(
    "HG-7.4/1-kinds",
    needs=Feature.SEQUENCE_PHASES
    | Feature.SEQUENCE_POINTS
    | Feature.POINTS
    | Feature.TRACE
    | Feature.CONFIG,
    evidence=SELF_REPORTED,
    depth=Depth.DEFAULT,
)
def a_replaced_upload_leaves_nothing(board: BoardClient) -> None:
    """a sequence in place of one of every kind and number of points, and that beside it, are
    whole
    """
    board.arm(trace_mode=TraceMode.CRC)
    period_us = period_to_play(board, board.most_points)
    before = "nothing"
    other: list[int] = []
    forms = list(_replaced_forms(board))
    for form, frames in forms if board.thorough else forms[1:4]:
        due = _replace_upload(board, form, frames)
        kind = f"{form.kind.name} of {form.points} points"
        name = f"{kind}, {frames} frames, in place of {before}"
        before = kind
        if not other:  # behind the first one; later replaced ones come behind it
            other = list(map(drive_crc, send_phases_to_store(board, _OTHER, frames=2)))
        for sequence, crcs in ((_SEQUENCE, due), (_OTHER, other)):
            seen = played_crcs(board, sequence, len(crcs), period_us=period_us)
            which = "" if sequence == _SEQUENCE else "beside it, the other sequence: "
            text = f"latched are {len(seen)} other drives than the {len(crcs)} stored"
            check_equal(seen, crcs, f"{name}: {which}{text}")


@case("HG-7.4/2-pieces", depth=Depth.DEFAULT)
def every_uploaded_piece_counts_for_itself(board: BoardClient) -> None:
    """behind a whole upload a part of the next one is INCOMPLETE"""
    most = board.identity.max_chunk
    for form in upload_forms(board, _SEQUENCE):
        frames = min(form.most_frames(board), -(-_LEAST_BYTES // form.frame_bytes))
        data = board.random.randbytes(form.frame_bytes * frames)
        size = len(data)
        for cut in sorted({1, 7, 8, 9, size // 2, size - 1} & set(range(1, min(size, most + 1)))):
            form.upload(board, data)
            form.begin(board, data)
            board.link.call(UploadChunk(0, data[:cut]), UploadChunkReply)
            board.link.refused(UploadCommit(form.target), ErrorCode.INCOMPLETE, cut)
    if board.has(Feature.CORRECTION):
        upload_correction(board, bytes(board.identity.transducers))
