"""HG-3.4, HG-3.5: flags, and IMMEDIATE among them."""

from __future__ import annotations

from haptogram_protocol.annotation.frames import annotated_frame_text
from haptogram_protocol.messages import (
    MUST_UNDERSTAND,
    ErrorCode,
    Flag,
    MessageType,
    Ping,
    Play,
    Pong,
)

from ...case import case
from ...client.board_client import BoardClient
from ...client.capabilities import requests_that_board_takes, session_for_request
from ...client.dialogue import full_client_dialogue, undamaged_received_pieces
from ...client.latching import latch_now
from ...outcome import SELF_REPORTED, check


@case("HG-3.4/1")
def refuses_unknown_header_flags(board: BoardClient) -> None:
    """each must-understand flag that is unknown refuses a request, by its bit"""
    flags = (0x20, 0x40, 0x80, 0xE0, 0x21)
    with board.counting(requests=len(flags)):
        for flag in flags:
            board.link.refused(Ping(0), ErrorCode.UNSUPPORTED, flag & MUST_UNDERSTAND, flags=flag)


@case("HG-3.4/1-stream", evidence=SELF_REPORTED)
def drops_unknown_header_flags(board: BoardClient) -> None:
    """each must-understand flag that is unknown drops a stream frame"""
    board.arm()
    with board.counting(unsupported=3, latched=0):
        for flag in (0x20, 0x40, 0x80):
            board.link.stream(board.flat_phases(), flags=flag | Flag.IMMEDIATE)
        board.clock.wait_latched()


@case("HG-3.4/2")
def ignores_the_low_nibble_of_flags(board: BoardClient) -> None:
    """PING with each bit of the low nibble is answered; a stream frame is latched"""
    for flag in (1, 2, 4, 8, 15):
        board.link.call(Ping(flag), Pong, flags=flag)
    board.arm()
    with board.counting(latched=1):
        board.link.stream(board.flat_phases(), flags=Flag.IMMEDIATE | 0x0F)
        board.clock.wait_latched()


@case("HG-3.4/3")
def sends_no_header_flags(board: BoardClient) -> None:
    """no frame of a full dialogue has a flag but LATE, and only traces have LATE"""
    traces = {MessageType.TRACE, MessageType.TRACE_PLAYBACK, MessageType.TRACE_DRIVE}
    for piece in undamaged_received_pieces(full_client_dialogue(board)):
        if piece.header is not None:
            allowed = Flag.LATE if piece.header.type in traces else 0
            check(not piece.header.flags & ~allowed, f"flags: {annotated_frame_text(piece.piece)}")


@case("HG-3.5/1")
def takes_the_immediate_flag_where_it_belongs(board: BoardClient) -> None:
    """IMMEDIATE on any request but PLAY is refused with UNSUPPORTED, detail 0x10"""
    kinds = [kind for kind in requests_that_board_takes(board) if kind is not Play]
    for kind in kinds:
        board.link.refused_raw(
            kind.TYPE,
            bytes(kind.LAYOUT.size),
            ErrorCode.UNSUPPORTED,
            Flag.IMMEDIATE,
            flags=Flag.IMMEDIATE,
            session=session_for_request(board, kind),
        )
    board.arm()
    with board.counting(latched=1):
        latch_now(board)


@case("HG-3.5/2", evidence=SELF_REPORTED)
def immediate_flag_ignores_the_time(board: BoardClient) -> None:
    """with IMMEDIATE a frame is latched at once, whatever time it carries"""
    board.arm()
    now_us = board.clock.device_us()
    for time_us in (0, 1, now_us - 1_000_000, now_us + 5_000_000, now_us + 2**31, 0xFFFFFFFF):
        with board.counting(latched=1):
            board.link.stream(board.flat_phases(), time_us & 0xFFFFFFFF, flags=Flag.IMMEDIATE)
            board.clock.wait_latched()
