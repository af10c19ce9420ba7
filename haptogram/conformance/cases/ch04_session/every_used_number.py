"""HG-4.9: which request uses its number, and which reply is remembered: a table.

A request of the session uses its number if it is carried out, or refused by the board itself, and
if that number is ahead of the newest one.  Nothing sets the newest number back.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from haptogram_protocol.messages import (
    VERSION_MAJOR,
    Arm,
    ErrorCode,
    Feature,
    Hello,
    Message,
    Mute,
    Ping,
    Pong,
    UploadChunk,
)
from haptogram_protocol.rules import UPLOADS
from haptogram_protocol.state import OutputState

from ...case import case
from ...client.board_client import BoardClient
from ...client.playback import send_phases_to_store_if_supported
from ...client.request_client import flags_at_once
from ...client.stream_kinds import refused_requests_to_send, valid_requests_to_send
from ...client.uploads import begin_any_upload
from ...client.wire import ReceivedByClient
from ...judge.repetition import judge_same_answer
from ...outcome import SELF_REPORTED, check, named

_SEQUENCE: Final = 4
_STALE: Final = 0x0F0F
_UNKNOWN_FLAG: Final = 0x40
_UNKNOWN_REQUEST: Final = 0x7B
_FARTHEST: Final = 32_767
#: How far a number is ahead of the newest one; negative: behind it.
_STEPS: Final = (1, 2, 300, _FARTHEST, 0, -1, -2, -300, -_FARTHEST)
_QUICK_STEPS: Final = (2, 0, -1, -300)


@dataclass(frozen=True, slots=True)
class NumberUse:
    """A request, and what it does to the numbers of a session.

    Attributes
    ----------
    name : str
        For reports.
    kind, payload, header
        Its type, its payload, fields of its header.
    is_used : bool
        Whether a number that is ahead of the newest one is the newest one behind it.
    is_remembered : bool
        Whether its reply is the remembered one behind it; it is refused unless it is ahead.
    """

    name: str
    kind: int
    payload: bytes = b""
    header: Mapping[str, int] = field(default_factory=dict)
    is_used: bool = False
    is_remembered: bool = False

    def ask(self, board: BoardClient, seq: int) -> ReceivedByClient:
        """Send the request with a number and return its answer."""
        return board.link.ask_raw(self.kind, self.payload, seq=seq, **self.header)


def _uses_of_any_number(board: BoardClient) -> Iterator[NumberUse]:
    """Yield requests that are judged alike whatever their number is."""
    mute, ping, chunk = int(Mute.TYPE), int(Ping.TYPE), int(UploadChunk.TYPE)
    stale: dict[str, Any] = {"session": board.link.session ^ _STALE}
    closed, flagged = {"session": 0}, {"flags": _UNKNOWN_FLAG}
    yield NumberUse("MUTE", mute, is_used=True)
    yield NumberUse("MUTE with flags and payload", mute, b"more", flagged, is_used=True)
    yield NumberUse("MUTE without a session", mute, b"", closed)
    yield NumberUse("MUTE of another session", mute, b"", stale)
    if board.identity.features & UPLOADS:
        first = UploadChunk(0, b"\x01").serialize()
        far = UploadChunk(0x7FFFFFFF, b"far behind").serialize()
        yield NumberUse("UPLOAD_CHUNK", chunk, first, is_used=True)
        yield NumberUse("UPLOAD_CHUNK past the end", chunk, far, is_used=True)
        yield NumberUse("UPLOAD_CHUNK, flagged", chunk, first, flagged)
        yield NumberUse("UPLOAD_CHUNK too short", chunk, b"\x00")
        yield NumberUse("UPLOAD_CHUNK of another session", chunk, first, stale)
    for name, hello in (
        ("HELLO again", board.hello_message(board.link.session)),
        ("HELLO of another version", Hello(VERSION_MAJOR + 1, 0, 1, 0)),
        ("HELLO with the nonce 0", Hello(VERSION_MAJOR, 0, 0, 0)),
    ):
        yield NumberUse(name, Hello.TYPE, hello.serialize(), closed)
    yield NumberUse("an unknown request", _UNKNOWN_REQUEST)
    yield NumberUse("PING, flagged", ping, bytes(8), flagged)
    yield NumberUse("PING too short", ping, bytes(7))
    yield NumberUse("PING of another session", ping, bytes(8), stale)


def _uses_of_later_numbers(board: BoardClient) -> Iterator[NumberUse]:
    """Yield every request that is remembered, carried out and refused."""
    for message in (*valid_requests_to_send(board, _SEQUENCE), *refused_requests_to_send(board)):
        if not isinstance(message, UploadChunk):
            yield _remembered_use(message)


def _remembered_use(message: Message) -> NumberUse:
    header = {"flags": flags_at_once(message)}
    name = message.TYPE.name
    return NumberUse(name, message.TYPE, message.serialize(), header, True, True)


@case("HG-4.9/3-steps", evidence=SELF_REPORTED)
def no_request_sets_the_newest_number_back(board: BoardClient) -> None:
    """requests of every type, ahead of the newest number and behind it: nothing sets it back"""
    steps = _STEPS if board.thorough else _QUICK_STEPS
    send_phases_to_store_if_supported(board, _SEQUENCE, frames=2)
    if board.identity.features & (Feature.SEQUENCE_PHASES | Feature.CORRECTION):
        begin_any_upload(board, _SEQUENCE)  # whose chunks are taken then
    for use in _uses_of_any_number(board):
        for step in steps:
            _judge_step(board, use, step)
    for use in _uses_of_later_numbers(board) if board.thorough else ():
        for step in steps:
            if step > 0:
                _judge_step(board, use, step)


def _judge_step(board: BoardClient, use: NumberUse, step: int) -> None:
    """FAILED unless behind a request the numbers up to the newest are used, and the next is not."""
    board.link.ask(Arm())
    delayed = board.link.seq
    if not use.is_remembered:
        board.disarm()
    ping = Ping(step & 0xFFFF)
    first, before = board.link.ask(ping), board.link.seq
    number = before + step
    answer = use.ask(board, number)
    newest = number if use.is_used and step > 0 else before
    text = f"behind {use.name} of a number {step:+d} from the newest one"
    if use.is_remembered:
        judge_same_answer(use.ask(board, number), answer, text)
    else:
        judge_same_answer(board.link.ask(ping, seq=before), first, text)
    for old in sorted({newest, newest - 1, before, number, number + 1}):
        if newest - _FARTHEST <= old <= newest:
            with named(f"{text}, {old & 0xFFFF}"):
                other = Ping(board.random.getrandbits(64))
                board.link.refused(other, ErrorCode.SEQUENCE_REUSED, old & 0xFFFF, seq=old)
    if newest - before < _FARTHEST - 3 and not use.is_remembered:
        used = delayed & 0xFFFF
        board.link.refused(Arm(), ErrorCode.SEQUENCE_REUSED, used, seq=delayed)
        board.link.seq = newest
        state = board.status().state
        check(state is not OutputState.ARMED, f"{text} a delayed copy of ARM was carried out")
    board.link.seq = max(newest, board.link.seq)
    board.link.call(Ping(1), Pong)  # the next number is not used
