"""HG-3.8: MUTE several times in one burst, with all that may switch on between them."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from typing import Final, TypeAlias

from haptogram_protocol.messages import (
    FIRST_STREAM_SEQ,
    Arm,
    Feature,
    Flag,
    Hello,
    HelloReply,
    Message,
    Mute,
    MuteReply,
)
from haptogram_protocol.state import OutputState

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.latching import latch_now
from ...client.playback import play_request, send_phases_to_store_if_supported
from ...client.stream_kinds import stream_kinds
from ...outcome import SELF_REPORTED, check, check_equal, fail
from .checks import judge_overtaken_request, judge_silence_behind_mute

_SEQUENCE: Final = 4
_STALE: Final = 0x0F0F
_AHEAD_US: Final = 60  # of a frame's t_apply: it would be latched between two MUTE
_LONGEST: Final = 4096
_STAGES: Final = (2, 1)  # frames between how many pairs of MUTE

#: A frame of a burst: its bytes, and of a request the message and its number.
_Sent: TypeAlias = tuple[bytes, Message | None, int]
_Between: TypeAlias = Callable[[], list[_Sent]]


def _request_in_burst(board: BoardClient, message: Message, **header: int) -> _Sent:
    wire, seq = board.link.request_wire(message, **header)
    return wire, message, seq


def _stream_in_burst(board: BoardClient, message: Message, at_us: int | None = None) -> _Sent:
    return board.link.stream_wire(message, at_us), None, 0


def _hello_in_burst(board: BoardClient) -> _Sent:
    nonce = board.new_nonce()
    sent = _request_in_burst(board, board.hello_message(nonce), session=0)
    board.link.session, board.link.stream_next = nonce, FIRST_STREAM_SEQ
    return sent


def _switches_on(board: BoardClient) -> Iterator[tuple[str, _Between]]:
    """Yield what might switch the output on behind a MUTE: its name, and what makes its frames."""

    def arm() -> _Sent:
        return _request_in_burst(board, Arm())

    def at_a_time() -> _Sent:
        t_us = board.clock.ready_us(board.clock.device_estimate_us()) + _AHEAD_US
        return _stream_in_burst(board, board.flat_phases(), t_us)

    yield "ARM", lambda: [arm(), arm()]
    yield "ARM and a frame for soon", lambda: [arm(), at_a_time()]
    for kind in board.sample(stream_kinds(board)):
        yield (
            f"ARM and {kind.name}, IMMEDIATE",
            lambda make=kind.make: [arm(), _stream_in_burst(board, make())],  # type: ignore[misc]
        )
    if board.has(Feature.SEQUENCE_PHASES):
        play = play_request(board, _SEQUENCE, loops=0, unattended_ms=1000)
        yield (
            "ARM and PLAY",
            lambda: [arm(), _request_in_burst(board, play, flags=int(Flag.IMMEDIATE))],
        )
    yield (
        "HELLO, ARM and a frame",
        lambda: [_hello_in_burst(board), arm(), _stream_in_burst(board, board.flat_phases())],
    )


@case("HG-3.8/4-burst", evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def nothing_switches_on_between_mutes(board: BoardClient) -> None:
    """MUTE, what may switch on, MUTE (and again) in one burst: nothing is on, ARM counts behind
    it
    """
    send_phases_to_store_if_supported(board, _SEQUENCE, frames=2)
    for way in board.wire.ways_of_mute():
        for name, make in _switches_on(board):
            for stages, others in itertools.product(board.sample(_STAGES), (False, True)):
                text = f"{name}{' of no session' * others}, between {stages + 1} MUTE {way}"
                _judge_burst_of_mutes(board, text, make, stages, others=others)


def _judge_burst_of_mutes(
    board: BoardClient, name: str, make: _Between, stages: int, *, others: bool
) -> None:
    """Send the burst from an ARMED, sounding board; FAILED unless it ends MUTED, and arms again.

    MUTE has no session, or another one, if *others*.
    """
    board.arm()
    latch_now(board)
    sessions = itertools.cycle((0, board.link.session ^ _STALE) if others else (None,))
    before = board.status().counters
    at_one_moment = _is_burst_at_one_moment(board)
    burst = [_request_in_burst(board, Mute(), **_session_of_mute(next(sessions)))]
    for _ in range(stages):
        burst += make()
        burst.append(_request_in_burst(board, Mute(), **_session_of_mute(next(sessions))))
    since = board.link.mark()
    board.link.send(*(wire for wire, _, _ in burst))
    for _, message, seq in burst:
        if message is not None:
            _judge_answer_in_burst(board, name, message, seq, since)
    board.clock.wait_computed(stages * board.most_points)
    board.clock.wait_latched()
    judge_silence_behind_mute(board)
    latched = board.counted_since(before)["latched"]
    check(
        latched == 0 or not at_one_moment,
        f"{name}, which came at one moment: {latched} frames of before MUTE were latched",
    )
    board.arm()
    with board.counting(latched=1):
        latch_now(board)


def _is_burst_at_one_moment(board: BoardClient) -> bool:
    """Return whether bytes take no time; wait then for a moment at which nothing is latched."""
    if not board.clock.is_one_moment(_LONGEST):
        return False
    carrier_us = board.clock.carrier_us
    board.wire.idle((carrier_us // 2 - board.clock.device_us()) % carrier_us)
    return True


def _session_of_mute(session: int | None) -> dict[str, int]:
    return {} if session is None else {"session": session}


def _judge_answer_in_burst(
    board: BoardClient, name: str, message: Message, seq: int, since: int
) -> None:
    answer = board.link.answer_to(message.TYPE, seq, since)
    if isinstance(message, Mute):
        state = board.link.reply_in(answer, MuteReply, Mute.TYPE).state
        check_equal(state, OutputState.MUTED, f"{name}: MUTE_REPLY says {state.name}")
    elif isinstance(message, Hello):
        reply = board.link.reply_in(answer, HelloReply, Hello.TYPE)
        check_equal(reply.nonce, message.nonce, f"{name}: HELLO_REPLY names {reply.nonce:#06x}")
    else:
        if answer.message is None:
            fail(f"{name}: the answer to {message.TYPE.name} cannot be read")
        judge_overtaken_request(message, answer.message)
