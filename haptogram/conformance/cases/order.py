"""Chapter 3, the order of checks and the counting of what is dropped."""

from __future__ import annotations

from typing import Final

from haptogram_protocol.messages import (
    ErrorCode,
    Feature,
    Flag,
    Hello,
    HelloReply,
    Mute,
    MuteReply,
    Phases,
    Ping,
    Pong,
    UploadCommit,
)

from ..case import case
from ..client import malformed_frames as crafting
from ..client.board_client import Bench
from ..outcome import SELF_REPORTED, check, not_observed

_STALE: Final = 0x0F0F
_UNKNOWN_REQUEST: Final = 0x7D
_UNKNOWN_STREAM: Final = 0x3D
_DEEPEST: Final = 512  # a queue deeper than this is not filled: it would take seconds
_STEP_US: Final = 1000


@case("HG-3.8/1", "requests with two defects are refused for the one that is checked first")
def requests_in_order(bench: Bench) -> None:
    stale = bench.session ^ _STALE
    used = bench.seq
    refused = bench.refused_raw
    refused(_UNKNOWN_REQUEST, b"", ErrorCode.UNSUPPORTED, _UNKNOWN_REQUEST, session=stale)
    refused(Ping.TYPE, bytes(8), ErrorCode.STALE_SESSION, bench.session, session=stale, flags=0x40)
    refused(Ping.TYPE, bytes(3), ErrorCode.STALE_SESSION, bench.session, session=stale)
    refused(Ping.TYPE, bytes(3), ErrorCode.UNSUPPORTED, 0x40, flags=0x40)
    refused(Ping.TYPE, bytes(3), ErrorCode.BAD_LENGTH, 8, seq=used)
    refused(Ping.TYPE, bytes(8), ErrorCode.UNSUPPORTED, 0x80, seq=used, flags=0x80)
    if bench.identity.features & (Feature.SEQUENCE_PHASES | Feature.CORRECTION):
        commit = UploadCommit(1).serialize()  # without an upload: BAD_STATE, were it new
        refused(UploadCommit.TYPE, commit, ErrorCode.SEQUENCE_REUSED, used & 0xFFFF, seq=used)


@case(
    "HG-3.8/1",
    "stream frames with two defects are counted for the one that is checked first",
    variant="stream",
    evidence=SELF_REPORTED,
)
def stream_in_order(bench: Bench) -> None:
    stale, good = bench.session ^ _STALE, bench.flat_phases()
    payload = good.serialize()
    bank = bytes([payload[0], 1]) + payload[2:]
    first = bench.stream_wire(good)
    used = bench.stream_next - 1
    tests: list[tuple[str, bytes]] = [
        ("dropped_state", first),
        ("unknown_type", bench.stream_raw(_UNKNOWN_STREAM, b"", session=stale)),
        ("stale_session", bench.stream_wire(good, seq=used, session=stale, flags=0x40)),
        ("stale_session", bench.stream_raw(Phases.TYPE, b"", seq=used, session=stale)),
        ("duplicate", bench.stream_wire(good, seq=used, flags=0x40)),
        ("duplicate", bench.stream_raw(Phases.TYPE, b"", seq=used)),
    ]
    bench.stream_next = used + 1  # the unknown frame was of another session
    tests += [
        ("unsupported", bench.stream_raw(Phases.TYPE, b"", flags=0x40)),
        ("bad_length", bench.stream_raw(Phases.TYPE, payload + b"\x00")),
        ("bad_value", bench.stream_raw(Phases.TYPE, bank)),
        ("dropped_state", bench.stream_wire(good, 0)),
    ]
    for counter, wire in tests:
        with bench.counting(**{counter: 1}):
            bench.send(wire)


@case(
    "HG-3.8/1",
    "at a queue that is full: order before room, room before horizon, order before lateness",
    variant="queue",
    evidence=SELF_REPORTED,
)
def queue_in_order(bench: Bench) -> None:
    depth = bench.identity.queue_depth
    if depth > _DEEPEST:
        not_observed(f"a queue of {depth} frames is not filled")
    good = bench.flat_phases()
    size = len(bench.stream_wire(good))
    bench.hello()
    bench.arm()
    start_us = bench.soon_us(bytes(size * (depth + 4)))
    times = [start_us + number * _STEP_US for number in range(depth)]
    check(times[-1] + _STEP_US < start_us + bench.identity.max_horizon_us, "the queue is too long")
    with bench.counting(dropped_order=2, dropped_full=2, flushed=depth):
        bench.send(*(bench.stream_wire(good, t_us) for t_us in times))
        beyond_us = times[-1] + 2 * bench.identity.max_horizon_us
        for t_us in (times[-1], times[0] - 10 * 1_000_000, times[-1] + _STEP_US, beyond_us):
            bench.send(bench.stream_wire(good, t_us))
        bench.in_time(times[0])
        bench.call(Mute(), MuteReply)


@case("HG-3.8/2", "a PING of the new session right behind its HELLO is answered, after it")
def takes_frames_as_they_come(bench: Bench) -> None:
    nonce = bench.new_nonce()
    hello, first = bench.request_wire(bench.hello_message(nonce), session=0)
    ping, second = bench.request_wire(Ping(5), session=nonce)
    since = bench.mark()
    bench.send(hello, ping)
    bench.adopt(bench.reply_in(bench.answer_to(Hello.TYPE, first, since), HelloReply, Hello.TYPE))
    bench.reply_in(bench.answer_to(Ping.TYPE, second, since), Pong, Ping.TYPE)
    numbers = [p.header.seq for p in bench.responses(since) if p.header is not None]
    check(numbers == [first, second], f"sent were {first}, {second}; answered {numbers}")


@case("HG-3.8/3", "MUTE with any session, flags, payload and number is carried out")
def mute_passes(bench: Bench) -> None:
    for header in (
        {"session": 0},
        {"session": bench.session ^ _STALE},
        {"flags": 0xFF},
        {"seq": 1},
        {"seq": bench.seq},
    ):
        bench.arm()
        answer = bench.ask_raw(Mute.TYPE, bytes(range(17)), **header)
        state = bench.reply_in(answer, MuteReply, Mute.TYPE).state
        check(state.name == "MUTED", f"MUTE with {header}: {state.name}")


@case(
    "HG-3.9/1",
    "one frame of every defect: each counter goes up by 1, all together by their number",
    evidence=SELF_REPORTED,
)
def counts_once(bench: Bench) -> None:
    good, old = bench.flat_phases(), bench.session ^ _STALE
    payload = good.serialize()
    used = bench.stream_next
    ping = bench.body(Ping.TYPE, bytes(8), seq=bench.next_seq())
    wires = [
        bench.stream_wire(good),
        bench.stream_wire(good, seq=used),
        bench.stream_wire(good, seq=used, session=old),
        bench.stream_raw(_UNKNOWN_STREAM, b""),
        bench.stream_wire(good, flags=0x40),
        bench.stream_raw(Phases.TYPE, payload + b"\x00"),
        bench.stream_raw(Phases.TYPE, bytes([payload[0], 1]) + payload[2:]),
        crafting.framed(crafting.with_wrong_crc(ping)),
        crafting.framed(b"\x40\x01\x02"),
        b"\x00\xff\x01\x02\x00",
        b"\x00" + crafting.noise(bench.random, 4200) + b"\x00",
    ]
    names = (
        "dropped_state duplicate stale_session unknown_type unsupported bad_length bad_value "
        "crc short cobs oversize"
    )
    with bench.counting(frames=7, requests=0, **dict.fromkeys(names.split(), 1)):
        bench.send(*wires)
        bench.wire.idle(bench.wire.line_us(sum(map(len, wires))))


_DROPS: Final = (
    "repeated",
    "duplicate",
    "stale_session",
    "bad_length",
    "bad_value",
    "unknown_type",
    "unsupported",
    "dropped_state",
    "dropped_order",
    "dropped_full",
    "dropped_future",
    "dropped_late",
)


@case(
    "HG-3.9/2",
    "frames = queued + requests + repeated + every drop, over 60 frames of all sorts",
    evidence=SELF_REPORTED,
)
def the_sum_holds(bench: Bench) -> None:
    bench.arm()
    before = bench.status().counters
    good, queued, sent = bench.flat_phases(), 0, 0
    for number in range(15):
        bench.send(bench.stream_wire(good))
        queued += 1
        bench.send(bench.stream_wire(good, seq=bench.stream_next - 1))
        bench.call(Ping(number), Pong)
        bench.send(bench.stream_wire(good, flags=Flag.IMMEDIATE | 0x40))
        sent += 4
    counted = bench.counted_since(before)
    check(counted["frames"] == sent, f"{sent} frames were sent, frames counts {counted['frames']}")
    total = queued + counted["requests"] + sum(counted[name] for name in _DROPS)
    check(total == sent, f"{sent} frames were sent, the parts of the sum are {total}: {counted}")
