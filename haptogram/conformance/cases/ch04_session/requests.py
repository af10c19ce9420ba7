"""HG-4.8, HG-4.9, HG-4.10, HG-4.12: requests one at a time, remembered, never done twice."""

from __future__ import annotations

from typing import Final

from haptogram_protocol.messages import (
    Arm,
    Disarm,
    ErrorCode,
    Feature,
    GetStatus,
    Message,
    Mute,
    MuteReply,
    Ping,
    Pong,
    UploadChunk,
    UploadChunkReply,
    UploadKind,
)
from haptogram_protocol.state import OutputState

from ...case import case, case_about_host
from ...client.board_client import BoardClient
from ...client.uploads import begin_upload
from ...client.wire import ReceivedByClient
from ...judge.repetition import judge_repeated_reply
from ...outcome import check, check_equal

_UPLOADS: Final = Feature.SEQUENCE_PHASES | Feature.CORRECTION


host_waits = case_about_host("HG-4.8/1")


host_repeats = case_about_host("HG-4.8/2")


host_counts = case_about_host("HG-4.8/3")


host_starts_at_0 = case_about_host("HG-4.8/4")


host_gives_up = case_about_host("HG-4.8/5")


def _send_request(
    board: BoardClient, wire: bytes, kind: type[Message], seq: int
) -> ReceivedByClient:
    """Send the bytes of a request and return the answer."""
    since = board.link.mark()
    board.link.send(wire)
    return board.link.answer_to(kind.TYPE, seq, since)


@case(
    "HG-4.9/1",
    "ARM again after a MUTE without a session: same reply to the byte, still MUTED; repeated + 1",
)
def repeats_the_reply_to_a_request(board: BoardClient) -> None:
    wire, seq = board.link.request_wire(Arm())
    _send_request(board, wire, Arm, seq)
    board.link.ask(Mute(), session=0, seq=seq + 1000)
    with board.counting(repeated=2):
        # GET_STATUS would be the last request: the repetitions come first.
        board.link.seq = seq + 1
        state = board.status().state
        check_equal(state, OutputState.MUTED, f"after MUTE without a session: {state.name}")
        wire, seq = board.link.request_wire(Ping(7))
        first = _send_request(board, wire, Ping, seq)
        board.wire.idle(5000)
        for _ in range(2):
            judge_repeated_reply(board, wire, seq, first, "PING")
    _repeated_arm_is_not_done_twice(board)


def _repeated_arm_is_not_done_twice(board: BoardClient) -> None:
    wire, seq = board.link.request_wire(Arm())
    first = _send_request(board, wire, Arm, seq)
    board.link.ask(Mute(), session=0, seq=seq + 1000)
    judge_repeated_reply(board, wire, seq, first, "ARM and a MUTE without a session")
    board.link.seq = seq
    state = board.status().state
    check(state is OutputState.MUTED, f"ARM sent again was carried out again: {state.name}")


@case(
    "HG-4.9/2",
    "the last request's number with other bytes is refused: SEQUENCE_REUSED, detail: the number",
)
def refuses_a_reused_request_number(board: BoardClient) -> None:
    board.arm()
    seq = board.link.seq & 0xFFFF
    board.link.refused(Disarm(), ErrorCode.SEQUENCE_REUSED, seq, seq=seq)
    board.link.refused(Ping(1), ErrorCode.SEQUENCE_REUSED, seq, seq=seq)
    state = board.status().state
    check_equal(state, OutputState.ARMED, f"a refused DISARM has led to {state.name}")


@case("HG-4.9/3", "a delayed copy of ARM does not undo a later DISARM: SEQUENCE_REUSED")
def refuses_a_delayed_copy_of_a_request(board: BoardClient) -> None:
    wire, seq = board.link.request_wire(Arm())
    _send_request(board, wire, Arm, seq)
    board.disarm()
    since = board.link.mark()
    board.link.send(wire)
    answer = board.link.answer_to(Arm.TYPE, seq, since)
    board.link.error_in(answer, Arm.TYPE, ErrorCode.SEQUENCE_REUSED, seq)
    for back in (2, 100, 30_000):
        old = (board.link.seq - back) & 0xFFFF
        board.link.refused(Ping(1), ErrorCode.SEQUENCE_REUSED, old, seq=old)
    state = board.status().state
    check_equal(state, OutputState.DISARMED, f"a delayed ARM has led to {state.name}")


@case("HG-4.9/4", "after refusals for flags, length and type the same number is still free")
def refused_requests_use_no_number(board: BoardClient) -> None:
    wire, seq = board.link.request_wire(Arm())
    reply = _send_request(board, wire, Arm, seq)
    free = (seq + 1) & 0xFFFF
    board.link.refused(Ping(1), ErrorCode.UNSUPPORTED, 0x20, seq=free, flags=0x20)
    board.link.refused_raw(Ping.TYPE, bytes(3), ErrorCode.BAD_LENGTH, 8, seq=free)
    board.link.refused_raw(0x7C, b"", ErrorCode.UNSUPPORTED, 0x7C, seq=free)
    board.link.refused(
        Ping(1), ErrorCode.STALE_SESSION, seq=free, session=board.link.session ^ 0x0F0F
    )
    judge_repeated_reply(board, wire, seq, reply, "refused requests")
    board.link.call(Ping(2), Pong, seq=free)
    board.link.seq = free


@case(
    "HG-4.9/5",
    "behind a MUTE a copy of a request: same reply if it was done, SEQUENCE_REUSED if it was lost",
)
def mute_passes_a_pending_request(board: BoardClient) -> None:
    ping, seq = board.link.request_wire(Ping(9))
    first = _send_request(board, ping, Ping, seq)
    board.link.call(Mute(), MuteReply)
    judge_repeated_reply(board, ping, seq, first, "PING and MUTE")
    for message in (Arm(), Ping(1)):
        lost, seq = board.link.request_wire(message)
        board.link.call(Mute(), MuteReply)
        since = board.link.mark()
        board.link.send(lost)
        answer = board.link.answer_to(message.TYPE, seq, since)
        board.link.error_in(answer, message.TYPE, ErrorCode.SEQUENCE_REUSED, seq)
    state = board.status().state
    check(state is OutputState.MUTED, f"an ARM that was lost before MUTE has led to {state.name}")
    board.link.call(Ping(2), Pong)


@case("HG-4.10/1", "MUTE is carried out each time; its number in the session counts as used")
def repeated_mute_is_done_again(board: BoardClient) -> None:
    board.arm()
    wire, seq = board.link.request_wire(Mute())
    _send_request(board, wire, Mute, seq)
    board.link.refused(Ping(1), ErrorCode.SEQUENCE_REUSED, seq, seq=seq)
    board.arm()
    _send_request(board, wire, Mute, seq)
    state = board.status().state
    check_equal(state, OutputState.MUTED, f"the same MUTE again has led to {state.name}")
    board.link.call(Mute(), MuteReply, session=0, seq=board.link.seq + 500)
    board.link.call(Ping(1), Pong)  # the number of a MUTE of no session is not used up


@case(
    "HG-4.10/1",
    "PING and MUTE at once: PING is answered, although the number of MUTE is newer",
    variant="behind",
)
def mute_uses_no_earlier_request_number(board: BoardClient) -> None:
    for number in range(8):
        ping, first = board.link.request_wire(Ping(number))
        mute, second = board.link.request_wire(Mute())
        since = board.link.mark()
        board.link.send(ping, mute)
        answer = board.link.answer_to(Ping.TYPE, first, since)
        board.link.reply_in(answer, Pong, Ping.TYPE)
        board.link.answer_to(Mute.TYPE, second, since)


@case("HG-4.10/1", "UPLOAD_CHUNK is carried out each time", variant="chunk")
def repeated_chunks_are_done_again(board: BoardClient) -> None:
    board.need_any(_UPLOADS)
    kind = UploadKind.PHASES if board.has(Feature.SEQUENCE_PHASES) else UploadKind.CORRECTION
    target = 1 if kind is UploadKind.PHASES else 0
    data = bytes(board.identity.transducers)
    begin_upload(board, kind, target, data)
    wire, seq = board.link.request_wire(UploadChunk(0, data[:1]))
    first = _send_request(board, wire, UploadChunk, seq)
    begin_upload(board, kind, target, data)
    since = board.link.mark()
    board.link.send(wire)
    again = board.link.reply_in(
        board.link.answer_to(UploadChunk.TYPE, seq, since), UploadChunkReply, UploadChunk.TYPE
    )
    check_equal(again.received, 1, f"a chunk of 1 byte again: {again.received} received, {first!r}")


@case(
    "HG-4.12/1", "DISARM, PING, GET_STATUS of another session: STALE_SESSION, session 0; not done"
)
def refuses_requests_of_another_session(board: BoardClient) -> None:
    board.arm()
    requests: tuple[Message, ...] = (Disarm(), Ping(1), GetStatus())
    with board.counting(requests=2 * len(requests)):
        for message in requests:
            for session in (0, board.link.session ^ 0x8001):
                answer = board.link.ask(message, session=session)
                board.link.error_in(
                    answer, message.TYPE, ErrorCode.STALE_SESSION, board.link.session
                )
                assert answer.header is not None  # ask
                check_equal(answer.header.session, 0, "ERROR(STALE_SESSION) is not of session 0")
    check(board.status().state is OutputState.ARMED, "a DISARM of another session was done")
