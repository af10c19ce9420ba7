"""HG-6.11: the ramps of two timers that run at once, of equal and of different lengths.

A ramp keeps the ``ramp_ms`` of its beginning.  So that of the lease, or of the unattended time in
its place, may be shorter or longer than that of the hold which began before it: SET_CONFIG comes in
between.  A ramp of the hold that begins second has the length of the first, as SET_CONFIG would
have ended that.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any, Final

from haptogram_protocol.messages import Feature, PlaybackEnded, StateChanged
from haptogram_protocol.state import MuteReason

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.latching import is_board_silent, latch_now
from ...client.playback import play_now, send_phases_to_store_if_supported
from ...judge.timers import EXACT_US, judge_mute_time, judged_mute_by_timer
from ...outcome import SELF_REPORTED, CaseEndedError, check, inconclusive
from ..ch12_timers.every_restart import SLOW_US, wait_for_timer

_MS: Final = 1000
_SEQUENCE: Final = 6
#: Lengths on a fast line, in ms.
_SHORT_HOLD_MS: Final = 20  # runs out before the other timer
_LONG_HOLD_MS: Final = 120  # and behind it
_OTHER_MS: Final = 40
_SHORT_RAMP_MS: Final = 150
_UNDONE_MS: Final = 145  # from the first latch: both ramps run
_LONG_RAMP_MS: Final = 2000
_SLOW_LINE_US: Final = 20_000  # for 200 bytes, or to a latch; beyond it all lengths grow
_WATCHED_US: Final = 100_000  # at a wall clock, behind the first end
_FRAME: Final = "a frame"
_LATCH: Final = "a latch"
_RAMPS_NEED: Final = Feature.CONFIG | Feature.AMPLITUDE
_OTHERS: Final = (MuteReason.HOST_SILENT, MuteReason.UNATTENDED)


@dataclass(frozen=True, slots=True)
class RampPair:
    """A ramp of the hold and one of another timer, which run at once.

    Attributes
    ----------
    other : MuteReason
        Of the other timer: HOST_SILENT or UNATTENDED.
    is_hold_first : bool
        Whether the ramp of the hold begins first.
    hold_ramp_ms, other_ramp_ms : int
        Lengths of the two.
    undone_by : str
        A frame, which undoes the other timer's ramp, or a latch, which undoes the hold's; empty:
        both go on.
    """

    other: MuteReason
    is_hold_first: bool
    hold_ramp_ms: int
    other_ramp_ms: int
    undone_by: str = ""

    def __str__(self) -> str:
        names = [f"{self.other_ramp_ms} ms ({self.other.name})"]
        names.insert(not self.is_hold_first, f"{self.hold_ramp_ms} ms (HOLD_EXPIRED)")
        undone = f", and {self.undone_by} in both" if self.undone_by else ""
        return f"a ramp of {' and then one of '.join(names)}{undone}"


def ramp_pairs(board: BoardClient, other: MuteReason, undone_by: str = "") -> list[RampPair]:
    """Return every pair of ramps that can run at once, and of which one ends soon."""
    short = min(_LONG_RAMP_MS, _ramp_time_ms(board, _SHORT_RAMP_MS))
    found = [RampPair(other, False, short, short, undone_by)]
    for hold_ms, other_ms in itertools.product((_LONG_RAMP_MS, short), (0, short, _LONG_RAMP_MS)):
        if not other_ms and undone_by:
            continue  # the other ramp is over as it begins
        ends_late = other_ms if undone_by == _LATCH else min(hold_ms, other_ms)
        if ends_late < _LONG_RAMP_MS or short == _LONG_RAMP_MS:
            found.append(RampPair(other, True, hold_ms, other_ms, undone_by))
    return found


def _judge_ramp_pairs(board: BoardClient, *undone_by: str) -> None:
    """Judge pairs of both other timers; at a wall clock those of each are shared out."""
    send_phases_to_store_if_supported(board, _SEQUENCE, frames=1)
    others = _OTHERS if board.has(Feature.SEQUENCE_PHASES) else _OTHERS[:1]
    groups = list(itertools.product(others, undone_by))
    for turn, (other, undone) in enumerate(groups):
        pairs = ramp_pairs(board, other, undone)
        if board.wire.limits.slack_us:
            pairs = pairs[turn % len(pairs) :: 4 if undone else 2]
        for pair in pairs:
            _judge_pair_of_ramps(board, pair)


def _ramp_time_ms(board: BoardClient, length_ms: int) -> int:
    """Return a length of time, or a longer one on a slow line, or for a slow board."""
    slow_line, slow_board = board.wire.line_us(200), board.ready_after_us()
    return length_ms * max(1, slow_line // _SLOW_LINE_US, -(-slow_board // _SLOW_LINE_US))


@dataclass(slots=True)
class _FadingTimer:
    """A timer with its ramp: when it began on the device clock, and both lengths."""

    reason: MuteReason
    began_us: int
    length_ms: int
    ramp_ms: int

    @property
    def runs_out_us(self) -> int:
        return self.began_us + self.length_ms * _MS

    @property
    def end_us(self) -> int:
        return self.runs_out_us + self.ramp_ms * _MS


def _judge_pair_of_ramps(board: BoardClient, pair: RampPair) -> None:
    try:
        _judge_first_end_of_ramps(board, pair)
    except CaseEndedError as error:
        raise CaseEndedError(error.behaviour, f"{pair}: {error}") from None


def _judge_first_end_of_ramps(board: BoardClient, pair: RampPair) -> None:
    """FAILED unless the ramp that ends first mutes the board, at its end, and nothing else does."""
    since = board.link.mark()
    with board.counting(timeouts=1):
        hold, other = _begin_pair_of_ramps(board, pair)
        if pair.undone_by:
            _undo_one_of_ramps(board, pair, hold, other)
        first, second = sorted((hold, other), key=lambda timer: timer.end_us)
        if second.end_us - first.end_us <= 2 * EXACT_US:
            inconclusive("the host was held up, so that both ramps end at once")
        left_us = first.end_us - board.clock.device_estimate_us()
        header, _ = judged_mute_by_timer(board, since, left_us + 50 * _MS, first.reason)
    due_ms = first.length_ms + first.ramp_ms
    judge_mute_time(board, first.began_us, header, due_ms, first.reason.name)
    if board.has(Feature.READ_RADIATED):
        check(is_board_silent(board), "transducers are driven behind the end")
    board.configure()
    board.arm()
    if not board.wire.limits.slack_us or second.end_us - first.end_us < _WATCHED_US:
        wait_for_timer(board, second.end_us + 5 * _MS)
        board.link.barrier()
    for kind, due in (StateChanged, 1), (PlaybackEnded, int(pair.other is MuteReason.UNATTENDED)):
        got = len(board.link.events(kind, since))
        check(got == due, f"{got} {kind.TYPE.name}, due are {due}")


def _begin_pair_of_ramps(board: BoardClient, pair: RampPair) -> tuple[_FadingTimer, _FadingTimer]:
    """Latch a frame, and let the timers of hold and other run; the last frame was the host's."""
    hold_ms = _ramp_time_ms(board, _SHORT_HOLD_MS if pair.is_hold_first else _LONG_HOLD_MS)
    other_ms = _ramp_time_ms(board, _OTHER_MS)
    settings: dict[str, Any] = {"hold_ms": hold_ms}
    if pair.other is MuteReason.HOST_SILENT:
        settings["host_timeout_ms"] = other_ms
    board.configure(**settings, ramp_ms=pair.hold_ramp_ms)
    board.arm()
    ahead_us = board.clock.on_carrier(_ramp_time_ms(board, _UNDONE_MS) * _MS)
    if pair.other is MuteReason.UNATTENDED:
        period_us = ahead_us if pair.undone_by == _LATCH else SLOW_US
        play_now(board, _SEQUENCE, loops=0, period_us=period_us, unattended_ms=other_ms)
        board.clock.wait_latched(board.ready_after_us())
    else:
        latch_now(board, board.flat_phases())
    latch_us = board.clock.unwrap(board.status().last_latch_us)
    hold = _FadingTimer(MuteReason.HOLD_EXPIRED, latch_us, hold_ms, pair.hold_ramp_ms)
    if pair.undone_by == _LATCH and pair.other is MuteReason.HOST_SILENT:
        board.link.send(board.link.stream_wire(board.flat_phases(), latch_us + ahead_us))
    if pair.is_hold_first:
        wait_for_timer(board, hold.runs_out_us + 5 * _MS)
        board.configure(**settings, ramp_ms=pair.other_ramp_ms)
    asked_us = board.clock.device_us()
    over_us = min(hold.end_us, latch_us + (other_ms + pair.hold_ramp_ms) * _MS)
    if asked_us >= over_us or (pair.is_hold_first and asked_us <= hold.runs_out_us):
        inconclusive("the host or the line is too slow to set a ramp_ms within a ramp")
    return hold, _FadingTimer(pair.other, asked_us, other_ms, pair.other_ramp_ms)


def _undo_one_of_ramps(
    board: BoardClient, pair: RampPair, hold: _FadingTimer, other: _FadingTimer
) -> None:
    """Let a frame or a latch come while both ramps run, and start its timer anew."""
    both_us, over_us = max(hold.runs_out_us, other.runs_out_us), min(hold.end_us, other.end_us)
    at_us = hold.began_us + board.clock.on_carrier(_ramp_time_ms(board, _UNDONE_MS) * _MS)
    if pair.undone_by == _LATCH:
        # A playback latches again before this hold and its ramp are over: the other ends first.
        hold.began_us, hold.ramp_ms = at_us, pair.other_ramp_ms
    else:
        wait_for_timer(board, at_us)
        other.began_us = at_us = board.clock.device_us()
    if not both_us < at_us < over_us:
        inconclusive(f"the host or the line is too slow for {pair.undone_by} in two ramps")


@case(
    "HG-6.11/5",
    "of two ramps at once, of any lengths, the one that ends first mutes, with its reason, once",
    variant="pairs",
    needs=_RAMPS_NEED,
    evidence=SELF_REPORTED,
)
def the_ramp_that_ends_first_mutes(board: BoardClient) -> None:
    _judge_pair_of_ramps(board, RampPair(MuteReason.HOST_SILENT, True, _LONG_RAMP_MS, 0))
    if board.thorough:
        _judge_ramp_pairs(board, "")


@case(
    "HG-6.11/5",
    "of two long ramps at once the one that began first mutes, with its reason, once",
    variant="long-pairs",
    needs=_RAMPS_NEED,
    evidence=SELF_REPORTED,
    depth=Depth.DEFAULT,
    wall_depth=Depth.FULL,
)
def the_long_ramp_that_ends_first_mutes(board: BoardClient) -> None:
    send_phases_to_store_if_supported(board, _SEQUENCE, frames=1)
    for other in _OTHERS if board.has(Feature.SEQUENCE_PHASES) else _OTHERS[:1]:
        for is_hold_first in (True, False):
            pair = RampPair(other, is_hold_first, _LONG_RAMP_MS, _LONG_RAMP_MS)
            _judge_pair_of_ramps(board, pair)


@case(
    "HG-6.11/4",
    "of two ramps at once, of any lengths, a frame or a latch ends its own; the other one mutes",
    variant="pairs",
    needs=_RAMPS_NEED,
    evidence=SELF_REPORTED,
    depth=Depth.DEFAULT,
)
def the_other_ramp_goes_on(board: BoardClient) -> None:
    reached = board.clock.horizon_us > 2 * _MS * _ramp_time_ms(board, _UNDONE_MS)
    _judge_ramp_pairs(board, _FRAME, *([_LATCH] if reached else []))
