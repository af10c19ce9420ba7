"""Chapter 8: trace and read-back, the board's own word, have to agree with what was sent."""

from __future__ import annotations

import zlib
from typing import Final

from haptogram_protocol.messages import (
    DriveKind,
    DriveReply,
    ErrorCode,
    Feature,
    LatchKey,
    PlaybackEnded,
    ReadDrive,
    ReadTrace,
    Trace,
    TraceDrive,
    TraceMode,
    TracePlayback,
    TraceReply,
)

from ..case import case
from ..client.board_client import Bench
from ..client.latching import full_drive, latch_now, latches, read_back, shown_in, watch
from ..client.playback import play_now, store_phases
from ..judge.witness import expect_shown
from ..outcome import SELF_REPORTED, check, not_observed

_ANY_READ: Final = Feature.READ_LATCHED | Feature.READ_RADIATED
_RING_TRIED: Final = 6000  # latches: a longer ring is not filled
_KINDS: Final = (Trace, TracePlayback, TraceDrive)


def _events(bench: Bench, since: int) -> int:
    bench.barrier()
    return sum(len(bench.events(kind, since)) for kind in _KINDS)


@case(
    "HG-8.1/1",
    "of 6 latches OFF and RING tell nothing by itself, CRC and DRIVE tell 6",
    needs=Feature.CONFIG,
    evidence=SELF_REPORTED,
)
def reports_as_told(bench: Bench) -> None:
    modes = {
        TraceMode.OFF: (Feature(0), 0),
        TraceMode.CRC: (Feature.TRACE, 6),
        TraceMode.DRIVE: (Feature.TRACE_DRIVE, 6),
        TraceMode.RING: (Feature.TRACE_RING, 0),
    }
    for mode, (feature, due) in modes.items():
        if not bench.has(feature):
            continue
        bench.configure(trace_mode=mode)
        bench.arm()
        since = bench.mark()
        for _ in range(6):
            latch_now(bench, bench.flat_phases())
        got = _events(bench, since)
        check(got == due, f"trace_mode {mode.name}: {got} events of 6 latches, due are {due}")


@case(
    "HG-8.2/1",
    "40 stream latches across 0xFFFF and two passes of a sequence have keys of their own",
    needs=Feature.CONFIG,
    evidence=SELF_REPORTED,
)
def keys_are_unique(bench: Bench) -> None:
    mode = watch(bench)
    bench.arm()
    since, first = bench.mark(), bench.stream_next
    for _ in range(40):
        latch_now(bench, bench.flat_phases())
    due = [(0, 0, first + number) for number in range(40)]
    if bench.has(Feature.SEQUENCE_PHASES):
        store_phases(bench, 12, frames=3)
        play_now(bench, 12, loops=2)
        bench.await_event(PlaybackEnded, since, 100_000)
        due += [(12, loop, index) for loop in range(2) for index in range(3)]
    got = [(latch.sequence, latch.loop, latch.index) for latch in latches(bench, since, mode)]
    check(len(set(got)) == len(got), f"{len(got)} latches have {len(set(got))} keys")
    wrong = [pair for pair in zip(got, due, strict=False) if pair[0] != pair[1]]
    check(got == due, f"keys seen and due: {wrong[:2]}, {len(got)} of {len(due)}")


@case(
    "HG-8.3/1",
    "the time in a trace is the carrier period at or after t_apply, as in STATUS",
    needs=Feature.TRACE | Feature.CONFIG,
    evidence=SELF_REPORTED,
)
def traces_tell_the_time(bench: Bench) -> None:
    bench.configure(trace_mode=TraceMode.CRC)
    bench.arm()
    for offset_us in (0, 3, 990):
        since = bench.mark()
        t_us = bench.soon_us(bytes(400)) + offset_us
        bench.send(bench.stream_wire(bench.flat_phases(), t_us))
        bench.in_time(t_us)
        bench.until(t_us + 100)
        seen = latches(bench, since, TraceMode.CRC)
        check(len(seen) == 1, f"one latch gives {len(seen)} TRACE")
        latch = seen[0]
        due_us = bench.on_carrier(t_us)
        check(latch.t_us == due_us, f"traced at {latch.t_us} us, due is {due_us} us")
        status_us = bench.unwrap(bench.status().last_latch_us)
        check(latch.t_us == status_us, f"TRACE says {latch.t_us} us, STATUS {status_us} us")


@case(
    "HG-8.3/2",
    "the CRC in TRACE is that of N phases and N amplitudes 255, of 8 random drives and a sequence",
    needs=Feature.TRACE | Feature.CONFIG,
    evidence=SELF_REPORTED,
)
def traces_hash_the_drive(bench: Bench) -> None:
    bench.configure(trace_mode=TraceMode.CRC, amplitude_ceiling=99)
    bench.arm()
    since = bench.mark()
    drives = [bench.random_registers() for _ in range(8)]
    for registers in drives:
        latch_now(bench, bench.phases(registers))
    if bench.has(Feature.SEQUENCE_PHASES):
        drives += store_phases(bench, 3, frames=3)
        play_now(bench, 3, loops=1)
        bench.await_event(PlaybackEnded, since, 100_000)
    got = [latch.crc for latch in latches(bench, since, TraceMode.CRC)]
    due = [zlib.crc32(full_drive(registers)) for registers in drives]
    wrong = sum(a != b for a, b in zip(got, due, strict=False))
    check(len(got) == len(due), f"{len(got)} of {len(due)} latches are traced")
    check(wrong == 0, f"{wrong} of {len(due)} traced CRCs are not those of the drives sent")


@case(
    "HG-8.4/1",
    "with trace_divider 3 latches 0, 3, 6 and 9 are told in full, anew after HELLO, no others",
    needs=Feature.TRACE_DRIVE | Feature.CONFIG,
    evidence=SELF_REPORTED,
)
def traces_every_third(bench: Bench) -> None:
    bench.configure(trace_mode=TraceMode.DRIVE, trace_divider=3)
    for anew in range(2):
        if anew:
            bench.hello()
        bench.arm()
        since, first = bench.mark(), bench.stream_next
        drives = [bench.random_registers() for _ in range(10)]
        for registers in drives:
            latch_now(bench, bench.phases(registers))
        bench.barrier()
        found = bench.events(TraceDrive, since)
        got = [event.key.index - first for _, event in found]
        check(got == [0, 3, 6, 9], f"of latches 0 to 9 these are told: {got}")
        check(_events(bench, since) == 4, "latches are told in another way as well")
        for number, (_, event) in zip(got, found, strict=True):
            same = event.data == full_drive(drives[number])
            check(same, f"TRACE_DRIVE of latch {number} shows another drive than was sent")


@case(
    "HG-8.5/1",
    "the ring keeps the last trace_ring latches, numbered from 0, and forgets the oldest",
    needs=Feature.TRACE_RING | Feature.CONFIG,
    evidence=SELF_REPORTED,
)
def ring_keeps_the_last(bench: Bench) -> None:
    size = bench.identity.trace_ring
    check(size > 0, "TRACE_RING is advertised, trace_ring is 0")
    bench.configure(trace_mode=TraceMode.RING)
    bench.arm()
    total = _fill(bench, size)
    reply = bench.call(ReadTrace(0, 0xFFFF), TraceReply)
    due = (max(0, total - size), total)
    got = (reply.oldest, reply.next)
    check(got == due, f"{total} latches, room for {size}: oldest and next are {got}, due {due}")


def _fill(bench: Bench, size: int) -> int:
    """Latch a few more drives than the ring holds, if that can be done; return how many."""
    if not bench.has(Feature.SEQUENCE_PHASES) or size > _RING_TRIED:
        for _ in range(20):
            latch_now(bench, bench.flat_phases())
        return 20
    loops = size // 2 + 3
    store_phases(bench, 2, frames=2)
    period_us = max(100, -(-1_000_000 // bench.identity.max_playback_rate_hz))
    since = bench.mark()
    play_now(bench, 2, loops=loops, period_us=period_us, unattended_ms=10_000)
    lasts_us = 2 * loops * period_us
    found = bench.await_event(PlaybackEnded, since, 2 * lasts_us + 100_000)
    check(found is not None, "the playback that fills the ring does not end")
    return 2 * loops


@case(
    "HG-8.5/2",
    "READ_TRACE of some, of none and of all: numbers, keys and CRCs, oldest first",
    needs=Feature.TRACE_RING | Feature.CONFIG,
    evidence=SELF_REPORTED,
)
def ring_is_read(bench: Bench) -> None:
    bench.configure(trace_mode=TraceMode.RING)
    bench.arm()
    first = bench.stream_next
    drives = [bench.random_registers() for _ in range(9)]
    for registers in drives:
        latch_now(bench, bench.phases(registers))
    for start, count in ((0, 9), (2, 3), (8, 100), (9, 5), (0, 0), (4, 1)):
        reply = bench.call(ReadTrace(start, count), TraceReply)
        numbers = [item.number for item in reply.records]
        due = list(range(9))[start : start + count]
        check(numbers == due, f"{count} from {start}: {numbers}")
        for item in reply.records:
            key = LatchKey(0, 0, first + item.number)
            check(item.key == key, f"latch {item.number} has the key {item.key}, due is {key}")
            crc = zlib.crc32(full_drive(drives[item.number]))
            check(item.crc == crc, f"latch {item.number} has the CRC of another drive")


@case(
    "HG-8.6/1",
    "READ_DRIVE of 1, of some and of too many transducers shows those from first on",
    evidence=SELF_REPORTED,
)
def reads_some(bench: Bench) -> None:
    bench.need_any(_ANY_READ)
    kind = DriveKind.LATCHED if bench.has(Feature.READ_LATCHED) else DriveKind.RADIATED
    count = bench.identity.transducers
    registers = bench.random_registers()
    bench.arm()
    latch_now(bench, bench.phases(registers))
    for first in {0, 1, count // 2, count - 1} & set(range(count)):
        for asked in (0, 1, 7, 0xFFFF):
            reply = bench.call(ReadDrive(kind, first, asked), DriveReply)
            shown = shown_in(reply)
            due = registers[first : first + asked]
            check(reply.first == first, f"asked from {first}, shown from {reply.first}")
            check(shown.phases == due, f"{asked} from {first}: other codes than were sent")
            check(shown.amplitudes == b"\xff" * len(due), f"{asked} from {first}: not full")


@case("HG-8.6/2", "READ_DRIVE from N on is refused with NOT_FOUND, detail N")
def reads_no_more(bench: Bench) -> None:
    bench.need_any(_ANY_READ)
    count = bench.identity.transducers
    for kind, feature in (
        (DriveKind.LATCHED, Feature.READ_LATCHED),
        (DriveKind.RADIATED, Feature.READ_RADIATED),
    ):
        if bench.has(feature):
            for first in (count, 0xFFFF):
                bench.refused(ReadDrive(kind, first, 1), ErrorCode.NOT_FOUND, count)


@case(
    "HG-8.6/3",
    "codes, key and time of a read-back are those of one latch, as trace and STATUS have them",
    needs=Feature.READ_LATCHED,
    evidence=SELF_REPORTED,
)
def reads_one_latch(bench: Bench) -> None:
    mode = watch(bench) if bench.has(Feature.CONFIG | Feature.TRACE) else None
    bench.arm()
    for _ in range(8):
        registers, index = bench.random_registers(), bench.stream_next
        since = bench.mark()
        latch_now(bench, bench.phases(registers))
        shown = read_back(bench)
        expect_shown(bench, shown, registers, b"\xff" * len(registers), bits=bench.finest)
        check(shown.reply.key == LatchKey(0, 0, index), f"key {shown.reply.key}, due is {index}")
        status = bench.status()
        got, due = shown.reply.t_latch_us, status.last_latch_us
        check(got == due, f"the read-back was latched at {got} us, says STATUS {due} us")
        if mode is not None:
            seen = latches(bench, since, mode)
            check(bool(seen) and seen[-1].crc == shown.crc, "trace and read-back disagree")


@case(
    "HG-8.6/4",
    "before the first latch of a session codes, key and time are 0",
    needs=Feature.READ_LATCHED,
    evidence=SELF_REPORTED,
)
def reads_nothing_at_first(bench: Bench) -> None:
    bench.arm()
    latch_now(bench, bench.phases(bench.random_registers()))
    bench.hello()
    shown = read_back(bench)
    check(not any(shown.reply.data), "codes of the session before are shown")
    key, t_us = shown.reply.key, shown.reply.t_latch_us
    check((key, t_us) == (LatchKey(0, 0, 0), 0), f"key {key}, time {t_us}")


def flood_with_traces(bench: Bench) -> tuple[int, int]:
    """Latch faster than the line can tell in full; return events seen and the latches."""
    bench.configure(trace_mode=TraceMode.DRIVE)
    store_phases(bench, 1, frames=2)
    rate = min(bench.identity.max_playback_rate_hz, 10_000)
    period_us = bench.on_carrier(-(-1_000_000 // rate))
    bench.arm()
    since = bench.mark()
    frames = 400
    play_now(bench, 1, loops=frames // 2, period_us=period_us)
    found = bench.await_event(PlaybackEnded, since, frames * period_us * 20 + 500_000)
    check(found is not None, "PLAYBACK_ENDED is lost among the traces")
    bench.barrier()
    return len(bench.events(TraceDrive, since)), frames


@case(
    "HG-8.7/1",
    "while traces fill the line 400 latches at the highest rate are all made, each in its time",
    needs=Feature.TRACE_DRIVE | Feature.SEQUENCE_PHASES | Feature.CONFIG,
    evidence=SELF_REPORTED,
)
def traces_delay_nothing(bench: Bench) -> None:
    before = bench.status().counters
    _, frames = flood_with_traces(bench)
    counted = bench.counted_since(before)
    check(counted["latched"] == frames, f"{counted['latched']} of {frames} frames were latched")
    times = [bench.unwrap(header.time_us) for header, _ in bench.events(TraceDrive)]
    start = times[0] if times else 0
    off = [t_us for t_us in times if (t_us - start) % bench.carrier_us]
    check(not off, "a trace that waits for the line tells another time than that of its latch")


@case(
    "HG-8.7/2",
    "traces that find no room are counted in trace_dropped; PONG and PLAYBACK_ENDED get through",
    needs=Feature.TRACE_DRIVE | Feature.SEQUENCE_PHASES | Feature.CONFIG,
    evidence=SELF_REPORTED,
)
def traces_give_way(bench: Bench) -> None:
    before = bench.status().counters
    seen, frames = flood_with_traces(bench)
    dropped = bench.counted_since(before)["trace_dropped"]
    check(
        seen + dropped == frames,
        f"{frames} latches: {seen} TRACE_DRIVE came, {dropped} are counted as dropped",
    )
    if not dropped:
        not_observed("this line is fast enough for every trace: none had to give way")
