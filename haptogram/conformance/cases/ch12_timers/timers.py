"""HG-3.6, HG-6.10, HG-6.11, HG-7.6, HG-9.1, HG-12.1, HG-12.2, HG-12.3, HG-12.4, HG-12.5, HG-12.6:
timers.

A length just above 2^b units is judged in some ten milliseconds: a timer that kept b bits of it
ends at once.  In virtual time each of these lengths passes as a whole too; at a wall clock only the
greatest ones do, in a run with ``--full``.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Final

from haptogram_protocol import messages as m
from haptogram_protocol.rules import CONFIG_BOUNDS
from haptogram_protocol.state import MuteReason

from ...case import Case, Depth, case, case_about_host
from ...client import latching, playback, uploads
from ...client.board_client import BoardClient
from ...client.capabilities import PLAYS, SHOWN_RAMPS, TRACED_PLAYS
from ...client.stream_kinds import stream_kinds, valid_requests_to_send
from ...judge.ramps import judge_straight_ramp, judged_ramp_reading
from ...judge.refused_requests import judged_refusal, requests_refused_while_armed
from ...judge.timers import (
    EXACT_US,
    HOLD,
    LEASE,
    RAMP,
    UNATTENDED,
    TimerKind,
    judge_status_period,
    judge_unmoved,
    judged_mute_by_timer,
    timer_kinds,
)
from ...outcome import SELF_REPORTED, check, check_equal, named, require
from ..ch05_stream.every_drop import DROPS, Drop, fill_queue, judge_drop
from ..ch07_configuration.playback import judge_playback
from .every_restart import SLOW_US, STORED, TIMER_MS, play_later_than_timer

_MS: Final = 1000
_STALE_MS: Final = 80
_RAMP_MS: Final = 100
_BITS: Final = (16, 15, 12, 10, 8)
_UNITS_US: Final = (1, 10, 100, 1000)
_OVER_MS: Final = 15  # beyond 2^b units: what is left of a length that wrapped
_LOOK_MS: Final = 30  # how long the board is watched for a timer that wrapped
_WRAP_US: Final = 2**32
_SEQUENCE: Final = 4
_SILENT_MS: Final = 70
_HELD_MS: Final = 120  # a hold, and a ramp that lasts longer than a host is held up
_FADING_MS: Final = 2000
_MOST_HOLD_MS: Final = 7000
_REQUESTS: Final = "requests"
_DROPS: Final = {drop.summary: drop for drop in DROPS}
_FRAMES: Final = 6


host_times = case_about_host("HG-12.6/1")


host_gives_up = case_about_host("HG-12.6/2")


@case("HG-12.1/1", needs=m.Feature.CONFIG, depth=Depth.DEFAULT)
def timers_are_exact(board: BoardClient) -> None:
    """hold and STATUS come within 1 ms of their time"""
    for hold_ms in (50, 137):
        HOLD.judge_whole(board, hold_ms)
    period_ms = board.quick_status_ms + 10
    board.configure(status_period_ms=period_ms)
    since = board.link.mark()
    board.wire.idle_beyond(6 * period_ms * _MS)
    judge_status_period(board, since, period_ms, 5, "6 periods")


@case("HG-12.2/1")
def lease_runs_out(board: BoardClient) -> None:
    """without a frame the board is muted host_timeout_ms later"""
    for least_ms in (50, 90):
        wanted_ms = board.clock.timer_ms(least_ms, len(board.bytes_of_frames(1)))
        due_ms = board.arm_with_timer(LEASE.name, wanted_ms) + board.graded_ramp_ms
        if board.has(m.Feature.CONFIG):  # else a hold may end before
            latching.latch_now(board)
        start_us, since = board.clock.device_us(), board.link.mark()
        LEASE.judge(board, since, start_us, due_ms)


@case("HG-12.2/2", needs=m.Feature.CONFIG)
def hold_timer_waits_for_a_latch(board: BoardClient) -> None:
    """between ARM and the first latch the hold does not run, the lease does"""
    LEASE.judge_whole(board, 80, hold_ms=30)


@case("HG-12.2/2-ended", needs=m.Feature.CONFIG, depth=Depth.DEFAULT)
def hold_timer_is_not_taken_up_again(board: BoardClient) -> None:
    """behind each end of a held drive, ARM and every other request start no hold"""
    for end in (m.Mute(), m.Disarm(), None):
        board.arm(hold_ms=_STALE_MS)
        latching.latch_now(board)
        board.link.ask(end) if end else board.hello()
        since, name = board.arm(), end.TYPE.name if end else "HELLO"
        for message in valid_requests_to_send(board, uploads.SEQUENCES[0]):
            if message.TYPE.name not in ("DISARM", "PLAY"):
                board.link.ask(message)
        board.wire.idle((_STALE_MS + 50) * _MS)
        told = [event.reason.name for _, event in board.link.events(m.StateChanged, since)]
        text = f"muted by {', '.join(told)} behind {name} and ARM, before any latch"
        check(not told, f"{text}: a hold runs that no latch began")


@case("HG-12.3/1")
def hold_timer_runs_from_the_last_latch(board: BoardClient) -> None:
    """the hold runs from the last of several latches"""
    hold_ms = board.arm_with_timer(HOLD.name, 75)
    text = f"a hold of {hold_ms} ms outlasts the lease, and no SET_CONFIG changes it"
    require(hold_ms < board.config.host_timeout_ms, text)
    since = board.link.mark()
    for _ in range(4):
        latching.latch_now(board)
        board.wire.idle(min(60, hold_ms // 5) * _MS)
    start_us = board.last_latch_us()
    due_ms = hold_ms + board.graded_ramp_ms
    HOLD.judge(board, since, start_us, due_ms, f"hold_ms = {hold_ms} after the last latch")


@case("HG-12.4/1", needs=PLAYS, depth=Depth.DEFAULT)
def lease_is_back_after_playback(board: BoardClient) -> None:
    """from the end of a playback on the lease is host_timeout_ms again"""
    board.configure(host_timeout_ms=150, hold_ms=5000)
    playback.send_phases_that_fit(board, 1, frames=2)
    since = board.arm()
    playback.play_now(board, 1, loops=150, period_us=1000, unattended_ms=5000)
    name = "a playback of 300 ms, longer than host_timeout_ms"
    ended, _ = board.due_event(m.PlaybackEnded, since, 600 * _MS, name)
    LEASE.judge(board, since, board.clock.unwrap(ended.time_us), 150, "after the playback")


@case("HG-12.5/1", needs=m.Feature.CONFIG, depth=Depth.DEFAULT)
def the_first_timer_wins(board: BoardClient) -> None:
    """the timer that runs out first mutes, in both orders"""
    ramp_ms = _RAMP_MS * board.has(m.Feature.AMPLITUDE)
    for first, second, lengths_ms in ((HOLD, LEASE, (60, 120)), (LEASE, HOLD, (80, 160))):
        first_ms, second_ms = map(board.clock.timer_ms, lengths_ms)
        with board.counting(timeouts=1):
            second_length = {second.name: second_ms}
            first.judge_whole(board, first_ms, first.name, ramp_ms=ramp_ms, **second_length)


def wrapping_timer_lengths(least_ms: int, most_ms: int, *, thorough: bool = True) -> list[int]:
    """Return lengths in ms just above every power of two in every unit, within the bounds.

    If not *thorough*: just above 2^16 units.

    Examples
    --------
    >>> wrapping_timer_lengths(20, 500)
    [48, 81, 271, 343, 425]
    """
    edges = {
        -(-(unit_us << bits) // _MS)
        for unit_us in _UNITS_US
        for bits in _BITS[: None if thorough else 1]
    }
    lengths = {edge + _OVER_MS for edge in edges if edge >= 2 * _OVER_MS}
    return sorted(ms for ms in lengths if max(least_ms, 2 * _OVER_MS) <= ms <= most_ms)


def _wrapping_case(
    clause: str, timer: TimerKind, text: str, least_ms: int, depth: Depth = Depth.QUICK
) -> Case:
    """Return the case that a timer, at lengths just above powers of two, does not expire early.

    *text* is its summary, with a place for the lengths; the shortest is *least_ms* or more.
    """
    title = text.format("just above every power of two of 1 µs to 1 ms do not")

    @case(f"{clause}-lengths", title, needs=timer.needs, depth=depth)
    def every_length(board: BoardClient) -> None:
        shortest_ms, most_ms = board.clock.timer_ms(least_ms), timer.most_ms(board)
        for length_ms in wrapping_timer_lengths(shortest_ms, most_ms, thorough=board.thorough):
            _timer_stays(board, timer, length_ms)

    return every_length


TIMERS_DO_NOT_WRAP: Final = (
    _wrapping_case("HG-12.2/1", LEASE, "leases {} run out at once", 20),
    _wrapping_case("HG-12.3/1", HOLD, "holds {} run out at once", 1),
    _wrapping_case("HG-7.6/5", UNATTENDED, "unattended times {} run out at once", 1, Depth.DEFAULT),
    _wrapping_case("HG-6.11/2", RAMP, "ramps {} end at once", 60),
)


def _timer_stays(board: BoardClient, timer: TimerKind, length_ms: int) -> None:
    """FAILED if a timer of *length_ms* expires early, within its first 30 ms."""
    since = board.link.mark()
    start_us = timer.start(board, length_ms)
    board.wire.idle_beyond(min(_LOOK_MS, length_ms - 2 * _OVER_MS) * _MS)
    for header, event in board.link.events(m.StateChanged, since):
        # By the board's own clock: a host that was held up may have let the whole length pass.
        took_us = board.clock.unwrap(header.time_us) - start_us
        text = f"{timer.name} = {length_ms}: {event.reason.name} within {took_us / _MS:.1f} ms"
        check(took_us >= length_ms * _MS - EXACT_US, text)
    board.mute()


@case("HG-9.1/1-lengths", needs=m.Feature.CONFIG)
def every_status_period_does_not_wrap(board: BoardClient) -> None:
    """status periods just above every power of two of 1 µs to 1 ms bring no STATUS at once"""
    for length_ms in wrapping_timer_lengths(board.quick_status_ms, 65_535, thorough=board.thorough):
        set_us = board.clock.device_us()
        board.configure(status_period_ms=length_ms)
        since = board.link.mark()
        look_us = min(_LOOK_MS, length_ms - 2 * _OVER_MS) * _MS
        board.wire.idle(look_us)  # a host that is held up sees what came in its time, too
        times = [board.clock.unwrap(h.time_us) for h, _ in board.link.events(m.Status, since)]
        got = sum(t_us - set_us < look_us for t_us in times)
        text = f"status_period_ms = {length_ms}: {got} STATUS within {look_us // _MS} ms"
        check_equal(got, 0, text)


@case("HG-6.11/5-timers", needs=m.Feature.CONFIG | m.Feature.AMPLITUDE, depth=Depth.DEFAULT)
def every_timer_ends_in_a_ramp(board: BoardClient) -> None:
    """hold, lease and unattended time each mute after their ramp, with their reason, counted
    once
    """
    ramp_ms = 270  # of other lengths: HG-6.11/5-pairs
    length_ms = board.clock.timer_ms(60, 2 * board.identity.transducers + 200)
    for timer in timer_kinds(board, HOLD, LEASE, UNATTENDED):
        with board.counting(timeouts=1):
            timer.judge_whole(board, length_ms, f"{timer.reason.name}, ramp", ramp_ms=ramp_ms)


# --- Whole lengths -----------------------------------------------------------------------------


@case("HG-12.1/1-whole", needs=m.Feature.CONFIG, wall_depth=Depth.FULL)
def every_timer_passes_its_whole_length(board: BoardClient) -> None:
    """lease, hold, ramp and unattended time of lengths up to the greatest end within 1 ms"""
    for timer in timer_kinds(board):
        lengths = [most_ms := timer.most_ms(board)]
        if board.wire.is_virtual:
            least_ms = board.clock.timer_ms(CONFIG_BOUNDS.get(timer.name, (1, most_ms))[0])
            lengths = [*wrapping_timer_lengths(least_ms, most_ms), most_ms]
        for length_ms in lengths:
            timer.judge_whole(board, length_ms)


@case("HG-9.1/1-whole", needs=m.Feature.CONFIG, wall_depth=Depth.FULL)
def every_status_period_passes_as_a_whole(board: BoardClient) -> None:
    """status periods of every length up to the greatest pass as a whole"""
    lengths = [65_535]
    if board.wire.is_virtual:
        lengths = [*wrapping_timer_lengths(board.quick_status_ms, lengths[0]), *lengths]
    for length_ms in lengths:
        before_us = board.clock.device_us()
        board.configure(status_period_ms=length_ms)
        since, start_us = board.link.mark(), board.clock.device_us()
        name = f"status_period_ms = {length_ms}"
        header, _ = board.due_event(m.Status, since, (length_ms + 1000) * _MS, name)
        late_us = board.clock.unwrap(header.time_us) - start_us - length_ms * _MS
        text = f"status_period_ms = {length_ms}: STATUS {late_us / _MS:+.1f} ms off"
        check(before_us - start_us - EXACT_US <= late_us <= EXACT_US, text)


def _wait_before_timer_wrap(board: BoardClient, before_us: int) -> int:
    """Wait until *before_us* before the next wrap of the device clock; return the wrap's time.

    Meanwhile the board is DISARMED, and asked for its time every 30 minutes, so that the host's
    unwrapped time stays right.
    """
    now_us = board.clock.device_us()
    wrap_us = -(-(now_us + before_us + 1000) // _WRAP_US) * _WRAP_US
    while (left_us := wrap_us - before_us - board.clock.device_us()) > 0:
        board.wire.idle(min(left_us, _WRAP_US // 2 - 1_000_000))
    return wrap_us


@case(
    "HG-3.6/1-sides",
    needs_reset=True,
    before_wrap_us=1_000_000,
    evidence=SELF_REPORTED,
    depth=Depth.DEFAULT,
)
def every_drop_on_both_sides_of_the_wrap(board: BoardClient) -> None:
    """frames are dropped by the same rules on both sides of 2^32 µs; a playback starts across it"""
    board.prepare()
    kind = stream_kinds(board)[0]
    for side in ("before", "after"):
        for drop in DROPS:
            with named(f"{side} 2^32 µs, frames {drop.summary}"):
                judge_drop(board, drop, kind)
        if side == "before" and board.has(TRACED_PLAYS):
            _play_across_timer_wrap(board)
        board.clock.wait_until(_WRAP_US + 100 * _MS)


def _play_across_timer_wrap(board: BoardClient) -> None:
    """FAILED unless a playback just after the clock's wrap, and one across it, latch as due.

    They start 30 ms after and 30 ms before a wrap; at a wall clock only the first one is played.
    """
    lead_us = board.clock.ready_us(100 * _MS + 2 * board.wire.limits.lead_us)
    for offset_us in (30 * _MS, -30 * _MS):
        playback.send_phases_to_store(board, _SEQUENCE, frames=_FRAMES)
        board.configure(trace_mode=m.TraceMode.CRC)
        wrap_us = _wait_before_timer_wrap(board, lead_us)
        start_us = board.clock.on_carrier(wrap_us + offset_us)
        with named(f"a playback from {offset_us:+d} µs of the wrap on"):
            judge_playback(board, m.TraceMode.CRC, _SEQUENCE, _FRAMES, 1, 10 * _MS, start_us)
        if not board.wire.is_virtual:
            return  # at a wall clock the next wrap is 71 minutes away
        board.disarm()


@case("HG-12.1/1-wrap", needs=m.Feature.CONFIG, needs_reset=True, wall_depth=Depth.FULL)
def every_timer_crosses_the_wrap(board: BoardClient) -> None:
    """STATUS, lease, hold, ramp and unattended time that run across 2^32 µs end at their times"""
    board.prepare()
    board.need(m.Feature.CONFIG)
    for timer in timer_kinds(board):
        board.configure(host_timeout_ms=10_000)
        wrap_us = _wait_before_timer_wrap(board, 100 * _MS)
        since = board.link.mark()
        start_us = timer.start(board, 200)
        if timer is HOLD and board.has(m.Feature.READ_LATCHED):
            told_us, shown_us = (
                board.status().last_latch_us,
                latching.read_back(board).reply.t_latch_us,
            )
            check_equal(shown_us, told_us, f"READ_DRIVE: latched at {shown_us}, STATUS disagrees")
        timer.judge(board, since, start_us, 200, f"{timer.name} across {wrap_us} µs")
        if not board.wire.is_virtual:
            return
    period_ms = board.quick_status_ms
    wrap_us = _wait_before_timer_wrap(board, 5 * period_ms * _MS // 2)
    board.configure(status_period_ms=period_ms)
    since = board.link.mark()
    board.wire.idle(6 * period_ms * _MS)
    judge_status_period(board, since, period_ms, 5, f"6 periods across {wrap_us} µs")


# --- The hold ----------------------------------------------------------------------------------


@case("HG-6.10/1-types", needs=m.Feature.CONFIG, depth=Depth.DEFAULT)
def every_other_frame_leaves_the_hold(board: BoardClient) -> None:
    """dropped frames of every kind and every request leave the hold as it runs; only latches do
    not
    """
    drops = [drop for drop in DROPS if drop.armed and drop.queued >= 0]
    names = [_REQUESTS, *(d.summary for d in sorted(drops, key=lambda drop: drop.queued))]
    parts = -(-_time_of_all_ms(board) // _MOST_HOLD_MS)  # more than one on a slow line
    for first in range(parts):
        judge_unmoved(HOLD.name, partial(_hold_late_us, board), names[first::parts])


def _length_of_hold_ms(board: BoardClient) -> int:
    """Return a hold in ms, as long as the frames of the case take on the line, at most 7000."""
    return min(_MOST_HOLD_MS, _time_of_all_ms(board))


def _time_of_all_ms(board: BoardClient) -> int:
    """Return the time that requests and frames of every kind take on the line, at most.

    It is in ms, 700 or more.
    """
    sizes = sum(len(kind.make().serialize()) + 20 for kind in stream_kinds(board))
    return board.clock.timer_ms(700, 8 * len(DROPS) * sizes)


def _hold_late_us(board: BoardClient, names: Sequence[str]) -> int:
    """Return by how many µs the hold mutes late (negative: early) when dropped frames come in it.

    *names* are the reasons of the drops, or stand for requests; the hold counts from the latch.
    """
    hold_ms = _length_of_hold_ms(board)
    board.hello()
    since = board.arm(hold_ms=hold_ms)
    start_us = latching.latch_timed(board)
    board.wire.idle(30 * _MS)
    for name in names:
        if name == _REQUESTS:
            _ask_all_during_hold(board)
        else:
            _send_all_during_hold(board, _DROPS[name], (hold_ms + 1000) * _MS)
    board.clock.require_before(start_us + (hold_ms - 20) * _MS, "everything within the hold")
    header, _ = judged_mute_by_timer(board, since, 3 * hold_ms * _MS, MuteReason.HOLD_EXPIRED)
    return board.clock.unwrap(header.time_us) - start_us - hold_ms * _MS


def _send_all_during_hold(board: BoardClient, drop: Drop, ahead_us: int) -> None:
    """Send the frames of *drop*, in every format, while the hold runs.

    If the drop needs a frame in the queue, one due in *ahead_us* is sent first.
    """
    last_us = fill_queue(board, 1, ahead_us) if drop.queued else 0
    for kind in stream_kinds(board):
        board.link.send(*drop.frames(board, kind, last_us))


def _ask_all_during_hold(board: BoardClient) -> None:
    """Send every request that must not change a running hold: accepted, refused, and HELLO."""
    for message in valid_requests_to_send(board, STORED):
        if message.TYPE.name not in ("DISARM", "PLAY"):
            board.link.ask(message)
    for refusal in requests_refused_while_armed(board):
        judged_refusal(board, refusal)
    board.hello(board.link.session)


@case("HG-12.3/1-ramp", needs=m.Feature.CONFIG | m.Feature.AMPLITUDE, depth=Depth.DEFAULT)
def every_request_leaves_the_ramp_of_a_hold(board: BoardClient) -> None:
    """during a ramp of the hold no request, ARM and SET_CONFIG among them, ends or moves it"""
    hold_ms, ramp_ms = 60, min(2000, _length_of_hold_ms(board))
    since = board.arm(hold_ms=hold_ms, ramp_ms=ramp_ms)
    start_us = latching.latch_timed(board)
    board.clock.idle_until(start_us + (hold_ms + 20) * _MS)
    _ask_all_during_hold(board)
    board.configure(hold_ms=10_000, ramp_ms=1)
    last_us = start_us + (hold_ms + ramp_ms - 20) * _MS
    board.clock.require_before(last_us, "everything within the ramp")
    HOLD.judge(board, since, start_us, hold_ms + ramp_ms, "hold and ramp")


@case("HG-12.3/1-playback", needs=PLAYS, depth=Depth.DEFAULT)
def every_played_latch_restarts_the_hold(board: BoardClient) -> None:
    """during a playback longer than the hold each latch restarts it; after it the hold runs out"""
    board.configure(hold_ms=100)
    playback.send_phases_that_fit(board, STORED, frames=2)
    since = board.arm()
    playback.play_now(board, STORED, loops=50, period_us=4 * _MS)
    name = "a playback of 400 ms with a hold of 100 ms"
    board.due_event(m.PlaybackEnded, since, 600 * _MS, name)
    start_us = board.last_latch_us()
    HOLD.judge(board, since, start_us, 100, "after the last frame of a playback")


@case("HG-12.3/1-stop", needs=PLAYS, depth=Depth.DEFAULT)
def every_stop_leaves_the_hold(board: BoardClient) -> None:
    """PLAY, a playback that waits, STOP and ARM leave the hold of the last latch as it runs"""
    playback.send_phases_that_fit(board, STORED, frames=2)
    for name in ("a playback that waits, muted", "a playback that waits", "a slow playback"):
        board.hello()
        since = board.arm(hold_ms=TIMER_MS)
        if name == "a slow playback":
            playback.play_now(board, STORED, loops=0, period_us=SLOW_US)
            board.clock.wait_latched()
        else:
            latching.latch_now(board)
        start_us = board.last_latch_us()
        board.clock.idle_until(start_us + 40 * _MS)
        if name != "a slow playback":
            play_later_than_timer(board, 2 * TIMER_MS, 2 * TIMER_MS)
        board.clock.idle_until(start_us + 80 * _MS)
        if not name.endswith("muted"):
            board.stop()
        board.arm()
        HOLD.judge(board, since, start_us, TIMER_MS, f"hold_ms behind {name}")


@case("HG-6.10/1-silent", needs=m.Feature.CONFIG, depth=Depth.DEFAULT)
def every_silent_drive_is_held(board: BoardClient) -> None:
    """drives without sound, of amplitude 0 or under a ceiling of 0, are held and traced as
    others
    """
    silent: dict[str, tuple[m.Message, int]] = {}
    if board.has(m.Feature.AMPLITUDE):
        codes = board.random_registers() + bytes(board.identity.transducers)
        silent["DRIVES of amplitude 0"] = m.Drives(codes), latching.FULL
        silent["PHASES under a ceiling of 0"] = board.flat_phases(5), 0
    if board.has(m.Feature.POINTS):
        points = (m.FocalPoint(10_000, 5_000, 150_000, 0, 0),)
        silent["POINTS of amplitude 0"] = m.Points(points), latching.FULL
    mode = m.TraceMode.CRC if board.has(m.Feature.TRACE) else m.TraceMode.OFF
    for name, (message, ceiling) in silent.items():
        since = board.arm(hold_ms=_SILENT_MS, amplitude_ceiling=ceiling, trace_mode=mode)
        with board.counting(latched=1, accepted=1, timeouts=1):
            start_us = latching.latch_timed(board, message)
            HOLD.judge(board, since, start_us, _SILENT_MS, name)
        traced = len(board.link.events(m.Trace, since))
        check_equal(traced, mode is m.TraceMode.CRC, f"{name}: {traced} traces of one latch")


# --- Latches that end its ramp -----------------------------------------------------------------


@case("HG-6.11/4-latches", needs=SHOWN_RAMPS, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_latch_ends_the_ramp_of_a_hold(board: BoardClient) -> None:
    """in a ramp of the hold every latch restores the output: at once, queued, late, played"""
    full = bytes([latching.FULL]) * board.identity.transducers
    ways = ["at once", "queued", "queued, with others behind it", "late"]
    if board.has(m.Feature.SEQUENCE_PHASES):
        playback.send_phases_that_fit(board, STORED, frames=2)
        ways += ["played", "played later"]
    for way in ways:
        board.hello()
        board.arm(hold_ms=_HELD_MS, ramp_ms=_FADING_MS, late_window_us=100_000)
        board.clock.require_horizon((2 * _HELD_MS + 8000 * way.endswith("it")) * _MS)
        start_us = latching.latch_timed(board)
        at_us = board.clock.on_carrier(start_us + 2 * _HELD_MS * _MS)
        if way.startswith("queued"):
            number = 3 if "others" in way else 1
            times = [at_us + 4_000_000 * place for place in range(number)]
            board.link.send(*(board.link.stream_wire(board.flat_phases(), t_us) for t_us in times))
        if way == "played later":
            playback.play_at(board, STORED, at_us, loops=0, period_us=9_000_000, unattended_ms=9000)
        board.clock.idle_until(at_us - 60 * _MS)
        faded = latching.read_back_radiated(board).loudest
        if board.clock.device_us() < at_us:
            check(faded < latching.FULL, f"{way}: no ramp of the hold begins")
        board.clock.wait_until(board.clock.ready_us(at_us))
        if way == "at once":
            latching.latch_now(board)
        elif way == "late":
            board.link.stream(board.flat_phases(), board.late_time_us(20 * _MS))
            board.clock.wait_latched(0)
        elif way == "played":
            playback.play_now(board, STORED, loops=0, period_us=SLOW_US)
            board.clock.wait_latched(0)
        latched_us = board.last_latch_us()
        reading = judged_ramp_reading(board, latched_us + _HELD_MS * _MS)
        # Behind that the ramp that was to end would be over, too.
        last_us = latched_us + (_HELD_MS + _FADING_MS - 100) * _MS
        board.clock.require_before(last_us, "a read-back after the latch")
        judge_straight_ramp(board, [reading], _FADING_MS, full, f"a frame {way}, ")
