"""HG-5.4, HG-7.2, HG-7.3, HG-7.4: uploads of every kind, number of points and size of chunks.

One in place of another leaves nothing of its kind, its size, its bytes.
"""

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
    UploadCommitReply,
    UploadKind,
)

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.capabilities import TRACED_PLAYS
from ...client.latching import drive_crc, played_crcs, streamed_crcs
from ...client.playback import period_to_play, send_phases_to_store
from ...client.stream_kinds import random_points_to_send
from ...client.uploads import (
    UploadForm,
    announce_upload,
    begin_upload,
    upload_correction,
    upload_forms,
    upload_to_board,
)
from ...outcome import SELF_REPORTED, check, check_equal, require

_TRACED_POINTS: Final = Feature.POINTS | Feature.SEQUENCE_POINTS | Feature.TRACE | Feature.CONFIG
_SEQUENCE: Final = 4
_FRAMES: Final = 3
_PLAYED: Final = 400  # frames at most
_TRACE_BYTES: Final = 60  # on the line, at most
_SIZES: Final = (1, 2, 3, 5, 7, 8, 9, 15, 16, 17, 31, 33, 63, 64, 65, 127, 129, 255, 256, 257)
_REPLACED: Final = 3
_OTHER: Final = 4
_LEAST_BYTES: Final = 40  # of an upload with pieces, if the board has room


@case("HG-7.2/2-kinds")
def every_upload_is_of_whole_frames(board: BoardClient) -> None:
    """1 to 3 whole frames of every kind and number of points are taken, and no broken frame"""
    most = board.identity.max_upload_bytes
    for form in upload_forms(board, points=range(1, board.most_points + 1)):
        unit = form.frame_bytes
        for frames in range(1, 1 + _FRAMES if form.target else 2):
            if frames * unit <= most:
                announce_upload(board, form.request(frames * unit))
        near = {unit + step for step in (-16, -4, -2, -1, 1, 2, 4, 16)}
        near |= {2 * unit + step for step in (-16, -1, 1, 16)} if form.target else set()
        for size in sorted(size for size in near if 0 < size <= most and size % unit):
            board.link.refused(form.request(size), ErrorCode.BAD_LENGTH, unit)


@case("HG-5.4/1-played", needs=_TRACED_POINTS, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_number_of_points_is_played(board: BoardClient) -> None:
    """3 frames of every number of points are played as they are latched from the stream"""
    board.arm(trace_mode=TraceMode.CRC)
    for number in range(1, board.most_points + 1):
        frames = [random_points_to_send(board, number) for _ in range(_FRAMES)]
        data = b"".join(frame.serialize() for frame in frames)
        upload_to_board(board, UploadKind.POINTS, _SEQUENCE, data, number)
        streamed = streamed_crcs(board, frames)
        period_us = period_to_play(board, number)
        played = played_crcs(board, _SEQUENCE, _FRAMES, period_us=period_us)
        traces = len(streamed) + len(played)
        check_equal(traces, 2 * _FRAMES, f"{traces} traces of {2 * _FRAMES} latches")
        text = f"frames of {number} points are played with other drives than streamed"
        check(played == streamed, text)


@case("HG-7.3/1-sizes", needs=TRACED_PLAYS, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
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
    board.configure(trace_mode=TraceMode.CRC)
    period_us = board.wire.period_us(_TRACE_BYTES, period_to_play(board))
    got = played_crcs(board, _SEQUENCE, frames, period_us=period_us)
    due = list(map(drive_crc, drives))
    check_equal(got, due, "the sequence that is played is not the one uploaded")


# --- In place of others -------------------------------------------------------------------------


def _replaced_forms(board: BoardClient) -> Iterator[tuple[UploadForm, int]]:
    """Yield forms, and numbers of frames, in an order in which each stands behind each."""
    found = upload_forms(board, _REPLACED, sorted({1, board.most_points}))
    forms = [form for form in found if form.target]
    pairs = list(zip(forms, (2, 3, 1), strict=False))
    for first, second in itertools.combinations_with_replacement(pairs, 2):
        yield from (first, second) if first == second else (first, second, first)


def _replace_upload(board: BoardClient, form: UploadForm, frames: int) -> list[int]:
    """Upload a sequence of random drives; return the CRC-32 of each, as the stream latches it."""
    if form.kind is UploadKind.PHASES:
        return list(map(drive_crc, send_phases_to_store(board, _REPLACED, frames=frames)))
    messages = [random_points_to_send(board, form.points) for _ in range(frames)]
    form.upload(board, b"".join(message.serialize() for message in messages))
    return streamed_crcs(board, messages)


@case(
    "HG-7.4/1-kinds",
    needs=_TRACED_POINTS | Feature.SEQUENCE_PHASES,
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
        for sequence, crcs in ((_REPLACED, due), (_OTHER, other)):
            seen = played_crcs(board, sequence, len(crcs), period_us=period_us)
            which = "" if sequence == _REPLACED else "beside it, the other sequence: "
            text = f"latched are {len(seen)} other drives than the {len(crcs)} stored"
            check_equal(seen, crcs, f"{name}: {which}{text}")


@case("HG-7.4/2-pieces", depth=Depth.DEFAULT)
def every_uploaded_piece_counts_for_itself(board: BoardClient) -> None:
    """behind a whole upload a part of the next one is INCOMPLETE"""
    most = board.identity.max_chunk
    for form in upload_forms(board, _REPLACED):
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
