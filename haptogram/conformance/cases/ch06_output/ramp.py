"""HG-6.7, HG-6.10, HG-6.11: lease, hold, and the ramp at their end."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Final

from haptogram_protocol.framing import encode_frame
from haptogram_protocol.messages import Feature, Ping, PlaybackEnded, StateChanged
from haptogram_protocol.state import MuteReason

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.latching import FULL, latch_now, read_back_radiated
from ...client.playback import play_now, send_phases_that_fit
from ...judge.ramps import RampReading, judge_straight_ramp, judged_ramp, judged_ramp_reading
from ...judge.timers import judge_lease_ends, judge_mute_time, judged_mute_by_timer
from ...outcome import SELF_REPORTED, check, check_equal

_MS: Final = 1000
_HOLD_MS: Final = 100
_RAMPS: Final = Feature.CONFIG | Feature.AMPLITUDE | Feature.READ_RADIATED


@case("HG-6.7/1", needs=Feature.CONFIG, depth=Depth.DEFAULT)
def any_frame_renews_the_output_lease(board: BoardClient) -> None:
    """frames dropped for type, flags, length, number or time renew the lease; stale frames do
    not
    """
    board.configure(host_timeout_ms=600)  # a busy emulator may miss a few frames' time
    good = board.flat_phases()
    kinds: dict[str, Callable[[], bytes]] = {
        "an unknown event": lambda: encode_frame(board.link.body(0xEE, b"", seq=0)),
        "a stream frame seen before": lambda: board.link.stream_wire(good, seq=0xFF00),
        "a stream frame of a wrong length": lambda: board.link.stream_raw(1, b"\x08"),
        "a request with unknown flags": lambda: board.link.request_wire(Ping(0), flags=0x40)[0],
        "a stream frame for the past": lambda: board.link.stream_wire(
            good, board.clock.device_us() - 10**6
        ),
    }
    for name, make in kinds.items():
        since = board.arm()
        for _ in range(7):
            board.link.send(make())
            board.wire.idle(100 * _MS)
        check(not board.link.events(StateChanged, since), f"{name} does not renew the lease")
    since = board.link.mark()
    stale = board.link.session ^ 0x00F0
    for _ in range(8):
        board.link.send(encode_frame(board.link.body(0xEE, b"", seq=0, session=stale)))
        board.wire.idle(100 * _MS)
    judge_lease_ends(board, since, "frames of another session renew the lease")


@case("HG-6.10/1", needs=Feature.CONFIG)
def mutes_the_output_after_hold(board: BoardClient) -> None:
    """a sounding board whose stream stops is muted by the hold"""
    since = board.arm(hold_ms=60)
    latch_now(board)
    judged_mute_by_timer(board, since, 200 * _MS, MuteReason.HOLD_EXPIRED)
    check_equal(board.status().reason, MuteReason.HOLD_EXPIRED, "STATUS does not say HOLD_EXPIRED")


def _ramp_of_output(board: BoardClient, *, ramp_ms: int) -> list[RampReading]:
    """Return what is radiated from before a ramp of the hold to behind its end."""
    board.arm(hold_ms=_HOLD_MS, ramp_ms=ramp_ms)
    latch_now(board)
    return judged_ramp(board, hold_ms=_HOLD_MS, ramp_ms=ramp_ms)


@case("HG-6.11/1", needs=_RAMPS, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def output_ramps_do_not_rise(board: BoardClient) -> None:
    """during a ramp the amplitude in read-backs never rises"""
    ramp = _ramp_of_output(board, ramp_ms=300)
    for before, after in itertools.pairwise(ramp):
        rises = [b for a, b in zip(before.amplitudes, after.amplitudes, strict=True) if b > a]
        text = f"{after.from_ms:.1f} ms into the ramp the amplitude rises to "
        check(not rises, f"{text}{max(rises, default=0)}")


@case("HG-6.11/2", needs=_RAMPS, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def output_ramps_reach_silence(board: BoardClient) -> None:
    """the amplitude is full before a ramp, is that of a straight line within it, and then 0"""
    ramp_ms = 400
    ramp = _ramp_of_output(board, ramp_ms=ramp_ms)
    judge_straight_ramp(board, ramp, ramp_ms, bytes([FULL]) * board.identity.transducers)


@case("HG-6.11/3")
def hard_mute_has_no_ramp(board: BoardClient) -> None:
    """with ramp_ms = 0 the board is muted right at the end of the hold"""
    since = board.arm(hold_ms=80, ramp_ms=0)
    latch_now(board)
    start_us = board.last_latch_us()
    header, _ = judged_mute_by_timer(board, since, 200 * _MS, MuteReason.HOLD_EXPIRED)
    judge_mute_time(board, start_us, header, 80, "hold_ms = 80, ramp_ms = 0")


@case("HG-6.11/4", needs=_RAMPS, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def output_ramps_are_renewed(board: BoardClient) -> None:
    """a latch ends the ramp of the hold, a request does not; any frame ends the lease's ramp"""
    board.arm(hold_ms=_HOLD_MS, ramp_ms=600)
    latch_now(board)
    board.wire.idle(300 * _MS)
    board.link.barrier()
    check(read_back_radiated(board).loudest < FULL, "a request ends the ramp of the hold")
    latch_now(board)
    loudest = read_back_radiated(board).loudest
    check_equal(loudest, FULL, "a latch does not end the ramp of the hold")
    since = board.arm(host_timeout_ms=100, ramp_ms=600)
    latch_now(board)
    board.wire.idle(400 * _MS)
    loudest = read_back_radiated(board).loudest
    check_equal(loudest, FULL, "a frame does not end the ramp of the lease")
    muted = board.link.events(StateChanged, since)
    check(not muted, "the lease muted the board before its ramp ended")


@case("HG-6.11/5", needs=Feature.CONFIG, evidence=SELF_REPORTED)
def output_ramps_end_muted(board: BoardClient) -> None:
    """a ramp ends in MUTED with its reason; the queue is flushed, timeouts + 1"""
    hold_ms = board.clock.timer_ms(60, 2 * board.identity.transducers + 200)
    ramp_ms = 60 if board.has(Feature.AMPLITUDE) else 0
    board.arm(hold_ms=hold_ms, ramp_ms=60)
    with board.counting(timeouts=1, flushed=1, latched=1):
        since = board.link.mark()
        latch_now(board)
        start_us = board.last_latch_us()
        board.clock.require_horizon(2_000_000)
        board.link.stream(board.flat_phases(), start_us + 2_000_000)
        timeout_us = (400 + hold_ms) * _MS
        header, _ = judged_mute_by_timer(board, since, timeout_us, MuteReason.HOLD_EXPIRED)
    judge_mute_time(board, start_us, header, hold_ms + ramp_ms, "the hold and its ramp")


@case("HG-6.11/6-alone", needs=_RAMPS, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def output_ramps_go_on_as_they_began(board: BoardClient) -> None:
    """a higher ceiling and another ramp_ms, set during a ramp, leave its line; a lower one cuts
    it
    """
    hold_ms, ramp_ms, ceiling = 60, 240, 100
    since = board.arm(hold_ms=hold_ms, ramp_ms=ramp_ms, amplitude_ceiling=ceiling)
    latch_now(board)
    latch_us = board.last_latch_us()
    begins = bytes([ceiling]) * board.identity.transducers
    for wait_ms, then in ((hold_ms + ramp_ms // 4, FULL), (ramp_ms // 4, 20)):
        board.wire.idle(wait_ms * _MS)
        board.configure(hold_ms=hold_ms, ramp_ms=2 * ramp_ms, amplitude_ceiling=then)
        reading = judged_ramp_reading(board, latch_us + hold_ms * _MS)
        name = f"ceiling {ceiling}, {then} meanwhile: "
        judge_straight_ramp(board, [reading], ramp_ms, begins, name, cut=min(ceiling, then))
    header, _ = judged_mute_by_timer(board, since, 3 * ramp_ms * _MS, MuteReason.HOLD_EXPIRED)
    judge_mute_time(board, latch_us, header, hold_ms + ramp_ms, "ramp_ms set meanwhile")


@case("HG-6.11/5-playback", needs=Feature.CONFIG | Feature.SEQUENCE_PHASES)
def output_ramps_end_playback(board: BoardClient) -> None:
    """at the end of a ramp a playback ends"""
    board.configure(hold_ms=50)
    send_phases_that_fit(board, 1, frames=2)
    since = board.arm()
    play_now(board, 1, loops=0, period_us=500_000)
    judged_mute_by_timer(board, since, 300 * _MS, MuteReason.HOLD_EXPIRED)
    board.due_event(PlaybackEnded, since, 50 * _MS, "a timer has muted the board")
