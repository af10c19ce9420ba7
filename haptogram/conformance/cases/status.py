"""Chapter 9: status, counters, margins and what gives way on the uplink."""

from __future__ import annotations

import itertools
from typing import Final

from haptogram_protocol.framing import encode_frame
from haptogram_protocol.messages import (
    Counters,
    Feature,
    GetGeometry,
    Ping,
    Pong,
    Status,
    StatusReply,
)

from ..case import case
from ..client.board_client import Bench
from ..client.latching import latch_now
from ..outcome import SELF_REPORTED, check

_MS: Final = 1000
_ASKED: Final = 40


@case("HG-9.1/1", "in 8.4 periods of status_period_ms eight STATUS come, with a period of 0 none")
def sends_status(bench: Bench) -> None:
    bench.need(Feature.CONFIG)
    period_ms = bench.quick_status_ms
    bench.configure(status_period_ms=period_ms)
    since = bench.mark()
    bench.wire.idle(int(8.4 * period_ms * _MS) + bench.wire.limits.slack_us)
    bench.barrier()
    times = [bench.unwrap(header.time_us) for header, _ in bench.events(Status, since)]
    check(len(times) >= 8, f"{len(times)} STATUS in 8.4 periods, due are 8")
    off = [b - a for a, b in itertools.pairwise(times) if abs(b - a - period_ms * _MS) > _MS]
    check(not off, f"between two STATUS: {off} us")
    bench.configure(status_period_ms=0)
    since = bench.mark()
    bench.wire.idle(200 * _MS)
    check(not bench.events(Status, since), "STATUS comes although status_period_ms is 0")


@case(
    "HG-9.1/2",
    "last_seq and last_latch_us are 0 until a latch, and again in a new session",
    evidence=SELF_REPORTED,
)
def begins_with_nothing(bench: Bench) -> None:
    bench.arm()
    for _ in range(2):
        found = bench.status()
        got = (found.last_seq, found.last_latch_us)
        check(got == (0, 0), f"before the first latch (last_seq, last_latch_us) is {got}")
        index = latch_now(bench, bench.flat_phases())
        found = bench.status()
        check(found.last_seq == index, f"last_seq is {found.last_seq}, due is {index}")
        check(found.last_latch_us != 0, "last_latch_us is 0 after a latch")
        bench.hello()
        bench.arm()


@case(
    "HG-9.2/1",
    "after a reset all counters are 0; a session, MUTE and DISARM clear none",
    needs_reset=True,
    evidence=SELF_REPORTED,
)
def counts_from_0(bench: Bench) -> None:
    bench.hello()
    first = bench.status().counters
    due = {"frames": 2, "requests": 2}
    wrong = {n: v for n, v in _values(first).items() if v != due.get(n, 0)}
    check(not wrong, f"after a reset, HELLO and GET_STATUS: {wrong}")
    _check_nothing_clears(bench)


@case(
    "HG-9.2/1",
    "a session, MUTE, DISARM and ARM clear no counter",
    variant="kept",
    evidence=SELF_REPORTED,
)
def keeps_its_counters(bench: Bench) -> None:
    _check_nothing_clears(bench)


def _check_nothing_clears(bench: Bench) -> None:
    bench.arm()
    latch_now(bench, bench.flat_phases())
    bench.send(bench.stream_wire(bench.flat_phases(), seq=bench.stream_next - 1))
    bench.send(b"\x00\xff\x01\x00\x00\x03\x01\x02\x00", encode_frame(bytes(10))[:-5], b"\x00")
    before = _values(bench.status().counters)
    bench.ask_raw(0x42)
    bench.arm()
    bench.disarm()
    bench.hello()
    after = _values(bench.status().counters)
    less = {name: (before[name], after[name]) for name in before if after[name] < before[name]}
    check(not less, f"counters that went back: {less}")


def _values(counters: Counters) -> dict[str, int]:
    return {name: getattr(counters, name) for name in Counters.WIRE}


@case(
    "HG-9.3/1",
    "margins of 3 frames in time and one too late, by number, least and mean; then anew",
    evidence=SELF_REPORTED,
)
def tells_margins(bench: Bench) -> None:
    bench.arm()
    bench.status()
    empty = bench.status()
    _check_margins(empty, 0, 0, 0, 0)
    good = bench.flat_phases()
    base_us = bench.device_us()
    ahead = (200_000, 300_000, 400_000)
    size = len(bench.stream_wire(good, 0, seq=0))
    bench.send(*(bench.stream_wire(good, base_us + margin) for margin in ahead))
    bench.send(bench.stream_wire(good, base_us - 1_000_000))  # not after the last: dropped, counted
    bench.send(bench.stream_wire(good))  # IMMEDIATE: no margin; flushes
    sent_us = bench.wire.line_us(size * 5)
    found = bench.status()
    late_us = bench.device_us() - base_us
    mean_us = (sum(ahead) - 1_000_000) // 4
    _check_margins(found, 4, -1_000_000, mean_us, late_us + sent_us)
    _check_margins(bench.status(), 0, 0, 0, 0)


def _check_margins(
    status: StatusReply, number: int, least_us: int, mean_us: int, slack_us: int
) -> None:
    check(status.margins == number, f"margins of {status.margins} frames, due are {number}")
    for name, got, due in (
        ("margin_min_us", status.margin_min_us, least_us),
        ("margin_mean_us", status.margin_mean_us, mean_us),
    ):
        check(
            due - slack_us - 1 <= got <= due + 1,
            f"{name} is {got}, due is {due} less at most {slack_us}",
        )


@case("HG-9.5/1", "events count up without a gap, even where traces were dropped at the board")
def drops_no_numbers(bench: Bench) -> None:
    from .evidence import flood_with_traces

    bench.need(Feature.TRACE_DRIVE | Feature.SEQUENCE_PHASES | Feature.CONFIG)
    since = bench.mark()
    flood_with_traces(bench)
    numbers = [
        piece.header.seq
        for piece in bench.wire.received[since:]
        if piece.is_event and piece.header is not None
    ]
    gaps = [(b - a) & 0xFFFF for a, b in itertools.pairwise(numbers) if (b - a) & 0xFFFF != 1]
    check(not gaps, f"between events that follow each other: steps of {gaps[:5]}")


@case(
    "HG-9.6/1",
    "40 GET_GEOMETRY without a pause: whole frames come, then the board answers as before",
)
def bounds_its_output(bench: Bench) -> None:
    wires = [bench.request_wire(GetGeometry(0, 0xFFFF))[0] for _ in range(_ASKED)]
    since = bench.mark()
    bench.send(*wires)
    bench.wire.idle(bench.wire.line_us(_ASKED * 4200))
    broken = [piece for piece in bench.wire.received[since:] if piece.fault]
    check(not broken, f"a frame came in pieces: {broken[0].fault if broken else ''}")
    bench.call(Ping(3), Pong)
    check(bench.status().free_bytes > 0, "free_bytes is 0 although nothing waits")
