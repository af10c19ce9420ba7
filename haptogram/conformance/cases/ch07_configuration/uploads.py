"""HG-7.2, HG-7.3, HG-7.4: uploads, refused before the first byte, taken whole or not at all."""

from __future__ import annotations

import zlib
from typing import Final

from haptogram_protocol.messages import (
    ErrorCode,
    Feature,
    UploadBegin,
    UploadBeginReply,
    UploadChunk,
    UploadChunkReply,
    UploadCommit,
    UploadCommitReply,
    UploadKind,
)

from ...case import case
from ...client.board_client import BoardClient
from ...client.latching import ask_for_board_latches, latches_received_from_board
from ...client.playback import play_now, play_out, send_phases_that_fit, send_phases_to_store
from ...client.uploads import (
    announce_upload,
    begin_upload,
    send_upload_chunks,
    upload_to_board,
)
from ...outcome import SELF_REPORTED, check, check_equal, require

_ANY: Final = Feature.SEQUENCE_PHASES | Feature.SEQUENCE_POINTS | Feature.CORRECTION
_LARGEST: Final = 0xFFFFFFFF


def _upload_kind(board: BoardClient) -> tuple[UploadKind, int, int]:
    """Return a kind that the board takes, a target for it and the bytes of one frame."""
    board.need_any(_ANY)
    if board.has(Feature.SEQUENCE_PHASES):
        return UploadKind.PHASES, 1, board.identity.transducers
    if board.has(Feature.CORRECTION):
        return UploadKind.CORRECTION, 0, board.identity.transducers
    return UploadKind.POINTS, 1, 16


def _begin_upload_of_size(board: BoardClient, size: int, crc: int = 0) -> UploadBegin:
    kind, target, _ = _upload_kind(board)
    return UploadBegin(kind, int(kind is UploadKind.POINTS), target, size, crc)


@case("HG-7.2/1")
def refuses_uploads_too_large(board: BoardClient) -> None:
    """an upload of more bytes or frames than fit is refused: TOO_LARGE, detail: the limit"""
    kind, _, frame = _upload_kind(board)
    identity = board.identity
    size = identity.max_upload_bytes - identity.max_upload_bytes % frame + frame
    tested = False
    if kind is not UploadKind.CORRECTION and size <= _LARGEST:  # of another size: HG-7.2/2
        error = board.link.refused(_begin_upload_of_size(board, size), ErrorCode.TOO_LARGE)
        check(
            error.detail <= identity.max_upload_bytes,
            f"the limit is {identity.max_upload_bytes}, the detail says {error.detail}",
        )
        tested = True
    frames = identity.max_sequence_frames + 1
    if kind is not UploadKind.CORRECTION and frames * frame <= identity.max_upload_bytes:
        board.link.refused(
            _begin_upload_of_size(board, frames * frame),
            ErrorCode.TOO_LARGE,
            identity.max_sequence_frames,
        )
        tested = True
    require(bool(tested), "no upload that 32 bits can announce is too large for this board")
    board.link.refused(UploadChunk(0, b"\x00"), ErrorCode.BAD_STATE)


@case("HG-7.2/7", needs_reset=True)
def takes_uploads_at_its_limits(board: BoardClient) -> None:
    """after a reset uploads of the advertised frames, points and bytes, and one less, are taken"""
    board.hello()
    kind, _, frame = _upload_kind(board)
    identity = board.identity
    sizes = {(kind, 0 if kind is not UploadKind.POINTS else 1, frame)}
    if board.has(Feature.SEQUENCE_POINTS):
        points = identity.max_points
        sizes |= {(UploadKind.POINTS, 1, 16), (UploadKind.POINTS, points, 16 * points)}
    for one, points, size in sorted(sizes):
        most = min(identity.max_sequence_frames, identity.max_upload_bytes // size)
        most = 1 if one is UploadKind.CORRECTION else most
        for frames in {frames for frames in (1, most - 1, most) if 1 <= frames <= most}:
            target = int(one is not UploadKind.CORRECTION)
            begin = UploadBegin(one, points, target, frames * size, 0)
            board.link.call(begin, UploadBeginReply)
    board.hello()  # which abandons the upload


@case("HG-7.2/2")
def refuses_uploads_of_broken_size(board: BoardClient) -> None:
    """sizes that are no whole frames are refused: BAD_LENGTH, detail: bytes in a frame"""
    _, _, frame = _upload_kind(board)
    for size in (0, frame + 1, 2 * frame - 1):
        if size == 0 or (size % frame and size <= board.identity.max_upload_bytes):
            board.link.refused(_begin_upload_of_size(board, size), ErrorCode.BAD_LENGTH, frame)


@case("HG-7.2/3")
def refuses_uploads_to_a_wrong_target(board: BoardClient) -> None:
    """sequence 0, and a correction for target 1, are refused with BAD_VALUE"""
    board.need_any(_ANY)
    count, offset = board.identity.transducers, UploadBegin.WIRE["target"].offset
    if board.has(Feature.SEQUENCE_PHASES):
        wrong = UploadBegin(UploadKind.PHASES, 0, 0, count, 0)
        board.link.refused(wrong, ErrorCode.BAD_VALUE, offset)
    if board.has(Feature.SEQUENCE_POINTS):
        wrong = UploadBegin(UploadKind.POINTS, 1, 0, 16, 0)
        board.link.refused(wrong, ErrorCode.BAD_VALUE, offset)
    if board.has(Feature.CORRECTION):
        wrong = UploadBegin(UploadKind.CORRECTION, 0, 1, count, 0)
        board.link.refused(wrong, ErrorCode.BAD_VALUE, offset)


@case("HG-7.2/4")
def upload_begins_anew(board: BoardClient) -> None:
    """a second UPLOAD_BEGIN discards the chunks of the first"""
    kind, target, frame = _upload_kind(board)
    data = b"\x07" * frame
    points = int(kind is UploadKind.POINTS)
    begin_upload(board, kind, target, data, points)
    send_upload_chunks(board, data)
    begin_upload(board, kind, target, data, points)
    board.link.refused(UploadCommit(target), ErrorCode.INCOMPLETE, 0)


@case("HG-7.2/5", needs=Feature.SEQUENCE_PHASES)
def upload_spares_the_playing_sequence(board: BoardClient) -> None:
    """UPLOAD_BEGIN for the sequence that plays is refused with BAD_STATE"""
    send_phases_that_fit(board, 5, frames=2)
    board.arm()
    play_now(board, 5, loops=0)
    size = board.identity.transducers
    board.link.refused(UploadBegin(UploadKind.PHASES, 0, 5, size, 0), ErrorCode.BAD_STATE, 1)


@case("HG-7.2/6")
def names_the_limits_of_uploads(board: BoardClient) -> None:
    """UPLOAD_BEGIN_REPLY names max_chunk and upload_window of HELLO_REPLY"""
    _, _, frame = _upload_kind(board)
    reply = announce_upload(board, _begin_upload_of_size(board, frame))
    due = board.identity.max_chunk, board.identity.upload_window
    told = reply.max_chunk, reply.window
    check(told == due, f"max_chunk and window are {told}, in HELLO_REPLY {due}")


@case("HG-7.3/1")
def takes_chunks_in_order(board: BoardClient) -> None:
    """chunks in order are taken, the same and overlapping ones again; one behind a gap is
    refused
    """
    kind, target, frame = _upload_kind(board)
    data = board.random.randbytes(frame)
    begin_upload(board, kind, target, data, int(kind is UploadKind.POINTS))
    size = max(1, min(board.identity.max_chunk // 2, 1 + frame // 5))
    for start in range(0, frame, size):
        for far in sorted({start + 1, frame - 1} & set(range(start + 1, frame))):
            board.link.refused(UploadChunk(far, b"\x00"), ErrorCode.INCOMPLETE, start)
        due = min(start + size, frame)
        for first, stop in ((max(0, start - size // 2), due), (start, due), (0, min(size, frame))):
            chunk = UploadChunk(first, data[first:stop])
            received = board.link.call(chunk, UploadChunkReply).received
            check(received == due, f"{received} bytes are there, not {due}")
    board.link.call(UploadCommit(target), UploadCommitReply)


@case("HG-7.3/2")
def takes_a_window_of_chunks(board: BoardClient) -> None:
    """a window of chunks sent without a pause is taken whole"""
    kind, target, frame = _upload_kind(board)
    identity = board.identity
    most = 1 if kind is UploadKind.CORRECTION else identity.max_sequence_frames
    frames = max(1, min(most, identity.upload_window * identity.max_chunk // frame))
    data = board.random.randbytes(frame * frames)
    reply = begin_upload(board, kind, target, data, int(kind is UploadKind.POINTS))
    pieces = [
        UploadChunk(start, data[start : start + reply.max_chunk])
        for start in range(0, len(data), reply.max_chunk)
    ][: reply.window]
    wires = [board.link.request_wire(piece) for piece in pieces]
    since = board.link.mark()
    board.link.send(*(wire for wire, _ in wires))
    for _, seq in wires:
        answer = board.link.answer_to(UploadChunk.TYPE, seq, since)
        board.link.reply_in(answer, UploadChunkReply, UploadChunk.TYPE)
    sent = sum(len(piece.data) for piece in pieces)
    received = board.link.call(UploadChunk(0, pieces[0].data), UploadChunkReply).received
    check_equal(
        received, sent, f"{sent} bytes in {len(pieces)} chunks were sent, {received} are there"
    )


@case("HG-7.3/3")
def limits_the_chunks_of_an_upload(board: BoardClient) -> None:
    """a chunk of max_chunk bytes is taken; one byte more is refused with BAD_LENGTH"""
    kind, target, frame = _upload_kind(board)
    limit = board.identity.max_chunk
    text = "no chunk longer than max_chunk fits, or makes sense"
    require(not (limit + 1 > 4000 or (kind is UploadKind.CORRECTION and frame <= limit)), text)
    frames = -(-(limit + 1) // frame)
    begin_upload(board, kind, target, bytes(frame * frames), int(kind is UploadKind.POINTS))
    board.link.refused(UploadChunk(0, bytes(limit + 1)), ErrorCode.BAD_LENGTH, limit)
    received = board.link.call(UploadChunk(0, bytes(limit)), UploadChunkReply).received
    check_equal(received, limit, f"a chunk of {limit} bytes: {received} are there")


@case("HG-7.3/4")
def refuses_stray_upload_chunks(board: BoardClient) -> None:
    """a chunk past the end is refused with BAD_VALUE, one without an upload with BAD_STATE"""
    kind, target, frame = _upload_kind(board)
    board.hello()
    board.link.refused(UploadChunk(0, b"\x01"), ErrorCode.BAD_STATE)
    begin_upload(board, kind, target, bytes(frame), int(kind is UploadKind.POINTS))
    for offset, size in ((frame, 1), (frame - 1, 2), (0xFFFFFFF0, 1), (0xFFFFFFFF, 2)):
        board.link.refused(UploadChunk(offset, bytes(size)), ErrorCode.BAD_VALUE)


@case("HG-7.3/4-edges")
def takes_chunks_that_fit(board: BoardClient) -> None:
    """chunks of 0, 1, 2 and max_chunk bytes at every edge: those at the start are taken"""
    kind, target, frame = _upload_kind(board)
    size = frame if kind is UploadKind.CORRECTION else 3 * frame
    for offset in (0, 1, size // 2, size - 1, size, size + 1, 1 << 16, 1 << 31, _LARGEST):
        for length in (0, 1, 2, board.identity.max_chunk):
            begin_upload(board, kind, target, bytes(size), int(kind is UploadKind.POINTS))
            answer = board.link.ask(UploadChunk(offset, bytes(length)))
            name = f"{length} bytes at {offset} of {size}"
            if offset or length > size:
                beyond = offset + length > size
                code = ErrorCode.BAD_VALUE if beyond else ErrorCode.INCOMPLETE
                error = board.link.error_in(answer, UploadChunk.TYPE, code)
                check(error.detail == 0, f"{name}: the detail is {error.detail}, not 0")
                continue
            reply = board.link.reply_in(answer, UploadChunkReply, UploadChunk.TYPE)
            check_equal(reply.received, length, f"{name}: {reply.received} are there")


@case("HG-7.4/1", needs=Feature.SEQUENCE_PHASES | Feature.CONFIG, evidence=SELF_REPORTED)
def upload_keeps_the_old_sequence(board: BoardClient) -> None:
    """until the commit the old sequence plays, then the new one, whole"""
    mode = ask_for_board_latches(board)
    old = send_phases_to_store(board, 6, frames=2)
    new = [board.random.randbytes(len(old[0])) for _ in range(2)]
    begin_upload(board, UploadKind.PHASES, 6, b"".join(new))
    send_upload_chunks(board, b"".join(new))
    for due in (old, new):
        board.hello()  # a new session: the ring begins anew, and an upload that is not committed
        if due is new:
            upload_to_board(board, UploadKind.PHASES, 6, b"".join(new))
        since = board.arm()
        play_out(board, 6, 2)
        full = b"\xff" * len(old[0])
        got = [latch.crc for latch in latches_received_from_board(board, since, mode)]
        wanted = [zlib.crc32(phases + full) for phases in due]
        which = "old" if due is old else "new"
        check(got == wanted, f"the {which} sequence is due; traced are {len(got)} other drives")


@case("HG-7.4/2")
def refuses_upload_commits_of_a_part(board: BoardClient) -> None:
    """a commit with bytes missing is refused: INCOMPLETE, detail: the first of them"""
    kind, target, frame = _upload_kind(board)
    frames = 1 if kind is UploadKind.CORRECTION else 2
    data = board.random.randbytes(frame * frames)
    begin_upload(board, kind, target, data, int(kind is UploadKind.POINTS))
    board.link.refused(UploadCommit(target), ErrorCode.INCOMPLETE, 0)
    board.link.call(UploadChunk(0, data[:1]), UploadChunkReply)
    if len(data) > 1:
        board.link.refused(UploadCommit(target), ErrorCode.INCOMPLETE, 1)
    size = board.identity.max_chunk
    for start in range(0, len(data), size):  # some of it is there already
        board.link.call(UploadChunk(start, data[start : start + size]), UploadChunkReply)
    got = board.link.call(UploadCommit(target), UploadCommitReply).frames
    due = board.identity.transducers if kind is UploadKind.CORRECTION else frames
    check(got == due, f"UPLOAD_COMMIT_REPLY says {got}, due is {due}")


@case("HG-7.4/3")
def refuses_upload_commits_of_other_bytes(board: BoardClient) -> None:
    """a commit of other bytes than announced is refused: CRC_MISMATCH, detail: their CRC-32"""
    kind, target, frame = _upload_kind(board)
    data = board.random.randbytes(frame)
    begin = _begin_upload_of_size(board, frame, zlib.crc32(data) ^ 0x10)
    announce_upload(board, begin)
    send_upload_chunks(board, data)
    board.link.refused(UploadCommit(target), ErrorCode.CRC_MISMATCH, zlib.crc32(data))
    check_equal(kind, begin.kind, "the upload is of another kind")


@case("HG-7.4/4")
def refuses_a_stray_upload_commit(board: BoardClient) -> None:
    """a commit of another target is refused with BAD_VALUE, one without an upload with BAD_STATE"""
    kind, target, frame = _upload_kind(board)
    board.hello()
    board.link.refused(UploadCommit(target), ErrorCode.BAD_STATE)
    data = bytes(frame)
    begin_upload(board, kind, target, data, int(kind is UploadKind.POINTS))
    send_upload_chunks(board, data)
    board.link.refused(UploadCommit(target + 1), ErrorCode.BAD_VALUE, 0)
