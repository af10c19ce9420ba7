"""HG-6.11: the ramp while two timers have run out."""

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
from ...judge.timers import judge_mute_time, judged_mute_by_timer
from ...outcome import SELF_REPORTED, check, named
from ..ch12_timers.every_restart import SLOW_US

_MS: Final = 1000
_SEQUENCE: Final = 6
#: Lengths on a fast line, in ms.
_SHORT_HOLD_MS: Final = 20  # runs out before the other timer
_LONG_HOLD_MS: Final = 120  # and behind it
_OTHER_MS: Final = 40
_RAMP_MS: Final = 150
_RENEWED_MS: Final = 145  # from the first latch: both timers have run out
_LONG_RAMP_MS: Final = 2000
_SLOW_LINE_US: Final = 20_000  # for 200 bytes, or to a latch; beyond it all lengths grow
_FRAME: Final = "a frame"
_LATCH: Final = "a latch"
_RAMPS_NEED: Final = Feature.CONFIG | Feature.AMPLITUDE
_OTHERS: Final = (MuteReason.HOST_SILENT, MuteReason.UNATTENDED)


@dataclass(frozen=True, slots=True)
class TimerPair:
    """The hold and another timer, which run out one behind the other.

    Attributes
    ----------
    other : MuteReason
        Of the other timer: HOST_SILENT or UNATTENDED.
    is_hold_first : bool
        Whether the hold runs out first, and begins the ramp.
    ramp_ms : int
        Length of the ramp.
    renewed_by : str
        A frame, which renews the other timer while both have run out, or a latch, which renews the
        hold; empty: nothing.
    """

    other: MuteReason
    is_hold_first: bool
    ramp_ms: int
    renewed_by: str = ""

    def __str__(self) -> str:
        names = [self.other.name]
        names.insert(not self.is_hold_first, "HOLD_EXPIRED")
        renewed = f", and {self.renewed_by} behind both" if self.renewed_by else ""
        return f"{' and then '.join(names)} in a ramp of {self.ramp_ms} ms{renewed}"


def _judge_timer_pairs(board: BoardClient, length_ms: int, *renewed_by: str) -> None:
    """Judge pairs of both other timers."""
    send_phases_to_store_if_supported(board, _SEQUENCE, frames=1)
    others = _OTHERS if board.has(Feature.SEQUENCE_PHASES) else _OTHERS[:1]
    ramp_ms = min(_LONG_RAMP_MS, _ramp_time_ms(board, length_ms))
    for other, is_hold_first, renewed in itertools.product(others, (True, False), renewed_by):
        pair = TimerPair(other, is_hold_first, ramp_ms, renewed)
        with named(str(pair)):
            _judge_end_of_ramp(board, pair)


def _ramp_time_ms(board: BoardClient, length_ms: int) -> int:
    """Return a length of time, or a longer one on a slow line, or for a slow board."""
    slow_line, slow_board = board.wire.period_us(200), board.clock.ready_us(0)
    return length_ms * max(1, slow_line // _SLOW_LINE_US, -(-slow_board // _SLOW_LINE_US))


def _judge_end_of_ramp(board: BoardClient, pair: TimerPair) -> None:
    """FAILED unless the ramp ends when it was due, with the timer that has run out, and once."""
    since = board.link.mark()
    with board.counting(timeouts=1):
        begins_us, both_us = _begin_ramp_of_pair(board, pair)
        if pair.renewed_by == _FRAME:
            board.clock.idle_until(both_us)
            frame_us = board.clock.device_us()
            board.clock.require_before(
                begins_us + pair.ramp_ms * _MS, "a frame in a ramp", frame_us
            )
        reason = pair.other
        if pair.renewed_by == _FRAME or (pair.is_hold_first and not pair.renewed_by):
            reason = MuteReason.HOLD_EXPIRED
        left_us = begins_us + pair.ramp_ms * _MS - board.clock.device_estimate_us()
        header, _ = judged_mute_by_timer(board, since, left_us + 50 * _MS, reason)
    judge_mute_time(board, begins_us, header, pair.ramp_ms, reason.name)
    if board.has(Feature.READ_RADIATED):
        check(is_board_silent(board), "transducers are driven behind the end")
    for kind, due in (StateChanged, 1), (PlaybackEnded, int(pair.other is MuteReason.UNATTENDED)):
        got = len(board.link.events(kind, since))
        check(got == due, f"{got} {kind.TYPE.name}, due are {due}")


def _begin_ramp_of_pair(board: BoardClient, pair: TimerPair) -> tuple[int, int]:
    """Let both timers run; return when the ramp begins, and when something renews one of them."""
    hold_ms = _ramp_time_ms(board, _SHORT_HOLD_MS if pair.is_hold_first else _LONG_HOLD_MS)
    other_ms = _ramp_time_ms(board, _OTHER_MS)
    settings: dict[str, Any] = {"hold_ms": hold_ms, "ramp_ms": pair.ramp_ms}
    if pair.other is MuteReason.HOST_SILENT:
        settings["host_timeout_ms"] = other_ms
    board.arm(**settings)
    ahead_us = board.clock.on_carrier(_ramp_time_ms(board, _RENEWED_MS) * _MS)
    if pair.other is MuteReason.UNATTENDED:
        period_us = ahead_us if pair.renewed_by == _LATCH else SLOW_US
        play_now(board, _SEQUENCE, loops=0, period_us=period_us, unattended_ms=other_ms)
        board.clock.wait_latched(0)
    else:
        latch_now(board)
    latch_us = board.last_latch_us()
    if pair.renewed_by == _LATCH and pair.other is MuteReason.HOST_SILENT:
        board.link.stream(board.flat_phases(), latch_us + ahead_us)
    asked_us = board.clock.device_us()
    hold_us, other_us = latch_us + hold_ms * _MS, asked_us + other_ms * _MS
    last_us = hold_us - (0 if pair.is_hold_first else other_ms * _MS)  # the PING renews a lease
    board.clock.require_before(last_us, "two timers that run out", asked_us)
    return min(hold_us, other_us), latch_us + ahead_us


@case("HG-6.11/5-pairs", needs=_RAMPS_NEED, evidence=SELF_REPORTED)
def the_first_timer_begins_the_ramp(board: BoardClient) -> None:
    """of two timers that run out the first begins the ramp, which mutes with its reason, once"""
    _judge_timer_pairs(board, _RAMP_MS, "")


@case("HG-6.11/4-pairs", needs=_RAMPS_NEED, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def the_ramp_goes_on(board: BoardClient) -> None:
    """a frame or a latch that renews one of two timers that have run out leaves the ramp as it
    is
    """
    reached = board.clock.horizon_us > 2 * _MS * _ramp_time_ms(board, _RENEWED_MS)
    _judge_timer_pairs(board, _RAMP_MS, _FRAME, *([_LATCH] if reached else []))
