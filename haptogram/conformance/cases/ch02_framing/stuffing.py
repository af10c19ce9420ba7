"""HG-2.2: byte stuffing by COBS, at the borders of full pieces, in both directions."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from haptogram_protocol.framing import CRC_BYTES, cobs_encode, encode_frame
from haptogram_protocol.messages import (
    DriveKind,
    DriveReply,
    Drives,
    Feature,
    Message,
    Mute,
    Phases,
    Ping,
    ReadDrive,
    TraceMode,
)

from ...case import case
from ...client.board_client import BoardClient
from ...client.dialogue import full_client_dialogue
from ...client.latching import full_client_drive, latch_now
from ...client.malformed_frames import (
    BLOCK,
    malformed_frame,
    malformed_mute_with_run,
    malformed_noise,
    malformed_with_crc,
)
from ...client.wire import ReceivedByClient
from ...judge.line_rules import judge_line_rule
from ...outcome import SELF_REPORTED, check, check_equal, fail, require

_RUNS: Final = (252, 253, 254, 255, 256, 507, 508, 509, 762)
_AROUND: Final = range(-4, 5)  # bytes around a full piece
_PIECES: Final = 3  # full pieces in a row
_ENDS: Final = (b"\x00", b"\x00\x00", b"\x00\x01", b"\x00\x00\x00\xff")
_MOST: Final = 1500  # bytes of a frame of the host


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
        body = board.link.body(Ping.TYPE, bytes(8), seq=board.link.next_seq())
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
    """Return lengths of runs without a zero at and around every multiple of a full piece.

    Examples
    --------
    >>> _runs_to_stuff(256)
    [250, 251, 252, 253, 254, 255, 256]
    """
    runs = (pieces * BLOCK + apart for pieces in range(1, _PIECES + 1) for apart in _AROUND)
    return [run for run in runs if run <= most]


def _runs_before_full_ends(shown: int, room: int) -> list[int]:
    """Return runs behind whose zero *shown* codes and their CRC end with a full piece, or nearly.

    Examples
    --------
    >>> _runs_before_full_ends(512, 512)
    [7, 260, 261, 262]
    """
    borders = (2 * BLOCK, *(BLOCK + n for n in (1, 0, -1)))
    runs = (shown + CRC_BYTES - 1 - border for border in borders)
    return [run for run in runs if 0 <= run < room]


def _drives_to_stuff(board: BoardClient) -> Iterator[tuple[int, Message, bytes]]:
    """Yield drives with a zero behind each run: its length, the frame, the registers."""
    count = board.identity.transducers
    graded = board.has(Feature.AMPLITUDE)
    room = 2 * count if graded else count
    for run in (*_runs_to_stuff(room - 1), *_runs_before_full_ends(2 * count, room)):
        codes = bytearray(malformed_noise(board.random, room))
        codes[run] = 0
        if graded:
            yield run, Drives(bytes(codes)), bytes(codes)
        else:
            yield run, Phases(bytes(codes)), full_client_drive(bytes(codes))


@case("HG-2.2/1-drives", needs=Feature.READ_LATCHED, evidence=SELF_REPORTED)
def every_drive_is_stuffed(board: BoardClient) -> None:
    """drives with zeros 254 n bytes before, behind, and before the end: read back, traced
    undamaged
    """
    if board.has(Feature.TRACE_DRIVE | Feature.CONFIG):
        board.configure(trace_mode=TraceMode.DRIVE)
    board.arm()
    judged = 0
    for run, message, registers in _drives_to_stuff(board):
        since, name = board.link.mark(), f"a drive with {run} bytes before a zero"
        latch_now(board, message)
        reply = _ask_with_stuffing(board, 0xFFFF, f"READ_DRIVE of {name}")
        wrong = sum(a != b for a, b in zip(reply.data, registers, strict=False))
        check_equal(wrong, 0, f"READ_DRIVE of {name}: {wrong} codes are not those that were sent")
        _check_stuffing(board.wire.received[since:], name)
        judged += 1
    latch_now(board, board.flat_phases(0xF8))  # without a zero: runs that go on into the CRC
    for count in sorted({run // 2 for run in _runs_to_stuff(2 * board.identity.transducers)}):
        _ask_with_stuffing(board, count, f"READ_DRIVE of {count}")
        judged += 1
    require(bool(judged), f"a drive of {board.identity.transducers} transducers fills no piece")


def _ask_with_stuffing(board: BoardClient, count: int, name: str) -> DriveReply:
    """Return the reply to a READ_DRIVE of *count*; FAILED if what comes instead is damaged."""
    wire, seq = board.link.request_wire(ReadDrive(DriveKind.LATCHED, 0, count))
    since = board.link.mark()

    def is_reply_or_damaged(piece: ReceivedByClient) -> bool:
        return piece.header is None or (piece.is_response and piece.header.seq == seq)

    board.link.send(wire)
    found = board.wire.wait_for(is_reply_or_damaged, since, board.wire.limits.answer_us)
    if found is None:
        fail(f"{name} is not answered")
    _check_stuffing([found], f"the answer to {name}")
    return board.link.reply_in(found, DriveReply, ReadDrive.TYPE)


def _check_stuffing(pieces: list[ReceivedByClient], name: str) -> None:
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
            body = board.link.body(Mute.TYPE, b"\x00" + around[0] + end + around[1], seq=seq)
            text = f"a frame with {end.hex(' ')} behind {run} bytes without a zero is not read"
            board.link.check_answered(seq, text, encode_frame(body))
