"""HG-3.3, HG-3.8, HG-3.9, HG-4.9: every type of the byte, every two defects, every count."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, Final

from haptogram_protocol.framing import encode_frame
from haptogram_protocol.messages import (
    MESSAGES,
    REQUEST_RANGE,
    STREAM_RANGE,
    ErrorCode,
    Flag,
    Message,
    Ping,
    Pong,
    UploadChunk,
)

from ...case import case
from ...client.board_client import BoardClient
from ...client.playback import send_phases_to_store_if_supported
from ...client.stream_kinds import refused_requests_to_send, stream_kinds, valid_requests_to_send
from ...outcome import SELF_REPORTED, named

_SEQUENCE: Final = 2
#: Defects of requests in the order of HG-3.8, with the codes of their refusals.
_OF_REQUESTS: Final = {
    "type": ErrorCode.UNSUPPORTED,
    "session": ErrorCode.STALE_SESSION,
    "flags": ErrorCode.UNSUPPORTED,
    "length": ErrorCode.BAD_LENGTH,
    "number": ErrorCode.SEQUENCE_REUSED,
}
#: Defects of stream frames in this order, with their counters.
_OF_STREAM: Final = {
    "type": "unknown_type",
    "session": "stale_session",
    "number": "duplicate",
    "flags": "unsupported",
    "length": "bad_length",
}


# --- Types -------------------------------------------------------------------------------------


def _unknown_frame_types(types: Iterable[int]) -> list[int]:
    return [kind for kind in types if kind not in MESSAGES]


@case("HG-3.3/2-types", evidence=SELF_REPORTED)
def foreign_types_are_dropped(board: BoardClient) -> None:
    """each of the 189 types that no host may send, of any session: dropped and counted, no
    answer
    """
    board.arm()
    streams = _unknown_frame_types(STREAM_RANGE)
    others = list(range(REQUEST_RANGE.stop, 0x100))
    for session in (board.link.session, board.link.session ^ 0x8000, 0):
        number = len(streams) + len(others)
        with board.counting(unknown_type=number, frames=number + 1, requests=1):  # a barrier
            wires = []
            for kind in streams:
                seq = None if session == board.link.session else board.link.stream_next
                wires.append(board.link.stream_raw(kind, b"", session=session, seq=seq))
            for kind in others:
                body = board.link.body(kind, bytes(4), seq=board.link.seq, session=session)
                wires.append(encode_frame(body))
            board.link.unanswered("a frame of a type that no host may send", *wires)


@case("HG-3.3/3-types")
def unknown_types_are_refused(board: BoardClient) -> None:
    """each of the 48 unknown types of requests, of any session, is refused by its type:
    UNSUPPORTED
    """
    kinds = _unknown_frame_types(REQUEST_RANGE)
    with board.counting(requests=2 * len(kinds)):
        for kind in kinds:
            for session in (board.link.session, board.link.session ^ 0x0010):
                payload = board.random.randbytes(kind % 20)
                board.link.refused_raw(kind, payload, ErrorCode.UNSUPPORTED, kind, session=session)


# --- Two defects -------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Frame:
    """A frame of a host in the making."""

    kind: int
    payload: bytes
    seq: int
    session: int
    flags: int = 0

    @property
    def header(self) -> dict[str, int]:
        """The fields of the header beside type and time."""
        return {"seq": self.seq, "session": self.session, "flags": self.flags}


def _spoil(board: BoardClient, frame: _Frame, defects: Iterable[str]) -> _Frame:
    """Return a frame with these defects."""
    draw, stream = board.random, frame.kind in STREAM_RANGE
    used = board.link.stream_next - 1 if stream else board.link.seq
    varies = frame.kind == UploadChunk.TYPE
    changes: dict[str, dict[str, Any]] = {
        "type": {
            "kind": draw.choice(_unknown_frame_types(STREAM_RANGE if stream else REQUEST_RANGE))
        },
        "session": {"session": board.link.session ^ 1 << draw.randrange(16)},
        "flags": {"flags": frame.flags | draw.choice((0x20, 0x40, 0x80, 0xE0))},
        "length": {"payload": frame.payload[:3] if varies else frame.payload + b"\x00"},
        "number": {"seq": used & 0xFFFF},
    }
    for defect in defects:
        frame = replace(frame, **changes[defect])
    return frame


def _detail_of_defect(board: BoardClient, frame: _Frame, defect: str, right: _Frame) -> int:
    """Return the detail of the ERROR for a defect; *right* is the frame without one."""
    kind = MESSAGES[right.kind]
    return {
        "type": frame.kind,
        "session": board.link.session,
        "flags": frame.flags & 0xE0,
        "length": 0 if kind.TAIL else kind.LAYOUT.size,
        "number": frame.seq,
    }[defect]


def _pairs_of_defects(board: BoardClient, defects: Iterable[str]) -> list[tuple[str, ...]]:
    """Return every two defects in order, each alone and all together; if quick, neighbours only."""
    every = tuple(defects)
    if not board.thorough:
        return [*itertools.pairwise(every), every]
    return [*((one,) for one in every), *itertools.combinations(every, 2), every]


def _name_with_defects(name: str, defects: Iterable[str]) -> str:
    return f"{name} with {', '.join(f'a wrong {defect}' for defect in defects)}"


def _right_request(board: BoardClient, message: Message) -> _Frame:
    seq = board.link.seq + 1 & 0xFFFF
    return _Frame(message.TYPE, message.serialize(), seq, board.link.session)


@case("HG-3.8/1-requests", evidence=SELF_REPORTED)
def two_defects_of_requests(board: BoardClient) -> None:
    """requests of every type with every two defects are refused and counted for the first of
    them
    """
    for message in valid_requests_to_send(board, _SEQUENCE):
        right = _right_request(board, message)
        for defects in _pairs_of_defects(board, _OF_REQUESTS):
            first = defects[0]
            if isinstance(message, UploadChunk) and first == "number":
                continue  # HG-4.10: carried out every time
            frame = _spoil(board, right, defects)
            code, detail = _OF_REQUESTS[first], _detail_of_defect(board, frame, first, right)
            with named(_name_with_defects(message.TYPE.name, defects)):
                board.link.refused_raw(frame.kind, frame.payload, code, detail, **frame.header)


@case("HG-4.9/4-numbers")
def defects_leave_the_number(board: BoardClient) -> None:
    """a request of every type that is refused for one defect leaves its number free for the next"""
    for message in valid_requests_to_send(board, _SEQUENCE):
        for defect in list(_OF_REQUESTS)[:-1]:
            frame = _spoil(board, _right_request(board, message), [defect])
            with named(f"{_name_with_defects(message.TYPE.name, [defect])}, then its number"):
                board.link.ask_raw(frame.kind, frame.payload, **frame.header)
                board.link.call(Ping(frame.seq), Pong)


@case("HG-3.8/1-formats", evidence=SELF_REPORTED)
def two_defects_of_stream(board: BoardClient) -> None:
    """stream frames of every format with every two defects count once, for the first of them"""
    link = board.link
    link.stream(board.flat_phases())  # the first number is used
    for kind in stream_kinds(board):
        message = kind.make()
        for defects in _pairs_of_defects(board, _OF_STREAM):
            payload, seq = message.serialize(), link.stream_next & 0xFFFF
            right = _Frame(message.TYPE, payload, seq, link.session, Flag.IMMEDIATE)
            frame = _spoil(board, right, defects)
            link.stream_next += not {*defects} & {"session", "number"}
            name = _name_with_defects(kind.name, defects)
            with named(name), board.counting(**{_OF_STREAM[defects[0]]: 1}):
                body = link.body(frame.kind, frame.payload, **frame.header)
                link.unanswered(name, encode_frame(body))


# --- Counts ------------------------------------------------------------------------------------


@case("HG-3.9/2-types", evidence=SELF_REPORTED)
def each_type_counts_once(board: BoardClient) -> None:
    """each request of every type, carried out or refused by the board, ARMED or not, counts once"""
    send_phases_to_store_if_supported(board, _SEQUENCE, frames=2)
    for armed in (True, False) if board.thorough else (True,):
        board.arm()
        messages: list[Message] = [
            *valid_requests_to_send(board, _SEQUENCE),
            *refused_requests_to_send(board),
        ]
        if not armed:
            board.disarm()
        for message in messages:
            with named(f"one {message.TYPE.name}"), board.counting(frames=1, requests=1):
                board.link.ask_at_once(message)
