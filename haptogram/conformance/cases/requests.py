"""Chapter 4, requests: one at a time, remembered, never done twice."""

from __future__ import annotations

import itertools
from typing import Final

from haptogram_protocol.framing import encode_frame
from haptogram_protocol.messages import (
    Arm,
    Disarm,
    DisarmReply,
    ErrorCode,
    Feature,
    GetConfig,
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
    UploadChunk,
    UploadChunkReply,
    UploadKind,
    signed_difference,
)
from haptogram_protocol.state import OutputState

from ..case import about_host, case
from ..client.board_client import Bench
from ..client.playback import play_now, store_phases
from ..client.recording import type_name
from ..outcome import check

_PROMPT_US: Final = 10_000
_TRIES: Final = 8
_CLOCK_US: Final = 10
_EVENTS_US: Final = 10_000  # until what a request leads to has been told
_UPLOADS: Final = Feature.SEQUENCE_PHASES | Feature.CORRECTION

host_waits = about_host("HG-4.8/1")
host_repeats = about_host("HG-4.8/2")
host_counts = about_host("HG-4.8/3")
host_starts_at_0 = about_host("HG-4.8/4")
host_ignores = about_host("HG-4.11/4")


def _repeat(bench: Bench, wire: bytes, kind: type[Message], seq: int) -> bytes:
    """Send the same bytes again and return the body of the answer."""
    since = bench.mark()
    bench.send(wire)
    return bench.answer_to(kind.TYPE, seq, since).body


@case(
    "HG-4.9/1",
    "ARM sent again after a MUTE of no session: same reply to the byte, still MUTED; repeated + 1",
)
def repeats_its_reply(bench: Bench) -> None:
    wire, seq = bench.request_wire(Arm())
    first = _repeat(bench, wire, Arm, seq)
    bench.ask(Mute(), session=0, seq=seq + 1000)
    with bench.counting(repeated=2):
        # GET_STATUS would be the last request: the repetitions come first.
        bench.seq = seq + 1
        state = bench.status().state
        check(state is OutputState.MUTED, f"after MUTE: {state.name}")
        wire, seq = bench.request_wire(Ping(7))
        first = _repeat(bench, wire, Ping, seq)
        bench.wire.idle(5000)
        for _ in range(2):
            again = _repeat(bench, wire, Ping, seq)
            check(again == first, f"PING again: {again.hex(' ')} instead of {first.hex(' ')}")
    _arm_is_not_done_twice(bench)


def _arm_is_not_done_twice(bench: Bench) -> None:
    wire, seq = bench.request_wire(Arm())
    first = _repeat(bench, wire, Arm, seq)
    bench.ask(Mute(), session=0, seq=seq + 1000)
    again = _repeat(bench, wire, Arm, seq)
    check(again == first, f"ARM again: {again.hex(' ')} instead of {first.hex(' ')}")
    bench.seq = seq
    state = bench.status().state
    check(state is OutputState.MUTED, f"ARM sent again was carried out again: {state.name}")


@case("HG-4.9/2", "the number of the last request with other bytes: SEQUENCE_REUSED, its detail")
def refuses_a_reused_number(bench: Bench) -> None:
    bench.arm()
    seq = bench.seq & 0xFFFF
    bench.refused(Disarm(), ErrorCode.SEQUENCE_REUSED, seq, seq=seq)
    bench.refused(Ping(1), ErrorCode.SEQUENCE_REUSED, seq, seq=seq)
    state = bench.status().state
    check(state is OutputState.ARMED, f"a refused DISARM has led to {state.name}")


@case("HG-4.9/3", "a delayed copy of ARM does not undo the DISARM behind it: SEQUENCE_REUSED")
def refuses_a_delayed_copy(bench: Bench) -> None:
    wire, seq = bench.request_wire(Arm())
    _repeat(bench, wire, Arm, seq)
    bench.disarm()
    since = bench.mark()
    bench.send(wire)
    answer = bench.answer_to(Arm.TYPE, seq, since)
    bench.error_in(answer, Arm.TYPE, ErrorCode.SEQUENCE_REUSED, seq)
    for back in (2, 100, 30_000):
        old = (bench.seq - back) & 0xFFFF
        bench.refused(Ping(1), ErrorCode.SEQUENCE_REUSED, old, seq=old)
    state = bench.status().state
    check(state is OutputState.DISARMED, f"a delayed ARM has led to {state.name}")


@case("HG-4.9/4", "after refusals for flags, length and type the same number is still free")
def refusals_use_up_nothing(bench: Bench) -> None:
    wire, seq = bench.request_wire(Arm())
    reply = _repeat(bench, wire, Arm, seq)
    free = (seq + 1) & 0xFFFF
    bench.refused(Ping(1), ErrorCode.UNSUPPORTED, 0x20, seq=free, flags=0x20)
    bench.refused_raw(Ping.TYPE, bytes(3), ErrorCode.BAD_LENGTH, 8, seq=free)
    bench.refused_raw(0x7C, b"", ErrorCode.UNSUPPORTED, 0x7C, seq=free)
    bench.refused(Ping(1), ErrorCode.STALE_SESSION, seq=free, session=bench.session ^ 0x0F0F)
    check(_repeat(bench, wire, Arm, seq) == reply, "the remembered reply is gone")
    bench.call(Ping(2), Pong, seq=free)
    bench.seq = free


@case("HG-4.10/1", "MUTE is carried out each time; its number in the session counts as used")
def does_mute_again(bench: Bench) -> None:
    bench.arm()
    wire, seq = bench.request_wire(Mute())
    _repeat(bench, wire, Mute, seq)
    bench.refused(Ping(1), ErrorCode.SEQUENCE_REUSED, seq, seq=seq)
    bench.arm()
    _repeat(bench, wire, Mute, seq)
    state = bench.status().state
    check(state is OutputState.MUTED, f"the same MUTE again has led to {state.name}")
    bench.call(Mute(), MuteReply, session=0, seq=bench.seq + 500)
    bench.call(Ping(1), Pong)  # the number of a MUTE of no session is not used up


@case("HG-4.10/1", "UPLOAD_CHUNK is carried out each time", variant="chunk")
def does_chunks_again(bench: Bench) -> None:
    bench.need_any(_UPLOADS)
    kind = UploadKind.PHASES if bench.has(Feature.SEQUENCE_PHASES) else UploadKind.CORRECTION
    target = 1 if kind is UploadKind.PHASES else 0
    data = bytes(bench.identity.transducers)
    bench.begin_upload(kind, target, data)
    wire, seq = bench.request_wire(UploadChunk(0, data[:1]))
    first = _repeat(bench, wire, UploadChunk, seq)
    bench.begin_upload(kind, target, data)
    since = bench.mark()
    bench.send(wire)
    again = bench.reply_in(
        bench.answer_to(UploadChunk.TYPE, seq, since), UploadChunkReply, UploadChunk.TYPE
    )
    check(again.received == 1, f"a chunk of 1 byte again: {again.received} received, {first!r}")


@case("HG-4.11/1", "responses have the number of their request and the open session")
def responses_belong(bench: Bench) -> None:
    requests: tuple[Message, ...] = (Ping(1), GetStatus(), GetConfig(), Arm(), Disarm())
    for message in requests:
        bench.seq += 77
        answer = bench.ask(message)  # waits for its number
        header = answer.header
        assert header is not None  # ask
        check(
            header.session == bench.session,
            f"{type_name(header.type)} has session {header.session:#06x}, "
            f"open is {bench.session:#06x}",
        )
    answer = bench.ask(Ping(1), session=bench.session ^ 0x0F0F)
    session = answer.header.session if answer.header else -1
    check(session == 0, f"ERROR(STALE_SESSION) has session {session:#06x}, must be 0")


@case("HG-4.11/2", "the time in the header is that of the first byte: t_tx of a PONG, in between")
def responses_tell_the_time(bench: Bench) -> None:
    for _ in range(_TRIES):
        first = bench.ask(Ping(1))
        middle = bench.ask(GetStatus())
        last = bench.ask(Ping(2))
        headers = [piece.header for piece in (first, middle, last)]
        times = [header.time_us for header in headers if header is not None]
        for time_us, piece in ((times[0], first), (times[2], last)):
            pong = bench.reply_in(piece, Pong, Ping.TYPE)
            apart_us = abs(signed_difference(time_us, pong.t_tx_us, 32))
            check(apart_us <= _CLOCK_US, f"header time and t_tx differ by {apart_us} us")
        steps = [signed_difference(b, a, 32) for a, b in itertools.pairwise(times)]
        check(
            all(0 <= step < 5_000_000 for step in steps),
            f"times of three responses in a row: {times}",
        )


@case("HG-4.11/3", "of 8 PINGs one is answered within 10 ms")
def answers_promptly(bench: Bench) -> None:
    took_us = min(_round_trip_us(bench, number) for number in range(_TRIES))
    size = 2 * len(encode_frame(bytes(26)))
    check(
        took_us <= _PROMPT_US + bench.wire.line_us(size),
        f"the fastest of {_TRIES} answers took {took_us} us",
    )


def _round_trip_us(bench: Bench, number: int) -> int:
    start_us = bench.wire.now_us()
    bench.call(Ping(number), Pong)
    return bench.wire.now_us() - start_us


@case("HG-4.11/5", "MUTE of no session: MUTE_REPLY comes before STATE_CHANGED")
def answers_before_it_reports(bench: Bench) -> None:
    bench.arm()
    _in_order(bench, Mute(), (MuteReply, StateChanged), session=0)


@case(
    "HG-4.11/5",
    "STOP, MUTE, DISARM, HELLO during playback: reply, STATE_CHANGED, then PLAYBACK_ENDED",
    variant="play",
    needs=Feature.SEQUENCE_PHASES,
)
def answers_before_playback_ends(bench: Bench) -> None:
    store_phases(bench, 1, frames=2)
    hello = bench.hello_message(bench.new_nonce())
    told: tuple[tuple[Message, int, tuple[type[Message], ...]], ...] = (
        (Stop(), bench.session, (StopReply, PlaybackEnded)),
        (Mute(), bench.session, (MuteReply, PlaybackEnded)),
        (Mute(), 0, (MuteReply, StateChanged, PlaybackEnded)),
        (Disarm(), bench.session, (DisarmReply, PlaybackEnded)),
        (hello, 0, (HelloReply, PlaybackEnded)),
    )
    for message, session, order in told:
        bench.arm()
        play_now(bench, 1, loops=0)
        _in_order(bench, message, order, session=session)
    bench.session = hello.nonce


def _in_order(
    bench: Bench, message: Message, due: tuple[type[Message], ...], *, session: int
) -> None:
    """Send a request; of what it is due to lead to, what comes has to come in that order."""
    since = bench.mark()
    bench.ask(message, session=session)
    bench.wire.idle(_EVENTS_US + bench.wire.limits.slack_us)
    came = [type(p.message) for p in bench.wire.received[since:] if isinstance(p.message, due)]
    check(
        came == sorted(came, key=due.index),
        f"{message.TYPE.name} was followed by {', '.join(kind.__name__ for kind in came)}",
    )


@case("HG-4.12/1", "ARM, DISARM, PING of another session: STALE_SESSION, session 0; not done")
def refuses_another_session(bench: Bench) -> None:
    bench.arm()
    requests: tuple[Message, ...] = (Disarm(), Ping(1), GetStatus())
    with bench.counting(stale_session=2 * len(requests)):
        for message in requests:
            for session in (0, bench.session ^ 0x8001):
                answer = bench.ask(message, session=session)
                bench.error_in(answer, message.TYPE, ErrorCode.STALE_SESSION, bench.session)
                assert answer.header is not None  # ask
                check(answer.header.session == 0, "ERROR(STALE_SESSION) is not of session 0")
    check(bench.status().state is OutputState.ARMED, "a DISARM of another session was done")
