"""HG-2.4, HG-3.4, HG-4.9, HG-4.11, HG-4.12, HG-6.4: frames of a host, at every type."""

from __future__ import annotations

import itertools
from typing import Final

from haptogram_protocol.messages import (
    REQUEST_RANGE,
    RESPONSE_OFFSET,
    VERSION_MAJOR,
    Error,
    ErrorCode,
    Hello,
    Message,
    Mute,
    MuteReply,
    Ping,
    Play,
    UploadBegin,
    UploadChunk,
)

from ...case import case
from ...client import malformed_frames
from ...client.board_client import BoardClient
from ...client.playback import send_phases_to_store_if_supported
from ...client.request_client import flags_at_once
from ...client.stream_kinds import (
    refused_requests_to_send,
    request_types_of_host,
    stream_kinds,
    valid_requests_to_send,
)
from ...client.uploads import require_room_for_upload
from ...client.wire import ReceivedByClient
from ...judge.repetition import judge_repeated_reply
from ...outcome import SELF_REPORTED, check, check_equal, named
from ..ch04_session.responses import check_answer_session

_SEQUENCE: Final = 3
_LONG: Final = 3000
_UNKNOWN_REQUEST: Final = 0x7B
_FLIPS: Final = (1, 1 << 15, 1 << 16, 1 << 31)
_IDEMPOTENT: Final = (Mute, UploadChunk)  # HG-4.10
_LOW_FLAGS: Final = (1, 2, 4, 8, 15)


@case("HG-2.4/2-types", evidence=SELF_REPORTED)
def crc_of_every_type(board: BoardClient) -> None:
    """frames of every type, short and long, with a bit of CRC or payload inverted, count in crc"""
    board.arm()
    for kind, payload in _payloads_of_every_type(board):
        stream = kind not in REQUEST_RANGE
        seq = board.link.stream_next if stream else board.link.next_seq()
        body = board.link.body(kind, payload, seq=seq, flags=0x10 * stream)
        frames = [malformed_frames.malformed_with_wrong_crc(body, flip) for flip in _FLIPS]
        frames.append(_damaged_of_every_type(body))
        wires = board.within_timers(map(malformed_frames.malformed_frame, frames))
        with board.counting(crc=len(wires), frames=1, requests=1):  # the barrier's
            text = f"type {kind:#04x} with {len(payload)} bytes and a wrong CRC"
            board.link.unanswered(text, *wires)


def _payloads_of_every_type(board: BoardClient) -> list[tuple[int, bytes]]:
    """Return every type of a host with a payload: as of zeros, valid, and long."""
    fixed = [(int(kind.TYPE), bytes(kind.LAYOUT.size)) for kind in request_types_of_host()]
    messages = [kind.make() for kind in stream_kinds(board)]
    messages.append(UploadChunk(0, board.random.randbytes(_LONG)))
    messages.append(board.hello_message(board.new_nonce()))
    valid = [(int(message.TYPE), message.serialize()) for message in messages]
    return [*fixed, *valid, (int(Mute.TYPE), board.random.randbytes(_LONG))]


def _damaged_of_every_type(body: bytes) -> bytes:
    """Return a body with one bit inverted behind its type, and the CRC that it had before."""
    whole = bytearray(malformed_frames.malformed_with_crc(body))
    whole[len(body) - 1] ^= 0x08
    return bytes(whole)


# --- Requests ----------------------------------------------------------------------------------


def _requests_of_every_type(board: BoardClient) -> list[Message]:
    """Return a valid request of every type; the sequence that they play is stored."""
    send_phases_to_store_if_supported(board, _SEQUENCE, frames=2)
    board.arm()
    return list(valid_requests_to_send(board, _SEQUENCE))


@case("HG-4.12/1-types")
def session_of_every_type(board: BoardClient) -> None:
    """a request of every type of another session, or of none, is refused: STALE_SESSION"""
    requests, session = _requests_of_every_type(board), board.link.session
    others = [0, *(session ^ 1 << bit for bit in range(16))]
    for message in requests:
        with board.counting(frames=len(others), requests=len(others)):
            for wrong in others:
                board.link.refused(message, ErrorCode.STALE_SESSION, session, session=wrong)


@case("HG-3.4/1-requests")
def flags_of_every_type(board: BoardClient) -> None:
    """each unknown flag in a request of every type is refused: UNSUPPORTED, detail: the flag"""
    for message in _requests_of_every_type(board):
        unknown = [0x20, 0x40, 0x80, 0xE0, 0x10, 0x30, 0xF0]
        known = flags_at_once(message)
        with board.counting(requests=len(unknown) - bool(known)):
            for flags in unknown:
                if flags & ~known:
                    detail = flags & ~known
                    board.link.refused(message, ErrorCode.UNSUPPORTED, detail, flags=flags | 0x0A)


@case("HG-3.4/2-requests")
def low_flags_are_ignored(board: BoardClient) -> None:
    """requests of every type with each bit of the low nibble are carried out, PLAY at once"""
    for low in _LOW_FLAGS:
        for message in _requests_of_every_type(board):
            plays = isinstance(message, Play)
            flags = low | flags_at_once(message)
            past_us = board.clock.device_us() - 2_000_000 if plays else 0  # HG-3.5/2: not used
            answer = board.link.ask(message, flags=flags, time_us=past_us)
            if isinstance(message, UploadBegin):
                require_room_for_upload(message, answer)
            due, text = message.TYPE + RESPONSE_OFFSET, board.link.answer_text(answer)
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
            board.link.refused_as_used(Ping(seq), seq)
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
                board.arm()
                header = {"session": session, "flags": next(every_flag)}
                answer = board.link.ask_raw(Mute.TYPE, board.random.randbytes(size), **header)
                state = board.link.reply_in(answer, MuteReply).state
                name = f"MUTE of session {session:#06x}, {size} bytes"
                check_equal(state.name, "MUTED", f"{name}: {state.name}")


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
        _check_header(board, board.link.ask(Mute(), session=session), Mute())
    for hello in (
        board.hello_message(board.link.session),
        Hello(VERSION_MAJOR + 1, 0, board.link.session, 0),
        Hello(VERSION_MAJOR, 0, 0, 0),
    ):
        _check_header(board, board.link.ask(hello), hello)
    _check_header(board, board.link.ask_raw(_UNKNOWN_REQUEST), None)


def _check_header(board: BoardClient, answer: ReceivedByClient, message: Message | None) -> None:
    """FAILED unless an answer is of the open session, and of the type of its request or ERROR."""
    name = message.TYPE.name if message is not None else "an unknown request"
    check_answer_session(answer, board.link.session, name)
    kind = answer.frame_header.type
    types = {int(Error.TYPE)} | ({message.TYPE + RESPONSE_OFFSET} if message is not None else set())
    check(kind in types, f"{name} is answered by a frame of type {kind:#04x}")
