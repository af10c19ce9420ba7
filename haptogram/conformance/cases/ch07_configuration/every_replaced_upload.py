"""HG-7.4: uploads in place of others: nothing is left of their kind, their size, their bytes."""

from __future__ import annotations

import itertools
import zlib
from collections.abc import Iterator
from typing import Final, TypeAlias

from haptogram_protocol.messages import (
    ErrorCode,
    Feature,
    Points,
    TraceMode,
    UploadChunk,
    UploadChunkReply,
    UploadCommit,
    UploadKind,
)
from haptogram_protocol.rules import UPLOADS

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.latching import full_client_drive, latch_now, latches_received_from_board
from ...client.playback import period_to_play, play_out
from ...client.stream_kinds import random_point_to_send
from ...client.uploads import begin_upload, upload_to_board
from ...outcome import SELF_REPORTED, check_equal

_SEQUENCE: Final = 3
_OTHER: Final = 4
_LEAST_BYTES: Final = 40  # of an upload with pieces, if the board has room
_Form: TypeAlias = tuple[UploadKind, int, int]  # kind, points in a frame, frames


def _forms_of_uploads(board: BoardClient) -> list[_Form]:
    most = board.most_points
    forms = [(UploadKind.PHASES, 0, 2), (UploadKind.POINTS, 1, 3)]
    return forms + ([(UploadKind.POINTS, most, 1)] if most > 1 else [])


def _every_form_behind_every_form(forms: list[_Form]) -> Iterator[_Form]:
    """Yield forms in an order in which each stands behind each, itself too."""
    for first, second in itertools.combinations_with_replacement(forms, 2):
        yield from (first, second) if first == second else (first, second, first)


def _replace_upload(board: BoardClient, form: _Form) -> list[int]:
    """Upload a sequence of random drives; return the CRC-32 of each, as the stream latches it."""
    kind, points, frames = form
    if kind is UploadKind.PHASES:
        registers = [board.random.randbytes(board.identity.transducers) for _ in range(frames)]
        upload_to_board(board, kind, _SEQUENCE, b"".join(registers))
        return [zlib.crc32(full_client_drive(codes)) for codes in registers]
    messages = [
        Points(tuple(random_point_to_send(board, points) for _ in range(points)))
        for _ in range(frames)
    ]
    data = b"".join(message.serialize() for message in messages)
    upload_to_board(board, kind, _SEQUENCE, data, points)
    since = board.link.mark()
    for message in messages:
        latch_now(board, message)
    return [latch.crc for latch in latches_received_from_board(board, since, TraceMode.CRC)]


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
    other = [board.random.randbytes(board.identity.transducers) for _ in range(2)]
    period_us = period_to_play(board, board.most_points)
    before = "nothing"
    forms = list(_every_form_behind_every_form(_forms_of_uploads(board)))
    for place, form in enumerate(forms if board.thorough else forms[1:4]):
        due = _replace_upload(board, form)
        name = f"{form[0].name} of {form[1]} points, {form[2]} frames, in place of {before}"
        before = name.partition(",")[0]
        if place == 0:  # behind the first one; later replaced ones come behind it
            upload_to_board(board, UploadKind.PHASES, _OTHER, b"".join(other))
        for sequence, crcs in (
            (_SEQUENCE, due),
            (_OTHER, [zlib.crc32(full_client_drive(codes)) for codes in other]),
        ):
            since = board.link.mark()
            play_out(board, sequence, len(crcs), period_us=period_us)
            seen = latches_received_from_board(board, since, TraceMode.CRC)
            which = "" if sequence == _SEQUENCE else "beside it, the other sequence: "
            check_equal(
                [latch.crc for latch in seen],
                crcs,
                f"{name}: {which}latched are {len(seen)} other drives than the {len(crcs)} stored",
            )


def _uploads_with_pieces(board: BoardClient) -> Iterator[tuple[UploadKind, int, int, bytes]]:
    """Yield kind, points, target and bytes of an upload of every kind that the board takes."""
    identity = board.identity
    for feature, kind, points, frame in (
        (Feature.SEQUENCE_PHASES, UploadKind.PHASES, 0, identity.transducers),
        (Feature.SEQUENCE_POINTS, UploadKind.POINTS, 1, 16),
        (Feature.CORRECTION, UploadKind.CORRECTION, 0, identity.transducers),
    ):
        if not board.has(feature):
            continue
        is_sequence = kind is not UploadKind.CORRECTION
        most = min(identity.max_upload_bytes // frame, identity.max_sequence_frames)
        frames = min(most, -(-_LEAST_BYTES // frame)) if is_sequence else 1
        yield kind, points, _SEQUENCE * is_sequence, board.random.randbytes(frame * frames)


@case("HG-7.4/2-pieces", depth=Depth.DEFAULT)
def every_uploaded_piece_counts_for_itself(board: BoardClient) -> None:
    """behind a whole upload a part of the next one is INCOMPLETE"""
    board.need_any(UPLOADS)
    for kind, points, target, data in _uploads_with_pieces(board):
        size, most = len(data), board.identity.max_chunk
        for cut in sorted({1, 7, 8, 9, size // 2, size - 1} & set(range(1, min(size, most + 1)))):
            upload_to_board(board, kind, target, data, points)
            begin_upload(board, kind, target, data, points)
            board.link.call(UploadChunk(0, data[:cut]), UploadChunkReply)
            board.link.refused(UploadCommit(target), ErrorCode.INCOMPLETE, cut)
    if board.has(Feature.CORRECTION):
        none = bytes(board.identity.transducers)
        upload_to_board(board, UploadKind.CORRECTION, 0, none)
