"""HG-2.2, HG-2.4: byte stuffing by COBS, the CRC-32, and bytes that look like MUTE and are none.

A board looks for MUTE ahead of other frames (HG-3.8/2): by the same rules as for every frame.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from haptogram_protocol import messages as m
from haptogram_protocol.cobs import cobs_encode
from haptogram_protocol.framing import CRC_BYTES, MAX_ENCODED_BYTES, encode_frame
from haptogram_protocol.state import OutputState

from ...case import Depth, case
from ...client import latching, playback
from ...client.board_client import BoardClient
from ...client.dialogue import full_client_dialogue
from ...client.introduction import introduce_to_board
from ...client.malformed_frames import (
    BLOCK,
    malformed_checksums,
    malformed_frame,
    malformed_mute_with_run,
    malformed_noise,
    malformed_with_crc,
    malformed_with_wrong_crc,
)
from ...client.wire import ReceivedByClient
from ...judge.line_rules import judge_line_rule
from ...judge.timers import LEASE, judge_within_hold
from ...outcome import SELF_REPORTED, check, check_equal, fail, inconclusive, require
from ..ch12_timers.every_restart import damaged_pings, judge_no_renewals

_RUNS: Final = (252, 253, 254, 255, 256, 507, 508, 509, 762)
_AROUND: Final = range(-4, 5)  # bytes around a full piece
_PIECES: Final = 3  # full pieces in a row
_ENDS: Final = (b"\x00", b"\x00\x00", b"\x00\x01", b"\x00\x00\x00\xff")
_MOST: Final = 1500  # bytes of a frame of the host
_SEQUENCE: Final = 4
_AHEAD_US: Final = 4_000_000
_LONG: Final = 3000
_LEAST: Final = 14  # bytes of a header and a CRC
_DAMAGE: Final = (1, 0x80000000, 0x00010000, 0xFFFFFFFF)
_FLIPS: Final = (1, 1 << 7, 1 << 8, 1 << 15, 1 << 16, 1 << 31)


@case("HG-2.2/1")
def frames_are_stuffed_by_cobs(board: BoardClient) -> None:
    """every frame of a full dialogue is stuffed as COBS prescribes"""
    judge_line_rule(full_client_dialogue(board), "HG-2.2/1")


@case("HG-2.2/1-runs")
def reads_long_runs_of_stuffed_bytes(board: BoardClient) -> None:
    """frames that end with 252 to 762 bytes without a zero are read, each as it was sent"""
    for run in _RUNS:
        data, seq = malformed_mute_with_run(board.link, run)
        text = f"a frame that ends with {run} bytes without a zero is not read"
        board.link.check_answered(seq, text, malformed_frame(data))


@case("HG-2.2/2", evidence=SELF_REPORTED)
def drops_frames_with_wrong_stuffing(board: BoardClient) -> None:
    """a code byte that points past the end is counted in cobs, once; the frame has no effect"""
    good = b"\x01"
    while good.endswith(b"\x01"):  # without this byte it would be COBS, too
        body = board.link.body(m.Ping.TYPE, bytes(8), seq=board.link.next_seq())
        good = cobs_encode(malformed_with_crc(body))
    broken = [b"\x05\x01\x02", b"\xff" + b"\x07" * 40, good[:-1], good + b"\x02", b"\x02"]
    with board.counting(cobs=len(broken)):
        wires = (b"\x00" + piece + b"\x00" for piece in broken)
        board.link.unanswered("a frame that is not COBS", *wires)


@case("HG-2.2/3")
def accepts_a_spare_stuffing_byte(board: BoardClient) -> None:
    """a frame that ends with a full piece and a code byte 01 is read"""
    for run in (BLOCK, 2 * BLOCK):
        data, seq = malformed_mute_with_run(board.link, run)
        text = f"a code byte 01 behind a full piece ({run} bytes without a zero) is refused"
        board.link.check_answered(seq, text, b"\x00", cobs_encode(data), b"\x01", b"\x00")


# --- At the borders of full pieces -------------------------------------------------------------


def _runs_to_stuff(most: int) -> list[int]:
    """Return lengths up to *most* of zero-free runs, within 4 bytes of 1 to 3 COBS blocks of 254.

    Examples
    --------
    >>> _runs_to_stuff(256)
    [250, 251, 252, 253, 254, 255, 256]
    """
    runs = (pieces * BLOCK + apart for pieces in range(1, _PIECES + 1) for apart in _AROUND)
    return [run for run in runs if run <= most]


def _runs_before_full_ends(shown: int, room: int) -> list[int]:
    """Return lengths < *room* of a zero-free run that lets a frame end near a full COBS block.

    The frame holds *shown* codes: the run, one zero, and codes that are 253 to 255 or 508 bytes
    with the CRC.

    Examples
    --------
    >>> _runs_before_full_ends(512, 512)
    [7, 260, 261, 262]
    """
    borders = (2 * BLOCK, *(BLOCK + n for n in (1, 0, -1)))
    runs = (shown + CRC_BYTES - 1 - border for border in borders)
    return [run for run in runs if 0 <= run < room]


def _drives_to_stuff(board: BoardClient) -> Iterator[tuple[int, m.Message, bytes]]:
    """Yield random drives whose only zero is behind a run of each length: length, frame, registers.

    The registers are N phase codes, then N amplitude codes.
    """
    count = board.identity.transducers
    graded = board.has(m.Feature.AMPLITUDE)
    room = 2 * count if graded else count
    for run in (*_runs_to_stuff(room - 1), *_runs_before_full_ends(2 * count, room)):
        codes = bytearray(malformed_noise(board.random, room))
        codes[run] = 0
        if graded:
            yield run, m.Drives(bytes(codes)), bytes(codes)
        else:
            yield run, m.Phases(bytes(codes)), latching.full_client_drive(bytes(codes))


@case("HG-2.2/1-drives", needs=m.Feature.READ_LATCHED, evidence=SELF_REPORTED)
def every_drive_is_stuffed(board: BoardClient) -> None:
    """drives with zeros 254 n bytes before, behind, and before the end: read back, traced
    undamaged
    """
    if board.has(m.Feature.TRACE_DRIVE | m.Feature.CONFIG):
        board.configure(trace_mode=m.TraceMode.DRIVE)
    board.arm()
    judged = 0
    for run, message, registers in _drives_to_stuff(board):
        since, name = board.link.mark(), f"a drive with {run} bytes before a zero"
        latching.latch_now(board, message)
        reply = _ask_with_stuffing(board, 0xFFFF, f"READ_DRIVE of {name}")
        wrong = sum(a != b for a, b in zip(reply.data, registers, strict=False))
        check_equal(wrong, 0, f"READ_DRIVE of {name}: {wrong} codes are not those that were sent")
        _check_stuffing(board.wire.received[since:], name)
        judged += 1
    latching.latch_now(
        board, board.flat_phases(0xF8)
    )  # without a zero: runs that go on into the CRC
    for count in sorted({run // 2 for run in _runs_to_stuff(2 * board.identity.transducers)}):
        _ask_with_stuffing(board, count, f"READ_DRIVE of {count}")
        judged += 1
    require(bool(judged), f"a drive of {board.identity.transducers} transducers fills no piece")


def _ask_with_stuffing(board: BoardClient, count: int, name: str) -> m.DriveReply:
    """Return the READ_DRIVE reply for *count* elements; *name* is the request in a finding.

    FAILED if the reply is missing, damaged or stuffed in another way than COBS allows.
    """
    wire, seq = board.link.request_wire(m.ReadDrive(m.DriveKind.LATCHED, 0, count))
    since = board.link.mark()

    def is_reply_or_damaged(piece: ReceivedByClient) -> bool:
        return piece.header is None or (piece.is_response and piece.header.seq == seq)

    board.link.send(wire)
    found = board.wire.wait_for(is_reply_or_damaged, since, board.wire.limits.answer_us)
    if found is None:
        fail(f"{name} is not answered")
    _check_stuffing([found], f"the answer to {name}")
    return board.link.reply_in(found, m.DriveReply, m.ReadDrive.TYPE)


def _check_stuffing(pieces: list[ReceivedByClient], name: str) -> None:
    """FAILED unless each frame is stuffed in the one way of COBS; *name* begins the finding."""
    for piece in pieces:
        check(not piece.fault, f"{name}: {piece.fault}")
        check_equal(piece.piece, cobs_encode(piece.unstuffed), f"{name} is stuffed in another way")


@case("HG-2.2/1-pieces")
def every_stuffed_piece_is_read(board: BoardClient) -> None:
    """frames with one, two or more zeros around each multiple of 254 other bytes are read"""
    for run in _runs_to_stuff(_MOST - 10):
        for end in _ENDS if board.thorough else _ENDS[:1]:
            around = [malformed_noise(board.random, size) for size in (run, min(run, _MOST - run))]
            seq = board.link.next_seq()
            body = board.link.body(m.Mute.TYPE, b"\x00" + around[0] + end + around[1], seq=seq)
            text = f"a frame with {end.hex(' ')} behind {run} bytes without a zero is not read"
            board.link.check_answered(seq, text, encode_frame(body))


@case("HG-2.4/1", needs_session=False)
def frames_have_crc32_checksum(board: BoardClient) -> None:
    """HELLO with a CRC-32 is answered by a frame with a CRC-32; another checksum is named"""
    board.link.session = 0
    for _ in range(3):
        reply = introduce_to_board(board)
        if isinstance(reply, m.HelloReply):
            _check_checksum(board)
            return
        if reply is not None:
            inconclusive(f"HELLO is answered by {reply}, with its CRC-32")
    for piece in filter(_is_framed_greeting, board.wire.received):
        check(piece.reason != "crc", f"frames come, but none with its CRC-32: {piece.fault}")
    hello = board.hello_message(board.new_nonce())
    body = board.link.body(hello.TYPE, hello.serialize(), seq=board.link.next_seq(), session=0)
    for name, data in malformed_checksums(body).items():
        since = board.link.mark()
        board.link.send(malformed_frame(data))
        found = board.wire.wait_for(_is_framed_greeting, since, board.wire.limits.answer_us)
        check(found is None, f"HELLO is answered if it ends with {name} instead of CRC-32")
    inconclusive("no HELLO is answered, with whatever checksum")


def _is_framed_greeting(piece: ReceivedByClient) -> bool:
    """Return True if a piece is of type HELLO_REPLY or ERROR, even with a wrong checksum."""
    return piece.unstuffed[:1] in (bytes([m.HelloReply.TYPE]), bytes([m.Error.TYPE]))


def _check_checksum(board: BoardClient) -> None:
    """FAILED if a frame of the board, in a dialogue of all requests, has a wrong CRC or none."""
    board.prepare()
    for piece in full_client_dialogue(board):
        if piece.reason in ("crc", "short"):
            fail(f"a frame without its CRC-32: {piece.fault}")


@case("HG-2.4/2", evidence=SELF_REPORTED)
def drops_frames_of_wrong_checksum(board: BoardClient) -> None:
    """frames with a wrong CRC are counted in crc; they get no answer and use up no number"""
    body = board.link.body(m.Ping.TYPE, bytes(8), seq=board.link.next_seq())
    others = malformed_checksums(body)
    del others["no checksum"]
    frames = [malformed_with_wrong_crc(body, flip) for flip in _DAMAGE]
    frames += others.values()
    for bit in (0, 13, 77, 100):  # damage in the body instead
        damaged = bytearray(malformed_with_crc(body))
        damaged[bit // 8] ^= 1 << bit % 8
        frames.append(bytes(damaged))
    flat = board.flat_phases()
    stream = board.link.body(flat.TYPE, flat.serialize(), seq=board.link.stream_next)
    frames.append(malformed_with_wrong_crc(stream))
    wires = [malformed_frame(frame) for frame in frames if len(frame) >= _LEAST]
    with board.counting(crc=len(wires), dropped_state=1):
        board.link.unanswered("a frame with a wrong CRC", *wires)
        # Its number is still free: the next frame takes it, without a gap or a duplicate.
        board.link.stream(flat)


@case("HG-2.4/2-lease", needs=m.Feature.CONFIG, depth=Depth.DEFAULT)
def wrong_checksums_renew_no_lease(board: BoardClient) -> None:
    """frames with a wrong CRC do not keep an ARMED board alive"""
    judge_no_renewals(board, damaged_pings, LEASE)


# --- Bytes that look like MUTE -----------------------------------------------------------------


def _bytes_like_mute(board: BoardClient) -> Iterator[tuple[str, bytes]]:
    """Yield malformed frames that hold a MUTE or part of it: description, bytes, no delimiters."""
    noise = malformed_noise(board.random, MAX_ENCODED_BYTES)
    for session in (board.link.session, 0):
        body = board.link.body(m.Mute.TYPE, seq=board.link.seq + 1, session=session)
        whole = malformed_with_crc(body)
        mute = cobs_encode(whole)
        for flip in _FLIPS:
            wrong = malformed_with_wrong_crc(body, flip)
            yield f"the bits {flip:#x} of its CRC inverted", cobs_encode(wrong)
        long = board.link.body(m.Mute.TYPE, bytes(_LONG), seq=0, session=session)
        wrong = malformed_with_wrong_crc(long)
        yield f"a payload of {_LONG} bytes and a wrong CRC", cobs_encode(wrong)
        yield "a byte too much", cobs_encode(whole + b"\x01")
        yield "a byte too little", cobs_encode(whole[:-1])
        yield "a header of 9 bytes", cobs_encode(malformed_with_crc(body[:9]))
        yield "its type and a CRC alone", cobs_encode(malformed_with_crc(body[:1]))
        yield "a code byte past its end", mute + b"\x02"
        yield "its first half alone", mute[: len(mute) // 2]
        yield "its second half alone", mute[len(mute) // 2 :]
        yield "a byte before it", b"\x01" + mute
        yield "junk before it, too long with it", noise + mute
        junk = malformed_noise(board.random, MAX_ENCODED_BYTES + 100)
        far = board.link.body(m.Mute.TYPE, junk, seq=0, session=session)
        yield "a payload beyond the longest frame", cobs_encode(malformed_with_crc(far))
        inside = m.UploadChunk(0x7FFFFFFF, b"\x00" + whole + b"\x00" + encode_frame(body))
        stale = board.link.body(inside.TYPE, inside.serialize(), seq=0, session=1)
        yield "a chunk around it", encode_frame(stale).strip(b"\x00")


@case("HG-2.4/2-mutes", evidence=SELF_REPORTED)
def every_damaged_mute_is_none(board: BoardClient) -> None:
    """bytes that look like MUTE, damaged, too short, too long, within a frame: the output goes
    on
    """
    board.wire.require_carried(2 * MAX_ENCODED_BYTES, _AHEAD_US // 4)
    plays = board.has(m.Feature.SEQUENCE_PHASES) and board.thorough
    if plays:
        playback.send_phases_that_fit(board, _SEQUENCE, frames=2)
    for _ in board.wire.ways_of_mute():
        for is_played in (False, True) if plays else (False,):
            _judge_damaged_mutes(board, is_played=is_played)


def _judge_damaged_mutes(board: BoardClient, *, is_played: bool) -> None:
    """FAILED if one of the malformed MUTEs mutes, flushes the queue or ends a playback.

    The output is on meanwhile: by a playback if *is_played*, else by a latch, with a frame queued.
    """
    board.hello()
    board.arm()
    if is_played:
        playback.play_now(board, _SEQUENCE, loops=0)
        board.clock.wait_latched()
    since, waits_until_us = board.link.mark(), 0
    latched_us = renewed_us = board.wire.now_us()
    latch_in_us = min(_AHEAD_US // 2, 250 * board.config.hold_ms)
    for name, piece in _bytes_like_mute(board):
        if not board.wire.carries(len(piece), latch_in_us // 2):
            continue  # a hold that nothing extends may end meanwhile
        if is_played:
            latched_us = renewed_us = board.wire.now_us()
        elif waits_until_us - board.clock.device_estimate_us() < _AHEAD_US - latch_in_us:
            renewed_us = board.wire.now_us()
            latching.latch_now(board)  # which flushes the frame that waits
            waits_until_us = board.clock.ahead_us(_AHEAD_US)
            board.link.stream(board.flat_phases(), waits_until_us)
        board.link.send(b"\x00" + piece + b"\x00")
        board.wire.idle_while_sending()
        board.link.barrier()
        found = board.status()
        told = board.link.events(m.StateChanged, since)
        shows = board.has(m.Feature.READ_RADIATED)
        for holds, wrong in (
            (found.state is OutputState.ARMED, f"{found.state.name}, {found.reason.name}"),
            (found.queued == (not is_played), f"{found.queued} frames wait"),
            (not shows or latching.read_back_radiated(board).loudest > 0, "the output is off"),
            (not told, f"the board tells {told[0][1] if told else ''}"),
        ):
            judge_within_hold(board, latched_us, holds, f"a MUTE with {name}: {wrong}")
        latched_us = renewed_us
    board.disarm()
