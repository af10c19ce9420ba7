"""HG-5.4, HG-7.2, HG-7.3, HG-7.4: uploads of every kind, taken whole or not at all."""

from __future__ import annotations

import dataclasses
import itertools
import zlib
from collections.abc import Iterable, Iterator
from typing import Final

from haptogram_protocol import messages as m

from ...case import Depth, case
from ...client import latching, playback, uploads
from ...client.board_client import BoardClient
from ...client.capabilities import PLAYS, TRACED_PLAYS
from ...client.stream_kinds import random_points_to_send
from ...outcome import SELF_REPORTED, check, check_equal, check_fields, require

_LARGEST: Final = 0xFFFFFFFF
_TRACED_POINTS: Final = (
    m.Feature.POINTS | m.Feature.SEQUENCE_POINTS | m.Feature.TRACE | m.Feature.CONFIG
)
_TRACED: Final = _TRACED_POINTS | m.Feature.SEQUENCE_PHASES
_SEQUENCE: Final = 4
_FRAMES: Final = 3
_PLAYED: Final = 400  # frames at most
_TRACE_BYTES: Final = 60  # on the line, at most
_SIZES: Final = (1, 2, 3, 5, 7, 8, 9, 15, 16, 17, 31, 33, 63, 64, 65, 127, 129, 255, 256, 257)
_REPLACED: Final = 3
_OTHER: Final = 4
_LEAST_BYTES: Final = 40  # of an upload with pieces, if the board has room


def _sequence_form(board: BoardClient) -> uploads.UploadForm:
    """Return the first supported upload form of a sequence; else that of the correction.

    UNIMPLEMENTED if the board takes no upload.
    """
    return max(uploads.upload_forms(board), key=lambda form: form.target > 0)


@case("HG-7.2/1")
def refuses_uploads_too_large(board: BoardClient) -> None:
    """an upload of more bytes or frames than fit is refused: TOO_LARGE, detail: the limit"""
    form, identity = _sequence_form(board), board.identity
    most, frame = identity.max_upload_bytes, form.frame_bytes
    size, frames = most - most % frame + frame, identity.max_sequence_frames + 1
    has_size = form.target and size <= _LARGEST  # a correction of another size: HG-7.2/2
    has_frames = form.target and frames * frame <= most
    if has_size:
        told = board.link.refused(form.request(size), m.ErrorCode.TOO_LARGE).detail
        check(told <= most, f"the limit is {most}, the detail says {told}")
    if has_frames:
        board.link.refused(form.request(frames * frame), m.ErrorCode.TOO_LARGE, frames - 1)
    text = "no upload that 32 bits can announce is too large for this board"
    require(bool(has_size or has_frames), text)
    board.link.refused(m.UploadChunk(0, b"\x00"), m.ErrorCode.BAD_STATE)


@case("HG-7.2/7", needs_reset=True)
def takes_uploads_at_its_limits(board: BoardClient) -> None:
    """after a reset uploads of the advertised frames, points and bytes, and one less, are taken"""
    board.hello()
    for form in uploads.upload_forms(board, points=sorted({1, board.identity.max_points})):
        most = form.most_frames(board)
        for frames in {frames for frames in (1, most - 1, most) if 1 <= frames <= most}:
            board.link.call(form.request(frames * form.frame_bytes), m.UploadBeginReply)
    board.hello()  # which abandons the upload


@case("HG-7.2/2")
def refuses_uploads_of_broken_size(board: BoardClient) -> None:
    """sizes that are no whole frames are refused: BAD_LENGTH, detail: bytes in a frame"""
    _judge_sizes(board, uploads.upload_forms(board)[0])


def _judge_sizes(board: BoardClient, form: uploads.UploadForm) -> None:
    """FAILED unless uploads of 1 to 3 whole frames are accepted, and other sizes are refused."""
    most, unit = board.identity.max_upload_bytes, form.frame_bytes
    for frames in range(1, 1 + _FRAMES if form.target else 2):
        if frames * unit <= most:
            uploads.announce_upload(board, form.request(frames * unit))
    near = {0} | {unit + step for step in (-16, -4, -2, -1, 1, 2, 4, 16)}
    near |= {2 * unit + step for step in (-16, -1, 1, 16)}
    for size in sorted(near):
        if size == 0 or (0 < size <= most and size % unit):
            board.link.refused(form.request(size), m.ErrorCode.BAD_LENGTH, unit)


@case("HG-7.2/3")
def refuses_uploads_to_a_wrong_target(board: BoardClient) -> None:
    """sequence 0, and a correction for target 1, are refused with BAD_VALUE"""
    offset = m.UploadBegin.WIRE["target"].offset
    for form in uploads.upload_forms(board):
        wrong = dataclasses.replace(form.request(form.frame_bytes), target=int(not form.target))
        board.link.refused(wrong, m.ErrorCode.BAD_VALUE, offset)


@case("HG-7.2/4")
def upload_begins_anew(board: BoardClient) -> None:
    """a second UPLOAD_BEGIN discards the chunks of the first"""
    form = uploads.upload_forms(board)[0]
    data = b"\x07" * form.frame_bytes
    form.begin(board, data)
    uploads.send_upload_chunks(board, data)
    form.begin(board, data)
    board.link.refused(m.UploadCommit(form.target), m.ErrorCode.INCOMPLETE, 0)


@case("HG-7.2/5", needs=m.Feature.SEQUENCE_PHASES)
def upload_spares_the_playing_sequence(board: BoardClient) -> None:
    """UPLOAD_BEGIN for the sequence that plays is refused with BAD_STATE"""
    form = uploads.upload_forms(board, 5)[0]
    playback.send_phases_that_fit(board, form.target, frames=2)
    board.arm()
    playback.play_now(board, form.target, loops=0)
    board.link.refused(form.request(form.frame_bytes), m.ErrorCode.BAD_STATE, 1)


@case("HG-7.2/6")
def names_the_limits_of_uploads(board: BoardClient) -> None:
    """UPLOAD_BEGIN_REPLY names max_chunk and upload_window of HELLO_REPLY"""
    form = uploads.upload_forms(board)[0]
    reply = uploads.announce_upload(board, form.request(form.frame_bytes))
    limits = board.identity
    check_fields(reply, "reply", max_chunk=limits.max_chunk, window=limits.upload_window)


@case("HG-7.3/1")
def takes_chunks_in_order(board: BoardClient) -> None:
    """chunks in order are taken, the same and overlapping ones again; one behind a gap is
    refused
    """
    form = uploads.upload_forms(board)[0]
    frame = form.frame_bytes
    data = board.random.randbytes(frame)
    form.begin(board, data)
    size = max(1, min(board.identity.max_chunk // 2, 1 + frame // 5))
    for start in range(0, frame, size):
        for far in sorted({start + 1, frame - 1} & set(range(start + 1, frame))):
            board.link.refused(m.UploadChunk(far, b"\x00"), m.ErrorCode.INCOMPLETE, start)
        due = min(start + size, frame)
        for first, stop in ((max(0, start - size // 2), due), (start, due), (0, min(size, frame))):
            _send_chunk(board, m.UploadChunk(first, data[first:stop]), due)
    board.link.call(m.UploadCommit(form.target), m.UploadCommitReply)


def _send_chunk(board: BoardClient, chunk: m.UploadChunk, due: int) -> None:
    """Send *chunk*; FAILED unless it is accepted and the board reports *due* bytes received."""
    reply = board.link.call(chunk, m.UploadChunkReply)
    check_fields(reply, f"{len(chunk.data)} bytes at {chunk.offset}", received=due)


@case("HG-7.3/2")
def takes_a_window_of_chunks(board: BoardClient) -> None:
    """a window of chunks sent without a pause is taken whole"""
    form, identity = uploads.upload_forms(board)[0], board.identity
    most = identity.max_sequence_frames if form.target else 1
    frames = max(1, min(most, identity.upload_window * identity.max_chunk // form.frame_bytes))
    data = board.random.randbytes(form.frame_bytes * frames)
    reply = form.begin(board, data)
    starts = range(0, len(data), reply.max_chunk)[: reply.window]
    pieces = [m.UploadChunk(start, data[start : start + reply.max_chunk]) for start in starts]
    for answer in board.link.exchange(*(board.link.request_wire(piece)[0] for piece in pieces)):
        board.link.reply_in(answer, m.UploadChunkReply, m.UploadChunk.TYPE)
    _send_chunk(board, pieces[0], sum(len(piece.data) for piece in pieces))


@case("HG-7.3/3")
def limits_the_chunks_of_an_upload(board: BoardClient) -> None:
    """a chunk of max_chunk bytes is taken; one byte more is refused with BAD_LENGTH"""
    form, limit = _sequence_form(board), board.identity.max_chunk
    text = "no chunk longer than max_chunk fits, or makes sense"
    require(limit < 4000 and (form.target > 0 or form.frame_bytes > limit), text)
    frames = -(-(limit + 1) // form.frame_bytes)
    form.begin(board, bytes(form.frame_bytes * frames))
    board.link.refused(m.UploadChunk(0, bytes(limit + 1)), m.ErrorCode.BAD_LENGTH, limit)
    _send_chunk(board, m.UploadChunk(0, bytes(limit)), limit)


@case("HG-7.3/4")
def refuses_stray_upload_chunks(board: BoardClient) -> None:
    """a chunk past the end is refused with BAD_VALUE, one without an upload with BAD_STATE"""
    form = uploads.upload_forms(board)[0]
    frame = form.frame_bytes
    board.hello()
    board.link.refused(m.UploadChunk(0, b"\x01"), m.ErrorCode.BAD_STATE)
    _judge_chunks(
        board, form, frame, ((frame, 1), (frame - 1, 2), (_LARGEST - 15, 1), (_LARGEST, 2))
    )


@case("HG-7.3/4-edges")
def takes_chunks_that_fit(board: BoardClient) -> None:
    """chunks of 0, 1, 2 and max_chunk bytes at every edge: those at the start are taken"""
    form = uploads.upload_forms(board)[0]
    size = form.frame_bytes * (3 if form.target else 1)
    offsets = (0, 1, size // 2, size - 1, size, size + 1, 1 << 16, 1 << 31, _LARGEST)
    lengths = (0, 1, 2, board.identity.max_chunk)
    _judge_chunks(board, form, size, itertools.product(offsets, lengths))


def _judge_chunks(
    board: BoardClient, form: uploads.UploadForm, size: int, spans: Iterable[tuple[int, int]]
) -> None:
    """FAILED unless only chunks that start at offset 0 and fit in the upload are accepted.

    Each of *spans* (offset, length) is the first chunk of an upload of *size* bytes.
    """
    for offset, length in spans:
        form.begin(board, bytes(size))
        chunk = m.UploadChunk(offset, bytes(length))
        if offset == 0 and length <= size:
            _send_chunk(board, chunk, length)
        else:
            is_beyond = offset + length > size
            code = m.ErrorCode.BAD_VALUE if is_beyond else m.ErrorCode.INCOMPLETE
            board.link.refused(chunk, code, 0)


@case("HG-7.4/1", needs=PLAYS, evidence=SELF_REPORTED)
def upload_keeps_the_old_sequence(board: BoardClient) -> None:
    """until the commit the old sequence plays, then the new one, whole"""
    mode = latching.ask_for_board_latches(board)
    old = playback.send_phases_to_store(board, 6, frames=2)
    new = [board.random_registers() for _ in range(2)]
    uploads.begin_upload(board, m.UploadKind.PHASES, 6, b"".join(new))
    uploads.send_upload_chunks(board, b"".join(new))
    for which, due in (("old", old), ("new", new)):
        board.hello()  # a new session: the ring begins anew, and an upload that is not committed
        if due is new:
            uploads.upload_to_board(board, m.UploadKind.PHASES, 6, b"".join(new))
        got = latching.played_crcs(board, 6, 2, mode)
        check_equal(
            got, list(map(latching.drive_crc, due)), f"CRC-32 of the {which} sequence, which is due"
        )


@case("HG-7.4/2")
def refuses_upload_commits_of_a_part(board: BoardClient) -> None:
    """a commit with bytes missing is refused: INCOMPLETE, detail: the first of them"""
    form = uploads.upload_forms(board)[0]
    frames = 2 if form.target else 1
    data = board.random.randbytes(form.frame_bytes * frames)
    form.begin(board, data)
    board.link.refused(m.UploadCommit(form.target), m.ErrorCode.INCOMPLETE, 0)
    board.link.call(m.UploadChunk(0, data[:1]), m.UploadChunkReply)
    if len(data) > 1:
        board.link.refused(m.UploadCommit(form.target), m.ErrorCode.INCOMPLETE, 1)
    size = board.identity.max_chunk
    for start in range(0, len(data), size):  # some of it is there already
        board.link.call(m.UploadChunk(start, data[start : start + size]), m.UploadChunkReply)
    reply = board.link.call(m.UploadCommit(form.target), m.UploadCommitReply)
    due = frames if form.target else board.identity.transducers
    check_fields(reply, "UPLOAD_COMMIT_REPLY", frames=due)


@case("HG-7.4/3")
def refuses_upload_commits_of_other_bytes(board: BoardClient) -> None:
    """a commit of other bytes than announced is refused: CRC_MISMATCH, detail: their CRC-32"""
    form = uploads.upload_forms(board)[0]
    data = board.random.randbytes(form.frame_bytes)
    crc = zlib.crc32(data)
    uploads.announce_upload(board, form.request(len(data), crc ^ 0x10))
    uploads.send_upload_chunks(board, data)
    board.link.refused(m.UploadCommit(form.target), m.ErrorCode.CRC_MISMATCH, crc)


@case("HG-7.4/4")
def refuses_a_stray_upload_commit(board: BoardClient) -> None:
    """a commit of another target is refused with BAD_VALUE, one without an upload with BAD_STATE"""
    form = uploads.upload_forms(board)[0]
    board.hello()
    board.link.refused(m.UploadCommit(form.target), m.ErrorCode.BAD_STATE)
    data = bytes(form.frame_bytes)
    form.begin(board, data)
    uploads.send_upload_chunks(board, data)
    board.link.refused(m.UploadCommit(form.target + 1), m.ErrorCode.BAD_VALUE, 0)


@case("HG-7.2/2-kinds")
def every_upload_is_of_whole_frames(board: BoardClient) -> None:
    """1 to 3 whole frames of every kind and number of points are taken, and no broken frame"""
    for form in uploads.upload_forms(board, points=range(1, board.most_points + 1)):
        _judge_sizes(board, form)


@case("HG-5.4/1-played", needs=_TRACED_POINTS, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_number_of_points_is_played(board: BoardClient) -> None:
    """3 frames of every number of points are played as they are latched from the stream"""
    board.arm(trace_mode=m.TraceMode.CRC)
    for number in range(1, board.most_points + 1):
        frames = [random_points_to_send(board, number) for _ in range(_FRAMES)]
        data = b"".join(frame.serialize() for frame in frames)
        uploads.upload_to_board(board, m.UploadKind.POINTS, _SEQUENCE, data, number)
        streamed = latching.streamed_crcs(board, frames)
        period_us = playback.period_to_play(board, number)
        played = latching.played_crcs(board, _SEQUENCE, _FRAMES, period_us=period_us)
        check_equal(len(streamed), _FRAMES, f"{len(streamed)} traces of {_FRAMES} frames")
        check_equal(played, streamed, f"CRC-32 of {_FRAMES} frames of {number} points, played")


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
    uploads.begin_upload(board, m.UploadKind.PHASES, _SEQUENCE, data)
    at = 0
    for size in [*sizes, *[min(sizes)] * (len(data) - sum(sizes))]:
        chunk = m.UploadChunk(at, data[at : at + size])
        at = board.link.call(chunk, m.UploadChunkReply).received
    reply = board.link.call(m.UploadCommit(_SEQUENCE), m.UploadCommitReply)
    check_fields(reply, "UPLOAD_COMMIT_REPLY", frames=frames)
    board.configure(trace_mode=m.TraceMode.CRC)
    period_us = board.wire.period_us(_TRACE_BYTES, playback.period_to_play(board))
    got = latching.played_crcs(board, _SEQUENCE, frames, period_us=period_us)
    due = list(map(latching.drive_crc, drives))
    check_equal(got, due, "the sequence that is played is not the one uploaded")


# --- In place of others -------------------------------------------------------------------------


def _replaced_forms(board: BoardClient) -> Iterator[tuple[uploads.UploadForm, int]]:
    """Yield upload forms, with a number of frames, so that each follows itself and every other."""
    found = uploads.upload_forms(board, _REPLACED, sorted({1, board.most_points}))
    forms = [form for form in found if form.target]
    pairs = list(zip(forms, (2, 3, 1), strict=False))
    for first, second in itertools.combinations_with_replacement(pairs, 2):
        yield from (first, second) if first == second else (first, second, first)


def _replace_upload(board: BoardClient, form: uploads.UploadForm, frames: int) -> list[int]:
    """Upload a sequence of random frames; return the CRC-32 of the drive of each."""
    if form.kind is m.UploadKind.PHASES:
        return list(
            map(latching.drive_crc, playback.send_phases_to_store(board, _REPLACED, frames=frames))
        )
    messages = [random_points_to_send(board, form.points) for _ in range(frames)]
    form.upload(board, b"".join(message.serialize() for message in messages))
    return latching.streamed_crcs(board, messages)


@case("HG-7.4/1-kinds", needs=_TRACED, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_replaced_upload_leaves_nothing(board: BoardClient) -> None:
    """a sequence in place of one of every kind and number of points, and that beside it, are
    whole
    """
    board.arm(trace_mode=m.TraceMode.CRC)
    period_us = playback.period_to_play(board, board.most_points)
    before = "nothing"
    other: list[int] = []
    forms = list(_replaced_forms(board))
    for form, frames in forms if board.thorough else forms[1:4]:
        due = _replace_upload(board, form, frames)
        kind = f"{form.kind.name} of {form.points} points"
        name = f"{kind}, {frames} frames, in place of {before}"
        before = kind
        if not other:  # behind the first one; later replaced ones come behind it
            other = list(
                map(latching.drive_crc, playback.send_phases_to_store(board, _OTHER, frames=2))
            )
        for sequence, crcs in ((_REPLACED, due), (_OTHER, other)):
            seen = latching.played_crcs(board, sequence, len(crcs), period_us=period_us)
            which = "" if sequence == _REPLACED else ", the other sequence beside it"
            check_equal(seen, crcs, f"{name}{which}: CRC-32 of the drives stored")


@case("HG-7.4/2-pieces", depth=Depth.DEFAULT)
def every_uploaded_piece_counts_for_itself(board: BoardClient) -> None:
    """behind a whole upload a part of the next one is INCOMPLETE"""
    most = board.identity.max_chunk
    for form in uploads.upload_forms(board, _REPLACED):
        frames = min(form.most_frames(board), -(-_LEAST_BYTES // form.frame_bytes))
        data = board.random.randbytes(form.frame_bytes * frames)
        size = len(data)
        for cut in sorted({1, 7, 8, 9, size // 2, size - 1} & set(range(1, min(size, most + 1)))):
            form.upload(board, data)
            form.begin(board, data)
            board.link.call(m.UploadChunk(0, data[:cut]), m.UploadChunkReply)
            board.link.refused(m.UploadCommit(form.target), m.ErrorCode.INCOMPLETE, cut)
