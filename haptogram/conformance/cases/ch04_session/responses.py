"""HG-4.11: number, time and order of responses."""

from __future__ import annotations

import itertools
from typing import Final

from haptogram_protocol.annotation.words import annotated_type_name
from haptogram_protocol.framing import encode_frame
from haptogram_protocol.messages import (
    Arm,
    Disarm,
    DisarmReply,
    Feature,
    GetConfig,
    GetGeometry,
    GetStatus,
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

from ...case import case, case_about_host
from ...client.board_client import BoardClient
from ...client.playback import play_now, send_phases_that_fit
from ...outcome import check, check_equal

_PROMPT_US: Final = 10_000
_TRIES: Final = 8
_CLOCK_US: Final = 10
_EVENTS_US: Final = 10_000  # until the events that a request leads to have come


host_ignores = case_about_host("HG-4.11/4")


@case("HG-4.11/1")
def responses_belong_to_their_requests(board: BoardClient) -> None:
    """responses have the number of their request and the open session"""
    requests: tuple[Message, ...] = (Ping(1), GetStatus(), GetConfig(), Arm(), Disarm())
    for message in requests:
        board.link.seq += 77
        answer = board.link.ask(message)  # waits for its number
        header = answer.header
        assert header is not None  # ask
        check_equal(
            header.session,
            board.link.session,
            f"{annotated_type_name(header.type)} has session {header.session:#06x}, "
            f"open is {board.link.session:#06x}",
        )
    answer = board.link.ask(Ping(1), session=board.link.session ^ 0x0F0F)
    session = answer.header.session if answer.header else -1
    check(session == 0, f"ERROR(STALE_SESSION) has session {session:#06x}, must be 0")


@case("HG-4.11/2")
def responses_tell_the_time(board: BoardClient) -> None:
    """the header time is that of the first byte: t_tx of a PONG; it rises from reply to reply"""
    for _ in range(_TRIES):
        first = board.link.ask(Ping(1))
        middle = board.link.ask(GetStatus())
        last = board.link.ask(Ping(2))
        headers = [piece.header for piece in (first, middle, last)]
        times = [header.time_us for header in headers if header is not None]
        for time_us, piece in ((times[0], first), (times[2], last)):
            pong = board.link.reply_in(piece, Pong, Ping.TYPE)
            apart_us = abs(signed_difference(time_us, pong.t_tx_us, 32))
            check(apart_us <= _CLOCK_US, f"header time and t_tx differ by {apart_us} µs")
        steps = [signed_difference(b, a, 32) for a, b in itertools.pairwise(times)]
        check(
            all(0 <= step < 5_000_000 for step in steps),
            f"times of three responses in a row: {times}",
        )


@case("HG-4.11/2-exact")
def refusing_responses_tell_the_time(board: BoardClient) -> None:
    """ERROR to unknown flags and a repeated HELLO_REPLY, behind a long reply: when they leave"""
    board.wire.require_exact_times()
    offset_us = _device_offset_of_responses_us(board)
    greeting = board.hello_message(board.link.session)
    for message, header in ((Ping(1), {"flags": 0x40}), (greeting, {"session": 0})):
        long, _ = board.link.request_wire(GetGeometry(0, 0xFFFF))
        short, seq = board.link.request_wire(message, **header)
        since = board.link.mark()
        board.link.send(long, short)
        answer = board.link.answer_to(message.TYPE, seq, since)
        assert answer.header is not None  # answer_to
        due_us = offset_us + board.wire.begun_us(answer)
        off_us = signed_difference(answer.header.time_us, due_us & 0xFFFFFFFF, 32)
        name = annotated_type_name(answer.header.type)
        check(abs(off_us) <= _CLOCK_US, f"the time of {name} is off by {off_us:+d} µs")


def _device_offset_of_responses_us(board: BoardClient) -> int:
    """Return the device clock less that of the transport, by a PONG that waited for nothing."""
    answer = board.link.ask(Ping(0))
    pong = board.link.reply_in(answer, Pong, Ping.TYPE)
    return pong.t_tx_us - board.wire.begun_us(answer)


@case("HG-4.11/6")
def repeated_responses_keep_their_time(board: BoardClient) -> None:
    """a PING again, 20 ms later: the time in the header is that of the first PONG"""
    wire, seq = board.link.request_wire(Ping(5))
    times = []
    for _ in range(3):
        since = board.link.mark()
        board.link.send(wire)
        answer = board.link.answer_to(Ping.TYPE, seq, since)
        assert answer.header is not None  # answer_to
        times.append((answer.header.time_us, board.link.reply_in(answer, Pong, Ping.TYPE).t_tx_us))
        board.wire.idle(20_000)
    check_equal(len(set(times)), 1, f"header time and t_tx of a PONG and its repetitions: {times}")


@case("HG-4.11/3")
def responses_come_promptly(board: BoardClient) -> None:
    """of 8 PINGs one is answered within 10 ms"""
    took_us = min(_response_round_trip_us(board, number) for number in range(_TRIES))
    size = 2 * len(encode_frame(bytes(26)))
    check(
        took_us <= board.wire.period_us(size) + _PROMPT_US,
        f"the fastest of {_TRIES} answers took {took_us} µs",
    )


def _response_round_trip_us(board: BoardClient, number: int) -> int:
    start_us = board.wire.now_us()
    board.link.call(Ping(number), Pong)
    return board.wire.now_us() - start_us


@case("HG-4.11/5")
def responses_come_before_reports(board: BoardClient) -> None:
    """MUTE without a session: MUTE_REPLY comes before STATE_CHANGED"""
    board.arm()
    _responses_in_order(board, Mute(), (MuteReply, StateChanged), session=0)


@case("HG-4.11/5-play", needs=Feature.SEQUENCE_PHASES)
def responses_come_before_the_playback_ends(board: BoardClient) -> None:
    """STOP, MUTE, DISARM, HELLO during playback: reply, STATE_CHANGED, then PLAYBACK_ENDED"""
    send_phases_that_fit(board, 1, frames=2)
    hello = board.hello_message(board.new_nonce())
    orders: tuple[tuple[Message, int, tuple[type[Message], ...]], ...] = (
        (Stop(), board.link.session, (StopReply, PlaybackEnded)),
        (Mute(), board.link.session, (MuteReply, PlaybackEnded)),
        (Mute(), 0, (MuteReply, StateChanged, PlaybackEnded)),
        (Disarm(), board.link.session, (DisarmReply, PlaybackEnded)),
        (hello, 0, (HelloReply, PlaybackEnded)),
    )
    for message, session, order in orders:
        board.arm()
        play_now(board, 1, loops=0)
        _responses_in_order(board, message, order, session=session)
    board.link.session = hello.nonce


def _responses_in_order(
    board: BoardClient, message: Message, due: tuple[type[Message], ...], *, session: int
) -> None:
    """Send a request; FAILED unless its reply and events come in the order *due*."""
    since = board.link.mark()
    board.link.ask(message, session=session)
    board.wire.idle_beyond(_EVENTS_US)
    came = [type(p.message) for p in board.wire.received[since:] if isinstance(p.message, due)]
    check(
        came == sorted(came, key=due.index),
        f"{message.TYPE.name} was followed by {', '.join(kind.__name__ for kind in came)}",
    )
