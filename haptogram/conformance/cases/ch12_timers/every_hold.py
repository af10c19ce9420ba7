"""HG-6.10, HG-6.11, HG-12.3: the hold runs from the last latch, whatever else comes."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Final

from haptogram_protocol.messages import (
    Arm,
    Drives,
    Feature,
    FocalPoint,
    Message,
    PlaybackEnded,
    PlayReply,
    Points,
    Stop,
    StopReply,
    Trace,
    TraceMode,
)
from haptogram_protocol.state import MuteReason

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.capabilities import PLAYS, SHOWN_RAMPS
from ...client.latching import FULL, latch_now, latch_timed, read_back_radiated
from ...client.playback import play_now, play_request, send_phases_that_fit
from ...client.stream_kinds import stream_kinds, valid_requests_to_send
from ...judge.ramps import judge_straight_ramp, judged_ramp_reading
from ...judge.refused_requests import judged_refusal, requests_refused_while_armed
from ...judge.timers import HOLD, judge_unmoved, judged_mute_by_timer
from ...outcome import SELF_REPORTED, check, check_equal
from ..ch05_stream.every_drop import DROPS, Drop, fill_queue
from .every_restart import SLOW_US, STORED, TIMER_MS, play_later_than_timer

_MS: Final = 1000
_SILENT_MS: Final = 70
_HELD_MS: Final = 120  # a hold, and a ramp that lasts longer than a host is held up
_FADING_MS: Final = 2000
_MOST_HOLD_MS: Final = 7000
_REQUESTS: Final = "requests"
_DROPS: Final = {drop.summary: drop for drop in DROPS}


@case("HG-6.10/1-types", needs=Feature.CONFIG, depth=Depth.DEFAULT)
def nothing_else_restarts_the_hold(board: BoardClient) -> None:
    """dropped frames of every kind and every request leave the hold as it runs; only latches do
    not
    """
    drops = [drop for drop in DROPS if drop.armed and drop.queued >= 0]
    names = [_REQUESTS, *(d.summary for d in sorted(drops, key=lambda drop: drop.queued))]
    parts = -(-_time_of_all_ms(board) // _MOST_HOLD_MS)  # more than one on a slow line
    for first in range(parts):
        judge_unmoved(HOLD.name, partial(_hold_late_us, board), names[first::parts])


def _length_of_hold_ms(board: BoardClient) -> int:
    """Return a hold that is longer than what is sent within it takes on the line."""
    return min(_MOST_HOLD_MS, _time_of_all_ms(board))


def _time_of_all_ms(board: BoardClient) -> int:
    """Return the time that requests and frames of every kind take on the line, at most."""
    sizes = sum(len(kind.make().serialize()) + 20 for kind in stream_kinds(board))
    return board.clock.timer_ms(700, 8 * len(DROPS) * sizes)


def _hold_late_us(board: BoardClient, names: Sequence[str]) -> int:
    """Return how late the hold mutes, with requests or dropped frames of a kind meanwhile."""
    hold_ms = _length_of_hold_ms(board)
    board.hello()
    since = board.arm(hold_ms=hold_ms)
    start_us = latch_timed(board)
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
    last_us = fill_queue(board, 1, ahead_us) if drop.queued else 0
    for kind in stream_kinds(board):
        board.link.send(*drop.frames(board, kind, last_us))


def _ask_all_during_hold(board: BoardClient) -> None:
    """Send every request that leaves the hold as it runs: carried out, refused, and HELLO again."""
    for message in valid_requests_to_send(board, STORED):
        if message.TYPE.name not in ("DISARM", "PLAY"):
            board.link.ask(message)
    for refusal in requests_refused_while_armed(board):
        judged_refusal(board, refusal)
    board.hello(board.link.session)


@case("HG-12.3/1-ramp", needs=Feature.CONFIG | Feature.AMPLITUDE, depth=Depth.DEFAULT)
def nothing_else_ends_the_ramp_of_a_hold(board: BoardClient) -> None:
    """during a ramp of the hold no request, ARM and SET_CONFIG among them, ends or moves it"""
    hold_ms, ramp_ms = 60, min(2000, _length_of_hold_ms(board))
    since = board.arm(hold_ms=hold_ms, ramp_ms=ramp_ms)
    start_us = latch_timed(board)
    board.clock.idle_until(start_us + (hold_ms + 20) * _MS)
    _ask_all_during_hold(board)
    board.configure(hold_ms=10_000, ramp_ms=1)
    last_us = start_us + (hold_ms + ramp_ms - 20) * _MS
    board.clock.require_before(last_us, "everything within the ramp")
    HOLD.judge(board, since, start_us, hold_ms + ramp_ms, "hold and ramp")


@case("HG-12.3/1-playback", needs=PLAYS, depth=Depth.DEFAULT)
def playback_restarts_the_hold(board: BoardClient) -> None:
    """during a playback longer than the hold each latch restarts it; after it the hold runs out"""
    board.configure(hold_ms=100)
    send_phases_that_fit(board, STORED, frames=2)
    since = board.arm()
    play_now(board, STORED, loops=50, period_us=4 * _MS)
    name = "a playback of 400 ms with a hold of 100 ms"
    board.due_event(PlaybackEnded, since, 600 * _MS, name)
    start_us = board.last_latch_us()
    HOLD.judge(board, since, start_us, 100, "after the last frame of a playback")


@case("HG-12.3/1-stop", needs=PLAYS, depth=Depth.DEFAULT)
def stop_leaves_the_hold(board: BoardClient) -> None:
    """PLAY, a playback that waits, STOP and ARM leave the hold of the last latch as it runs"""
    send_phases_that_fit(board, STORED, frames=2)
    for name in ("a playback that waits, muted", "a playback that waits", "a slow playback"):
        board.hello()
        since = board.arm(hold_ms=TIMER_MS)
        if name == "a slow playback":
            play_now(board, STORED, loops=0, period_us=SLOW_US)
            board.clock.wait_latched()
        else:
            latch_now(board)
        start_us = board.last_latch_us()
        board.clock.idle_until(start_us + 40 * _MS)
        if name != "a slow playback":
            play_later_than_timer(board, 2 * TIMER_MS, 2 * TIMER_MS)
        board.clock.idle_until(start_us + 80 * _MS)
        if not name.endswith("muted"):
            board.link.call(Stop(), StopReply)
        board.link.ask(Arm())
        HOLD.judge(board, since, start_us, TIMER_MS, f"hold_ms behind {name}")


@case("HG-6.10/1-silent", needs=Feature.CONFIG, depth=Depth.DEFAULT)
def silent_drives_are_held_by_the_hold(board: BoardClient) -> None:
    """drives without sound, of amplitude 0 or under a ceiling of 0, are held and traced as
    others
    """
    silent: dict[str, tuple[Message, int]] = {}
    if board.has(Feature.AMPLITUDE):
        codes = board.random_registers() + bytes(board.identity.transducers)
        silent["DRIVES of amplitude 0"] = Drives(codes), FULL
        silent["PHASES under a ceiling of 0"] = board.flat_phases(5), 0
    if board.has(Feature.POINTS):
        points = (FocalPoint(10_000, 5_000, 150_000, 0, 0),)
        silent["POINTS of amplitude 0"] = Points(points), FULL
    mode = TraceMode.CRC if board.has(Feature.TRACE) else TraceMode.OFF
    for name, (message, ceiling) in silent.items():
        since = board.arm(hold_ms=_SILENT_MS, amplitude_ceiling=ceiling, trace_mode=mode)
        with board.counting(latched=1, accepted=1, timeouts=1):
            start_us = latch_timed(board, message)
            HOLD.judge(board, since, start_us, _SILENT_MS, name)
        traced = len(board.link.events(Trace, since))
        check_equal(traced, mode is TraceMode.CRC, f"{name}: {traced} traces of one latch")


# --- Latches that end its ramp -----------------------------------------------------------------


@case("HG-6.11/4-latches", needs=SHOWN_RAMPS, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_latch_ends_the_ramp_of_a_hold(board: BoardClient) -> None:
    """in a ramp of the hold every latch restores the output: at once, queued, late, played"""
    full = bytes([FULL]) * board.identity.transducers
    ways = ["at once", "queued", "queued, with others behind it", "late"]
    if board.has(Feature.SEQUENCE_PHASES):
        send_phases_that_fit(board, STORED, frames=2)
        ways += ["played", "played later"]
    for way in ways:
        board.hello()
        board.arm(hold_ms=_HELD_MS, ramp_ms=_FADING_MS, late_window_us=100_000)
        board.clock.require_horizon((_HELD_MS + 200 + 8000 * way.endswith("it")) * _MS)
        start_us = latch_timed(board)
        at_us = board.clock.on_carrier(start_us + (_HELD_MS + 200) * _MS)  # a tenth of the ramp
        if way.startswith("queued"):
            number = 3 if "others" in way else 1
            times = [at_us + 4_000_000 * place for place in range(number)]
            board.link.send(*(board.link.stream_wire(board.flat_phases(), t_us) for t_us in times))
        if way == "played later":
            play = play_request(board, STORED, loops=0, period_us=9_000_000, unattended_ms=9000)
            board.link.call(play, PlayReply, time_us=at_us)
        board.clock.idle_until(at_us - 60 * _MS)
        faded = read_back_radiated(board).loudest
        if board.clock.device_us() < at_us:
            check(faded < FULL, f"{way}: no ramp of the hold begins")
        board.clock.wait_until(board.clock.ready_us(at_us))
        if way == "at once":
            latch_now(board)
        elif way == "late":
            board.link.stream(board.flat_phases(), board.late_time_us(20 * _MS))
            board.clock.wait_latched(0)
        elif way == "played":
            play_now(board, STORED, loops=0, period_us=SLOW_US)
            board.clock.wait_latched(0)
        latched_us = board.last_latch_us()
        reading = judged_ramp_reading(board, latched_us + _HELD_MS * _MS)
        # Behind that the ramp that was to end would be over, too.
        last_us = latched_us + (_HELD_MS + _FADING_MS - 100) * _MS
        board.clock.require_before(last_us, "a read-back after the latch")
        judge_straight_ramp(board, [reading], _FADING_MS, full, f"a frame {way}, ")
