"""HG-3.3: message types."""

from __future__ import annotations

from typing import Final

from haptogram_protocol.annotation.words import annotated_type_name
from haptogram_protocol.framing import encode_frame
from haptogram_protocol.messages import (
    MESSAGES,
    REQUEST_RANGE,
    RESPONSE_OFFSET,
    STREAM_RANGE,
    ErrorCode,
    Hello,
    Message,
    MessageType,
    Mute,
)

from ...case import case, case_about_host
from ...client.board_client import BoardClient
from ...client.capabilities import requests_that_board_takes, session_for_request
from ...outcome import SELF_REPORTED, check

_UNKNOWN_REQUESTS: Final = (0x50, 0x7E, 0x7F)


@case("HG-3.3/1")
def header_has_the_right_reply_type(board: BoardClient) -> None:
    """each request is answered by its type + 0x40, or by ERROR"""
    kinds: list[type[Message]] = [*requests_that_board_takes(board), Mute]
    for kind in kinds:
        payload = bytes(kind.LAYOUT.size)
        if kind is Hello:
            payload = board.hello_message(board.link.session).serialize()
        answer = board.link.ask_raw(kind.TYPE, payload, session=session_for_request(board, kind))
        got = board.link.type_of(answer)
        check(
            got in (kind.TYPE + RESPONSE_OFFSET, MessageType.ERROR),
            f"{kind.TYPE.name} is answered by {annotated_type_name(got)}",
        )


@case("HG-3.3/2", evidence=SELF_REPORTED)
def drops_unknown_header_types(board: BoardClient) -> None:
    """stream, response and event frames of unknown types are counted in unknown_type, unanswered"""
    kinds = (0x00, 0x04, 0x3F, 0x80, 0xBE, 0xBF, 0xC0, 0xFF)
    frames = [
        board.link.stream_raw(kind, bytes(5))
        if kind in STREAM_RANGE
        else encode_frame(board.link.body(kind, bytes(5), seq=kind))
        for kind in kinds
    ]
    with board.counting(unknown_type=len(kinds)):
        board.link.unanswered("a frame of an unknown type", *frames)


@case("HG-3.3/3")
def refuses_unknown_header_types(board: BoardClient) -> None:
    """unknown requests are refused with UNSUPPORTED and their type, and counted"""
    unknown = [kind for kind in _UNKNOWN_REQUESTS if kind not in MESSAGES]
    with board.counting(requests=len(unknown)):
        for kind in unknown:
            assert kind in REQUEST_RANGE  # the tuple above says so
            board.link.refused_raw(kind, bytes(3), ErrorCode.UNSUPPORTED, kind)


not_host_response = case_about_host("HG-3.3/4")
