"""HG-4.9, HG-4.10: the remembered reply of every type, and what replaces it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from typing import Any, Final

from haptogram_protocol.errors import RemoteProtocolError
from haptogram_protocol.framing import HEADER_BYTES, encode_frame
from haptogram_protocol.messages import (
    MESSAGES,
    Config,
    DriveKind,
    Error,
    ErrorCode,
    Feature,
    Flag,
    GetGeometry,
    Hello,
    Message,
    Mute,
    MuteReply,
    Ping,
    Play,
    Pong,
    ReadDrive,
    ReadTrace,
    SetConfig,
    Stop,
    TraceMode,
    UploadChunk,
)

from ...case import case
from ...client import malformed_frames
from ...client.board_client import BoardClient
from ...client.capabilities import UPLOADS, requests_that_board_takes
from ...client.playback import (
    PERIOD_US,
    play_now,
    send_phases_to_store,
    send_phases_to_store_if_supported,
    shortest_period_to_play_us,
)
from ...client.stream_kinds import refused_requests_to_send, valid_requests_to_send
from ...client.wire import ReceivedByClient
from ...outcome import check

_SEQUENCE: Final = 4
_UNKNOWN_REQUEST: Final = 0x7B
_IDEMPOTENT: Final = (Mute, UploadChunk)  # HG-4.10
_NUMBERS: Final = (0, 1, 0xFF, 0x100, 0x7FFF, 0x8000, 0xFFFE, 0xFFFF)
_LOW_FLAGS: Final = (1, 2, 4, 8)

#: Something that the board hears between a request and its repetition.
Between = Callable[[BoardClient], object]


def _remembered(board: BoardClient) -> Iterator[Message]:
    """Yield a request of every type that is remembered; the board is ARMED before each."""
    send_phases_to_store_if_supported(board, _SEQUENCE, frames=2)
    for message in valid_requests_to_send(board, _SEQUENCE):
        if not isinstance(message, _IDEMPOTENT):
            yield message


def _largest_remembered_request(board: BoardClient) -> Iterator[Message]:
    """Yield the requests whose replies are as long as the board makes them."""
    yield GetGeometry(0, 0xFFFF)
    for feature, kind in (
        (Feature.READ_LATCHED, DriveKind.LATCHED),
        (Feature.READ_RADIATED, DriveKind.RADIATED),
    ):
        if board.has(feature):
            yield ReadDrive(kind, 0, 0xFFFF)
    if board.has(Feature.TRACE_RING):
        yield ReadTrace(0, 0xFFFF)


def _fill_ring_for_remembered_reply(board: BoardClient) -> None:
    """Latch so often that the ring fills a frame, at most a thousand times."""
    if not board.has(Feature.TRACE_RING | Feature.CONFIG | Feature.SEQUENCE_PHASES):
        return
    board.configure(trace_mode=TraceMode.RING)
    board.arm()
    period_us = shortest_period_to_play_us(board, PERIOD_US // 4)
    play_now(board, _SEQUENCE, loops=100, period_us=period_us)
    board.wire.idle(250 * period_us)
    board.link.ask(Stop())


def _flags_of_repetition(message: Message) -> int:
    return int(Flag.IMMEDIATE) if isinstance(message, Play) else 0


# --- What does not replace the remembered reply ------------------------------------------------


def _is_remembered_reply(
    board: BoardClient, wire: bytes, seq: int, first: ReceivedByClient, after: str
) -> None:
    """FAILED unless the request in *wire* gets the reply *first* to the byte."""
    since = board.link.mark()
    board.link.send(wire)
    kind = first.body[0]
    again = board.link.answer_to(kind, seq, since)
    check(
        again.body == first.body,
        f"after {after}, a repeated request is answered by {board.link.answer_text(again)}; "
        f"the first answer was {board.link.answer_text(first)}",
    )


def _judge_remembered_reply(board: BoardClient, betweens: dict[str, Between]) -> None:
    """FAILED unless every request gets its reply again behind each of *betweens*."""
    for message in [*_remembered(board), *refused_requests_to_send(board), GetGeometry(0, 0xFFFF)]:
        board.arm()
        wire, seq = board.link.request_wire(message, flags=_flags_of_repetition(message))
        since = board.link.mark()
        board.link.send(wire)
        first = board.link.answer_to(message.TYPE, seq, since)
        for name, send in betweens.items():
            send(board)
            _is_remembered_reply(board, wire, seq, first, f"{message.TYPE.name} and {name}")


def _mute_between_repetitions(board: BoardClient) -> None:
    board.link.call(Mute(), MuteReply)


def _other_mute_between_repetitions(session: Callable[[BoardClient], int], ahead: int) -> Between:
    """Send a MUTE whose number is not used up, or was used before."""

    def send(board: BoardClient) -> None:
        seq = board.link.seq + ahead
        board.link.call(Mute(), MuteReply, session=session(board), seq=seq)

    return send


def _chunk_between_repetitions(offset: int, size: int) -> Between:
    def send(board: BoardClient) -> None:
        board.link.ask(UploadChunk(offset, bytes(size)))

    return send


_MUTES: Final[dict[str, Between]] = {
    "a MUTE of its own number": _other_mute_between_repetitions(
        lambda board: board.link.session, 0
    ),
    "a MUTE without a session": _other_mute_between_repetitions(lambda _: 0, 7),
    "a MUTE of another session": _other_mute_between_repetitions(
        lambda board: board.link.session ^ 0x0F0F, 30_000
    ),
    "a MUTE of the session": _mute_between_repetitions,
}
_CHUNKS: Final[dict[str, Between]] = {
    "an UPLOAD_CHUNK that is refused": _chunk_between_repetitions(0x7FFFFFFF, 8),
    "an empty UPLOAD_CHUNK": _chunk_between_repetitions(0, 0),
    "an UPLOAD_CHUNK": _chunk_between_repetitions(0, 1),
}


@case(
    "HG-4.10/1",
    "a reply of every type, refusals too, is still remembered after MUTE and UPLOAD_CHUNK",
    variant="kept",
)
def remembered_reply_outlives_idempotent_requests(board: BoardClient) -> None:
    betweens = dict(_MUTES)
    if board.identity.features & UPLOADS:
        betweens |= _CHUNKS
    _judge_remembered_reply(board, betweens)


@case(
    "HG-4.10/1",
    "the number of a MUTE or UPLOAD_CHUNK of the session, refused or not, is used: SEQUENCE_REUSED",
    variant="used",
)
def idempotent_requests_use_request_numbers(board: BoardClient) -> None:
    messages: list[Message] = [Mute()]
    if board.identity.features & UPLOADS:
        messages += [UploadChunk(0, b""), UploadChunk(0, b"\x01"), UploadChunk(0x7FFFFFFF, b"\x01")]
    for message in messages:
        board.link.ask(message)
        seq = board.link.seq & 0xFFFF
        board.link.refused(Ping(1), ErrorCode.SEQUENCE_REUSED, seq, seq=seq)


def _refused_between_repetitions(code: ErrorCode, message: Message | int, **header: Any) -> Between:
    def send(board: BoardClient) -> None:
        seq = board.link.seq + header.get("ahead", 1)
        rest = {name: value for name, value in header.items() if name != "ahead"}
        if rest.pop("stale", False):
            rest["session"] = board.link.session ^ 0x0101
        kind, payload = (
            (message, rest.pop("payload", b""))
            if isinstance(message, int)
            else (message.TYPE, message.serialize())
        )
        board.link.refused_raw(kind, payload, code, seq=seq, **rest)

    return send


def _stream_between_repetitions(board: BoardClient) -> None:
    board.link.send(board.link.stream_wire(board.flat_phases()))
    board.link.send(board.link.stream_wire(board.flat_phases(), flags=0x40))


def _damaged_between_repetitions(board: BoardClient) -> None:
    body = board.link.body(Ping.TYPE, bytes(8), seq=board.link.seq + 1)
    board.link.send(
        malformed_frames.malformed_frame(malformed_frames.malformed_with_wrong_crc(body))
    )
    board.link.send(b"\x00\xff\x01\x02\x00", b"\x00\x05\x01\x02\x03\x04\x00")


_REFUSALS: Final[dict[str, Between]] = {
    "an unknown request": _refused_between_repetitions(ErrorCode.UNSUPPORTED, _UNKNOWN_REQUEST),
    "a request of another session": _refused_between_repetitions(
        ErrorCode.STALE_SESSION, Ping(1), stale=True
    ),
    "an unknown flag": _refused_between_repetitions(ErrorCode.UNSUPPORTED, Ping(2), flags=0x40),
    "a wrong length": _refused_between_repetitions(
        ErrorCode.BAD_LENGTH, Ping.TYPE, payload=bytes(7)
    ),
    "a used number": _refused_between_repetitions(ErrorCode.SEQUENCE_REUSED, Ping(3), ahead=0),
    "an old number": _refused_between_repetitions(ErrorCode.SEQUENCE_REUSED, Ping(4), ahead=-1),
    "a number far behind": _refused_between_repetitions(
        ErrorCode.SEQUENCE_REUSED, Ping(5), ahead=-30_000
    ),
    "a HELLO of another version": _refused_between_repetitions(
        ErrorCode.VERSION, Hello(2, 0, 1, 0), session=0
    ),
    "a HELLO of nonce 0": _refused_between_repetitions(
        ErrorCode.BAD_VALUE, Hello(1, 0, 0, 0), session=0
    ),
    "stream frames": _stream_between_repetitions,
    "damaged frames": _damaged_between_repetitions,
}


@case(
    "HG-4.9/4",
    "a reply of every type, refusals too, is still remembered after each refusal of steps 5 to 11",
    variant="types",
)
def remembered_reply_outlives_refusals(board: BoardClient) -> None:
    _judge_remembered_reply(board, _REFUSALS)


@case(
    "HG-4.9/1",
    "refused requests, and those with the longest replies, get the same bytes again",
    variant="replies",
)
def every_reply_is_remembered(board: BoardClient) -> None:
    if board.has(Feature.SEQUENCE_PHASES):
        send_phases_to_store(board, _SEQUENCE, frames=2)
        _fill_ring_for_remembered_reply(board)
    board.arm()
    for message in [*refused_requests_to_send(board), *_largest_remembered_request(board)]:
        with board.counting(repeated=2, requests=1, frames=3):
            wire, seq = board.link.request_wire(message, flags=_flags_of_repetition(message))
            since = board.link.mark()
            board.link.send(wire)
            first = board.link.answer_to(message.TYPE, seq, since)
            for _ in range(2):
                _is_remembered_reply(board, wire, seq, first, message.TYPE.name)
        board.link.refused(
            message, ErrorCode.SEQUENCE_REUSED, seq, seq=seq, flags=_flags_of_repetition(message)
        )


@case(
    "HG-4.9/3",
    "requests 1 to 32767 numbers ahead are carried out, those 1 to 32768 behind are refused",
    variant="jumps",
)
def every_jump_of_request_numbers_is_judged(board: BoardClient) -> None:
    for bits in range(16):
        for jump in {1 << bits, (1 << bits) - 1} - {0, 1 << 15}:
            board.link.seq += jump - 1
            board.link.call(Ping(jump), Pong)
            old = board.link.seq - (1 << bits) & 0xFFFF
            board.link.refused(Ping(jump), ErrorCode.SEQUENCE_REUSED, old, seq=old)


@case(
    "HG-4.9/1",
    "requests numbered 0, 255, 0x7FFF, 0x8000, 0xFFFF and beside them get the same bytes again",
    variant="numbers",
)
def every_request_number_is_remembered(board: BoardClient) -> None:
    for number in _NUMBERS:
        board.hello(seq=number - 1 & 0xFFFF)
        wire, seq = board.link.request_wire(Ping(number), seq=number)
        since = board.link.mark()
        board.link.send(wire)
        first = board.link.answer_to(Ping.TYPE, seq, since)
        board.link.reply_in(first, Pong, Ping.TYPE)
        _is_remembered_reply(board, wire, seq, first, f"PING of number {number:#06x}")
        board.link.refused(Ping(~number & 0xFFFF), ErrorCode.SEQUENCE_REUSED, seq, seq=seq)
        board.link.call(Ping(1), Pong, seq=number + 1)
        board.link.seq = number + 1


@case(
    "HG-4.9/4",
    "a request of every type, refused for flags, length or a value of no table, uses no number",
    variant="values",
)
def refused_requests_leave_the_request_number(board: BoardClient) -> None:
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
            check(isinstance(answer.message, Pong), f"{text}: got {board.link.answer_text(answer)}")


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


@case(
    "HG-4.9/2",
    "the number of a request of every type with one byte changed, in header or payload, is refused",
    variant="bytes",
)
def every_changed_byte_is_no_repetition(board: BoardClient) -> None:
    for message in _remembered(board):
        board.arm()
        seq = board.link.next_seq()
        body = board.link.body(
            message.TYPE,
            message.serialize(),
            seq=seq,
            flags=_flags_of_repetition(message),
            time_us=0x01020304,
        )
        since = board.link.mark()
        board.link.send(encode_frame(body))
        first = board.link.answer_to(message.TYPE, seq, since)
        for name, changed in _requests_with_other_bytes(board, body):
            since = board.link.mark()
            board.link.send(encode_frame(changed))
            answer = board.link.answer_to(changed[0], seq, since)
            check(
                _is_repetition_refused(answer, seq, may_be_value="payload" in name),
                f"{message.TYPE.name}, then its number with another {name}: should be "
                f"SEQUENCE_REUSED, got {board.link.answer_text(answer)}",
            )
        _is_remembered_reply(
            board, encode_frame(body), seq, first, f"{message.TYPE.name} and others like it"
        )


def _is_repetition_refused(answer: ReceivedByClient, seq: int, *, may_be_value: bool) -> bool:
    """Return whether a request was refused for its number, or for a value, which comes first."""
    error = answer.message
    if not isinstance(error, Error):
        return False
    if may_be_value and error.code in (ErrorCode.BAD_VALUE, ErrorCode.UNSUPPORTED):
        return True
    return (error.code, error.detail) == (ErrorCode.SEQUENCE_REUSED, seq)
