"""HG-2.4, HG-3.2, HG-3.4, HG-4.9, HG-4.11, HG-4.12, HG-6.4: frames of a host, at every type."""

from __future__ import annotations

import itertools
from typing import Final

from haptogram_protocol.framing import encode_frame
from haptogram_protocol.messages import (
    REQUEST_RANGE,
    RESPONSE_OFFSET,
    VERSION_MAJOR,
    Error,
    ErrorCode,
    Flag,
    Hello,
    Message,
    Mute,
    MuteReply,
    Ping,
    Play,
    UploadBegin,
    UploadChunk,
)
from haptogram_protocol.rules import UPLOADS

from ...case import Depth, case
from ...client import malformed_frames
from ...client.board_client import BoardClient
from ...client.capabilities import requests_that_board_takes, session_for_request
from ...client.playback import send_phases_that_fit
from ...client.stream_kinds import (
    refused_requests_to_send,
    request_types_of_host,
    stream_kinds,
    valid_requests_to_send,
)
from ...client.uploads import require_room_for_upload
from ...client.wire import ReceivedByClient
from ...judge.repetition import judge_same_answer
from ...outcome import SELF_REPORTED, check, check_equal

_SEQUENCE: Final = 3
_LONG: Final = 3000
_UNKNOWN_REQUEST: Final = 0x7B
_FLIPS: Final = (1, 1 << 15, 1 << 16, 1 << 31)
_IDEMPOTENT: Final = (Mute, UploadChunk)  # HG-4.10
_LOW_FLAGS: Final = (1, 2, 4, 8, 15)


@case(
    "HG-2.4/2",
    "frames of every type, short and long, with a bit of CRC or payload inverted, count in crc",
    variant="types",
    evidence=SELF_REPORTED,
)
def crc_is_checked_at_every_header_type(board: BoardClient) -> None:
    board.arm()
    for kind, payload in _payloads_of_every_type(board):
        stream = kind not in REQUEST_RANGE
        seq = board.link.stream_next if stream else board.link.next_seq()
        session = 0 if kind == Hello.TYPE else board.link.session
        body = board.link.body(kind, payload, seq=seq, session=session, flags=0x10 * stream)
        frames = [malformed_frames.malformed_with_wrong_crc(body, flip) for flip in _FLIPS]
        frames.append(_damaged_of_every_type(body))
        wires = board.within_timers(map(malformed_frames.malformed_frame, frames))
        with board.counting(crc=len(wires), frames=1, requests=1):  # the barrier's
            board.link.unanswered(
                f"type {kind:#04x} with {len(payload)} bytes and a wrong CRC", *wires
            )


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
    if any(isinstance(message, Play) for message in valid_requests_to_send(board, _SEQUENCE)):
        send_phases_that_fit(board, _SEQUENCE, frames=2)
    board.arm()
    return list(valid_requests_to_send(board, _SEQUENCE))


@case(
    "HG-4.12/1",
    "a request of every type of another session, or of none, is refused: STALE_SESSION",
    variant="types",
)
def every_header_type_has_its_session(board: BoardClient) -> None:
    requests, session = _requests_of_every_type(board), board.link.session
    others = [0, *(session ^ 1 << bit for bit in range(16))]
    for message in requests:
        with board.counting(frames=len(others), requests=len(others)):
            for wrong in others:
                seq = board.link.next_seq()
                board.link.refused(
                    message, ErrorCode.STALE_SESSION, session, session=wrong, seq=seq
                )


@case(
    "HG-3.4/1",
    "each unknown flag in a request of every type is refused: UNSUPPORTED, detail: the flag",
    variant="requests",
)
def every_header_type_has_its_flags(board: BoardClient) -> None:
    for message in _requests_of_every_type(board):
        unknown = [0x20, 0x40, 0x80, 0xE0, 0x10, 0x30, 0xF0]
        known = int(Flag.IMMEDIATE) if isinstance(message, Play) else 0
        with board.counting(requests=len(unknown) - bool(known)):
            for flags in unknown:
                if flags & ~known:
                    detail = flags & ~known
                    board.link.refused(message, ErrorCode.UNSUPPORTED, detail, flags=flags | 0x0A)


@case(
    "HG-3.4/2",
    "requests of every type with each bit of the low nibble are carried out, PLAY at once",
    variant="requests",
)
def every_header_type_ignores_low_flags(board: BoardClient) -> None:
    for low in _LOW_FLAGS:
        for message in _requests_of_every_type(board):
            plays = isinstance(message, Play)
            flags = low | (Flag.IMMEDIATE if plays else 0)
            past_us = board.clock.device_us() - 2_000_000 if plays else 0  # HG-3.5/2: not used
            answer = board.link.ask(message, flags=flags, time_us=past_us)
            if isinstance(message, UploadBegin):
                require_room_for_upload(message, answer)
            check_equal(
                board.link.type_of(answer),
                message.TYPE + RESPONSE_OFFSET,
                f"{message.TYPE.name} with the flags {flags:#04x} is answered by "
                f"{board.link.answer_text(answer)}",
            )


@case(
    "HG-3.2/4",
    "requests of every type and 11 wrong lengths: the detail is the right one, 0 where it varies",
    variant="requests",
    depth=Depth.DEFAULT,
)
def every_header_type_has_its_length(board: BoardClient) -> None:
    kinds: list[tuple[type[Message], int]] = []
    for kind in requests_that_board_takes(board):
        kinds += [(kind, size) for size in _wrong_lengths_of_type(kind.LAYOUT.size)]
    if board.identity.features & UPLOADS:
        kinds += [(UploadChunk, size) for size in range(UploadChunk.LAYOUT.size)]
    with board.counting(requests=len(kinds)):
        for kind, size in kinds:
            right = 0 if kind.TAIL else kind.LAYOUT.size
            board.link.refused_raw(
                kind.TYPE,
                bytes(size),
                ErrorCode.BAD_LENGTH,
                right,
                session=session_for_request(board, kind),
            )


def _wrong_lengths_of_type(right: int) -> list[int]:
    """Return lengths other than *right*, and with the same low byte."""
    near = {0, 1, right - 1, right + 1, 2 * right, right + 4}
    far = {right + (1 << bits) for bits in (7, 8, 9, 10, 11)}
    return sorted(size for size in near | far if size >= 0 and size != right)


@case(
    "HG-4.9/1",
    "a request of every type sent again gets the same bytes, and is not carried out again",
    variant="types",
    evidence=SELF_REPORTED,
)
def every_header_type_is_remembered(board: BoardClient) -> None:
    for message in _requests_of_every_type(board):
        if isinstance(message, _IDEMPOTENT):
            continue
        flags = Flag.IMMEDIATE if isinstance(message, Play) else 0
        started = board.status().counters
        seq = board.link.next_seq()
        first = board.link.ask(message, seq=seq, flags=flags)
        again = board.link.ask(message, seq=seq, flags=flags)
        name = message.TYPE.name
        judge_same_answer(again, first, name)
        board.link.refused(Ping(seq), ErrorCode.SEQUENCE_REUSED, seq, seq=seq)
        counted = board.counted_since(started)
        found = tuple(counted[name_of] for name_of in ("requests", "repeated"))
        check_equal(
            found,
            (2, 1),
            f"{name}, the same again, and its number with another request: requests, repeated "
            f"count {found}",
        )
        before = board.status().counters
        # GET_STATUS is the newest request now: what came before it is old.
        board.link.refused(message, ErrorCode.SEQUENCE_REUSED, seq, seq=seq, flags=flags)
        counted = board.counted_since(before)
        found = tuple(counted[name_of] for name_of in ("requests", "repeated"))
        check_equal(found, (1, 0), f"an old {name}: requests, repeated count {found}")


@case(
    "HG-6.4/1",
    "MUTE with payloads of 0 to 3000 bytes, every flag and any session mutes an ARMED board",
    variant="sizes",
)
def mute_passes_with_every_header(board: BoardClient) -> None:
    every_flag = itertools.cycle([0, *(1 << bit for bit in range(8)), 0xF0, 0xFF])
    sizes = (0, 1, 2, 30, 100, 255, 256, 1000, _LONG)
    before = board.status().counters
    for size in sizes:
        for session in (0, board.link.session, board.link.session ^ 1):
            board.arm()
            seq, flags = board.link.next_seq(), next(every_flag)
            body = board.link.body(
                Mute.TYPE, board.random.randbytes(size), seq=seq, session=session, flags=flags
            )
            since = board.link.mark()
            board.link.send(encode_frame(body))
            answer = board.link.answer_to(Mute.TYPE, seq, since)
            state = board.link.reply_in(answer, MuteReply, Mute.TYPE).state
            name = f"MUTE of session {session:#06x}, {size} bytes"
            check_equal(state.name, "MUTED", f"{name}: {state.name}")
    counted = board.counted_since(before)
    due = 2 * 3 * len(sizes)  # with an ARM each
    moved = {name: number for name, number in counted.items() if number}
    wanted = {"frames": due, "requests": due}
    check(moved == wanted, f"{due // 2} ARM and MUTE are counted in {moved}, due is {wanted}")


# --- Number and session of each reply ----------------------------------------------------------


@case(
    "HG-4.11/1",
    "replies and refusals of every type have type, number and open session, whatever MUTE carries",
    variant="types",
)
def every_reply_has_the_header_of_its_request(board: BoardClient) -> None:
    for message in [*_requests_of_every_type(board), *refused_requests_to_send(board)]:
        board.arm()
        flags = Flag.IMMEDIATE if isinstance(message, Play) else 0
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
        _check_header(board, board.link.ask(hello, session=0), hello)
    _check_header(board, board.link.ask_raw(_UNKNOWN_REQUEST), None)


def _check_header(board: BoardClient, answer: ReceivedByClient, message: Message | None) -> None:
    """FAILED unless an answer is of the open session, and of the type of its request or ERROR."""
    name = message.TYPE.name if message is not None else "an unknown request"
    header = answer.header
    assert header is not None  # ask
    check_equal(
        header.session,
        board.link.session,
        f"the answer to {name} has session {header.session:#06x}, open is "
        f"{board.link.session:#06x}",
    )
    types = {int(Error.TYPE)} | ({message.TYPE + RESPONSE_OFFSET} if message is not None else set())
    check(header.type in types, f"{name} is answered by a frame of type {header.type:#04x}")
