"""HG-4.9, HG-4.10: numbers of requests: which are taken, which are used up, which are refused."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Final

from haptogram_protocol.errors import RemoteProtocolError
from haptogram_protocol.framing import HEADER_BYTES, encode_frame
from haptogram_protocol.messages import (
    MESSAGES,
    Config,
    Error,
    ErrorCode,
    Hello,
    Message,
    Mute,
    Ping,
    Pong,
    SetConfig,
    UploadChunk,
)
from haptogram_protocol.rules import UPLOADS

from ...case import case
from ...client.board_client import BoardClient
from ...client.capabilities import requests_that_board_takes
from ...client.request_client import flags_at_once
from ...client.wire import ReceivedByClient
from ...judge.repetition import judge_repeated_reply, judge_same_answer, requests_to_repeat
from ...outcome import check

_NUMBERS: Final = (0, 1, 0xFF, 0x100, 0x7FFF, 0x8000, 0xFFFE, 0xFFFF)
_LOW_FLAGS: Final = (1, 2, 4, 8)
#: Bits of the echo of a PING that, inverted, leave the low, and the high, half of its CRC-32.
_SAME_HALF_OF_CRC: Final = {"low": 0x15E3E, "high": 0x8567}


@case("HG-4.10/1-used")
def idempotent_requests_use_request_numbers(board: BoardClient) -> None:
    """the number of a MUTE or UPLOAD_CHUNK of the session, refused or not, is used:
    SEQUENCE_REUSED
    """
    messages: list[Message] = [Mute()]
    if board.identity.features & UPLOADS:
        messages += [UploadChunk(0, b""), UploadChunk(0, b"\x01"), UploadChunk(0x7FFFFFFF, b"\x01")]
    for message in messages:
        board.link.ask(message)
        seq = board.link.seq & 0xFFFF
        board.link.refused(Ping(1), ErrorCode.SEQUENCE_REUSED, seq, seq=seq)


@case("HG-4.9/3-jumps")
def every_jump_of_request_numbers_is_judged(board: BoardClient) -> None:
    """requests 1 to 32767 numbers ahead are carried out, those 1 to 32768 behind are refused"""
    for bits in range(16):
        for jump in {1 << bits, (1 << bits) - 1} - {0, 1 << 15}:
            board.link.seq += jump - 1
            board.link.call(Ping(jump), Pong)
            old = board.link.seq - (1 << bits) & 0xFFFF
            board.link.refused(Ping(jump), ErrorCode.SEQUENCE_REUSED, old, seq=old)


@case("HG-4.9/1-numbers")
def every_request_number_is_remembered(board: BoardClient) -> None:
    """requests numbered 0, 255, 0x7FFF, 0x8000, 0xFFFF and beside them get the same bytes again"""
    for number in _NUMBERS:
        board.hello(seq=number - 1 & 0xFFFF)
        board.link.seq = number - 1
        first = board.link.ask(Ping(number))
        board.link.reply_in(first, Pong)
        judge_repeated_reply(board, Ping(number), first, f"PING of number {number:#06x}")
        board.link.refused(Ping(~number & 0xFFFF), ErrorCode.SEQUENCE_REUSED, number, seq=number)
        board.link.call(Ping(1), Pong)


@case("HG-4.9/4-values")
def refused_requests_leave_the_request_number(board: BoardClient) -> None:
    """a request of every type, refused for flags or length, uses no number; for a value it does"""
    board.arm()
    for kind in requests_that_board_takes(board):
        if kind is Hello:
            continue
        payload = bytes(kind.LAYOUT.size)
        refusals = {
            "an unknown flag": (payload, 0x40, ErrorCode.UNSUPPORTED),
            "a wrong length": (payload + b"\x00", 0, ErrorCode.BAD_LENGTH),
        }
        for name, at in _enumeration_bytes_of_request(kind):
            wrong = payload[:at] + b"\xee" + payload[at + 1 :]
            refusals[f"{name} = 0xee"] = wrong, 0, ErrorCode.BAD_VALUE
        for name, (wrong, flags, code) in refusals.items():
            seq = board.link.next_seq()
            board.link.refused_raw(kind.TYPE, wrong, code, seq=seq, flags=flags)
            answer = board.link.ask(Ping(seq), seq=seq)
            text = f"{kind.TYPE.name} with {name}, then PING of its number"
            due = Error if code is ErrorCode.BAD_VALUE else Pong
            check(isinstance(answer.message, due), f"{text}: got {board.link.answer_text(answer)}")


def _enumeration_bytes_of_request(kind: type[Message]) -> Iterator[tuple[str, int]]:
    """Yield the fields of a request that are enumerations, with their offsets."""
    if kind is SetConfig:
        yield "trace_mode", Config.WIRE["trace_mode"].offset
    for name, field in kind.WIRE.items():
        if field.enumeration is not None:
            yield name, field.offset


# --- What is another request -------------------------------------------------------------------


def _requests_with_other_bytes(board: BoardClient, body: bytes) -> Iterator[tuple[str, bytes]]:
    """Yield bodies with the number of *body* that differ from it in one field, all legal."""
    for low in _LOW_FLAGS:
        yield f"flag {low:#x}", body[:1] + bytes([body[1] ^ low]) + body[2:]
    for at in range(4, 8):
        yield f"byte {at - 4} of time_us", _request_with_flipped_byte(body, at)
    for at in range(HEADER_BYTES, len(body)):
        changed = _request_with_flipped_byte(body, at)
        if _is_legal_request(board, changed):
            yield f"byte {at - HEADER_BYTES} of the payload", changed
    size = len(body) - HEADER_BYTES
    for kind in requests_that_board_takes(board):
        changed = bytes([kind.TYPE]) + body[1:]
        same = kind is Hello or body[0] == kind.TYPE or kind.LAYOUT.size != size
        if not same and _is_legal_request(board, changed):
            yield f"type {kind.TYPE.name}", changed


def _request_with_flipped_byte(body: bytes, at: int) -> bytes:
    return body[:at] + bytes([body[at] ^ 1]) + body[at + 1 :]


def _is_legal_request(board: BoardClient, body: bytes) -> bool:
    """Return whether the values of a body are those of its tables, and SET_CONFIG's in bounds."""
    try:
        message = MESSAGES[body[0]].deserialize(body[HEADER_BYTES:])
    except RemoteProtocolError:
        return False
    if not isinstance(message, SetConfig):
        return True
    config = dataclasses.replace(message.config, hold_ms=board.config.hold_ms)
    return config == board.config  # the bounds of hold_ms are far


@case("HG-4.9/2-bytes")
def every_changed_byte_is_no_repetition(board: BoardClient) -> None:
    """the number of a request of every type with one byte changed, in header or payload, is
    refused
    """
    for message in requests_to_repeat(board):
        board.arm()
        seq, name = board.link.next_seq(), message.TYPE.name
        header = {"seq": seq, "flags": flags_at_once(message), "time_us": 0x01020304}
        body = board.link.body(message.TYPE, message.serialize(), **header)
        (first,) = board.link.exchange(encode_frame(body))
        for other, changed in _requests_with_other_bytes(board, body):
            (answer,) = board.link.exchange(encode_frame(changed))
            check(
                _is_repetition_refused(answer, seq, may_be_value="payload" in other),
                f"{name}, then its number with another {other}: should be "
                f"SEQUENCE_REUSED, got {board.link.answer_text(answer)}",
            )
        (again,) = board.link.exchange(encode_frame(body))
        judge_same_answer(again, first, f"after {name} and others like it")


def _is_repetition_refused(answer: ReceivedByClient, seq: int, *, may_be_value: bool) -> bool:
    """Return whether a request was refused for its number, or for a value, which comes first."""
    error = answer.message
    if not isinstance(error, Error):
        return False
    if may_be_value and error.code in (ErrorCode.BAD_VALUE, ErrorCode.UNSUPPORTED):
        return True
    return (error.code, error.detail) == (ErrorCode.SEQUENCE_REUSED, seq)


@case("HG-4.9/2-halves")
def half_a_crc_makes_no_repetition(board: BoardClient) -> None:
    """a PING with the number of the last one, and half of its CRC-32, is refused"""
    for half, bits in _SAME_HALF_OF_CRC.items():
        echo = board.random.getrandbits(64)
        board.link.call(Ping(echo), Pong)
        answer = board.link.ask(Ping(echo ^ bits), seq=board.link.seq)
        due = _is_repetition_refused(answer, board.link.seq & 0xFFFF, may_be_value=False)
        got = board.link.answer_text(answer)
        check(due, f"a PING with the {half} half of the last one's CRC: got {got}")
