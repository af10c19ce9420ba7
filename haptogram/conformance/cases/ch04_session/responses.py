"""HG-4.11, HG-4.12: number, time, order and session of responses; frames while none is open."""

from __future__ import annotations

import itertools
from typing import Final

from haptogram_protocol.annotation.words import annotated_type_name
from haptogram_protocol.framing import encode_frame
from haptogram_protocol.messages import (
    REQUEST_RANGE,
    STREAM_RANGE,
    VERSION_MAJOR,
    Arm,
    Disarm,
    DisarmReply,
    ErrorCode,
    Feature,
    GetConfig,
    GetGeometry,
    GetStatus,
    Hello,
    HelloReply,
    Message,
    Mute,
    MuteReply,
    Ping,
    PlaybackEnded,
    Pong,
    StateChanged,
    Stop,
    StopReply,
    signed_difference,
)
from haptogram_protocol.rules import unsupported_types
from haptogram_protocol.state import OutputState

from ...case import case, case_about_host
from ...client.board_client import BoardClient
from ...client.playback import play_now, send_phases_that_fit
from ...client.stream_kinds import request_types_of_host
from ...client.wire import ReceivedByClient
from ...outcome import SELF_REPORTED, check, check_equal, check_fields

_PROMPT_US: Final = 10_000
_TRIES: Final = 8
_CLOCK_US: Final = 10
_EVENTS_US: Final = 10_000  # until the events that a request leads to have come
_UNKNOWN_REQUEST: Final = 0x7B
#: Counters of what a board does with frames of an open session.
_OF_A_SESSION: Final = ("accepted", "latched", "dropped_state", "duplicate", "gap", "bad_length")


host_ignores = case_about_host("HG-4.11/4")


@case("HG-4.11/1")
def responses_have_their_session(board: BoardClient) -> None:
    """responses have the number of their request and the open session"""
    requests: tuple[Message, ...] = (Ping(1), GetStatus(), GetConfig(), Arm(), Disarm())
    for message in requests:
        board.link.seq += 77
        check_answer_session(board.link.ask(message), board.link.session)
    check_answer_session(board.link.ask(Ping(1), session=board.link.session ^ 0x0F0F), 0)


def check_answer_session(answer: ReceivedByClient, due: int, name: str = "") -> None:
    """FAILED unless an answer, to the request *name*, has the session that is open."""
    kind, session = annotated_type_name(answer.frame_header.type), answer.frame_header.session
    check_equal(session, due, f"{kind}{name and ' to '}{name} has session {session:#06x}")


@case("HG-4.11/2")
def responses_tell_the_time(board: BoardClient) -> None:
    """the header time is that of the first byte: t_tx of a PONG; it rises from reply to reply"""
    for _ in range(_TRIES):
        answers = [board.link.ask(message) for message in (Ping(1), GetStatus(), Ping(2))]
        times = [answer.frame_header.time_us for answer in answers]
        for answer in answers[::2]:
            t_tx_us = board.link.reply_in(answer, Pong).t_tx_us
            apart_us = abs(signed_difference(answer.frame_header.time_us, t_tx_us, 32))
            check(apart_us <= _CLOCK_US, f"header time and t_tx differ by {apart_us} µs")
        steps = [signed_difference(b, a, 32) for a, b in itertools.pairwise(times)]
        in_order = all(0 <= step < 5_000_000 for step in steps)
        check(in_order, f"times of three responses in a row: {times}")


@case("HG-4.11/2-exact")
def refusals_tell_the_time(board: BoardClient) -> None:
    """ERROR to unknown flags and a repeated HELLO_REPLY, behind a long reply: when they leave"""
    board.wire.require_exact_times()
    offset_us = _device_offset_us(board)
    greeting = board.hello_message(board.link.session)
    for message, flags in ((Ping(1), 0x40), (greeting, 0)):
        long, _ = board.link.request_wire(GetGeometry(0, 0xFFFF))
        short, _ = board.link.request_wire(message, flags=flags)
        _, answer = board.link.exchange(long, short)
        due_us = offset_us + board.wire.begun_us(answer)
        off_us = signed_difference(answer.frame_header.time_us, due_us & 0xFFFFFFFF, 32)
        name = annotated_type_name(answer.frame_header.type)
        check(abs(off_us) <= _CLOCK_US, f"the time of {name} is off by {off_us:+d} µs")


def _device_offset_us(board: BoardClient) -> int:
    """Return the device clock less that of the transport, by a PONG that waited for nothing."""
    answer = board.link.ask(Ping(0))
    pong = board.link.reply_in(answer, Pong)
    return pong.t_tx_us - board.wire.begun_us(answer)


@case("HG-4.11/6")
def repetitions_keep_their_time(board: BoardClient) -> None:
    """a PING again, 20 ms later: the time in the header is that of the first PONG"""
    seq, times = board.link.next_seq(), []
    for _ in range(3):
        answer = board.link.ask(Ping(5), seq=seq)
        times.append((answer.frame_header.time_us, board.link.reply_in(answer, Pong).t_tx_us))
        board.wire.idle(20_000)
    check_equal(len(set(times)), 1, f"header time and t_tx of a PONG and its repetitions: {times}")


@case("HG-4.11/3")
def responses_come_promptly(board: BoardClient) -> None:
    """of 8 PINGs one is answered within 10 ms"""
    took = []
    for number in range(_TRIES):
        start_us = board.wire.now_us()
        board.link.ping(number)
        took.append(board.wire.now_us() - start_us)
    due_us = board.wire.period_us(2 * len(encode_frame(bytes(26)))) + _PROMPT_US
    check(min(took) <= due_us, f"the fastest of {_TRIES} answers took {min(took)} µs")


@case("HG-4.11/5")
def responses_precede_events(board: BoardClient) -> None:
    """MUTE without a session: MUTE_REPLY comes before STATE_CHANGED"""
    board.arm()
    _responses_in_order(board, Mute(), (MuteReply, StateChanged), session=0)


@case("HG-4.11/5-play", needs=Feature.SEQUENCE_PHASES)
def responses_precede_playback_ended(board: BoardClient) -> None:
    """STOP, MUTE, DISARM, HELLO during playback: reply, STATE_CHANGED, then PLAYBACK_ENDED"""
    send_phases_that_fit(board, 1, frames=2)
    hello = board.hello_message(board.new_nonce())
    replies: tuple[tuple[Message, int | None, type[Message]], ...] = (
        (Stop(), None, StopReply),
        (Mute(), None, MuteReply),
        (Mute(), 0, MuteReply),
        (Disarm(), None, DisarmReply),
        (hello, None, HelloReply),
    )
    for message, session, reply in replies:
        board.arm()
        play_now(board, 1, loops=0)
        told = (StateChanged,) if session == 0 else ()
        _responses_in_order(board, message, (reply, *told, PlaybackEnded), session=session)
    board.link.session = hello.nonce


def _responses_in_order(
    board: BoardClient, message: Message, due: tuple[type[Message], ...], *, session: int | None
) -> None:
    """Send a request; FAILED unless its reply and events come in the order *due*."""
    since = board.link.mark()
    board.link.ask(message, session=session)
    board.wire.idle_beyond(_EVENTS_US)
    came = [type(p.message) for p in board.wire.received[since:] if isinstance(p.message, due)]
    followed = ", ".join(kind.__name__ for kind in came)
    is_in_order = came == sorted(came, key=due.index)
    check(is_in_order, f"{message.TYPE.name} was followed by {followed}")


@case("HG-4.12/1-closed", needs_reset=True, evidence=SELF_REPORTED)
def every_frame_when_closed(board: BoardClient) -> None:
    """before the first HELLO frames of every type and session, 0 too, are stale: nothing is done"""
    streamed: list[int] = []
    answers = []
    for session in (0, 1, 0x8000, 0xFFFF, board.new_nonce()):
        for kind in request_types_of_host():
            name = f"{kind.TYPE.name} of session {session:#06x}"
            payload = bytes(kind.LAYOUT.size)
            if kind.TYPE in STREAM_RANGE:
                board.link.send(board.link.stream_raw(kind.TYPE, payload, session=session))
                streamed.append(kind.TYPE)
            elif kind.TYPE in REQUEST_RANGE and kind not in (Hello, Mute):
                answer = board.link.ask_raw(kind.TYPE, payload, session=session)
                answers.append((name, kind.TYPE, answer))
    identity = board.hello()
    check_fields(identity, "frames before the first HELLO", state=OutputState.DISARMED)
    lacking = unsupported_types(Feature(identity.features))  # these are refused in step 5
    for name, kind_of, answer in answers:
        unknown = kind_of in lacking
        code = ErrorCode.UNSUPPORTED if unknown else ErrorCode.STALE_SESSION
        board.link.error_in(answer, kind_of, code, kind_of if unknown else 0)
        check_answer_session(answer, 0, f"{name}, while none is open,")
    due = dict.fromkeys(_OF_A_SESSION, 0)
    due["stale_session"] = sum(kind not in lacking for kind in streamed)
    counters = board.status().counters
    check_fields(counters, f"{len(streamed)} frames before the first HELLO: counters", **due)
    asked = len(answers) + 2  # HELLO and GET_STATUS
    heard = board.link.knocks  # repetitions of the first one, to a board that boots
    text = f"{asked} requests from the reset on; requests is {counters.requests}"
    check(asked <= counters.requests <= asked + heard, text)


@case("HG-4.11/1-closed", needs_reset=True)
def every_answer_when_closed(board: BoardClient) -> None:
    """before the first HELLO every answer has session 0"""
    board.link.session = 0
    answers = {
        "MUTE": board.link.ask(Mute()),
        "MUTE of a session": board.link.ask(Mute(), session=0x1234),
        "PING": board.link.ask(Ping(1)),
        "PING of a session": board.link.ask(Ping(1), session=0x1234),
        "an unknown request": board.link.ask_raw(_UNKNOWN_REQUEST),
        "HELLO of another version": board.link.ask(Hello(VERSION_MAJOR + 1, 0, 1, 0)),
        "HELLO of nonce 0": board.link.ask(Hello(VERSION_MAJOR, 0, 0, 0)),
    }
    for name, answer in answers.items():
        check_answer_session(answer, 0, f"{name}, while none is open,")
