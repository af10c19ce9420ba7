"""Chapter 5, queue and latch: which frame comes into force, and when."""

from __future__ import annotations

import zlib
from typing import Final

from haptogram_protocol.messages import DriveKind, DriveReply, Feature, ReadDrive

from ..case import case
from ..client.board_client import Bench
from ..client.latching import full_drive, latch_now, latches, shown_in, watch
from ..judge.witness import Witness
from ..outcome import SELF_REPORTED, check, fail, not_observed

_DEEPEST: Final = 512
_OFFSETS_US: Final = (0, 1, 7, 12, 24, 25, 26, 49, 1000)
_BURST: Final = 48
_READS: Final = 12
_MAX_LATE_US: Final = 100_000  # HG-7.1


@case(
    "HG-5.7/1",
    "frames while DISARMED and MUTED are counted in dropped_state",
    evidence=SELF_REPORTED,
)
def drops_unless_armed(bench: Bench) -> None:
    t_us = bench.soon_us(bytes(2000))
    with bench.counting(dropped_state=2, latched=0):
        bench.send(bench.stream_wire(bench.flat_phases()))
        bench.send(bench.stream_wire(bench.flat_phases(), t_us))
        bench.until(t_us)
    bench.arm()
    bench.ask_raw(0x42)
    with bench.counting(dropped_state=1, latched=0):
        latch_now(bench, bench.flat_phases())


@case(
    "HG-5.7/2",
    "a t_apply equal to, or before, that of the last queued frame: dropped_order",
    evidence=SELF_REPORTED,
)
def keeps_its_order(bench: Bench) -> None:
    bench.arm()
    t_us = bench.soon_us(bytes(4000)) + 20_000
    good = bench.flat_phases()
    with bench.counting(dropped_order=3, latched=2):
        bench.send(bench.stream_wire(good, t_us))
        for early_us in (0, 1, 10_000):
            bench.send(bench.stream_wire(good, t_us - early_us))
        bench.send(bench.stream_wire(good, t_us + 1000))
        bench.in_time(t_us - 10_000)
        bench.until(t_us + 2000)


@case(
    "HG-5.7/3",
    "queue_depth frames are queued and latched, the one more is dropped_full",
    evidence=SELF_REPORTED,
)
def holds_its_depth(bench: Bench) -> None:
    depth = bench.identity.queue_depth
    if depth > _DEEPEST:
        not_observed(f"a queue of {depth} frames is not filled")
    bench.arm()
    good = bench.flat_phases()
    size = len(bench.stream_wire(good, 0, seq=0))
    start_us = bench.soon_us(bytes(size * (depth + 1)))
    with bench.counting(dropped_full=1, latched=depth):
        for number in range(depth + 1):
            bench.send(bench.stream_wire(good, start_us + 1000 * number))
        queued = bench.status().queued
        bench.in_time(start_us)
        check(queued == depth, f"{depth} frames wait, queued is {queued}")
        bench.until(start_us + 1000 * depth)


@case(
    "HG-5.7/4",
    "a frame beyond max_horizon_us is dropped_future, one 1% nearer is queued",
    evidence=SELF_REPORTED,
)
def sees_its_horizon(bench: Bench) -> None:
    bench.arm()
    horizon_us = bench.identity.max_horizon_us
    size = len(bench.stream_wire(bench.flat_phases(), 0, seq=0))
    slack_us = 20_000 + 2 * bench.wire.limits.lead_us + 10 * bench.wire.line_us(size)
    now_us = bench.device_us()
    with bench.counting(dropped_future=3, flushed=1):
        for t_us in (now_us + horizon_us + slack_us, now_us + 2 * horizon_us, now_us + 2**31 - 1):
            bench.send(bench.stream_wire(bench.flat_phases(), t_us))
        bench.send(bench.stream_wire(bench.flat_phases(), now_us + horizon_us - horizon_us // 100))
        bench.barrier()
        bench.disarm()


@case(
    "HG-5.7/5",
    "with late_window_us = 0 frames 1 us to 1 s late are dropped_late, none is latched",
    evidence=SELF_REPORTED,
)
def drops_what_is_late(bench: Bench) -> None:
    bench.arm()
    late = (1, 100, 5_000, 200_000, 1_000_000)
    with bench.counting(dropped_late=len(late), latched=0):
        for late_us in late:
            bench.send(bench.stream_wire(bench.flat_phases(), bench.device_us() - late_us))
        bench.rest()


@case(
    "HG-5.7/5",
    "with a window of 100 ms a frame 0.5 s late is dropped_late",
    variant="window",
    needs=Feature.CONFIG,
    evidence=SELF_REPORTED,
)
def drops_beyond_the_window(bench: Bench) -> None:
    bench.configure(late_window_us=_MAX_LATE_US)
    bench.arm()
    with bench.counting(dropped_late=1, latched=0):
        bench.send(bench.stream_wire(bench.flat_phases(), bench.device_us() - 500_000))
        bench.rest()


@case(
    "HG-5.7/6",
    "with a window of 100 ms a frame 5 ms late is latched, counted in late, LATE in its trace",
    needs=Feature.CONFIG,
    evidence=SELF_REPORTED,
)
def latches_within_the_window(bench: Bench) -> None:
    traced = bench.identity.features & (Feature.TRACE | Feature.TRACE_DRIVE | Feature.TRACE_RING)
    mode = watch(bench) if traced else None
    bench.configure(late_window_us=_MAX_LATE_US, **({"trace_mode": mode} if mode else {}))
    bench.arm()
    since = bench.mark()
    with bench.counting(late=1, latched=2):
        bench.send(bench.stream_wire(bench.flat_phases(), bench.device_us() - 5000))
        bench.rest()
        t_us = bench.soon_us(bytes(600))
        bench.send(bench.stream_wire(bench.flat_phases(), t_us))
        bench.in_time(t_us)
        bench.until(t_us + 1000)
    if mode is not None:
        flags = [latch.late for latch in latches(bench, since, mode)]
        check(flags == [True, False], f"a late frame, then one in time: LATE is {flags}")


@case("HG-5.7/7", "max_horizon_us is less than 2^31")
def horizon_is_less(bench: Bench) -> None:
    horizon_us = bench.identity.max_horizon_us
    check(0 < horizon_us < 2**31, f"max_horizon_us is {horizon_us}")


@case(
    "HG-5.8/1",
    "frames for 0 to 49 us past a carrier period are latched on the next one, none before",
    evidence=SELF_REPORTED,
)
def latches_on_the_carrier(bench: Bench) -> None:
    bench.arm()
    for offset_us in _OFFSETS_US:
        t_us = bench.soon_us(bytes(400)) + offset_us
        before = bench.status().counters.latched
        bench.send(bench.stream_wire(bench.flat_phases(), t_us))
        early = bench.status()
        if bench.unwrap(early.last_latch_us) < t_us and bench.device_estimate_us() < t_us - 500:
            check(early.counters.latched == before, "a frame is latched before its t_apply")
        bench.in_time(t_us)
        bench.until(t_us + 100)
        due_us = bench.on_carrier(t_us)
        got_us = bench.unwrap(bench.status().last_latch_us)
        check(
            got_us == due_us,
            f"t_apply {t_us} us: latched at {got_us} us, due is {due_us} us "
            f"({got_us - due_us:+d} us)",
        )


@case(
    "HG-5.8/1",
    "frames latched as soon as complete lie on multiples of the carrier period",
    variant="immediate",
    evidence=SELF_REPORTED,
)
def immediate_on_the_carrier(bench: Bench) -> None:
    bench.arm()
    for _ in range(12):
        latch_now(bench, bench.flat_phases())
        t_us = bench.unwrap(bench.status().last_latch_us)
        off_us = t_us % bench.carrier_us
        check(off_us == 0, f"latched at {t_us} us, {off_us} us past a carrier period")


@case(
    "HG-5.8/2",
    "two drives that alternate on every carrier period are never mixed in a read-back or a trace",
    needs=Feature.READ_LATCHED,
    evidence=SELF_REPORTED,
)
def latches_all_at_once(bench: Bench) -> None:
    count = bench.identity.transducers
    mode = watch(bench) if bench.has(Feature.CONFIG | Feature.TRACE) else None
    drives = (bytes([0x08]) * count, bytes([0xF0]) * count)
    since = bench.mark()
    bench.arm()
    for _ in range(3):
        _check_burst(bench, drives)
    if mode is not None:
        known = {zlib.crc32(full_drive(drive)) for drive in drives}
        mixed = [latch for latch in latches(bench, since, mode) if latch.crc not in known]
        check(not mixed, f"a traced drive is neither of the two: {mixed[:1]}")


def _check_burst(bench: Bench, drives: tuple[bytes, bytes]) -> None:
    """Read back again and again while every carrier period brings another drive."""
    rate = max(1, bench.identity.max_frame_rate_hz)
    step_us = bench.on_carrier(-(-1_000_000 // rate))
    number = min(_BURST, bench.identity.queue_depth)
    message = [bench.phases(drive) for drive in drives]
    start_us = bench.soon_us(bytes(number * len(bench.stream_wire(message[0], seq=0))))
    bench.send(*(bench.stream_wire(message[n % 2], start_us + n * step_us) for n in range(number)))
    bench.in_time(start_us)
    bench.wire.idle(max(0, start_us - bench.device_estimate_us()))
    since = bench.mark()
    reads = [
        bench.request_wire(ReadDrive(DriveKind.LATCHED, 0, len(drives[0]))) for _ in range(_READS)
    ]
    bench.send(*(wire for wire, _ in reads))
    for _, seq in reads:
        answer = bench.answer_to(ReadDrive.TYPE, seq, since)
        shown = shown_in(bench.reply_in(answer, DriveReply, ReadDrive.TYPE))
        if len(set(shown.phases)) > 1:
            share = shown.phases.count(drives[0][0]), shown.phases.count(drives[1][0])
            fail(f"non-atomic latch: one read-back shows two drives mixed, {share} transducers")
    bench.until(start_us + number * step_us)


@case(
    "HG-5.8/3",
    "of two frames for the same carrier period the later is latched, the other flushed",
    evidence=SELF_REPORTED,
)
def one_latch_a_period(bench: Bench) -> None:
    if bench.carrier_us < 3:
        not_observed("a carrier period of this board has no room for two times")
    bench.arm()
    t_us = bench.soon_us(bytes(1200))
    with bench.counting(latched=2, flushed=1):
        for early_us in (bench.carrier_us - 1, bench.carrier_us - 2):
            bench.send(bench.stream_wire(bench.flat_phases(), t_us - early_us))
        last = bench.stream_next - 1
        bench.in_time(t_us - bench.carrier_us)
        bench.until(t_us + 100)
        got = bench.status().last_seq
        check(got == last, f"frame {last} replaces {last - 1}; latched was {got}")
        latch_now(bench, bench.flat_phases())


@case("HG-5.8/4", "25 latches count 25 in latched, no more", evidence=SELF_REPORTED)
def counts_latches(bench: Bench) -> None:
    bench.arm()
    with bench.counting(latched=25):
        for _ in range(25):
            latch_now(bench, bench.flat_phases())


@case(
    "HG-5.8/5",
    "each of 8 drives is in the registers from its time to that of the next",
    evidence=SELF_REPORTED,
)
def holds_the_last_drive(bench: Bench) -> None:
    witness = Witness.of(bench)
    bench.arm()
    before = bench.random_registers()
    latch_now(bench, bench.phases(before))
    for _ in range(8):
        registers = bench.random_registers()
        t_us = bench.soon_us(bytes(1000)) + 10_000 + bench.wire.limits.lead_us
        since = bench.mark()
        bench.send(bench.stream_wire(bench.phases(registers), t_us))
        if witness.mode is None:
            witness.expect(before, bits=bench.finest)
            bench.in_time(t_us)
        bench.until(t_us + 100)
        witness.expect(registers, bits=bench.finest, since=since)
        before = registers
    bench.wire.idle(200_000)
    if witness.mode is None:
        witness.expect(before, bits=bench.finest)


@case(
    "HG-5.9/1",
    "IMMEDIATE flushes 3 queued frames and is latched at once",
    evidence=SELF_REPORTED,
)
def immediate_flushes(bench: Bench) -> None:
    bench.arm()
    t_us = bench.soon_us(bytes(2000)) + 50_000
    with bench.counting(flushed=3, latched=1):
        for number in range(3):
            bench.send(bench.stream_wire(bench.flat_phases(), t_us + number * 1000))
        index = latch_now(bench, bench.flat_phases())
        bench.in_time(t_us)
        got = bench.status()
        check(
            (got.last_seq, got.queued) == (index, 0),
            f"frame {index} as soon as complete: last_seq {got.last_seq}, queued {got.queued}",
        )
        bench.until(t_us + 5000)
