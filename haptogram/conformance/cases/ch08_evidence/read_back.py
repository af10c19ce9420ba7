"""HG-8.6: the read-back of a drive."""

from __future__ import annotations

from haptogram_protocol.messages import (
    DriveKind,
    DriveReply,
    ErrorCode,
    Feature,
    LatchKey,
    ReadDrive,
    TraceMode,
)
from haptogram_protocol.rules import READ_BACKS

from ...case import case
from ...client.board_client import BoardClient
from ...client.latching import (
    ask_for_board_latches_if_supported,
    client_drive_of_reply,
    latch_now,
    latches_received_from_board,
    read_back,
)
from ...judge.witness import expect_witnessed_drive
from ...outcome import SELF_REPORTED, check, check_equal


@case(
    "HG-8.6/1",
    "READ_DRIVE of one, some and too many transducers shows those from first on",
    evidence=SELF_REPORTED,
)
def reads_back_a_span(board: BoardClient) -> None:
    board.need_any(READ_BACKS)
    kind = DriveKind.LATCHED if board.has(Feature.READ_LATCHED) else DriveKind.RADIATED
    count = board.identity.transducers
    registers = board.random_registers()
    board.arm()
    latch_now(board, board.phases(registers))
    for first in {0, 1, count // 2, count - 1} & set(range(count)):
        for asked in (0xFFFF, 7, 1, 0):
            reply = board.link.call(ReadDrive(kind, first, asked), DriveReply)
            shown = client_drive_of_reply(reply)
            due = registers[first : first + asked]
            check_equal(reply.first, first, f"asked from {first}, shown from {reply.first}")
            check_equal(
                shown.phases,
                due,
                f"READ_DRIVE of {asked} transducers from {first}: other codes than were sent",
            )
            check_equal(
                shown.amplitudes,
                b"\xff" * len(due),
                f"READ_DRIVE of {asked} transducers from {first}: amplitudes are not full",
            )


@case("HG-8.6/2", "READ_DRIVE from N on is refused with NOT_FOUND, detail N")
def reads_back_no_more_transducers(board: BoardClient) -> None:
    board.need_any(READ_BACKS)
    count = board.identity.transducers
    for kind, feature in (
        (DriveKind.LATCHED, Feature.READ_LATCHED),
        (DriveKind.RADIATED, Feature.READ_RADIATED),
    ):
        if board.has(feature):
            for first in (count, 0xFFFF):
                board.link.refused(ReadDrive(kind, first, 1), ErrorCode.NOT_FOUND, count)


@case(
    "HG-8.6/3",
    "codes, key and time of a read-back belong to one latch, as in trace and STATUS",
    needs=Feature.READ_LATCHED,
    evidence=SELF_REPORTED,
)
def reads_back_one_latch(board: BoardClient) -> None:
    mode = ask_for_board_latches_if_supported(board, Feature.TRACE)
    board.arm()
    for _ in range(8):
        registers, index = board.random_registers(), board.link.stream_next
        since = board.link.mark()
        latch_now(board, board.phases(registers))
        shown = read_back(board)
        expect_witnessed_drive(board, shown, registers, b"\xff" * len(registers))
        check(shown.reply.key == LatchKey(0, 0, index), f"key {shown.reply.key}, due is {index}")
        status = board.status()
        got, due = shown.reply.t_latch_us, status.last_latch_us
        check(got == due, f"the read-back was latched at {got} µs, says STATUS {due} µs")
        if mode is not TraceMode.OFF:
            seen = latches_received_from_board(board, since, mode)
            check(bool(seen) and seen[-1].crc == shown.crc, "trace and read-back disagree")


@case(
    "HG-8.6/4",
    "before the first latch of a session codes, key and time are 0",
    needs=Feature.READ_LATCHED,
    evidence=SELF_REPORTED,
)
def reads_back_nothing_at_first(board: BoardClient) -> None:
    board.arm()
    latch_now(board, board.phases(board.random_registers()))
    board.hello()
    shown = read_back(board)
    check(not any(shown.reply.data), "codes of the session before are shown")
    key, t_us = shown.reply.key, shown.reply.t_latch_us
    check_equal((key, t_us), (LatchKey(0, 0, 0), 0), f"key {key}, time {t_us}")
