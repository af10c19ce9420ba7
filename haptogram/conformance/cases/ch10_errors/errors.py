"""HG-10.1, HG-10.2: ERROR changes nothing, and has the code of its case."""

from __future__ import annotations

from haptogram_protocol.messages import (
    VERSION_MAJOR,
    Config,
    ConfigReply,
    Error,
    ErrorCode,
    Feature,
    GetConfig,
    GetGeometry,
    Hello,
    Ping,
    Pong,
    SetConfig,
    UploadCommit,
)

from ...case import case, case_about_host
from ...client.board_client import BoardClient
from ...client.latching import latch_now
from ...outcome import check, check_equal

unknown_codes = case_about_host("HG-10.1/3")


@case("HG-10.1/1")
def error_refusals_change_nothing(board: BoardClient) -> None:
    """refused requests leave state, configuration, queue and stream numbers alone"""
    board.arm()
    before, config = board.status(), board.link.call(GetConfig(), ConfigReply)
    t_us = board.clock.soon_us(bytes(2000), ahead_us=40_000)
    with board.counting(latched=2):
        board.link.stream(board.flat_phases(), t_us)
        board.link.refused_raw(0x43, b"\x00", ErrorCode.BAD_LENGTH, 0)
        board.link.refused_raw(0x43, b"", ErrorCode.UNSUPPORTED, 0x20, flags=0x20)
        board.link.refused_raw(0x43, b"", ErrorCode.STALE_SESSION, session=board.link.session ^ 3)
        board.link.refused(GetGeometry(0xFFFF, 1), ErrorCode.NOT_FOUND)
        board.clock.wait_until(t_us + 100)
        latch_now(board)
    after = board.status()
    check_equal(after.state, before.state, f"a refusal has led to {after.state.name}")
    found = board.link.call(GetConfig(), ConfigReply)
    check_equal(found, config, "a refusal has changed the configuration")


@case("HG-10.1/2")
def stream_gets_no_error(board: BoardClient) -> None:
    """stream frames, good ones and bad ones of every kind, get no answer"""
    board.arm()
    good = board.flat_phases()
    frames = [
        board.link.stream_wire(good),
        board.link.stream_wire(good, flags=0x80),
        board.link.stream_wire(good, seq=board.link.stream_next - 1),
        board.link.stream_wire(good, session=0),
        board.link.stream_wire(good, board.clock.device_us() - 10_000),
        board.link.stream_wire(good, board.clock.device_us() + board.identity.max_horizon_us * 2),
        board.link.stream_raw(0x3C, b"abc"),
        board.link.stream_raw(good.TYPE, b""),
    ]
    board.link.unanswered("a stream frame", *frames)
    board.disarm()
    board.link.unanswered("a stream frame while DISARMED", board.link.stream_wire(good))


@case("HG-10.2/1")
def uses_the_right_error_codes(board: BoardClient) -> None:
    """ten refusals have the code that SPEC.md gives; none is BUSY"""
    board.link.refused_raw(0x7B, b"", ErrorCode.UNSUPPORTED, 0x7B)
    board.link.refused(Ping(0), ErrorCode.UNSUPPORTED, 0x80, flags=0x80)
    board.link.refused_raw(Ping.TYPE, b"", ErrorCode.BAD_LENGTH, 8)
    board.link.refused(board.hello_message(0), ErrorCode.BAD_VALUE, 2, session=0)
    hello = Hello(VERSION_MAJOR + 5, 0, board.new_nonce(), 0)
    board.link.refused(hello, ErrorCode.VERSION, VERSION_MAJOR, session=0)
    board.link.refused(
        Ping(0), ErrorCode.STALE_SESSION, board.link.session, session=board.link.session ^ 9
    )
    board.link.call(Ping(1), Pong)
    seq = board.link.seq & 0xFFFF
    board.link.refused(Ping(2), ErrorCode.SEQUENCE_REUSED, seq, seq=seq)
    count = board.identity.transducers
    board.link.refused(GetGeometry(count, 1), ErrorCode.NOT_FOUND, count)
    if board.has(Feature.CONFIG):
        wrong = Config(hold_ms=0)
        board.link.refused(SetConfig(wrong), ErrorCode.BAD_VALUE, Config.WIRE["hold_ms"].offset)
    if board.identity.features & (Feature.SEQUENCE_PHASES | Feature.CORRECTION):
        board.link.refused(UploadCommit(1), ErrorCode.BAD_STATE, 0)
    busy = [
        piece
        for piece in board.wire.received
        if isinstance(piece.message, Error) and piece.message.code == ErrorCode.BUSY
    ]
    check(not busy, "a refusal that does not pass by itself is BUSY")
