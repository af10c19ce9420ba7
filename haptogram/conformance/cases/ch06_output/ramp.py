"""HG-6.7, HG-6.10, HG-6.11: lease, hold, and the ramp at their end, of every amplitude."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from haptogram_protocol import messages as m
from haptogram_protocol.state import MuteReason

from ...case import Depth, case
from ...client import latching, playback
from ...client.board_client import BoardClient
from ...client.wire import DELAYED_LEAD_FACTOR, WALL_LEAD_US
from ...judge.ramps import judge_straight_ramp, judged_ramp, judged_ramp_reading
from ...judge.timers import (
    HOLD,
    LEASE,
    UNATTENDED,
    TimerKind,
    judge_in_time,
    judged_mute_by_timer,
    timer_kinds,
)
from ...outcome import SELF_REPORTED, check, check_equal, check_fields, named
from ..ch05_stream.every_drop import DROPS
from ..ch07_configuration.every_setting import every_other_setting
from ..ch12_timers.every_restart import SLOW_US, judge_no_renewals, judge_renewals, stale_pings

_MS: Final = 1000
_HOLD_MS: Final = 100
_RAMPS: Final = m.Feature.CONFIG | m.Feature.AMPLITUDE | m.Feature.READ_RADIATED
_SHORT_MS: Final = 60
_LONG_MS: Final = 2000  # the longest ramp: counters of 16 bits wrap in it, whose ticks are short
_SEQUENCE: Final = 4
#: Ceilings, and the length of the ramp that begins below each.
_RAMPS_MS: Final = {255: _LONG_MS, 254: 100, 128: 300, 100: 100, 1: 100, 0: 100}
_PLAYED_RAMPS_MS: Final = {128: 300}  # at a wall clock
_FADES: Final = m.Feature.CONFIG | m.Feature.AMPLITUDE
#: Ceilings at the beginning of a ramp, and set one after the other within it.
_CEILINGS_IN_RAMPS: Final = (
    (255, (200, 255, 199, 200, 60, 61, 255, 0, 1, 255)),
    (100, (100, 255, 101, 254)),
    (200, (255, 40, 255, 39, 200)),
    (0, (255, 1)),
    (1, (0, 255)),
)
#: Lengths of two timers on a fast line, in ms.
_SHORT_HOLD_MS: Final = 20  # runs out before the other timer
_LONG_HOLD_MS: Final = 120  # and behind it
_OTHER_MS: Final = 40
_RAMP_MS: Final = 150
_RENEWED_MS: Final = 145  # from the first latch: both timers have run out
_SLOW_LINE_US: Final = 20_000  # for 200 bytes, or twice to a latch; beyond it all lengths grow
_DROPPED: Final = ("duplicate", "bad_length", "dropped_late")
_FRAME: Final = "a frame"
_LATCH: Final = "a latch"
#: Of the frames that renew a lease, one each that is dropped for type, flags, number, length, time.
_RENEW_A_LEASE: Final = (
    "an unknown event",
    "PING with an unknown flag",
    *(f"a frame {drop.summary}" for drop in DROPS if drop.counter in _DROPPED),
)


@case("HG-6.7/1", needs=m.Feature.CONFIG, depth=Depth.DEFAULT)
def any_frame_renews_the_output_lease(board: BoardClient) -> None:
    """frames dropped for type, flags, length, number or time renew the lease; stale frames do
    not
    """
    judge_renewals(board, plays=False, names=_RENEW_A_LEASE)
    judge_no_renewals(board, stale_pings, LEASE)


@case("HG-6.10/1")
def mutes_the_output_after_hold(board: BoardClient) -> None:
    """a sounding board whose stream stops is muted by the hold"""
    hold_ms, since = board.arm_with_timer("hold_ms", 60), board.link.mark()
    latching.latch_now(board)
    timeout_us = (hold_ms + board.config.ramp_ms + 140) * _MS
    judged_mute_by_timer(board, since, timeout_us, MuteReason.HOLD_EXPIRED)
    board.check_status("behind the hold", reason=MuteReason.HOLD_EXPIRED)


@case("HG-6.11/1", needs=_RAMPS, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def output_ramps_do_not_rise(board: BoardClient) -> None:
    """during a ramp the amplitude in read-backs never rises"""
    board.arm(hold_ms=_HOLD_MS, ramp_ms=300)
    latching.latch_now(board)
    ramp = judged_ramp(board, hold_ms=_HOLD_MS, ramp_ms=300)
    for before, after in itertools.pairwise(ramp):
        rises = [b for a, b in zip(before.amplitudes, after.amplitudes, strict=True) if b > a]
        text = f"{after.from_ms:.1f} ms into the ramp the amplitude rises to "
        check(not rises, f"{text}{max(rises, default=0)}")


@case("HG-6.11/2", needs=_RAMPS, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def output_ramps_reach_silence(board: BoardClient) -> None:
    """the amplitude is full before a ramp, is that of a straight line within it, and then 0"""
    _judge_output_ramp(board, latching.FULL, 400, plays=False)


@case("HG-6.11/3")
def hard_mute_has_no_ramp(board: BoardClient) -> None:
    """with ramp_ms = 0 the board is muted right at the end of the hold"""
    HOLD.judge_whole(board, 80, "hold_ms = 80, ramp_ms = 0", ramp_ms=0)


@case("HG-6.11/4", needs=_RAMPS, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def output_ramps_are_renewed(board: BoardClient) -> None:
    """a latch ends the ramp of the hold, a request does not; any frame ends the lease's ramp"""
    board.arm(hold_ms=_HOLD_MS, ramp_ms=600)
    latching.latch_now(board)
    board.wire.idle(200 * _MS)
    board.link.barrier()
    check(
        latching.read_back_radiated(board).loudest < latching.FULL,
        "a request ends the ramp of the hold",
    )
    latching.latch_now(board)
    check_fields(
        latching.read_back_radiated(board), "a latch in the ramp of the hold", loudest=latching.FULL
    )
    since = board.arm(host_timeout_ms=100, ramp_ms=600)
    latching.latch_now(board)
    board.wire.idle(250 * _MS)
    check_fields(
        latching.read_back_radiated(board),
        "a frame in the ramp of the lease",
        loudest=latching.FULL,
    )
    muted = board.link.events(m.StateChanged, since)
    check(not muted, "the lease muted the board before its ramp ended")


@case("HG-6.11/5", needs=m.Feature.CONFIG, evidence=SELF_REPORTED)
def output_ramps_end_muted(board: BoardClient) -> None:
    """a ramp ends in MUTED with its reason; the queue is flushed, timeouts + 1"""
    hold_ms = board.clock.timer_ms(60, 2 * board.identity.transducers + 200)
    ramp_ms = 60 if board.has(m.Feature.AMPLITUDE) else 0
    since = board.link.mark()
    with board.counting(timeouts=1, flushed=1, latched=1):
        start_us = HOLD.start(board, hold_ms, ramp_ms=60)
        board.clock.require_horizon(2_000_000)
        board.link.stream(board.flat_phases(), start_us + 2_000_000)
        board.clock.require_before(start_us + hold_ms * _MS, "a frame within the hold")
        HOLD.judge(board, since, start_us, hold_ms + ramp_ms, "the hold and its ramp")


@case("HG-6.11/6-alone", needs=_RAMPS, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def output_ramps_go_on_as_they_began(board: BoardClient) -> None:
    """a higher ceiling and another ramp_ms, set during a ramp, leave its line; a lower one cuts
    it
    """
    steps = [{"ramp_ms": 300, "amplitude_ceiling": ceiling} for ceiling in (latching.FULL, 20)]
    _judge_ramp_with_settings(board, 100, steps, plays=False)


@case("HG-6.11/5-playback", needs=m.Feature.CONFIG | m.Feature.SEQUENCE_PHASES)
def output_ramps_end_playback(board: BoardClient) -> None:
    """at the end of a ramp a playback ends"""
    board.configure(hold_ms=50)
    playback.send_phases_that_fit(board, 1, frames=2)
    since = board.arm()
    playback.play_now(board, 1, loops=0, period_us=500_000)
    judged_mute_by_timer(board, since, 300 * _MS, MuteReason.HOLD_EXPIRED)
    board.due_event(m.PlaybackEnded, since, 50 * _MS, "a timer has muted the board")


# --- Ramps of every amplitude under every ceiling ------------------------------------------------


def _amplitudes_in_ramps(ceiling: int, count: int) -> bytes:
    """Return *count* amplitude codes in turn: near *ceiling*, its half and double, 0 and 255.

    An array of fewer transducers has the first of them.
    """
    near = (
        latching.FULL,
        ceiling + 1,
        ceiling,
        0,
        ceiling - 1,
        latching.FULL - 1,
        2 * ceiling,
        1,
        ceiling // 2,
        2,
    )
    codes = list(dict.fromkeys(code for code in near if 0 <= code <= latching.FULL))
    return bytes(codes[n % len(codes)] for n in range(count))


@case("HG-6.11/2-ceilings", needs=_RAMPS, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_ceiling_of_ramps(board: BoardClient) -> None:
    """ramps of amplitudes at and beside each ceiling, one of 2 s too: straight from begin to end"""
    played = board.has(m.Feature.SEQUENCE_PHASES)
    playback.send_phases_to_store_if_supported(board, _SEQUENCE, frames=1)
    at_wall = not board.wire.is_virtual
    played_ms = (_PLAYED_RAMPS_MS if at_wall else _RAMPS_MS) if played else {}
    for ceiling, ramp_ms in _RAMPS_MS.items():
        _judge_output_ramp(board, ceiling, ramp_ms, plays=False)
    for ceiling, ramp_ms in played_ms.items():
        _judge_output_ramp(board, ceiling, ramp_ms, plays=True)


def _judge_output_ramp(board: BoardClient, ceiling: int, ramp_ms: int, *, plays: bool) -> None:
    """Let the hold expire; FAILED unless the amplitudes fall linearly to 0 in *ramp_ms*.

    *ceiling* limits them before; *plays*: they are of a playback, else of the stream.
    """
    board.arm(hold_ms=_SHORT_MS, ramp_ms=ramp_ms, amplitude_ceiling=ceiling)
    begins = _below_ceiling(_latch_before_ramp(board, plays=plays), ceiling)
    ramp = judged_ramp(board, hold_ms=_SHORT_MS, ramp_ms=ramp_ms)
    name = f"ceiling {ceiling}, of a {'played' if plays else 'stream'} frame: "
    judge_straight_ramp(board, ramp, ramp_ms, begins, name)


def _latch_before_ramp(board: BoardClient, *, plays: bool) -> bytes:
    """Latch a stream frame or, if *plays*, a stored one; return its N amplitude codes."""
    count = board.identity.transducers
    if plays:
        playback.play_now(board, _SEQUENCE, loops=1)
        board.clock.wait_latched()
        return bytes([latching.FULL]) * count
    amplitudes = _amplitudes_in_ramps(board.config.amplitude_ceiling, count)
    latching.latch_now(board, m.Drives(bytes(count) + amplitudes))
    return amplitudes


def _below_ceiling(amplitudes: bytes, ceiling: int) -> bytes:
    """Return the amplitudes limited to the ceiling."""
    return bytes(min(code, ceiling) for code in amplitudes)


# --- What is set during the ramp of a hold -----------------------------------------------------


@case("HG-6.11/6-fields", needs=_RAMPS, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_setting_within_a_ramp(board: BoardClient) -> None:
    """a ramp keeps line and end, whichever field is set to its least and greatest value
    meanwhile
    """
    lengths: list[dict[str, Any]] = [
        {"hold_ms": 1},
        {"hold_ms": 10_000},
        {"ramp_ms": 0},
        {"ramp_ms": 2000},
        {"ramp_ms": 1},
        {"host_timeout_ms": 1000},
        {"hold_ms": 1, "ramp_ms": 0},
    ]
    ceilings = [{"amplitude_ceiling": ceiling} for ceiling in (latching.FULL, 100, 101)]
    steps = [*every_other_setting(board), *ceilings, *lengths]
    for plays in _sources_of_drives(board):
        # Behind the last ones the ramp ends: at its own time, whatever is in force.
        for last in board.sample(lengths[::-1]):
            _judge_ramp_with_settings(board, 100, [*steps, last], plays=plays)


@case("HG-6.11/6-ceilings", needs=_RAMPS, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_ceiling_within_a_ramp(board: BoardClient) -> None:
    """of the ceilings that are set in a ramp the one in force cuts it off; its line goes on"""
    chains: list[tuple[int, tuple[int, ...]]] = list(_CEILINGS_IN_RAMPS)
    codes = (0, 1, 2, 77, 128, 253, 254, 255)
    chains += [(first, tuple(board.random.choices(codes, k=len(codes)))) for first in codes]
    for first, ceilings in board.sample(chains):
        steps = [{"amplitude_ceiling": ceiling} for ceiling in ceilings]
        for plays in _sources_of_drives(board):
            _judge_ramp_with_settings(board, first, steps, plays=plays)


def _sources_of_drives(board: BoardClient) -> Iterator[bool]:
    """Yield False: stream frames; then, in virtual time, if the board can play, True: playback."""
    yield False
    if board.has(m.Feature.SEQUENCE_PHASES) and board.wire.is_virtual:
        playback.send_phases_to_store(board, _SEQUENCE, frames=1)
        yield True


def _judge_ramp_with_settings(
    board: BoardClient, ceiling: int, steps: Sequence[Mapping[str, Any]], *, plays: bool
) -> None:
    """FAILED unless a hold ramp stays straight and on time while settings change in *steps*.

    *plays*: the drive is of a playback, else of the stream; *ceiling* limits it before.
    """
    ramp_ms = _length_of_long_ramp_ms(board)
    before = {"hold_ms": _SHORT_MS, "ramp_ms": ramp_ms, "amplitude_ceiling": ceiling}
    since = board.arm(**before)
    begins = _below_ceiling(_latch_before_ramp(board, plays=plays), ceiling)
    latch_us = board.last_latch_us()
    start_us = latch_us + _SHORT_MS * _MS
    for place, changes in enumerate(steps, 1):
        at_us = start_us + ramp_ms * _MS * place // (len(steps) + 1)
        board.wire.idle(max(0, at_us - board.clock.device_estimate_us()))
        board.configure(**before | dict(changes))
        reading = judged_ramp_reading(board, start_us)
        name = f"ceiling {ceiling}, {dict(changes)} meanwhile: "
        cut = board.config.amplitude_ceiling
        judge_straight_ramp(board, [reading], ramp_ms, begins, name, cut=cut)
    name = f"a ramp of {_SHORT_MS} + {ramp_ms} ms, {dict(steps[-1])} meanwhile"
    HOLD.judge(board, since, latch_us, _SHORT_MS + ramp_ms, name)


def _length_of_long_ramp_ms(board: BoardClient) -> int:
    """Return a ramp in ms: 500, or 2000 where 25 settings and read-backs take longer than 500."""
    reads = 25 * (2 * board.identity.transducers + 150)
    needed_us = 4 * board.wire.line_us(reads) + 50 * board.wire.trip_us
    return _LONG_MS // 4 if needed_us <= _LONG_MS // 4 * _MS else _LONG_MS


# --- How a ramp ends ---------------------------------------------------------------------------


@case("HG-6.11/4-settings", needs=_RAMPS, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_undone_ramp_takes_the_new_ceiling(board: BoardClient) -> None:
    """a ramp that is undone leads to full amplitude below the ceiling that was set in it"""
    playback.send_phases_to_store_if_supported(board, _SEQUENCE, frames=1)
    timers = ["hold", "lease", "both", "both, the lease first"]
    timers += ["unattended"] if board.has(m.Feature.SEQUENCE_PHASES) else []
    for first, then in ((100, latching.FULL), (latching.FULL, 100)):
        for timer in timers if first < then or board.wire.is_virtual else timers[:1]:
            _undo_ramp_with_settings(board, timer, first, then)


def _undo_ramp_with_settings(board: BoardClient, timer: str, first: int, then: int) -> None:
    """FAILED unless a ceiling set in a ramp limits the output, be the ramp undone or going on.

    The expiry of *timer* begins the ramp under the ceiling *first*; then *then* is set.  A frame or
    latch undoes the ramp of one timer; if hold and lease have both expired it goes on.
    """
    long = {"hold_ms": 5000, "host_timeout_ms": 10_000, "ramp_ms": _LONG_MS}
    short = {
        "hold": {"hold_ms": _SHORT_MS},
        "lease": {"host_timeout_ms": 2 * _SHORT_MS},
        "both": {"hold_ms": _SHORT_MS, "host_timeout_ms": 2 * _SHORT_MS},
        "both, the lease first": {"hold_ms": 3 * _SHORT_MS, "host_timeout_ms": 2 * _SHORT_MS},
        "unattended": {},
    }[timer]
    board.hello()  # ends a playback
    board.arm(**long | short | {"amplitude_ceiling": first})
    if timer == "unattended":
        playback.play_now(
            board, _SEQUENCE, loops=0, period_us=9_000_000, unattended_ms=2 * _SHORT_MS
        )
        board.clock.wait_latched()
        latched = bytes([latching.FULL]) * board.identity.transducers
    else:
        latched = _latch_before_ramp(board, plays=False)
    latch_us = board.last_latch_us()
    frame_us = board.clock.device_us()
    board.wire.idle(4 * _SHORT_MS * _MS)
    board.configure(**long | {"amplitude_ceiling": then})
    if timer == "hold":
        latching.latch_now(board, m.Drives(bytes(len(latched)) + latched))
    if timer.startswith("both"):  # the hold has run out: the ramp goes on, as it began
        start_us = latch_us + short["hold_ms"] * _MS
        if "lease" in timer:
            start_us = frame_us + short["host_timeout_ms"] * _MS
        reading = judged_ramp_reading(board, start_us)
        begins = _below_ceiling(latched, first)
        name = f"a ramp of {timer}, ceiling {first}, then {then}: "
        judge_straight_ramp(board, [reading], _LONG_MS, begins, name, cut=then)
        return
    shown = latching.read_back_radiated(board)
    board.clock.require_before(latch_us + _LONG_MS * _MS, "a read-back in a ramp")
    due = _below_ceiling(latched, then)
    wrong = [(n, got) for n, got in enumerate(shown.amplitudes) if got != due[n]]
    judge_in_time(
        board,
        not wrong,
        f"a ramp of {timer} under a ceiling of {first} is undone, {then} was set in it: "
        f"of transducers and amplitudes {wrong[:3]} are not min({list(latched[:3])}..., {then})",
    )


# --- Two timers that have run out ---------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class TimerPair:
    """The hold and another timer, which run out one behind the other.

    Attributes
    ----------
    other : TimerKind
        The other timer.
    is_hold_first : bool
        Whether the hold runs out first, and begins the ramp.
    ramp_ms : int
        Length of the ramp.
    renewed_by : str
        A frame, which renews the other timer while both have run out, or a latch, which renews the
        hold; empty: nothing.
    """

    other: TimerKind
    is_hold_first: bool
    ramp_ms: int
    renewed_by: str = ""

    def __str__(self) -> str:
        names = [self.other.reason.name]
        names.insert(not self.is_hold_first, "HOLD_EXPIRED")
        renewed = f", and {self.renewed_by} behind both" if self.renewed_by else ""
        return f"{' and then '.join(names)} in a ramp of {self.ramp_ms} ms{renewed}"


def _judge_timer_pairs(board: BoardClient, length_ms: int, *renewed_by: str) -> None:
    """FAILED unless the ramp ends right if the hold and another timer expire, either of them first.

    Right is once, on time, with the reason of the timer that caused it.  *renewed_by*: what comes
    in the ramp, a frame or a latch; empty: nothing.  *length_ms* is its length, 2000 at most.
    """
    playback.send_phases_to_store_if_supported(board, _SEQUENCE, frames=1)
    others = timer_kinds(board, LEASE, UNATTENDED)
    ramp_ms = min(_LONG_MS, _ramp_time_ms(board, length_ms))
    for other, is_hold_first, renewed in itertools.product(others, (True, False), renewed_by):
        pair = TimerPair(other, is_hold_first, ramp_ms, renewed)
        with named(str(pair)):
            _judge_end_of_ramp(board, pair)


def _ramp_time_ms(board: BoardClient, length_ms: int) -> int:
    """Return *length_ms*, times a factor on a slow line or board or after the host was late.

    Slow: 200 bytes take 40 ms or more on the line, or a frame over 10 ms to its latch.
    """
    slow_line, slow_board = board.wire.period_us(200), 2 * board.clock.ready_us(0)
    slow = max(slow_line // _SLOW_LINE_US, -(-slow_board // _SLOW_LINE_US))
    delayed = board.wire.limits.lead_us // (DELAYED_LEAD_FACTOR * WALL_LEAD_US)
    return length_ms * max(1, slow, delayed)


def _judge_end_of_ramp(board: BoardClient, pair: TimerPair) -> None:
    """FAILED unless the ramp of *pair* ends once, on time, with the reason of the right timer.

    That is the one that expires first or, if this is renewed in the ramp, the other one.
    """
    since = board.link.mark()
    with board.counting(timeouts=1):
        begins_us, both_us = _begin_ramp_of_pair(board, pair)
        if pair.renewed_by == _FRAME:
            board.clock.idle_until(both_us)
            ends_us, frame_us = begins_us + pair.ramp_ms * _MS, board.clock.device_us()
            board.clock.require_before(ends_us, "a frame in a ramp", frame_us)
        by_hold = pair.renewed_by == _FRAME or (pair.is_hold_first and not pair.renewed_by)
        timer = HOLD if by_hold else pair.other
        timer.judge(board, since, begins_us, pair.ramp_ms, timer.reason.name)
    latching.check_silent(board, "behind the end")
    for kind, due in (m.StateChanged, 1), (m.PlaybackEnded, int(pair.other is UNATTENDED)):
        got = len(board.link.events(kind, since))
        check_equal(got, due, f"{got} {kind.TYPE.name}")


def _begin_ramp_of_pair(board: BoardClient, pair: TimerPair) -> tuple[int, int]:
    """Start both timers of *pair*; return when the ramp begins, and when a frame is to renew one.

    Both are device times in µs.
    """
    hold_ms = _ramp_time_ms(board, _SHORT_HOLD_MS if pair.is_hold_first else _LONG_HOLD_MS)
    other_ms = _ramp_time_ms(board, _OTHER_MS)
    settings: dict[str, Any] = {"hold_ms": hold_ms, "ramp_ms": pair.ramp_ms}
    if pair.other is LEASE:
        settings["host_timeout_ms"] = other_ms
    board.arm(**settings)
    ahead_us = board.clock.on_carrier(_ramp_time_ms(board, _RENEWED_MS) * _MS)
    if pair.other is UNATTENDED:
        period_us = ahead_us if pair.renewed_by == _LATCH else SLOW_US
        playback.play_now(board, _SEQUENCE, loops=0, period_us=period_us, unattended_ms=other_ms)
        board.clock.wait_latched(0)
    else:
        latching.latch_now(board)
    latch_us = board.last_latch_us()
    if pair.renewed_by == _LATCH and pair.other is LEASE:
        board.link.stream(board.flat_phases(), latch_us + ahead_us)
    asked_us = board.clock.device_us()
    hold_us, other_us = latch_us + hold_ms * _MS, asked_us + other_ms * _MS
    last_us = hold_us - (0 if pair.is_hold_first else other_ms * _MS)  # the PING renews a lease
    board.clock.require_before(last_us, "two timers that run out", asked_us)
    return min(hold_us, other_us), latch_us + ahead_us


@case("HG-6.11/5-pairs", needs=_FADES, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_first_timer_begins_the_ramp(board: BoardClient) -> None:
    """of two timers that run out the first begins the ramp, which mutes with its reason, once"""
    _judge_timer_pairs(board, _RAMP_MS, "")


@case("HG-6.11/4-pairs", needs=_FADES, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_ramp_goes_on_behind_a_second_timer(board: BoardClient) -> None:
    """a frame or a latch that renews one of two timers that have run out leaves the ramp as it
    is
    """
    reached = board.clock.horizon_us > 2 * _MS * _ramp_time_ms(board, _RENEWED_MS)
    _judge_timer_pairs(board, _RAMP_MS, _FRAME, *([_LATCH] if reached else []))
