"""HG-2.4, HG-3.4, HG-4.9, HG-4.12, HG-6.4: every frame of a host, at every type."""

from __future__ import annotations

from typing import Final

from haptogram_protocol.framing import encode_frame
from haptogram_protocol.messages import (
    REQUEST_RANGE,
    ErrorCode,
    Flag,
    Hello,
    Message,
    Mute,
    MuteReply,
    Ping,
    Play,
    UploadChunk,
)

from ...case import case
from ...client import malformed_frames
from ...client.board_client import BoardClient
from ...client.playback import store_phases
from ...client.stream_kinds import host_types, stream_kinds, valid_requests
from ...outcome import SELF_REPORTED, check

_SEQUENCE: Final = 9
_LONG: Final = 3000
_FLIPS: Final = (1, 1 << 15, 1 << 16, 1 << 31)
_IDEMPOTENT: Final = (Mute, UploadChunk)  # HG-4.10


@case(
    "HG-2.4/2",
    "frames of every type, short and long, with a bit of CRC or payload inverted, count in crc",
    variant="types",
    evidence=SELF_REPORTED,
)
def every_type_is_checked(board: BoardClient) -> None:
    board.arm()
    for kind, payload in _payloads(board):
        stream = kind not in REQUEST_RANGE
        seq = board.link.stream_next if stream else board.link.next_seq()
        session = 0 if kind == Hello.TYPE else board.link.session
        body = board.link.body(kind, payload, seq=seq, session=session, flags=0x10 * stream)
        frames = [malformed_frames.with_wrong_crc(body, flip) for flip in _FLIPS]
        frames.append(_damaged(body))
        with board.counting(crc=len(frames), frames=1, requests=1):  # the barrier's
            board.link.unanswered(
                f"type {kind:#04x} with {len(payload)} bytes and a wrong CRC",
                *map(malformed_frames.malformed_frame, frames),
            )


def _payloads(board: BoardClient) -> list[tuple[int, bytes]]:
    """Return every type of a host with a payload: as of zeros, valid, and long."""
    fixed = [(int(kind.TYPE), bytes(kind.LAYOUT.size)) for kind in host_types()]
    messages = [kind.make() for kind in stream_kinds(board)]
    messages.append(UploadChunk(0, board.random.randbytes(_LONG)))
    messages.append(board.hello_message(board.new_nonce()))
    valid = [(int(message.TYPE), message.serialize()) for message in messages]
    return [*fixed, *valid, (int(Mute.TYPE), board.random.randbytes(_LONG))]


def _damaged(body: bytes) -> bytes:
    """Return a body with one bit inverted behind its type, and the CRC that it had before."""
    whole = bytearray(malformed_frames.with_crc(body))
    whole[len(body) - 1] ^= 0x08
    return bytes(whole)


# --- Requests ----------------------------------------------------------------------------------


def _requests(board: BoardClient) -> list[Message]:
    """Return a valid request of every type; the sequence that they play is stored."""
    if any(isinstance(message, Play) for message in valid_requests(board, _SEQUENCE)):
        store_phases(board, _SEQUENCE, frames=2)
    board.arm()
    return list(valid_requests(board, _SEQUENCE))


@case(
    "HG-4.12/1",
    "a request of every type of another session, or of none, is refused: STALE_SESSION",
    variant="types",
)
def every_type_has_a_session(board: BoardClient) -> None:
    requests, session = _requests(board), board.link.session
    with board.counting(stale_session=2 * len(requests), frames=2 * len(requests), requests=0):
        for message in requests:
            for wrong in (session ^ 0x0100, 0):
                seq = board.link.next_seq()
                board.link.refused(
                    message, ErrorCode.STALE_SESSION, session, session=wrong, seq=seq
                )


@case(
    "HG-3.4/1",
    "each unknown flag in a request of every type is refused: UNSUPPORTED, detail: the flag",
    variant="requests",
)
def every_type_has_its_flags(board: BoardClient) -> None:
    for message in _requests(board):
        unknown = [0x20, 0x40, 0x80, 0xE0]
        if not isinstance(message, Play):
            unknown.append(int(Flag.IMMEDIATE))
        with board.counting(unsupported=len(unknown)):
            for flags in unknown:
                board.link.refused(message, ErrorCode.UNSUPPORTED, flags, flags=flags)


@case(
    "HG-4.9/1",
    "a request of every type sent again gets the same bytes, and is not carried out again",
    variant="types",
    evidence=SELF_REPORTED,
)
def every_type_is_remembered(board: BoardClient) -> None:
    for message in _requests(board):
        if isinstance(message, _IDEMPOTENT):
            continue
        flags = Flag.IMMEDIATE if isinstance(message, Play) else 0
        seq = board.link.next_seq()
        first = board.link.ask(message, seq=seq, flags=flags)
        again = board.link.ask(message, seq=seq, flags=flags)
        name = message.TYPE.name
        check(
            first.body == again.body,
            f"{name} sent again is answered by {board.link.answer_text(again)}, "
            f"the first was {board.link.answer_text(first)}",
        )
        board.link.refused(Ping(seq), ErrorCode.SEQUENCE_REUSED, seq, seq=seq)
        before = board.status().counters
        # GET_STATUS is the newest request now: what came before it is old.
        board.link.refused(message, ErrorCode.SEQUENCE_REUSED, seq, seq=seq, flags=flags)
        counted = board.counted_since(before)
        check(
            (counted["bad_value"], counted["requests"]) == (1, 0),
            f"an old {name} counts bad_value {counted['bad_value']}, "
            f"requests {counted['requests']}",
        )


@case(
    "HG-6.4/1",
    "MUTE with payloads of 0 to 3000 bytes, every flag and any session mutes an ARMED board",
    variant="sizes",
)
def every_mute_mutes(board: BoardClient) -> None:
    for size in (0, 1, 2, 30, 100, 255, 256, 1000, _LONG):
        for session in (0, board.link.session, board.link.session ^ 1):
            board.arm()
            seq = board.link.next_seq()
            flags = board.random.choice((0, 0x10, 0x20, 0xF0, 0xFF))
            body = board.link.body(
                Mute.TYPE, board.random.randbytes(size), seq=seq, session=session, flags=flags
            )
            since = board.link.mark()
            board.link.send(encode_frame(body))
            answer = board.link.answer_to(Mute.TYPE, seq, since, board.wire.line_us(size))
            state = board.link.reply_in(answer, MuteReply, Mute.TYPE).state
            check(state.name == "MUTED", f"MUTE with {size} bytes: {state.name}")
