"""Chapter 7, uploads: refused before the first byte, taken whole or not at all."""

from __future__ import annotations

import zlib
from typing import Final

from haptogram_protocol.messages import (
    ErrorCode,
    Feature,
    PlaybackEnded,
    UploadBegin,
    UploadChunk,
    UploadChunkReply,
    UploadCommit,
    UploadCommitReply,
    UploadKind,
)

from ..case import case
from ..client.board_client import Bench
from ..client.latching import latches, watch
from ..client.playback import play_now, store_phases
from ..outcome import SELF_REPORTED, check, not_observed

_ANY: Final = Feature.SEQUENCE_PHASES | Feature.SEQUENCE_POINTS | Feature.CORRECTION
_LARGEST: Final = 0xFFFFFFFF


def _kind(bench: Bench) -> tuple[UploadKind, int, int]:
    """Return a kind that the board takes, a target for it and the bytes of one frame."""
    bench.need_any(_ANY)
    if bench.has(Feature.SEQUENCE_PHASES):
        return UploadKind.PHASES, 1, bench.identity.transducers
    if bench.has(Feature.CORRECTION):
        return UploadKind.CORRECTION, 0, bench.identity.transducers
    return UploadKind.POINTS, 1, 16


def _begin(bench: Bench, size: int, crc: int = 0) -> UploadBegin:
    kind, target, _ = _kind(bench)
    return UploadBegin(kind, int(kind is UploadKind.POINTS), target, size, crc)


@case("HG-7.2/1", "more bytes, or more frames, than there is room for: TOO_LARGE, by the limit")
def refuses_what_is_too_large(bench: Bench) -> None:
    kind, _, frame = _kind(bench)
    identity = bench.identity
    size = identity.max_upload_bytes - identity.max_upload_bytes % frame + frame
    tested = False
    if size <= _LARGEST:
        error = bench.refused(_begin(bench, size), ErrorCode.TOO_LARGE)
        check(
            error.detail <= identity.max_upload_bytes,
            f"the limit is {identity.max_upload_bytes}, the detail says {error.detail}",
        )
        tested = True
    frames = identity.max_sequence_frames + 1
    if kind is not UploadKind.CORRECTION and frames * frame <= identity.max_upload_bytes:
        bench.refused(
            _begin(bench, frames * frame), ErrorCode.TOO_LARGE, identity.max_sequence_frames
        )
        tested = True
    if not tested:
        not_observed("no upload that 32 bits can announce is too large for this board")
    bench.refused(UploadChunk(0, b"\x00"), ErrorCode.BAD_STATE)


@case("HG-7.2/2", "sizes of 0 and of a frame and a byte: BAD_LENGTH, by the bytes in a frame")
def refuses_a_broken_size(bench: Bench) -> None:
    _, _, frame = _kind(bench)
    for size in (0, frame + 1, 2 * frame - 1):
        if size == 0 or size % frame:
            bench.refused(_begin(bench, size), ErrorCode.BAD_LENGTH, frame)


@case("HG-7.2/3", "a sequence 0, and a correction for 1, are refused with BAD_VALUE")
def refuses_a_wrong_target(bench: Bench) -> None:
    bench.need_any(_ANY)
    count, offset = bench.identity.transducers, UploadBegin.WIRE["target"].offset
    if bench.has(Feature.SEQUENCE_PHASES):
        wrong = UploadBegin(UploadKind.PHASES, 0, 0, count, 0)
        bench.refused(wrong, ErrorCode.BAD_VALUE, offset)
    if bench.has(Feature.SEQUENCE_POINTS):
        wrong = UploadBegin(UploadKind.POINTS, 1, 0, 16, 0)
        bench.refused(wrong, ErrorCode.BAD_VALUE, offset)
    if bench.has(Feature.CORRECTION):
        wrong = UploadBegin(UploadKind.CORRECTION, 0, 1, count, 0)
        bench.refused(wrong, ErrorCode.BAD_VALUE, offset)


@case("HG-7.2/4", "a second UPLOAD_BEGIN abandons what came for the first")
def begins_anew(bench: Bench) -> None:
    kind, target, frame = _kind(bench)
    data = b"\x07" * frame
    points = int(kind is UploadKind.POINTS)
    bench.begin_upload(kind, target, data, points)
    bench.send_chunks(data)
    bench.begin_upload(kind, target, data, points)
    bench.refused(UploadCommit(target), ErrorCode.INCOMPLETE, 0)


@case(
    "HG-7.2/5",
    "UPLOAD_BEGIN for the sequence that plays is refused with BAD_STATE",
    needs=Feature.SEQUENCE_PHASES,
)
def protects_what_plays(bench: Bench) -> None:
    store_phases(bench, 5, frames=2)
    bench.arm()
    play_now(bench, 5, loops=0)
    size = bench.identity.transducers
    bench.refused(UploadBegin(UploadKind.PHASES, 0, 5, size, 0), ErrorCode.BAD_STATE, 1)


@case("HG-7.3/1", "chunks backwards and three times each are put together as they belong")
def takes_any_order(bench: Bench) -> None:
    kind, target, frame = _kind(bench)
    data = bench.random.randbytes(frame)
    bench.begin_upload(kind, target, data, int(kind is UploadKind.POINTS))
    size = max(1, min(bench.identity.max_chunk, 1 + frame // 5))
    starts = list(range(0, frame, size))
    for start in [*reversed(starts), *starts, starts[0]]:
        reply = bench.call(UploadChunk(start, data[start : start + size]), UploadChunkReply)
    check(reply.received == frame, f"{reply.received} of {frame} bytes are there")
    bench.call(UploadCommit(target), UploadCommitReply)


@case("HG-7.3/2", "a window of chunks without a pause: all are taken")
def takes_a_window(bench: Bench) -> None:
    kind, target, frame = _kind(bench)
    identity = bench.identity
    most = 1 if kind is UploadKind.CORRECTION else identity.max_sequence_frames
    frames = max(1, min(most, identity.upload_window * identity.max_chunk // frame))
    data = bench.random.randbytes(frame * frames)
    reply = bench.begin_upload(kind, target, data, int(kind is UploadKind.POINTS))
    pieces = [
        UploadChunk(start, data[start : start + reply.max_chunk])
        for start in range(0, len(data), reply.max_chunk)
    ][: reply.window]
    wires = [bench.request_wire(piece) for piece in pieces]
    since = bench.mark()
    bench.send(*(wire for wire, _ in wires))
    extra_us = bench.wire.line_us(sum(len(wire) for wire, _ in wires))
    for _, seq in wires:
        answer = bench.answer_to(UploadChunk.TYPE, seq, since, extra_us)
        bench.reply_in(answer, UploadChunkReply, UploadChunk.TYPE)
    sent = sum(len(piece.data) for piece in pieces)
    received = bench.call(UploadChunk(0, pieces[0].data), UploadChunkReply).received
    check(received == sent, f"{sent} bytes in {len(pieces)} chunks were sent, {received} are there")


@case("HG-7.3/3", "a chunk of max_chunk bytes is taken, one byte more is BAD_LENGTH")
def limits_its_chunks(bench: Bench) -> None:
    kind, target, frame = _kind(bench)
    limit = bench.identity.max_chunk
    if limit + 1 > 4000 or (kind is UploadKind.CORRECTION and frame <= limit):
        not_observed("no chunk longer than max_chunk fits, or makes sense")
    frames = -(-(limit + 1) // frame)
    bench.begin_upload(kind, target, bytes(frame * frames), int(kind is UploadKind.POINTS))
    bench.refused(UploadChunk(0, bytes(limit + 1)), ErrorCode.BAD_LENGTH, limit)
    received = bench.call(UploadChunk(0, bytes(limit)), UploadChunkReply).received
    check(received == limit, f"a chunk of {limit} bytes: {received} are there")


@case("HG-7.3/4", "a chunk past the end is BAD_VALUE, one without an upload BAD_STATE")
def refuses_stray_chunks(bench: Bench) -> None:
    kind, target, frame = _kind(bench)
    bench.hello()
    bench.refused(UploadChunk(0, b"\x01"), ErrorCode.BAD_STATE)
    bench.begin_upload(kind, target, bytes(frame), int(kind is UploadKind.POINTS))
    for offset, size in ((frame, 1), (frame - 1, 2), (0xFFFFFFF0, 1), (0xFFFFFFFF, 2)):
        bench.refused(UploadChunk(offset, bytes(size)), ErrorCode.BAD_VALUE)


@case(
    "HG-7.4/1",
    "until the commit the old sequence plays, then the new one, whole",
    needs=Feature.SEQUENCE_PHASES | Feature.CONFIG,
    evidence=SELF_REPORTED,
)
def keeps_the_old_one(bench: Bench) -> None:
    mode = watch(bench)
    old = store_phases(bench, 6, frames=2)
    new = [bench.random.randbytes(len(old[0])) for _ in range(2)]
    bench.begin_upload(UploadKind.PHASES, 6, b"".join(new))
    bench.send_chunks(b"".join(new))
    for due in (old, new):
        bench.hello()  # a new session: the ring begins anew, and an upload that is not committed
        if due is new:
            bench.upload(UploadKind.PHASES, 6, b"".join(new))
        bench.arm()
        since = bench.mark()
        play_now(bench, 6, loops=1)
        bench.await_event(PlaybackEnded, since, 100_000)
        full = b"\xff" * len(old[0])
        got = [latch.crc for latch in latches(bench, since, mode)]
        wanted = [zlib.crc32(phases + full) for phases in due]
        which = "old" if due is old else "new"
        check(got == wanted, f"the {which} sequence is due; traced are {len(got)} other drives")


@case("HG-7.4/2", "a commit with a gap is INCOMPLETE, by the first byte; then the rest is taken")
def refuses_a_gap(bench: Bench) -> None:
    kind, target, frame = _kind(bench)
    frames = 1 if kind is UploadKind.CORRECTION else 2
    data = bench.random.randbytes(frame * frames)
    bench.begin_upload(kind, target, data, int(kind is UploadKind.POINTS))
    bench.refused(UploadCommit(target), ErrorCode.INCOMPLETE, 0)
    half = max(1, frame // 2)
    bench.call(UploadChunk(0, data[:1]), UploadChunkReply)
    bench.call(UploadChunk(half, data[half:][: bench.identity.max_chunk]), UploadChunkReply)
    if half > 1:
        bench.refused(UploadCommit(target), ErrorCode.INCOMPLETE, 1)
    bench.send_chunks(data)
    got = bench.call(UploadCommit(target), UploadCommitReply).frames
    due = bench.identity.transducers if kind is UploadKind.CORRECTION else frames
    check(got == due, f"UPLOAD_COMMIT_REPLY says {got}, due is {due}")


@case("HG-7.4/3", "a commit of other bytes than announced is CRC_MISMATCH, by their CRC-32")
def refuses_other_bytes(bench: Bench) -> None:
    kind, target, frame = _kind(bench)
    data = bench.random.randbytes(frame)
    begin = _begin(bench, frame, zlib.crc32(data) ^ 0x10)
    bench.ask(begin)
    bench.send_chunks(data)
    bench.refused(UploadCommit(target), ErrorCode.CRC_MISMATCH, zlib.crc32(data))
    check(kind is begin.kind, "the upload is of another kind")


@case("HG-7.4/4", "a commit of another target is BAD_VALUE, one without an upload BAD_STATE")
def refuses_a_stray_commit(bench: Bench) -> None:
    kind, target, frame = _kind(bench)
    bench.hello()
    bench.refused(UploadCommit(target), ErrorCode.BAD_STATE)
    data = bytes(frame)
    bench.begin_upload(kind, target, data, int(kind is UploadKind.POINTS))
    bench.send_chunks(data)
    bench.refused(UploadCommit(target + 1), ErrorCode.BAD_VALUE, 0)
