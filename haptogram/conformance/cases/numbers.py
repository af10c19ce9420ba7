"""Chapter 3, numbers that wrap."""

from __future__ import annotations

import itertools
from typing import Final

from haptogram_protocol.messages import FIRST_STREAM_SEQ, Feature, Ping, Pong, Status

from ..case import case
from ..client.board_client import Bench
from ..client.dialogue import talk
from ..client.latching import latch_now
from ..client.recording import describe
from ..outcome import SELF_REPORTED, check

_ACROSS: Final = 40  # frames from 0xFFF0 on: the wrap is the 17th
_WRAP_US: Final = 2**32
_JUMPS: Final = (2, 255, 256, 300, 20_000, 30_000, 32_000, 0x7FFF)


@case(
    "HG-3.6/1",
    "40 stream frames across 0xFFFF are latched: no gap, no duplicate",
    evidence=SELF_REPORTED,
)
def stream_numbers_wrap(bench: Bench) -> None:
    bench.arm()
    with bench.counting(latched=_ACROSS):
        for _ in range(_ACROSS):
            latch_now(bench, bench.flat_phases())


@case("HG-3.6/1", "requests across 0xFFFF are answered; old ones are refused", variant="requests")
def request_numbers_wrap(bench: Bench) -> None:
    bench.seq = 0xFFFC
    bench.hello()
    for _ in range(8):
        bench.call(Ping(bench.seq), Pong)


@case(
    "HG-3.6/1",
    "frames for times on both sides of 2^32 us are latched, each at its time",
    variant="time",
    needs_reset=True,
    evidence=SELF_REPORTED,
)
def times_wrap(bench: Bench) -> None:
    bench.settle()
    bench.configure(hold_ms=10_000)
    lead_us = bench.wire.limits.lead_us
    bench.until(_WRAP_US - 4 * lead_us - 200_000)
    bench.arm()
    start_us = bench.on_carrier(_WRAP_US - 20_000)
    times = [start_us + 10_000 * number for number in range(6)]
    with bench.counting(latched=len(times)):
        bench.send(*(bench.stream_wire(bench.flat_phases(), t_us) for t_us in times))
        bench.in_time(times[0])
        bench.until(times[-1] + 1000)
        last_us = bench.status().last_latch_us
    check(
        last_us == times[-1] & 0xFFFFFFFF,
        f"the last frame was for {times[-1]} us (mod 2^32: {times[-1] & 0xFFFFFFFF}); "
        f"last_latch_us is {last_us}",
    )


@case("HG-3.6/2", "events count up by 1; requests in between make no gap in the stream")
def three_sequences(bench: Bench) -> None:
    pieces = [piece for piece in talk(bench) if piece.is_event]
    for before, after in itertools.pairwise(pieces):
        assert before.header is not None  # is_event
        assert after.header is not None
        step = (after.header.seq - before.header.seq) & 0xFFFF
        check(step == 1, f"an event {step} after the one before: {describe(after.piece)}")
    bench.hello()
    with bench.counting(dropped_state=8):
        for number in range(8):
            bench.send(bench.stream_wire(bench.flat_phases()))
            bench.call(Ping(number), Pong)


@case(
    "HG-3.6/3",
    "a first stream frame 0xFFF0 is no gap, 0xFFF3 is a gap of 3",
    evidence=SELF_REPORTED,
)
def first_stream_number(bench: Bench) -> None:
    with bench.counting(dropped_state=1):
        bench.send(bench.stream_wire(bench.flat_phases()))
    bench.hello()
    with bench.counting(dropped_state=1, gap=3):
        bench.send(bench.stream_wire(bench.flat_phases(), seq=FIRST_STREAM_SEQ + 3))


@case("HG-3.6/4", "the first event of each of 3 sessions has the number 0", needs=Feature.CONFIG)
def first_event_number(bench: Bench) -> None:
    period_ms = bench.quick_status_ms
    bench.configure(status_period_ms=period_ms)
    for _ in range(3):
        bench.hello()
        since = bench.mark()
        event = bench.await_event(Status, since, 2000 * period_ms + 2 * bench.wire.limits.slack_us)
        check(event is not None, "no STATUS came within two periods of a session")
        first = next(piece for piece in bench.wire.received[since:] if piece.is_event)
        header = first.header
        assert header is not None  # is_event
        check(header.seq == 0, f"first event of the session: {describe(first.piece)}")


@case(
    "HG-3.6/5",
    "after gaps of up to 2^15 - 1 and several wraps STATUS reports the unwrapped number",
    evidence=SELF_REPORTED,
)
def unwrapped_numbers(bench: Bench) -> None:
    bench.arm()
    check(bench.status().last_seq == 0, "last_seq is not 0 before the first latch")
    index = latch_now(bench, bench.flat_phases())
    for jump in _JUMPS:
        got = bench.status().last_seq
        check(got == index, f"unwrapped number {index}: last_seq is {got}")
        bench.stream_next += jump - 1
        with bench.counting(gap=jump - 1, latched=1):
            index = latch_now(bench, bench.flat_phases())
    got = bench.status().last_seq
    check(got == index, f"unwrapped number {index}: last_seq is {got}")
