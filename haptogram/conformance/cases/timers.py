"""Chapters 6 and 12: lease, hold, ramps, and which of them wins."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Final

from haptogram_protocol.framing import encode_frame
from haptogram_protocol.messages import (
    DriveKind,
    DriveReply,
    Feature,
    Header,
    Ping,
    PlaybackEnded,
    ReadDrive,
    StateChanged,
    Status,
)
from haptogram_protocol.state import MuteReason, OutputState

from ..case import about_host, case
from ..client.board_client import Bench
from ..client.latching import Shown, latch_now, radiated, shown_in
from ..client.playback import play_now, store_phases
from ..outcome import SELF_REPORTED, check, fail

_MS: Final = 1000
_EXACT_US: Final = 1000  # HG-12.1: timers are within 1 ms

host_times = about_host("HG-12.6/1")
host_gives_up = about_host("HG-12.6/2")


def muted_by_timer(
    bench: Bench, since: int, timeout_us: int, reason: MuteReason
) -> tuple[Header, StateChanged]:
    """Return the STATE_CHANGED of a timer; FAILED if it does not come, or is of another one."""
    found = bench.await_event(StateChanged, since, timeout_us + 2 * bench.wire.limits.slack_us)
    if found is None:
        fail(f"{reason.name}: the board is not muted within {timeout_us / _MS:.0f} ms")
    header, event = found
    check(
        (event.state, event.reason) == (OutputState.MUTED, reason),
        f"due is MUTED, {reason.name}; STATE_CHANGED says {event.state.name}, {event.reason.name}",
    )
    return header, event


def _check_time(bench: Bench, start_us: int, header: Header, due_ms: int, what: str) -> None:
    took_us = bench.unwrap(header.time_us) - start_us
    check(
        abs(took_us - due_ms * _MS) <= _EXACT_US,
        f"{what}: muted {took_us / _MS:.3f} ms after, due is {due_ms} ms within 1 ms",
    )


@case(
    "HG-6.7/1",
    "frames that are dropped for type, flags, length or number renew the lease; others do not",
    needs=Feature.CONFIG,
)
def any_frame_renews(bench: Bench) -> None:
    bench.configure(host_timeout_ms=300)
    good = bench.flat_phases()
    kinds: dict[str, Callable[[], bytes]] = {
        "an unknown event": lambda: encode_frame(bench.body(0xEE, b"", seq=0)),
        "a stream frame seen before": lambda: bench.stream_wire(good, seq=0xFF00),
        "a stream frame of a wrong length": lambda: bench.stream_raw(1, b"\x08"),
        "a request with unknown flags": lambda: bench.request_wire(Ping(0), flags=0x40)[0],
        "a stream frame for the past": lambda: bench.stream_wire(good, bench.device_us() - 10**6),
    }
    for name, make in kinds.items():
        bench.arm()
        since = bench.mark()
        for _ in range(6):
            bench.send(make())
            bench.wire.idle(100 * _MS)
        check(not bench.events(StateChanged, since), f"{name} does not renew the lease")
    since = bench.mark()
    stale = bench.session ^ 0x00F0
    for _ in range(5):
        bench.send(encode_frame(bench.body(0xEE, b"", seq=0, session=stale)))
        bench.wire.idle(100 * _MS)
    check(bool(bench.events(StateChanged, since)), "frames of another session renew the lease")


@case("HG-12.1/1", "hold and STATUS come within 1 ms of their time", needs=Feature.CONFIG)
def timers_are_exact(bench: Bench) -> None:
    for hold_ms in (50, 137):
        bench.configure(hold_ms=hold_ms)
        bench.arm()
        since = bench.mark()
        latch_now(bench, bench.flat_phases())
        start_us = bench.unwrap(bench.status().last_latch_us)
        header, _ = muted_by_timer(bench, since, hold_ms * 2 * _MS, MuteReason.HOLD_EXPIRED)
        _check_time(bench, start_us, header, hold_ms, f"hold_ms = {hold_ms}")
    period_ms = bench.quick_status_ms + 10
    bench.configure(status_period_ms=period_ms)
    since = bench.mark()
    bench.wire.idle(6 * period_ms * _MS + bench.wire.limits.slack_us)
    times = [bench.unwrap(header.time_us) for header, _ in bench.events(Status, since)]
    check(len(times) >= 5, f"status_period_ms = {period_ms}: {len(times)} STATUS in 6 periods")
    steps = [b - a for a, b in itertools.pairwise(times)]
    off = [step for step in steps if abs(step - period_ms * _MS) > _EXACT_US]
    check(not off, f"status_period_ms = {period_ms}: steps of {off} us")


@case("HG-12.2/1", "without a frame the board is muted host_timeout_ms later", needs=Feature.CONFIG)
def lease_runs_out(bench: Bench) -> None:
    for timeout_ms in (80, 200):
        bench.configure(host_timeout_ms=timeout_ms)
        bench.arm()
        latch_now(bench, bench.flat_phases())
        start_us, since = bench.device_us(), bench.mark()
        header, _ = muted_by_timer(bench, since, 3 * timeout_ms * _MS, MuteReason.HOST_SILENT)
        _check_time(bench, start_us, header, timeout_ms, f"host_timeout_ms = {timeout_ms}")


@case(
    "HG-12.2/2",
    "between ARM and the first latch the hold does not run, the lease does",
    needs=Feature.CONFIG,
)
def hold_waits_for_a_latch(bench: Bench) -> None:
    bench.configure(hold_ms=30, host_timeout_ms=250)
    bench.arm()
    start_us, since = bench.device_us(), bench.mark()
    header, _ = muted_by_timer(bench, since, 600 * _MS, MuteReason.HOST_SILENT)
    _check_time(bench, start_us, header, 250, "host_timeout_ms = 250")


@case("HG-12.3/1", "the hold runs from the last of several latches", needs=Feature.CONFIG)
def hold_runs_from_the_last_latch(bench: Bench) -> None:
    bench.configure(hold_ms=150)
    bench.arm()
    since = bench.mark()
    for _ in range(4):
        latch_now(bench, bench.flat_phases())
        bench.wire.idle(60 * _MS)
    start_us = bench.unwrap(bench.status().last_latch_us)
    header, _ = muted_by_timer(bench, since, 300 * _MS, MuteReason.HOLD_EXPIRED)
    _check_time(bench, start_us, header, 150, "hold_ms = 150 after the last latch")


@case("HG-6.10/1", "a sounding board whose stream stops is muted by the hold", needs=Feature.CONFIG)
def hold_mutes(bench: Bench) -> None:
    bench.configure(hold_ms=60)
    bench.arm()
    since = bench.mark()
    latch_now(bench, bench.flat_phases())
    muted_by_timer(bench, since, 200 * _MS, MuteReason.HOLD_EXPIRED)
    check(bench.status().reason is MuteReason.HOLD_EXPIRED, "STATUS does not say HOLD_EXPIRED")


_RAMPS: Final = Feature.CONFIG | Feature.AMPLITUDE | Feature.READ_RADIATED


def _ramp(bench: Bench, *, hold_ms: int, ramp_ms: int) -> list[tuple[float, int]]:
    """Return (share of the ramp, amplitude) from before a ramp of the hold to behind its end."""
    bench.configure(hold_ms=hold_ms, ramp_ms=ramp_ms)
    bench.arm()
    latch_now(bench, bench.flat_phases())
    start_us = bench.unwrap(bench.status().last_latch_us) + hold_ms * _MS
    end_us = start_us + ramp_ms * _MS
    found: list[tuple[float, int]] = []
    while not found or found[-1][0] < 1.1:
        t_us, shown = _read_at(bench)
        found.append(((t_us - start_us) / (end_us - start_us), shown.loudest))
        bench.wire.idle(ramp_ms * _MS // 40)
    return found


def _read_at(bench: Bench) -> tuple[int, Shown]:
    read = ReadDrive(DriveKind.RADIATED, 0, bench.identity.transducers)
    answer = bench.ask(read)
    assert answer.header is not None  # ask
    reply = bench.reply_in(answer, DriveReply, ReadDrive.TYPE)
    return bench.unwrap(answer.header.time_us), shown_in(reply)


@case(
    "HG-6.11/1",
    "read-backs during a ramp: the amplitude never rises",
    needs=_RAMPS,
    evidence=SELF_REPORTED,
)
def ramps_do_not_rise(bench: Bench) -> None:
    ramp = _ramp(bench, hold_ms=100, ramp_ms=300)
    for (_, before), (share, after) in itertools.pairwise(ramp):
        check(after <= before, f"at {share:.0%} of the ramp the amplitude rises to {after}")


@case(
    "HG-6.11/2",
    "read-backs during a ramp: full before it, in small steps on the way, 0 at its end",
    needs=_RAMPS,
    evidence=SELF_REPORTED,
)
def ramps_reach_silence(bench: Bench) -> None:
    ramp = _ramp(bench, hold_ms=100, ramp_ms=400)
    early = [level for share, level in ramp if share < -0.02]
    check(all(level == 255 for level in early), f"before the ramp: amplitudes {early[-3:]}")
    late = [level for share, level in ramp if share > 1.02]
    check(bool(late) and not any(late), f"after ramp_ms: amplitudes {late[:3]}")
    way = [(share, level) for share, level in ramp if 0.05 < share < 0.95]
    check(all(0 < level < 255 for _, level in way), f"the ramp is skipped: {way[:4]} ...")
    points = [(0.0, 255), *way, (1.0, 0)]
    for (before, high), (after, low) in itertools.pairwise(points):
        # At most 1/8 at a time: over a share d of the ramp it can drop by 255 (d + 1/8) at most.
        limit = 255 * (max(after - before, 0) + 1 / 8) + 2
        check(high - low <= limit, f"from {high} to {low} within {after - before:.1%} of a ramp")


@case("HG-6.11/3", "with ramp_ms = 0 the board is muted right at the end of the hold")
def hard_mute(bench: Bench) -> None:
    bench.configure(hold_ms=80, ramp_ms=0)
    bench.arm()
    since = bench.mark()
    latch_now(bench, bench.flat_phases())
    start_us = bench.unwrap(bench.status().last_latch_us)
    header, _ = muted_by_timer(bench, since, 200 * _MS, MuteReason.HOLD_EXPIRED)
    _check_time(bench, start_us, header, 80, "hold_ms = 80, ramp_ms = 0")


@case(
    "HG-6.11/4",
    "a latch ends the ramp of the hold, a request does not; any frame ends that of the lease",
    needs=_RAMPS,
    evidence=SELF_REPORTED,
)
def ramps_are_renewed(bench: Bench) -> None:
    bench.configure(hold_ms=100, ramp_ms=600)
    bench.arm()
    latch_now(bench, bench.flat_phases())
    bench.wire.idle(300 * _MS)
    bench.barrier()
    check(radiated(bench).loudest < 255, "a request ends the ramp of the hold")
    latch_now(bench, bench.flat_phases())
    check(radiated(bench).loudest == 255, "a latch does not end the ramp of the hold")
    bench.configure(host_timeout_ms=100, ramp_ms=600)
    bench.arm()
    latch_now(bench, bench.flat_phases())
    since = bench.mark()
    bench.wire.idle(400 * _MS)
    check(radiated(bench).loudest == 255, "a frame does not end the ramp of the lease")
    check(not bench.events(StateChanged, since), "the lease muted the board before its ramp ended")


@case(
    "HG-6.11/5",
    "at the end of a ramp: MUTED with its reason, queue flushed, timeouts + 1",
    needs=Feature.CONFIG,
    evidence=SELF_REPORTED,
)
def ramps_end_muted(bench: Bench) -> None:
    bench.configure(hold_ms=60, ramp_ms=60)
    bench.arm()
    with bench.counting(timeouts=1, flushed=1, latched=1):
        since = bench.mark()
        latch_now(bench, bench.flat_phases())
        start_us = bench.unwrap(bench.status().last_latch_us)
        bench.send(bench.stream_wire(bench.flat_phases(), start_us + 2_000_000))
        header, _ = muted_by_timer(bench, since, 400 * _MS, MuteReason.HOLD_EXPIRED)
    ramp_ms = 60 if bench.has(Feature.AMPLITUDE) else 0
    _check_time(bench, start_us, header, 60 + ramp_ms, "hold_ms = 60 and the ramp")


@case(
    "HG-6.11/5",
    "at the end of a ramp a playback ends",
    variant="playback",
    needs=Feature.CONFIG | Feature.SEQUENCE_PHASES,
)
def ramps_end_playback(bench: Bench) -> None:
    bench.configure(hold_ms=50)
    store_phases(bench, 1, frames=2)
    bench.arm()
    since = bench.mark()
    play_now(bench, 1, loops=0, period_us=500_000)
    muted_by_timer(bench, since, 300 * _MS, MuteReason.HOLD_EXPIRED)
    found = bench.await_event(PlaybackEnded, since, 50 * _MS + bench.wire.limits.slack_us)
    check(found is not None, "a timer has muted the board, but no PLAYBACK_ENDED came")


@case(
    "HG-12.4/1",
    "when a playback ends the lease is host_timeout_ms again, from then on",
    needs=Feature.CONFIG | Feature.SEQUENCE_PHASES,
)
def lease_after_playback(bench: Bench) -> None:
    bench.configure(host_timeout_ms=150, hold_ms=5000)
    store_phases(bench, 1, frames=2)
    bench.arm()
    since = bench.mark()
    play_now(bench, 1, loops=150, period_us=1000, unattended_ms=5000)
    ended = bench.await_event(PlaybackEnded, since, 600 * _MS + bench.wire.limits.slack_us)
    if ended is None:
        fail("a playback of 300 ms did not end: host_timeout_ms counted while it played?")
    header, _ = muted_by_timer(bench, since, 500 * _MS, MuteReason.HOST_SILENT)
    _check_time(bench, bench.unwrap(ended[0].time_us), header, 150, "after the playback")


@case("HG-12.5/1", "the timer that runs out first mutes, in both orders", needs=Feature.CONFIG)
def the_first_timer_wins(bench: Bench) -> None:
    for reason, hold_ms, lease_ms, ramp_ms in (
        (MuteReason.HOLD_EXPIRED, 60, 120, 100),
        (MuteReason.HOST_SILENT, 160, 80, 100),
    ):
        bench.configure(hold_ms=hold_ms, host_timeout_ms=lease_ms, ramp_ms=ramp_ms)
        bench.arm()
        since = bench.mark()
        with bench.counting(timeouts=1):
            latch_now(bench, bench.flat_phases())
            start_us = bench.device_us()
            header, _ = muted_by_timer(bench, since, 600 * _MS, reason)
        took_ms = (bench.unwrap(header.time_us) - start_us) / _MS
        ramp = ramp_ms if bench.has(Feature.AMPLITUDE) else 0
        most = min(hold_ms, lease_ms) + ramp + 1
        check(took_ms <= most, f"muted after {took_ms:.1f} ms, {most} ms is the most")
