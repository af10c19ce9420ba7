"""HG-4.1, HG-4.2, HG-4.4, HG-4.7: opening a session, versions, events without a session."""

from __future__ import annotations

from typing import Final

from haptogram_protocol.messages import (
    VERSION_MAJOR,
    ErrorCode,
    Hello,
    HelloReply,
    Mute,
    Ping,
    Pong,
)
from haptogram_protocol.state import OutputState

from ...case import case, case_about_host
from ...client.board_client import BoardClient
from ...outcome import check, check_equal

_LISTEN_US: Final = 300_000


host_opens = case_about_host("HG-4.1/1")


host_chooses = case_about_host("HG-4.1/2")


host_stops = case_about_host("HG-4.4/2")


@case("HG-4.1/3")
def refuses_nonce_0(board: BoardClient) -> None:
    """HELLO with the nonce 0 is refused with BAD_VALUE, detail 2; nothing changes"""
    board.link.refused(board.hello_message(0), ErrorCode.BAD_VALUE, 2, session=0)
    board.link.call(Ping(1), Pong)


@case("HG-4.1/4")
def opens_one_session(board: BoardClient) -> None:
    """after a second HELLO the first session is stale, for requests and stream"""
    old = board.link.session
    board.hello()
    board.link.refused(Ping(0), ErrorCode.STALE_SESSION, board.link.session, session=old)
    with board.counting(stale_session=1):
        board.link.stream(board.flat_phases(), seq=0xFFF0, session=old)


@case("HG-4.1/4-reset", needs_reset=True)
def opens_no_session_at_reset(board: BoardClient) -> None:
    """after a reset no session is open"""
    board.link.refused(Ping(0), ErrorCode.STALE_SESSION, 0, session=board.new_nonce())


@case("HG-4.2/1")
def hello_states_the_version(board: BoardClient) -> None:
    """HELLO_REPLY states the version that the board has"""
    reply = board.hello()
    check_equal(reply.major, VERSION_MAJOR, f"HELLO_REPLY says version {reply.major}.{reply.minor}")
    for minor in (0, 1, 255):
        hello = Hello(VERSION_MAJOR, minor, board.new_nonce(), 0xFFFFFFFF)
        again = board.link.call(hello, HelloReply, session=0)
        board.adopt(again)
        told = f"{again.major}.{again.minor}"
        check_equal(
            again.minor, reply.minor, f"to HELLO of minor {minor} the board says that it has {told}"
        )
    hello = Hello(VERSION_MAJOR + 1, 0, board.new_nonce(), 0)
    board.link.refused(hello, ErrorCode.VERSION, reply.major, session=0)


@case("HG-4.4/1")
def hello_of_other_versions_is_refused(board: BoardClient) -> None:
    """HELLO of other major versions is refused with VERSION; the session goes on"""
    board.arm()
    with board.counting(requests=3):
        for major in (0, VERSION_MAJOR + 1, 255):
            hello = Hello(major, 0, board.new_nonce(), 0)
            board.link.refused(hello, ErrorCode.VERSION, VERSION_MAJOR, session=0)
    state = board.status().state
    check_equal(state, OutputState.ARMED, f"a refused HELLO has moved the state to {state.name}")


@case("HG-4.7/1", needs_reset=True)
def no_event_without_a_session(board: BoardClient) -> None:
    """for 0.3 s after a reset and a PING without a session no event comes"""
    board.link.refused(Ping(0), ErrorCode.STALE_SESSION, 0, session=77)
    board.link.ask(Mute(), session=0)
    board.wire.idle(_LISTEN_US)
    events = [piece for piece in board.wire.received if piece.is_event]
    check(not events, f"{len(events)} events came before the first HELLO")
