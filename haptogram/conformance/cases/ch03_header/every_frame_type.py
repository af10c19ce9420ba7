"""HG-2.4, HG-3.3, HG-3.4, HG-3.8, HG-3.9, HG-4.9, HG-4.11, HG-4.12, HG-6.4: frames of a host, at
every type and defect.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

from haptogram_protocol import messages as m
from haptogram_protocol.framing import encode_frame

from ...case import case
from ...client import malformed_frames, playback, uploads
from ...client.board_client import BoardClient
from ...client.request_client import flags_at_once
from ...client.stream_kinds import (
    StreamKind,
    refused_requests_to_send,
    request_types_of_host,
    stream_kinds,
    valid_requests_to_send,
)
from ...client.wire import ReceivedByClient
from ...judge.repetition import judge_repeated_reply
from ...outcome import SELF_REPORTED, check, check_equal, named
from ..ch04_session.identity import check_answer_session
from ..ch04_session.requests import judge_stale_requests

_SEQUENCE: Final = 3
_LONG: Final = 3000
_UNKNOWN_REQUEST: Final = 0x7B
_FLIPS: Final = (1, 1 << 15, 1 << 16, 1 << 31)
_IDEMPOTENT: Final = (m.Mute, m.UploadChunk)  # HG-4.10
_LOW_FLAGS: Final = (1, 2, 4, 8, 15)
#: Defects of requests in the order of HG-3.8, with the codes of their refusals.
_OF_REQUESTS: Final = {
    "type": m.ErrorCode.UNSUPPORTED,
    "session": m.ErrorCode.STALE_SESSION,
    "flags": m.ErrorCode.UNSUPPORTED,
    "length": m.ErrorCode.BAD_LENGTH,
    "number": m.ErrorCode.SEQUENCE_REUSED,
}
#: Defects of stream frames in this order, with their counters.
_OF_STREAM: Final = {
    "type": "unknown_type",
    "session": "stale_session",
    "number": "duplicate",
    "flags": "unsupported",
    "length": "bad_length",
}


@case("HG-2.4/2-types", evidence=SELF_REPORTED)
def crc_of_every_type(board: BoardClient) -> None:
    """frames of every type, short and long, with a bit of CRC or payload inverted, count in crc"""
    board.arm()
    for kind, payload in _payloads_of_every_type(board):
        stream = kind not in m.REQUEST_RANGE
        seq = board.link.stream_next if stream else board.link.next_seq()
        body = board.link.body(kind, payload, seq=seq, flags=0x10 * stream)
        frames = [malformed_frames.malformed_with_wrong_crc(body, flip) for flip in _FLIPS]
        frames.append(_damaged_of_every_type(body))
        wires = board.within_timers(map(malformed_frames.malformed_frame, frames))
        with board.counting(crc=len(wires), frames=1, requests=1):  # the barrier's
            text = f"type {kind:#04x} with {len(payload)} bytes and a wrong CRC"
            board.link.unanswered(text, *wires)


def _payloads_of_every_type(board: BoardClient) -> list[tuple[int, bytes]]:
    """Return (type, payload) of every message that a host sends.

    Payloads are zeros for requests, valid for stream frames and HELLO, and 3000 random bytes for
    MUTE and UPLOAD_CHUNK.
    """
    fixed = [(int(kind.TYPE), bytes(kind.LAYOUT.size)) for kind in request_types_of_host()]
    messages = [kind.make() for kind in stream_kinds(board)]
    messages.append(m.UploadChunk(0, board.random.randbytes(_LONG)))
    messages.append(board.hello_message(board.new_nonce()))
    valid = [(int(message.TYPE), message.serialize()) for message in messages]
    return [*fixed, *valid, (int(m.Mute.TYPE), board.random.randbytes(_LONG))]


def _damaged_of_every_type(body: bytes) -> bytes:
    """Return *body* with bit 3 of its last byte flipped, then the CRC of the body as it was."""
    whole = bytearray(malformed_frames.malformed_with_crc(body))
    whole[len(body) - 1] ^= 0x08
    return bytes(whole)


# --- Requests ----------------------------------------------------------------------------------


def _requests_of_every_type(board: BoardClient) -> list[m.Message]:
    """Store a sequence and arm; return a valid request of every type."""
    playback.send_phases_to_store_if_supported(board, _SEQUENCE, frames=2)
    board.arm()
    return list(valid_requests_to_send(board, _SEQUENCE))


@case("HG-4.12/1-types")
def session_of_every_type(board: BoardClient) -> None:
    """a request of every type of another session, or of none, is refused: STALE_SESSION"""
    requests, session = _requests_of_every_type(board), board.link.session
    judge_stale_requests(board, requests, [0, *(session ^ 1 << bit for bit in range(16))])


@case("HG-3.4/1-requests")
def flags_of_every_type(board: BoardClient) -> None:
    """each unknown flag in a request of every type is refused: UNSUPPORTED, detail: the flag"""
    flags = (0x20, 0x40, 0x80, 0xE0, 0x10, 0x30, 0xF0)
    judge_unknown_flags(board, _requests_of_every_type(board), [flag | 0x0A for flag in flags])


def judge_unknown_flags(
    board: BoardClient, messages: Iterable[m.Message], flags: Sequence[int]
) -> None:
    """FAILED unless requests with each of *flags* that they do not know are refused by its bits."""
    for message in messages:
        known = ~flags_at_once(message) & m.MUST_UNDERSTAND
        unknown = [flag for flag in flags if flag & known]
        with board.counting(requests=len(unknown)):
            for flag in unknown:
                board.link.refused(message, m.ErrorCode.UNSUPPORTED, flag & known, flags=flag)


@case("HG-3.4/2-requests")
def low_flags_are_ignored(board: BoardClient) -> None:
    """requests of every type with each bit of the low nibble are carried out, PLAY at once"""
    for low in _LOW_FLAGS:
        for message in _requests_of_every_type(board):
            plays = isinstance(message, m.Play)
            flags = low | flags_at_once(message)
            past_us = board.clock.device_us() - 2_000_000 if plays else 0  # HG-3.5/2: not used
            answer = board.link.ask(message, flags=flags, time_us=past_us)
            if isinstance(message, m.UploadBegin):
                uploads.require_room_for_upload(message, answer)
            due, text = message.TYPE + m.RESPONSE_OFFSET, board.link.answer_text(answer)
            name = f"{message.TYPE.name} with the flags {flags:#04x}"
            check_equal(answer.frame_header.type, due, f"{name} is answered by {text}")


@case("HG-4.9/1-types", evidence=SELF_REPORTED)
def replies_are_remembered(board: BoardClient) -> None:
    """a request of every type sent again gets the same bytes, and is not carried out again"""
    for message in _requests_of_every_type(board):
        if isinstance(message, _IDEMPOTENT):
            continue
        name = message.TYPE.name
        text = f"{name}, the same again, and its number with another request"
        with named(text), board.counting(requests=2, repeated=1):
            first = board.link.ask_at_once(message)
            seq = first.frame_header.seq
            judge_repeated_reply(board, message, first, name)
            board.link.refused_as_used(m.Ping(seq), seq)
        with named(f"an old {name}"), board.counting(requests=1, repeated=0):
            # GET_STATUS is the newest request now: what came before it is old.
            board.link.refused_as_used(message, seq)


@case("HG-6.4/1-sizes")
def mute_of_every_size(board: BoardClient) -> None:
    """MUTE with payloads of 0 to 3000 bytes, every flag and any session mutes an ARMED board"""
    every_flag = itertools.cycle([0, *(1 << bit for bit in range(8)), 0xF0, 0xFF])
    sizes = (0, 1, 2, 30, 100, 255, 256, 1000, _LONG)
    due = 2 * 3 * len(sizes)  # with an ARM each
    with board.counting(frames=due, requests=due):
        for size in sizes:
            for session in (0, board.link.session, board.link.session ^ 1):
                judge_mute(board, size, session=session, flags=next(every_flag))


def judge_mute(board: BoardClient, size: int, **header: int) -> None:
    """FAILED unless MUTE with a payload of so many bytes mutes an ARMED board."""
    board.arm()
    answer = board.link.ask_raw(m.Mute.TYPE, board.random.randbytes(size), **header)
    state = board.link.reply_in(answer, m.MuteReply).state
    check_equal(state.name, "MUTED", f"MUTE with {header}, {size} bytes: {state.name}")


# --- Number and session of each reply ----------------------------------------------------------


@case("HG-4.11/1-types")
def header_of_every_reply(board: BoardClient) -> None:
    """replies and refusals of every type have type, number and open session, whatever MUTE
    carries
    """
    for message in [*_requests_of_every_type(board), *refused_requests_to_send(board)]:
        board.arm()
        flags = flags_at_once(message)
        board.link.seq += board.random.randrange(1, 3000)
        _check_header(board, board.link.ask(message, flags=flags), message)
        seq = board.link.seq
        for again in ({"flags": 0x40}, {"seq": seq, "flags": flags}, {"seq": seq, "time_us": 5}):
            _check_header(board, board.link.ask(message, **again), message)
    for session in (board.link.session, 0, board.link.session ^ 0x0101, 0xFFFF):
        _check_header(board, board.link.ask(m.Mute(), session=session), m.Mute())
    for hello in (
        board.hello_message(board.link.session),
        m.Hello(m.VERSION_MAJOR + 1, 0, board.link.session, 0),
        m.Hello(m.VERSION_MAJOR, 0, 0, 0),
    ):
        _check_header(board, board.link.ask(hello), hello)
    _check_header(board, board.link.ask_raw(_UNKNOWN_REQUEST), None)


def _check_header(board: BoardClient, answer: ReceivedByClient, message: m.Message | None) -> None:
    """FAILED unless an answer is of the open session, and is ERROR or the reply to *message*.

    None: the request is of a type that no message has, and only ERROR is right.
    """
    name = message.TYPE.name if message is not None else "an unknown request"
    check_answer_session(answer, board.link.session, name)
    kind = answer.frame_header.type
    types = {int(m.Error.TYPE)} | (
        {message.TYPE + m.RESPONSE_OFFSET} if message is not None else set()
    )
    check(kind in types, f"{name} is answered by a frame of type {kind:#04x}")


# --- Types -------------------------------------------------------------------------------------


def _unknown_frame_types(types: Iterable[int]) -> list[int]:
    """Return those of *types* that no message has."""
    return [kind for kind in types if kind not in m.MESSAGES]


@case("HG-3.3/2-types", evidence=SELF_REPORTED)
def foreign_types_are_dropped(board: BoardClient) -> None:
    """each of the 189 types that no host may send, of any session: dropped and counted, no
    answer
    """
    board.arm()
    kinds = [*_unknown_frame_types(m.STREAM_RANGE), *range(m.REQUEST_RANGE.stop, 0x100)]
    judge_foreign_types(board, kinds, board.link.session, board.link.session ^ 0x8000, 0)


def judge_foreign_types(board: BoardClient, kinds: Sequence[int], *sessions: int) -> None:
    """FAILED unless frames of types that no host sends are counted, and not answered."""
    number = len(kinds)
    for session in sessions:
        with board.counting(unknown_type=number, frames=number + 1, requests=1):  # a barrier
            wires = [_frame_of_foreign_type(board, kind, session) for kind in kinds]
            board.link.unanswered("a frame of a type that no host may send", *wires)


def _frame_of_foreign_type(board: BoardClient, kind: int, session: int) -> bytes:
    """Return a frame of type *kind*: an empty stream frame, or a request of 4 zeros.

    A request has the number of the last one.
    """
    if kind in m.STREAM_RANGE:
        seq = None if session == board.link.session else board.link.stream_next
        return board.link.stream_raw(kind, b"", session=session, seq=seq)
    return encode_frame(board.link.body(kind, bytes(4), seq=board.link.seq, session=session))


@case("HG-3.3/3-types")
def unknown_types_are_refused(board: BoardClient) -> None:
    """each of the 48 unknown types of requests, of any session, is refused by its type:
    UNSUPPORTED
    """
    kinds = _unknown_frame_types(m.REQUEST_RANGE)
    judge_unknown_requests(board, kinds, board.link.session, board.link.session ^ 0x0010)


def judge_unknown_requests(board: BoardClient, kinds: Sequence[int], *sessions: int) -> None:
    """FAILED unless requests of unknown types are refused by their type."""
    with board.counting(requests=len(sessions) * len(kinds)):
        for kind, session in itertools.product(kinds, sessions):
            payload = board.random.randbytes(kind % 20)
            board.link.refused_raw(kind, payload, m.ErrorCode.UNSUPPORTED, kind, session=session)


# --- Two defects -------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Frame:
    """A frame of a host before it is encoded."""

    kind: int
    payload: bytes
    seq: int
    session: int
    flags: int = 0

    @property
    def header(self) -> dict[str, int]:
        """The fields of the header beside type and time."""
        return {"seq": self.seq, "session": self.session, "flags": self.flags}


def _frame_with_defects(board: BoardClient, frame: _Frame, defects: Iterable[str]) -> _Frame:
    """Return *frame* with *defects*: "type", "session", "flags", "length" or "number" is wrong."""
    draw, stream = board.random, frame.kind in m.STREAM_RANGE
    used = board.link.stream_next - 1 if stream else board.link.seq
    varies = frame.kind == m.UploadChunk.TYPE
    changes: dict[str, dict[str, Any]] = {
        "type": {
            "kind": draw.choice(_unknown_frame_types(m.STREAM_RANGE if stream else m.REQUEST_RANGE))
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
    """Return the detail due in an ERROR for *defect* in *frame*, such as the right length.

    *right* is the frame without defects.
    """
    kind = m.MESSAGES[right.kind]
    return {
        "type": frame.kind,
        "session": board.link.session,
        "flags": frame.flags & 0xE0,
        "length": 0 if kind.TAIL else kind.LAYOUT.size,
        "number": frame.seq,
    }[defect]


def _pairs_of_defects(defects: Iterable[str], *, thorough: bool) -> list[tuple[str, ...]]:
    """Return defects alone, in pairs and all at once; not *thorough*: adjacent pairs, and all."""
    every = tuple(defects)
    if not thorough:
        return [*itertools.pairwise(every), every]
    return [*((one,) for one in every), *itertools.combinations(every, 2), every]


def _name_with_defects(name: str, defects: Iterable[str]) -> str:
    """Return the name of a frame, followed by the names of its defects."""
    return f"{name} with {', '.join(f'a wrong {defect}' for defect in defects)}"


def _right_request(board: BoardClient, message: m.Message) -> _Frame:
    """Return a request without a defect, with the next number."""
    seq = board.link.seq + 1 & 0xFFFF
    return _Frame(message.TYPE, message.serialize(), seq, board.link.session)


@case("HG-3.8/1-requests", evidence=SELF_REPORTED)
def two_defects_of_requests(board: BoardClient) -> None:
    """requests of every type with every two defects are refused and counted for the first of
    them
    """
    requests = valid_requests_to_send(board, _SEQUENCE)
    judge_two_defects_of_requests(board, requests, thorough=board.thorough)


def judge_two_defects_of_requests(
    board: BoardClient, messages: Iterable[m.Message], *, thorough: bool = True
) -> None:
    """FAILED unless requests with two defects are refused for the one that is checked first."""
    for message in messages:
        right = _right_request(board, message)
        for defects in _pairs_of_defects(_OF_REQUESTS, thorough=thorough):
            first = defects[0]
            if isinstance(message, m.UploadChunk) and first == "number":
                continue  # HG-4.10: carried out every time
            frame = _frame_with_defects(board, right, defects)
            code, detail = _OF_REQUESTS[first], _detail_of_defect(board, frame, first, right)
            with named(_name_with_defects(message.TYPE.name, defects)):
                board.link.refused_raw(frame.kind, frame.payload, code, detail, **frame.header)


@case("HG-4.9/4-numbers")
def defects_leave_the_number(board: BoardClient) -> None:
    """a request of every type that is refused for one defect leaves its number free for the next"""
    for message in valid_requests_to_send(board, _SEQUENCE):
        for defect in list(_OF_REQUESTS)[:-1]:
            frame = _frame_with_defects(board, _right_request(board, message), [defect])
            with named(f"{_name_with_defects(message.TYPE.name, [defect])}, then its number"):
                board.link.ask_raw(frame.kind, frame.payload, **frame.header)
                board.link.ping(frame.seq)


@case("HG-3.8/1-formats", evidence=SELF_REPORTED)
def two_defects_of_stream(board: BoardClient) -> None:
    """stream frames of every format with every two defects count once, for the first of them"""
    judge_two_defects_of_stream(board, stream_kinds(board), thorough=board.thorough)


def judge_two_defects_of_stream(
    board: BoardClient, kinds: Iterable[StreamKind], *, thorough: bool = True
) -> None:
    """FAILED unless stream frames with two defects count for the one that is checked first."""
    link = board.link
    link.stream(board.flat_phases())  # the first number is used
    for kind in kinds:
        message = kind.make()
        for defects in _pairs_of_defects(_OF_STREAM, thorough=thorough):
            payload, seq = message.serialize(), link.stream_next & 0xFFFF
            right = _Frame(message.TYPE, payload, seq, link.session, m.Flag.IMMEDIATE)
            frame = _frame_with_defects(board, right, defects)
            link.stream_next += not {*defects} & {"session", "number"}
            name = _name_with_defects(kind.name, defects)
            with named(name), board.counting(**{_OF_STREAM[defects[0]]: 1}):
                body = link.body(frame.kind, frame.payload, **frame.header)
                link.unanswered(name, encode_frame(body))


# --- Counts ------------------------------------------------------------------------------------


@case("HG-3.9/2-types", evidence=SELF_REPORTED)
def each_type_counts_once(board: BoardClient) -> None:
    """each request of every type, carried out or refused by the board, ARMED or not, counts once"""
    playback.send_phases_to_store_if_supported(board, _SEQUENCE, frames=2)
    for armed in (True, False) if board.thorough else (True,):
        board.arm()
        messages: list[m.Message] = [
            *valid_requests_to_send(board, _SEQUENCE),
            *refused_requests_to_send(board),
        ]
        if not armed:
            board.disarm()
        for message in messages:
            with named(f"one {message.TYPE.name}"), board.counting(frames=1, requests=1):
                board.link.ask_at_once(message)
