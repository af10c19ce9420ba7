"""HG-4.8, HG-4.9, HG-4.10, HG-4.12: requests one at a time, remembered, never done twice."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from haptogram_protocol.messages import (
    Arm,
    Disarm,
    ErrorCode,
    Feature,
    GetGeometry,
    GetStatus,
    Message,
    Mute,
    MuteReply,
    Ping,
    Pong,
    ReadDrive,
    ReadTrace,
    Stop,
    TraceMode,
    UploadChunk,
    UploadChunkReply,
)
from haptogram_protocol.rules import UPLOADS
from haptogram_protocol.state import OutputState

from ...case import case, case_about_host
from ...client.board_client import BoardClient
from ...client.capabilities import drive_kinds
from ...client.playback import (
    PERIOD_US,
    play_now,
    send_phases_that_fit,
    shortest_period_to_play_us,
)
from ...client.stream_kinds import refused_requests_to_send
from ...client.uploads import begin_any_upload
from ...judge.repetition import (
    CHUNKS_BETWEEN,
    MUTES_BETWEEN,
    REFUSALS_BETWEEN,
    Between,
    every_request_to_repeat,
    judge_repeated_reply,
)
from ...outcome import check_equal

OF_HOST: Final = tuple(case_about_host(f"HG-4.8/{number}") for number in range(1, 6))
_SEQUENCE: Final = 4
_FILLED_US: Final = 1_000_000


@case("HG-4.9/1")
def repeats_the_reply(board: BoardClient) -> None:
    """ARM again after a MUTE without a session: same reply to the byte, still MUTED; repeated +
    1
    """
    board.link.ask(Arm())
    board.link.ask(Mute(), session=0, seq=board.link.seq + 1000)
    with board.counting(repeated=2):
        # GET_STATUS would be the last request: the repetitions come first.
        board.check_state(OutputState.MUTED, "after MUTE without a session:")
        first = board.link.ask(Ping(7))
        board.wire.idle(5000)
        for _ in range(2):
            judge_repeated_reply(board, Ping(7), first, "PING")
    first = board.link.ask(Arm())
    board.link.ask(Mute(), session=0, seq=board.link.seq + 1000)
    judge_repeated_reply(board, Arm(), first, "ARM and a MUTE without a session")
    board.check_state(OutputState.MUTED, "ARM sent again was carried out again:")


@case("HG-4.9/2")
def refuses_reused_number(board: BoardClient) -> None:
    """the last request's number with other bytes is refused: SEQUENCE_REUSED, detail: the number"""
    board.arm()
    for message in (Disarm(), Ping(1)):
        board.link.refused_as_used(message)
    board.check_state(OutputState.ARMED, "a refused DISARM has led to")


@case("HG-4.9/3")
def refuses_delayed_copy(board: BoardClient) -> None:
    """a delayed copy of ARM does not undo a later DISARM: SEQUENCE_REUSED"""
    board.link.ask(Arm())
    board.disarm()
    board.link.refused_as_used(Arm(), board.link.seq - 1)
    for back in (2, 100, 30_000):
        board.link.refused_as_used(Ping(1), board.link.seq - back)
    board.check_state(OutputState.DISARMED, "a delayed ARM has led to")


@case("HG-4.9/4")
def refusals_use_no_number(board: BoardClient) -> None:
    """after refusals for flags, length and type the same number is still free"""
    reply = board.link.ask(Arm())
    free = board.link.seq + 1 & 0xFFFF
    board.link.refused(Ping(1), ErrorCode.UNSUPPORTED, 0x20, seq=free, flags=0x20)
    board.link.refused_raw(Ping.TYPE, bytes(3), ErrorCode.BAD_LENGTH, 8, seq=free)
    board.link.refused_raw(0x7C, b"", ErrorCode.UNSUPPORTED, 0x7C, seq=free)
    stale = board.link.session ^ 0x0F0F
    board.link.refused(Ping(1), ErrorCode.STALE_SESSION, seq=free, session=stale)
    judge_repeated_reply(board, Arm(), reply, "refused requests")
    board.link.call(Ping(2), Pong)


@case("HG-4.9/5")
def mute_passes_pending_request(board: BoardClient) -> None:
    """behind a MUTE a copy of a request: same reply if it was done, SEQUENCE_REUSED if it was
    lost
    """
    first = board.link.ask(Ping(9))
    board.link.call(Mute(), MuteReply)
    judge_repeated_reply(board, Ping(9), first, "PING and MUTE")
    for lost in (Arm(), Ping(1)):
        board.link.next_seq()
        board.link.call(Mute(), MuteReply)
        board.link.refused_as_used(lost, board.link.seq - 1)
    board.check_state(OutputState.MUTED, "an ARM that was lost before MUTE has led to")
    board.link.call(Ping(2), Pong)


@case("HG-4.10/1")
def repeated_mute_is_done(board: BoardClient) -> None:
    """MUTE is carried out each time; its number in the session counts as used"""
    board.arm()
    board.link.ask(Mute())
    seq = board.link.seq
    board.link.refused_as_used(Ping(1))
    board.arm()
    board.link.ask(Mute(), seq=seq)
    board.check_state(OutputState.MUTED, "the same MUTE again has led to")
    board.link.call(Mute(), MuteReply, session=0, seq=board.link.seq + 500)
    board.link.call(Ping(1), Pong)  # the number of a MUTE of no session is not used up


@case("HG-4.10/1-behind")
def mute_uses_later_number(board: BoardClient) -> None:
    """PING and MUTE at once: PING is answered, although the number of MUTE is newer"""
    for number in range(8):
        wires = [board.link.request_wire(message)[0] for message in (Ping(number), Mute())]
        board.link.reply_in(board.link.exchange(*wires)[0], Pong)


@case("HG-4.10/1-chunk")
def repeated_chunks_are_done(board: BoardClient) -> None:
    """UPLOAD_CHUNK is carried out each time"""
    begin_any_upload(board, 1)
    chunk = UploadChunk(0, bytes(1))
    first = board.link.call(chunk, UploadChunkReply)
    seq = board.link.seq
    begin_any_upload(board, 1)
    received = board.link.call(chunk, UploadChunkReply, seq=seq).received
    check_equal(received, 1, f"a chunk of 1 byte again: {received} received, {first} before")


@case("HG-4.12/1")
def refuses_stale_requests(board: BoardClient) -> None:
    """DISARM, PING, GET_STATUS of another session: STALE_SESSION, session 0; not done"""
    board.arm()
    requests: tuple[Message, ...] = (Disarm(), Ping(1), GetStatus())
    with board.counting(requests=2 * len(requests)):
        for message in requests:
            for session in (0, board.link.session ^ 0x8001):
                answer = board.link.ask(message, session=session)
                code, told = ErrorCode.STALE_SESSION, answer.frame_header.session
                board.link.error_in(answer, message.TYPE, code, board.link.session)
                check_equal(told, 0, f"{code.name} of session {told:#06x}")
    board.check_state(OutputState.ARMED, "a DISARM of another session has led to")


def _largest_remembered_request(board: BoardClient) -> Iterator[Message]:
    """Yield the requests whose replies are as long as the board makes them."""
    yield GetGeometry(0, 0xFFFF)
    yield from (ReadDrive(kind, 0, 0xFFFF) for kind in drive_kinds(board))
    if board.has(Feature.TRACE_RING):
        yield ReadTrace(0, 0xFFFF)


def _fill_ring(board: BoardClient) -> None:
    """Latch so often in a second at most that the ring fills a frame, if the board can."""
    if not board.has(Feature.TRACE_RING | Feature.CONFIG | Feature.SEQUENCE_PHASES):
        return
    board.arm(trace_mode=TraceMode.RING)
    period_us = shortest_period_to_play_us(board, PERIOD_US // 4)
    play_now(board, _SEQUENCE, loops=100, period_us=period_us)
    board.wire.idle(min(250 * period_us, _FILLED_US))
    board.link.ask(Stop())


def _judge_remembered_reply(board: BoardClient, betweens: dict[str, Between]) -> None:
    """FAILED unless every request gets its reply again behind each of *betweens*."""
    for message in every_request_to_repeat(board):
        board.arm()
        first = board.link.ask_at_once(message)
        for name, send in betweens.items():
            send(board)
            judge_repeated_reply(board, message, first, f"{message.TYPE.name} and {name}")


@case("HG-4.10/1-kept")
def every_mute_between(board: BoardClient) -> None:
    """a reply of every type, refusals too, is still remembered after MUTE and UPLOAD_CHUNK"""
    chunks = CHUNKS_BETWEEN if board.identity.features & UPLOADS else {}
    _judge_remembered_reply(board, MUTES_BETWEEN | chunks)


@case("HG-4.9/4-types")
def every_refusal_between(board: BoardClient) -> None:
    """a reply of every type, refusals too, is still remembered after each refusal of steps 5 to
    11
    """
    _judge_remembered_reply(board, REFUSALS_BETWEEN)


@case("HG-4.9/1-replies")
def every_reply_is_remembered(board: BoardClient) -> None:
    """refused requests, and those with the longest replies, get the same bytes again"""
    if board.has(Feature.SEQUENCE_PHASES):
        send_phases_that_fit(board, _SEQUENCE, frames=2)
        _fill_ring(board)
    board.arm()
    for message in [*refused_requests_to_send(board), *_largest_remembered_request(board)]:
        with board.counting(repeated=2, requests=1, frames=3):
            first = board.link.ask_at_once(message)
            for _ in range(2):
                judge_repeated_reply(board, message, first, message.TYPE.name)
        board.link.refused_as_used(message, first.frame_header.seq)
