"""HG-3.8: the order in which a board checks a frame."""

from __future__ import annotations

import itertools
from typing import Final

from haptogram_protocol.messages import (
    RESPONSE_OFFSET,
    Arm,
    Error,
    ErrorCode,
    Feature,
    Flag,
    Hello,
    HelloReply,
    Message,
    Mute,
    MuteReply,
    Phases,
    Ping,
    Play,
    Pong,
    UploadCommit,
)
from haptogram_protocol.state import MuteReason, OutputState

from ...case import case
from ...client.board_client import BoardClient
from ...client.latching import is_board_silent
from ...client.playback import play_request, send_phases_that_fit, wait_for_no_latch
from ...outcome import SELF_REPORTED, check, check_equal, fail

_STALE: Final = 0x0F0F
_UNKNOWN_REQUEST: Final = 0x7D
_UNKNOWN_STREAM: Final = 0x3D
_DEEPEST: Final = 512  # a queue deeper than this is not filled: it would take seconds
_LATEST_US: Final = 1 << 30  # behind the last in the queue: what is half a turn ahead has passed
_STATUS_BYTES: Final = 200  # of a STATUS_REPLY and of its request on the line, at most
_STEP_US: Final = 1000
_SEQUENCE: Final = 4


@case("HG-3.8/1")
def checks_requests_in_order(board: BoardClient) -> None:
    """requests with two defects are refused for the one that is checked first"""
    stale = board.link.session ^ _STALE
    used = board.link.seq
    refused = board.link.refused_raw
    refused(_UNKNOWN_REQUEST, b"", ErrorCode.UNSUPPORTED, _UNKNOWN_REQUEST, session=stale)
    refused(
        Ping.TYPE, bytes(8), ErrorCode.STALE_SESSION, board.link.session, session=stale, flags=0x40
    )
    refused(Ping.TYPE, bytes(3), ErrorCode.STALE_SESSION, board.link.session, session=stale)
    refused(Ping.TYPE, bytes(3), ErrorCode.UNSUPPORTED, 0x40, flags=0x40)
    refused(Ping.TYPE, bytes(3), ErrorCode.BAD_LENGTH, 8, seq=used)
    refused(Ping.TYPE, bytes(8), ErrorCode.UNSUPPORTED, 0x80, seq=used, flags=0x80)
    if board.identity.features & (Feature.SEQUENCE_PHASES | Feature.CORRECTION):
        commit = UploadCommit(1).serialize()  # without an upload: BAD_STATE, were it new
        refused(UploadCommit.TYPE, commit, ErrorCode.SEQUENCE_REUSED, used & 0xFFFF, seq=used)


@case("HG-3.8/1-stream", evidence=SELF_REPORTED)
def checks_stream_frames_in_order(board: BoardClient) -> None:
    """stream frames with two defects are counted for the one that is checked first"""
    stale, good = board.link.session ^ _STALE, board.flat_phases()
    payload = good.serialize()
    first = board.link.stream_wire(good)
    used = board.link.stream_next - 1
    tests: list[tuple[str, bytes]] = [
        ("dropped_state", first),
        ("unknown_type", board.link.stream_raw(_UNKNOWN_STREAM, b"", session=stale)),
        ("stale_session", board.link.stream_wire(good, seq=used, session=stale, flags=0x40)),
        ("stale_session", board.link.stream_raw(Phases.TYPE, b"", seq=used, session=stale)),
        ("duplicate", board.link.stream_wire(good, seq=used, flags=0x40)),
        ("duplicate", board.link.stream_raw(Phases.TYPE, b"", seq=used)),
    ]
    board.link.stream_next = used + 1  # the unknown frame was of another session
    tests += [
        ("unsupported", board.link.stream_raw(Phases.TYPE, b"", flags=0x40)),
        ("bad_length", board.link.stream_raw(Phases.TYPE, payload + b"\x00")),
        ("dropped_state", board.link.stream_wire(good, 0)),
    ]
    for counter, wire in tests:
        with board.counting(**{counter: 1}):
            board.link.send(wire)


@case("HG-3.8/1-queue", evidence=SELF_REPORTED)
def checks_for_the_queue_in_order(board: BoardClient) -> None:
    """a full queue: order is checked before room, room before horizon, order before lateness"""
    depth = board.depth_to_fill()
    good = board.shortest_stream()
    board.hello()
    board.arm()
    times = board.times_in_queue(depth, others=4)
    with board.counting(dropped_order=2, dropped_full=2, flushed=depth):
        board.link.send(*(board.link.stream_wire(good, t_us) for t_us in times))
        beyond_us = times[-1] + min(2 * board.identity.max_horizon_us, _LATEST_US)
        for t_us in (times[-1], times[0] - 10 * 1_000_000, times[-1] + _STEP_US, beyond_us):
            board.link.stream(good, t_us)
        board.link.barrier()  # or MUTE may overtake them
        board.clock.end_exchange()
        board.link.call(Mute(), MuteReply)


@case("HG-3.8/2")
def checks_frames_in_the_order_they_come(board: BoardClient) -> None:
    """a PING of the new session right behind its HELLO is answered, after it"""
    nonce = board.new_nonce()
    hello, first = board.link.request_wire(board.hello_message(nonce), session=0)
    ping, second = board.link.request_wire(Ping(5), session=nonce)
    since = board.link.mark()
    board.link.send(hello, ping)
    board.adopt(
        board.link.reply_in(board.link.answer_to(Hello.TYPE, first, since), HelloReply, Hello.TYPE)
    )
    board.link.reply_in(board.link.answer_to(Ping.TYPE, second, since), Pong, Ping.TYPE)
    numbers = [p.header.seq for p in board.link.responses(since) if p.header is not None]
    check(numbers == [first, second], f"sent were {first}, {second}; answered {numbers}")


def _answer_to_checked_message(
    board: BoardClient, message: Message, seq: int, since: int
) -> Message:
    found = board.link.answer_to(message.TYPE, seq, since).message
    if found is None:
        fail(f"the answer to {message.TYPE.name} cannot be read")
    return found


@case("HG-3.8/4", evidence=SELF_REPORTED)
def frames_before_mute_are_checked_before_it(board: BoardClient) -> None:
    """ARM, a stream frame, PLAY, ARM and MUTE at once: off behind it, each frame done or refused"""
    plays = board.has(Feature.SEQUENCE_PHASES)
    if plays:
        send_phases_that_fit(board, _SEQUENCE, frames=2)
    for _ in board.wire.ways_of_mute():
        for session, sounds in itertools.product((board.link.session, 0), (False, True)):
            board.arm()
            if not sounds:
                board.disarm()
            play = play_request(board, _SEQUENCE, loops=0, unattended_ms=1000)
            ahead: list[tuple[Message, int]] = [(Arm(), 0), (Ping(7), 0)]
            ahead += [(play, Flag.IMMEDIATE)] if plays else []
            ahead.append((Arm(), 0))
            before = board.status().counters
            since = board.link.mark()
            wires = [board.link.request_wire(message, flags=flags) for message, flags in ahead]
            frame = board.link.stream_wire(board.flat_phases())
            mute, mute_seq = board.link.request_wire(Mute(), session=session)
            first, *others = (wire for wire, _ in wires)
            board.link.send(first, frame, *others, mute)
            state = _answer_to_checked_message(board, Mute(), mute_seq, since)
            check_equal(state, MuteReply(OutputState.MUTED), "MUTE behind other frames")
            for (message, _), (_, seq) in zip(ahead, wires, strict=True):
                judge_overtaken_request(
                    message, _answer_to_checked_message(board, message, seq, since)
                )
            board.clock.wait_latched()
            judge_silence_behind_mute(board)
            counted = board.counted_since(before)
            found = counted["accepted"], counted["dropped_state"]
            check(
                found in ((1, 0), (0, 1)),
                f"a stream frame, ... and MUTE at once: accepted and dropped_state count {found}",
            )


def judge_overtaken_request(message: Message, answer: Message) -> None:
    """FAILED unless a request before a MUTE was carried out, or refused for being overtaken."""
    name = message.TYPE.name
    if isinstance(answer, Error):
        refused = (answer.code, answer.detail) == (ErrorCode.BAD_STATE, OutputState.MUTED)
        check(
            refused and isinstance(message, Arm | Play),
            f"{name} right before MUTE is refused with code {answer.code}, detail {answer.detail}",
        )
        return
    due = message.TYPE + RESPONSE_OFFSET
    check_equal(answer.TYPE, due, f"{name} right before MUTE is answered by {answer.TYPE.name}")


def judge_silence_behind_mute(board: BoardClient) -> None:
    """FAILED unless the board is MUTED, silent, and stays so."""
    found = board.status()
    got = found.state, found.reason, found.queued
    check_equal(got, (OutputState.MUTED, MuteReason.MUTE, 0), f"behind MUTE: {got}")
    latched, begin_us = found.counters.latched, board.wire.now_us()
    if board.has(Feature.READ_RADIATED):
        check(is_board_silent(board), "behind MUTE the board radiates")
    wait_for_no_latch(board, 5000)
    behind = board.status()
    check_equal(behind.counters.latched, latched, "what arrived before MUTE is latched behind it")
    check_equal(
        behind.state,
        OutputState.MUTED,
        f"{board.wire.now_us() - begin_us} µs behind MUTE: {behind.state.name}",
    )


@case("HG-3.8/3")
def mute_passes_all_header_checks(board: BoardClient) -> None:
    """MUTE with any session, flags, payload and number is carried out"""
    for header in (
        {"session": 0},
        {"session": board.link.session ^ _STALE},
        {"flags": 0xFF},
        {"seq": board.link.seq - 1},
        {"seq": board.link.seq},
    ):
        board.arm()
        answer = board.link.ask_raw(Mute.TYPE, bytes(range(17)), **header)
        state = board.link.reply_in(answer, MuteReply, Mute.TYPE).state
        check_equal(state.name, "MUTED", f"MUTE with {header}: {state.name}")
