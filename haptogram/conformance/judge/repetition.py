"""A request and its repetition: what a board may hear between them, and the reply that is due."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, Final, TypeAlias

from haptogram_protocol import messages as m

from ..client import malformed_frames, playback
from ..client.board_client import BoardClient
from ..client.request_client import RequestClient
from ..client.stream_kinds import refused_requests_to_send, valid_requests_to_send
from ..client.wire import ReceivedByClient
from ..outcome import fail, record_differences

_SEQUENCE: Final = 4
_UNKNOWN_REQUEST: Final = 0x7B
_IDEMPOTENT: Final = (m.Mute, m.UploadChunk)  # HG-4.10

#: Something that the board hears between a request and its repetition.
Between: TypeAlias = Callable[[BoardClient], object]


def requests_to_repeat(board: BoardClient) -> Iterator[m.Message]:
    """Yield a request of every type that is remembered and carried out, if the board is ARMED."""
    playback.send_phases_to_store_if_supported(board, _SEQUENCE, frames=2)
    for message in valid_requests_to_send(board, _SEQUENCE):
        if not isinstance(message, _IDEMPOTENT):
            yield message


def every_request_to_repeat(board: BoardClient) -> Iterator[m.Message]:
    """Yield a request of every type that is remembered, carried out or refused, if ARMED."""
    yield from requests_to_repeat(board)
    yield from refused_requests_to_send(board)
    yield m.GetGeometry(0, 0xFFFF)


def judge_repeated_reply(
    board: BoardClient, message: m.Message, first: ReceivedByClient, after: str
) -> None:
    """FAILED unless a request with the number of the reply *first* gets it again to the byte."""
    again = board.link.ask_at_once(message, seq=first.frame_header.seq)
    judge_same_answer(again, first, f"after {after}")


def judge_same_answer(again: ReceivedByClient, first: ReceivedByClient, name: str) -> None:
    """FAILED unless the answer to a request that was sent again is the first one to the byte."""
    if again.body == first.body:
        return
    text = f"{name}, the same request again is answered by {RequestClient.answer_text(again)}"
    if isinstance(again.message, m.Error) and again.message.code == m.ErrorCode.SEQUENCE_REUSED:
        text = f"{name}, the reply to the request before is forgotten: {text.partition(', ')[2]}"
    if type(again.message) is not type(first.message):
        fail(f"{text}; the first answer was {RequestClient.answer_text(first)}")
    parts = (again.header, first.header), (again.message, first.message)
    differs = [record_differences(one, two, "was") for one, two in parts if one != two]
    fail(f"{text}; another than at first: {'; '.join(differs)}")


# --- What comes between -------------------------------------------------------------------------


def _mute_between_repetitions(board: BoardClient) -> None:
    """Send a MUTE between two repeated requests."""
    board.link.call(m.Mute(), m.MuteReply)


def _other_mute_between_repetitions(session: Callable[[BoardClient], int], ahead: int) -> Between:
    """Return a function that sends a MUTE with the session that *session* returns.

    Its sequence number is *ahead* more than that of the last request.
    """

    def send(board: BoardClient) -> None:
        seq = board.link.seq + ahead
        board.link.call(m.Mute(), m.MuteReply, session=session(board), seq=seq)

    return send


def _chunk_between_repetitions(offset: int, size: int) -> Between:
    """Return a function that sends an upload chunk of *size* zero bytes for *offset*."""

    def send(board: BoardClient) -> None:
        board.link.ask(m.UploadChunk(offset, bytes(size)))

    return send


MUTES_BETWEEN: Final[dict[str, Between]] = {
    "a MUTE of its own number": _other_mute_between_repetitions(
        lambda board: board.link.session, 0
    ),
    "a MUTE without a session": _other_mute_between_repetitions(lambda _: 0, 7),
    "a MUTE of another session": _other_mute_between_repetitions(
        lambda board: board.link.session ^ 0x0F0F, 30_000
    ),
    "a MUTE of the session": _mute_between_repetitions,
}
CHUNKS_BETWEEN: Final[dict[str, Between]] = {
    "an UPLOAD_CHUNK that is refused": _chunk_between_repetitions(0x7FFFFFFF, 8),
    "an empty UPLOAD_CHUNK": _chunk_between_repetitions(0, 0),
    "an UPLOAD_CHUNK": _chunk_between_repetitions(0, 1),
}


def _refused_between_repetitions(
    code: m.ErrorCode, message: m.Message | int, **header: Any
) -> Between:
    """Return a function that sends a request which the board refuses with *code*.

    *message* may be a bare message type. In *header*, "payload" is its payload, "ahead" how far its
    number is beyond the last one (1), "stale" True another session; others are header fields.
    """

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
    """Send two stream frames, the second with an unknown flag."""
    board.link.send(board.link.stream_wire(board.flat_phases()))
    board.link.send(board.link.stream_wire(board.flat_phases(), flags=0x40))


def _damaged_between_repetitions(board: BoardClient) -> None:
    """Send a damaged PING, and bytes that are no frame."""
    board.link.send(malformed_frames.malformed_ping(board.link))
    board.link.send(b"\x00\xff\x01\x02\x00", b"\x00\x05\x01\x02\x03\x04\x00")


REFUSALS_BETWEEN: Final[dict[str, Between]] = {
    "an unknown request": _refused_between_repetitions(m.ErrorCode.UNSUPPORTED, _UNKNOWN_REQUEST),
    "a request of another session": _refused_between_repetitions(
        m.ErrorCode.STALE_SESSION, m.Ping(1), stale=True
    ),
    "an unknown flag": _refused_between_repetitions(m.ErrorCode.UNSUPPORTED, m.Ping(2), flags=0x40),
    "a wrong length": _refused_between_repetitions(
        m.ErrorCode.BAD_LENGTH, m.Ping.TYPE, payload=bytes(7)
    ),
    "a used number": _refused_between_repetitions(m.ErrorCode.SEQUENCE_REUSED, m.Ping(3), ahead=0),
    "an old number": _refused_between_repetitions(m.ErrorCode.SEQUENCE_REUSED, m.Ping(4), ahead=-1),
    "a number far behind": _refused_between_repetitions(
        m.ErrorCode.SEQUENCE_REUSED, m.Ping(5), ahead=-30_000
    ),
    "a HELLO of another version": _refused_between_repetitions(
        m.ErrorCode.VERSION, m.Hello(m.VERSION_MAJOR + 1, 0, 1, 0), session=0
    ),
    "a HELLO of nonce 0": _refused_between_repetitions(
        m.ErrorCode.BAD_VALUE, m.Hello(m.VERSION_MAJOR, 0, 0, 0), session=0
    ),
    "stream frames": _stream_between_repetitions,
    "damaged frames": _damaged_between_repetitions,
}
