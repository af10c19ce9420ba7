"""HG-4.9: which request uses its number, and which reply is remembered: a table.

A request of the session uses its number if it is carried out, or refused by the board itself, and
if that number is ahead of the newest one.  Nothing sets the newest number back.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

from haptogram_protocol.framing import encode_frame
from haptogram_protocol.messages import (
    VERSION_MAJOR,
    Arm,
    ErrorCode,
    Feature,
    Flag,
    Hello,
    Message,
    Mute,
    Ping,
    Play,
    Pong,
    UploadChunk,
    UploadKind,
)
from haptogram_protocol.rules import UPLOADS
from haptogram_protocol.state import OutputState

from ...case import case
from ...client.board_client import BoardClient
from ...client.playback import send_phases_to_store_if_supported
from ...client.stream_kinds import refused_requests_to_send, valid_requests_to_send
from ...client.uploads import begin_upload
from ...client.wire import ReceivedByClient
from ...judge.repetition import judge_same_answer
from ...outcome import SELF_REPORTED, CaseEndedError, check

_SEQUENCE: Final = 4
_STALE: Final = 0x0F0F
_UNKNOWN_FLAG: Final = 0x40
_UNKNOWN_REQUEST: Final = 0x7B
_FARTHEST: Final = 32_767
#: How far a number is ahead of the newest one; negative: behind it.
_STEPS: Final = (1, 2, 300, _FARTHEST, 0, -1, -2, -300, -_FARTHEST)
_QUICK_STEPS: Final = (2, 0, -1, -300)

#: Returns the bytes of a request with a number.
_MakeRequest: TypeAlias = Callable[[BoardClient, int], bytes]


@dataclass(frozen=True, slots=True)
class NumberUse:
    """A request, and what it does to the numbers of a session.

    Attributes
    ----------
    name : str
        For reports.
    kind : int
        Its type.
    make : callable
        Returns its bytes with a number.
    is_used : bool
        Whether a number that is ahead of the newest one is the newest one behind it.
    is_remembered : bool
        Whether its reply is the remembered one behind it; it is refused unless it is ahead.
    """

    name: str
    kind: int
    make: _MakeRequest
    is_used: bool
    is_remembered: bool = False


def _use(name: str, kind: int, payload: bytes, *, is_used: bool, **header: Any) -> NumberUse:
    def make(board: BoardClient, seq: int) -> bytes:
        session = board.link.session ^ header["xor"] if "xor" in header else header.get("session")
        flags = header.get("flags", 0)
        return encode_frame(board.link.body(kind, payload, seq=seq, flags=flags, session=session))

    return NumberUse(name, kind, make, is_used)


def _uses_of_any_number(board: BoardClient) -> Iterator[NumberUse]:
    """Yield requests that are judged alike whatever their number is."""
    mute, ping, chunk = int(Mute.TYPE), int(Ping.TYPE), int(UploadChunk.TYPE)
    first = UploadChunk(0, b"\x01").serialize()
    yield _use("MUTE", mute, b"", is_used=True)
    yield _use("MUTE with flags and payload", mute, b"more", is_used=True, flags=_UNKNOWN_FLAG)
    yield _use("MUTE without a session", mute, b"", is_used=False, session=0)
    yield _use("MUTE of another session", mute, b"", is_used=False, xor=_STALE)
    if board.identity.features & UPLOADS:
        far = UploadChunk(0x7FFFFFFF, b"far behind").serialize()
        yield _use("UPLOAD_CHUNK", chunk, first, is_used=True)
        yield _use("UPLOAD_CHUNK past the end", chunk, far, is_used=True)
        yield _use("UPLOAD_CHUNK, flagged", chunk, first, is_used=False, flags=_UNKNOWN_FLAG)
        yield _use("UPLOAD_CHUNK too short", chunk, b"\x00", is_used=False)
        yield _use("UPLOAD_CHUNK of another session", chunk, first, is_used=False, xor=_STALE)
    for name, hello in (
        ("HELLO again", board.hello_message(board.link.session)),
        ("HELLO of another version", Hello(VERSION_MAJOR + 1, 0, 1, 0)),
        ("HELLO with the nonce 0", Hello(VERSION_MAJOR, 0, 0, 0)),
    ):
        yield _use(name, Hello.TYPE, hello.serialize(), is_used=False, session=0)
    yield _use("an unknown request", _UNKNOWN_REQUEST, b"", is_used=False)
    yield _use("PING, flagged", ping, bytes(8), is_used=False, flags=_UNKNOWN_FLAG)
    yield _use("PING too short", ping, bytes(7), is_used=False)
    yield _use("PING of another session", ping, bytes(8), is_used=False, xor=_STALE)


def _uses_of_later_numbers(board: BoardClient) -> Iterator[NumberUse]:
    """Yield every request that is remembered, carried out and refused."""
    for message in (*valid_requests_to_send(board, _SEQUENCE), *refused_requests_to_send(board)):
        if not isinstance(message, UploadChunk):
            yield _remembered_use(message)


def _remembered_use(message: Message) -> NumberUse:
    flags = int(Flag.IMMEDIATE) if isinstance(message, Play) else 0

    def make(board: BoardClient, seq: int) -> bytes:
        return board.link.request_wire(message, seq=seq, flags=flags)[0]

    return NumberUse(message.TYPE.name, message.TYPE, make, is_used=True, is_remembered=True)


@case(
    "HG-4.9/3",
    "requests of every type, ahead of the newest number and behind it: nothing sets it back",
    variant="steps",
    evidence=SELF_REPORTED,
)
def no_request_sets_the_newest_number_back(board: BoardClient) -> None:
    steps = _STEPS if board.thorough else _QUICK_STEPS
    send_phases_to_store_if_supported(board, _SEQUENCE, frames=2)
    if board.identity.features & UPLOADS:
        _begin_upload_for_numbers(board)
    for use in _uses_of_any_number(board):
        for step in steps:
            _judge_step(board, use, step)
    for use in _uses_of_later_numbers(board) if board.thorough else ():
        for step in steps:
            if step > 0:
                _judge_step(board, use, step)


def _begin_upload_for_numbers(board: BoardClient) -> None:
    """Announce an upload, whose chunks are taken then."""
    count = board.identity.transducers
    if board.has(Feature.CORRECTION):
        begin_upload(board, UploadKind.CORRECTION, 0, bytes(count))
    elif board.has(Feature.SEQUENCE_PHASES):
        begin_upload(board, UploadKind.PHASES, _SEQUENCE, bytes(count))


def _judge_step(board: BoardClient, use: NumberUse, step: int) -> None:
    """FAILED unless behind a request the numbers up to the newest are used, and the next is not."""
    arm, delayed = board.link.request_wire(Arm())
    _answer_to_step(board, arm, Arm.TYPE, delayed)
    if not use.is_remembered:
        board.disarm()
    wire, before = board.link.request_wire(Ping(step & 0xFFFF))
    kind, reply = Ping.TYPE, _answer_to_step(board, wire, Ping.TYPE, before)
    number = board.link.seq + step
    sent = use.make(board, number & 0xFFFF)
    answer = _answer_to_step(board, sent, use.kind, number & 0xFFFF)
    newest = number if use.is_used and step > 0 else board.link.seq
    if use.is_remembered:
        wire, before, reply = sent, number & 0xFFFF, answer
    text = f"behind {use.name} of a number {step:+d} from the newest one"
    again = _answer_to_step(board, wire, use.kind if use.is_remembered else kind, before)
    judge_same_answer(again, reply, text)
    for old in sorted({newest, newest - 1, board.link.seq, number, number + 1}):
        if newest - _FARTHEST <= old <= newest:
            _check_step_is_refused(board, Ping(board.random.getrandbits(64)), old, text)
    if newest - board.link.seq < _FARTHEST - 3 and not use.is_remembered:
        late = _answer_to_step(board, arm, Arm.TYPE, delayed)
        board.link.error_in(late, Arm.TYPE, ErrorCode.SEQUENCE_REUSED, delayed)
        board.link.seq = newest
        state = board.status().state
        check(state is not OutputState.ARMED, f"{text} a delayed copy of ARM was carried out")
    board.link.seq = max(newest, board.link.seq)
    board.link.call(Ping(1), Pong)  # the next number is not used


def _answer_to_step(board: BoardClient, wire: bytes, kind: int, seq: int) -> ReceivedByClient:
    since = board.link.mark()
    board.link.send(wire)
    return board.link.answer_to(kind, seq, since)


def _check_step_is_refused(board: BoardClient, message: Message, seq: int, text: str) -> None:
    answer = board.link.ask(message, seq=seq)
    try:
        board.link.error_in(answer, message.TYPE, ErrorCode.SEQUENCE_REUSED, seq & 0xFFFF)
    except CaseEndedError as error:
        raise CaseEndedError(error.behaviour, f"{text}, {seq & 0xFFFF}: {error}") from None
