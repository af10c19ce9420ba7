"""HG-3.3, HG-3.8, HG-3.9, HG-4.9: every type of the byte, every two defects, every count."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Final

from haptogram_protocol.framing import encode_frame
from haptogram_protocol.messages import (
    MESSAGES,
    REQUEST_RANGE,
    STREAM_RANGE,
    ErrorCode,
    Flag,
    Message,
    Ping,
    Play,
    Pong,
    UploadChunk,
)

from ...case import case
from ...client.board_client import BoardClient
from ...client.playback import send_phases_to_store_if_supported
from ...client.stream_kinds import refused_requests_to_send, stream_kinds, valid_requests_to_send
from ...outcome import SELF_REPORTED, check_equal, named

_SEQUENCE: Final = 2


# --- Types -------------------------------------------------------------------------------------


def _unknown_frame_types(types: Iterable[int]) -> list[int]:
    return [kind for kind in types if kind not in MESSAGES]


@case("HG-3.3/2-types", evidence=SELF_REPORTED)
def every_foreign_header_type_is_dropped(board: BoardClient) -> None:
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
def every_unknown_header_type_is_refused(board: BoardClient) -> None:
    """each of the 48 unknown types of requests, of any session, is refused by its type:
    UNSUPPORTED
    """
    kinds = _unknown_frame_types(REQUEST_RANGE)
    with board.counting(requests=2 * len(kinds)):
        for kind in kinds:
            for session in (board.link.session, board.link.session ^ 0x0010):
                board.link.refused_raw(
                    kind,
                    board.random.randbytes(kind % 20),
                    ErrorCode.UNSUPPORTED,
                    kind,
                    session=session,
                )


# --- Two defects -------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Frame:
    """A frame of a host in the making."""

    kind: int
    payload: bytes
    seq: int
    session: int
    flags: int = 0


@dataclass(frozen=True, slots=True)
class _Defect:
    """A defect of a frame, and how a board tells it.

    Attributes
    ----------
    name, counter : str
        For reports; what counts the frame.
    spoil : callable
        Takes client and frame, returns the frame with the defect.
    code : ErrorCode or None
        Of the refusal of a request; None: of stream frames only.
    """

    name: str
    counter: str
    spoil: Callable[[BoardClient, _Frame], _Frame]
    code: ErrorCode | None = None


def _detail_of_defect(board: BoardClient, frame: _Frame, defect: _Defect, right: _Frame) -> int:
    """Return the detail of the ERROR for a defect; *right* is the frame without one."""
    kind = MESSAGES[right.kind]
    length = 0 if kind.TAIL else kind.LAYOUT.size
    return {
        "type": frame.kind,
        "session": board.link.session,
        "flags": frame.flags & 0xE0,
        "length": length,
        "number": frame.seq,
    }[defect.name]


def _header_type_defect(board: BoardClient, frame: _Frame) -> _Frame:
    of = STREAM_RANGE if frame.kind in STREAM_RANGE else REQUEST_RANGE
    return replace(frame, kind=board.random.choice(_unknown_frame_types(of)))


def _header_session_defect(board: BoardClient, frame: _Frame) -> _Frame:
    return replace(frame, session=board.link.session ^ 1 << board.random.randrange(16))


def _header_flags_defect(board: BoardClient, frame: _Frame) -> _Frame:
    return replace(frame, flags=frame.flags | board.random.choice((0x20, 0x40, 0x80, 0xE0)))


def _length_defect(_: BoardClient, frame: _Frame) -> _Frame:
    varies = frame.kind == UploadChunk.TYPE
    return replace(frame, payload=frame.payload[:3] if varies else frame.payload + b"\x00")


def _header_number_defect(board: BoardClient, frame: _Frame) -> _Frame:
    stream = frame.kind in STREAM_RANGE
    used = board.link.stream_next - 1 if stream else board.link.seq
    return replace(frame, seq=used & 0xFFFF)


#: In the order of HG-3.8.
_OF_REQUESTS: Final = (
    _Defect("type", "requests", _header_type_defect, ErrorCode.UNSUPPORTED),
    _Defect("session", "requests", _header_session_defect, ErrorCode.STALE_SESSION),
    _Defect("flags", "requests", _header_flags_defect, ErrorCode.UNSUPPORTED),
    _Defect("length", "requests", _length_defect, ErrorCode.BAD_LENGTH),
    _Defect("number", "requests", _header_number_defect, ErrorCode.SEQUENCE_REUSED),
)
_OF_STREAM: Final = (
    _Defect("type", "unknown_type", _header_type_defect),
    _Defect("session", "stale_session", _header_session_defect),
    _Defect("number", "duplicate", _header_number_defect),
    _Defect("flags", "unsupported", _header_flags_defect),
    _Defect("length", "bad_length", _length_defect),
)


def _pairs_of_defects(board: BoardClient, defects: Iterable[_Defect]) -> list[tuple[_Defect, ...]]:
    """Return every two defects in order, each alone and all together; if quick, neighbours only."""
    every = tuple(defects)
    if not board.thorough:
        return [*itertools.pairwise(every), every]
    return [*((one,) for one in every), *itertools.combinations(every, 2), every]


@case("HG-3.8/1-requests", evidence=SELF_REPORTED)
def requests_with_every_two_defects_are_checked_in_order(board: BoardClient) -> None:
    """requests of every type with every two defects are refused and counted for the first of
    them
    """
    for message in valid_requests_to_send(board, _SEQUENCE):
        seq = board.link.seq + 1 & 0xFFFF
        right = _Frame(message.TYPE, message.serialize(), seq, board.link.session)
        for defects in _pairs_of_defects(board, _OF_REQUESTS):
            if isinstance(message, UploadChunk) and defects[0].name == "number":
                continue  # HG-4.10: carried out every time
            frame = right
            for defect in defects:
                frame = defect.spoil(board, frame)
            first = defects[0]
            assert first.code is not None  # of a request
            with named(f"{message.TYPE.name} with {_names_of_defects(defects)}"):
                board.link.refused_raw(
                    frame.kind,
                    frame.payload,
                    first.code,
                    _detail_of_defect(board, frame, first, right),
                    seq=frame.seq,
                    session=frame.session,
                    flags=frame.flags,
                )


@case("HG-4.9/4-numbers")
def every_defect_leaves_the_request_number(board: BoardClient) -> None:
    """a request of every type that is refused for one defect leaves its number free for the next"""
    for message in valid_requests_to_send(board, _SEQUENCE):
        for defect in _OF_REQUESTS[:-1]:
            seq = board.link.seq + 1 & 0xFFFF
            right = _Frame(message.TYPE, message.serialize(), seq, board.link.session)
            frame = defect.spoil(board, right)
            with named(f"{message.TYPE.name} with a wrong {defect.name}, then its number"):
                board.link.ask_raw(
                    frame.kind, frame.payload, seq=seq, session=frame.session, flags=frame.flags
                )
                board.link.call(Ping(seq), Pong)


@case("HG-3.8/1-formats", evidence=SELF_REPORTED)
def stream_frames_with_every_two_defects_are_checked_in_order(board: BoardClient) -> None:
    """stream frames of every format with every two defects count once, for the first of them"""
    board.link.stream(board.flat_phases())  # the first number is used
    for kind in stream_kinds(board):
        message = kind.make()
        for some in _pairs_of_defects(board, _OF_STREAM):
            frame = _Frame(
                message.TYPE,
                message.serialize(),
                board.link.stream_next & 0xFFFF,
                board.link.session,
                Flag.IMMEDIATE,
            )
            for defect in some:
                frame = defect.spoil(board, frame)
            names = {defect.name for defect in some}
            board.link.stream_next += not names & {"session", "number"}
            body = board.link.body(
                frame.kind, frame.payload, seq=frame.seq, flags=frame.flags, session=frame.session
            )
            name = f"{kind.name} with {_names_of_defects(some)}"
            with named(name), board.counting(**{some[0].counter: 1}):
                board.link.unanswered(name, encode_frame(body))


def _names_of_defects(defects: Iterable[_Defect]) -> str:
    return ", ".join(f"a wrong {defect.name}" for defect in defects)


# --- Counts ------------------------------------------------------------------------------------


@case("HG-3.9/2-types", evidence=SELF_REPORTED)
def every_header_type_counts_once(board: BoardClient) -> None:
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
            flags = Flag.IMMEDIATE if isinstance(message, Play) else 0
            before = board.status().counters
            board.link.ask(message, flags=flags)
            counted = board.counted_since(before)
            found = {name: counted[name] for name in ("frames", "requests", "repeated")}
            due = {"frames": 1, "requests": 1, "repeated": 0}
            check_equal(found, due, f"one {message.TYPE.name} counts {found}")
