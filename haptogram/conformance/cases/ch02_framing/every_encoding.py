"""HG-2.2: byte stuffing at the borders of full pieces, in both directions."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from haptogram_protocol.framing import CRC_BYTES, cobs_encode
from haptogram_protocol.messages import (
    DriveKind,
    DriveReply,
    Drives,
    Feature,
    Message,
    Mute,
    Phases,
    ReadDrive,
    TraceMode,
)

from ...case import case
from ...client import malformed_frames
from ...client.board_client import BoardClient
from ...client.latching import FULL, latch_now
from ...client.wire import ReceivedByClient
from ...outcome import SELF_REPORTED, check, check_equal, fail, require

_AROUND: Final = range(-4, 5)  # bytes around a full piece
_PIECES: Final = 3  # full pieces in a row
_ENDS: Final = (b"\x00", b"\x00\x00", b"\x00\x01", b"\x00\x00\x00\xff")
_MOST: Final = 1500  # bytes of a frame of the host


def _runs_to_stuff(most: int) -> list[int]:
    """Return lengths of runs without a zero at and around every multiple of a full piece.

    Examples
    --------
    >>> _runs_to_stuff(256)
    [250, 251, 252, 253, 254, 255, 256]
    """
    borders = range(1, _PIECES + 1)
    runs = (pieces * malformed_frames.BLOCK + apart for pieces in borders for apart in _AROUND)
    return [run for run in runs if run <= most]


def _full_stuffing_piece(board: BoardClient, size: int) -> bytes:
    return malformed_frames.malformed_noise(board.random, size)


def _runs_before_full_ends(shown: int, room: int) -> list[int]:
    """Return runs behind whose zero *shown* codes and their CRC end with a full piece, or nearly.

    Examples
    --------
    >>> _runs_before_full_ends(512, 512)
    [7, 260, 261, 262]
    """
    borders = (2 * malformed_frames.BLOCK, *(malformed_frames.BLOCK + n for n in (1, 0, -1)))
    runs = (shown + CRC_BYTES - 1 - border for border in borders)
    return [run for run in runs if 0 <= run < room]


def _drives_to_stuff(board: BoardClient) -> Iterator[tuple[int, Message, bytes]]:
    """Yield drives with a zero behind each run: its length, the frame, the registers."""
    count = board.identity.transducers
    graded = board.has(Feature.AMPLITUDE)
    room = 2 * count if graded else count
    for run in (*_runs_to_stuff(room - 1), *_runs_before_full_ends(2 * count, room)):
        codes = bytearray(_full_stuffing_piece(board, room))
        codes[run] = 0
        if graded:
            yield run, Drives(bytes(codes)), bytes(codes)
        else:
            registers = bytes(codes) + bytes([FULL]) * count
            yield run, Phases(bytes(codes)), registers


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
        since = board.link.mark()
        latch_now(board, message)
        _check_stuffed_reply(board, run, registers)
        _check_stuffing(board.wire.received[since:], f"a drive with {run} bytes before a zero")
        judged += 1
    latch_now(board, board.flat_phases(0xF8))  # without a zero: runs that go on into the CRC
    for count in _counts_of_stuffed_bytes(board.identity.transducers):
        _ask_with_stuffing(board, ReadDrive(DriveKind.LATCHED, 0, count), f"READ_DRIVE of {count}")
        judged += 1
    require(bool(judged), f"a drive of {board.identity.transducers} transducers fills no piece")


def _counts_of_stuffed_bytes(transducers: int) -> list[int]:
    halves = {run // 2 for run in _runs_to_stuff(2 * transducers)}
    return sorted(halves)


def _check_stuffed_reply(board: BoardClient, run: int, registers: bytes) -> None:
    name = f"READ_DRIVE of a drive with {run} bytes before a zero"
    reply = _ask_with_stuffing(board, ReadDrive(DriveKind.LATCHED, 0, 0xFFFF), name)
    wrong = sum(a != b for a, b in zip(reply.data, registers, strict=False))
    check_equal(wrong, 0, f"{name}: {wrong} codes are not those that were sent")


def _ask_with_stuffing(board: BoardClient, message: ReadDrive, name: str) -> DriveReply:
    """Return the reply; FAILED if what comes instead is damaged."""
    wire, seq = board.link.request_wire(message)
    since = board.link.mark()

    def is_reply_or_damaged(piece: ReceivedByClient) -> bool:
        return piece.header is None or (piece.is_response and piece.header.seq == seq)

    board.link.send(wire)
    found = board.wire.wait_for(is_reply_or_damaged, since, board.wire.limits.answer_us)
    if found is None:
        fail(f"{name} is not answered")
    check(found.header is not None, f"the answer to {name} is damaged: {found.fault}")
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
            payload = (
                b"\x00"
                + _full_stuffing_piece(board, run)
                + end
                + _full_stuffing_piece(board, min(run, _MOST - run))
            )
            seq = board.link.next_seq()
            data = malformed_frames.malformed_with_crc(board.link.body(Mute.TYPE, payload, seq=seq))
            since = board.link.mark()
            board.link.send(malformed_frames.malformed_frame(data))
            if board.link.try_answer(seq, since) is None:
                fail(f"a frame with {end.hex(' ')} behind {run} bytes without a zero is not read")
