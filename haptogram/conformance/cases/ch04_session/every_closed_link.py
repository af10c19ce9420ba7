"""HG-4.11, HG-4.12: frames of every type while no session is open."""

from __future__ import annotations

from typing import Final

from haptogram_protocol.messages import (
    REQUEST_RANGE,
    STREAM_RANGE,
    VERSION_MAJOR,
    ErrorCode,
    Feature,
    Flag,
    Hello,
    Mute,
    Ping,
)
from haptogram_protocol.rules import unsupported_types
from haptogram_protocol.state import OutputState

from ...case import case
from ...client.board_client import BoardClient
from ...client.stream_kinds import request_types_of_host
from ...outcome import SELF_REPORTED, check, check_equal

_UNKNOWN_REQUEST: Final = 0x7B
#: Counters of what a board does with frames of an open session.
_OF_A_SESSION: Final = ("accepted", "latched", "dropped_state", "duplicate", "gap", "bad_length")


@case("HG-4.12/1-closed", needs_reset=True, evidence=SELF_REPORTED)
def closed_link_does_nothing_before_hello(board: BoardClient) -> None:
    """before the first HELLO frames of every type and session, 0 too, are stale: nothing is done"""
    streamed: list[int] = []
    answers = []
    for session in (0, 1, 0x8000, 0xFFFF, board.new_nonce()):
        for kind in request_types_of_host():
            name = f"{kind.TYPE.name} of session {session:#06x}"
            payload = bytes(kind.LAYOUT.size)
            if kind.TYPE in STREAM_RANGE:
                header = {"session": session, "flags": int(Flag.IMMEDIATE)}
                board.link.send(board.link.stream_raw(kind.TYPE, payload, **header))
                streamed.append(kind.TYPE)
            elif kind.TYPE in REQUEST_RANGE and kind not in (Hello, Mute):
                answer = board.link.ask_raw(kind.TYPE, payload, session=session)
                answers.append((name, kind.TYPE, answer))
    identity = board.hello()
    lacking = unsupported_types(Feature(identity.features))  # these are refused in step 5
    for name, kind_of, answer in answers:
        unknown = kind_of in lacking
        code = ErrorCode.UNSUPPORTED if unknown else ErrorCode.STALE_SESSION
        board.link.error_in(answer, kind_of, code, kind_of if unknown else 0)
        told = answer.header.session if answer.header is not None else -1
        check_equal(told, 0, f"no session is open; the refusal of {name} has {told:#06x}")
    state = identity.state
    check_equal(
        state, OutputState.DISARMED, f"frames before the first HELLO have led to {state.name}"
    )
    counters = board.status().counters
    moved = {name: number for name in _OF_A_SESSION if (number := getattr(counters, name))}
    check(not moved, f"frames before the first HELLO are counted in {moved}")
    stale, requests = counters.stale_session, counters.requests
    due = sum(kind not in lacking for kind in streamed)
    check_equal(stale, due, f"{due} frames before HELLO; stale_session is {stale}")
    asked = len(answers) + 2  # HELLO and GET_STATUS
    heard = board.link.knocks  # repetitions of the first one, to a board that boots
    text = f"{asked} requests from the reset on; requests is {requests}"
    check(asked <= requests <= asked + heard, text)


@case("HG-4.11/1-closed", needs_reset=True)
def closed_link_has_session_0(board: BoardClient) -> None:
    """before the first HELLO every answer has session 0"""
    board.link.session = 0
    answers = {
        "MUTE": board.link.ask(Mute()),
        "MUTE of a session": board.link.ask(Mute(), session=0x1234),
        "PING": board.link.ask(Ping(1)),
        "PING of a session": board.link.ask(Ping(1), session=0x1234),
        "an unknown request": board.link.ask_raw(_UNKNOWN_REQUEST),
        "HELLO of another version": board.link.ask(Hello(VERSION_MAJOR + 1, 0, 1, 0)),
        "HELLO of nonce 0": board.link.ask(Hello(VERSION_MAJOR, 0, 0, 0)),
    }
    for name, answer in answers.items():
        session = answer.header.session if answer.header is not None else -1
        check_equal(session, 0, f"no session is open; the answer to {name} has {session:#06x}")
