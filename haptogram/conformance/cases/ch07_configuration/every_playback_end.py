"""HG-3.6, HG-7.6, HG-7.8: playbacks that are ended at every moment, and what comes behind them."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Final

from haptogram_protocol.messages import (
    Disarm,
    GetStatus,
    Mute,
    Status,
    Stop,
)
from haptogram_protocol.state import MuteReason

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.capabilities import PLAYS
from ...client.latching import ask_for_board_latches, latches_received_from_board
from ...client.playback import (
    await_playback_end,
    period_to_play,
    play_later,
    play_now,
    send_phases_to_store,
)
from ...judge.timers import judged_mute_by_timer
from ...outcome import SELF_REPORTED, check, check_equal
from .playback import judge_end_told

_MS: Final = 1000
_SEQUENCE: Final = 5
_FRAMES: Final = 3
_AHEAD_US: Final = 3_000_000
_ALONE_MS: Final = 200
_SHORT_LEASE_MS: Final = 60

_Act = Callable[[BoardClient], object]


def _waiting_playback(board: BoardClient) -> None:
    play_later(board, _SEQUENCE, _AHEAD_US)


def _playback_in_its_first_frame(board: BoardClient) -> None:
    play_now(board, _SEQUENCE, loops=0, period_us=9_000_000)
    board.clock.wait_latched()


def _playback_in_a_later_frame(board: BoardClient) -> None:
    period_us = period_to_play(board)
    play_now(board, _SEQUENCE, loops=0, period_us=period_us)
    for _ in range(2 * (_FRAMES + 2)):
        board.wire.idle(period_us // 2)
        board.link.ask(GetStatus())  # a slow board is not left alone for so long


#: Moments of a playback, with the least number of frames that it has latched.
_MOMENTS: Final[dict[str, tuple[_Act, int]]] = {
    "that waits for its start": (_waiting_playback, 0),
    "in its first frame": (_playback_in_its_first_frame, 1),
    "in a later frame": (_playback_in_a_later_frame, _FRAMES + 1),
}
#: What ends a playback, but for its last frame and the timers.
_ENDS: Final[dict[str, _Act]] = {
    "STOP": lambda board: board.link.ask(Stop()),
    "MUTE": lambda board: board.link.ask(Mute()),
    "MUTE without a session": lambda board: board.link.ask(Mute(), session=0),
    "DISARM": lambda board: board.link.ask(Disarm()),
    "a new session": lambda board: board.hello(),
}


@case("HG-7.8/1-ends", needs=PLAYS, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_playback_end_is_told(board: BoardClient) -> None:
    """one PLAYBACK_ENDED tells of a playback that waits, in its first frame and later, by every
    end
    """
    send_phases_to_store(board, _SEQUENCE, frames=_FRAMES)
    for (moment, (bring, least)), (name, end) in itertools.product(_MOMENTS.items(), _ENDS.items()):
        board.arm()
        since, before = board.link.mark(), board.status().counters
        bring(board)
        end(board)
        latched = board.counted_since(before)["latched"]
        text = f"a playback {moment}, ended by {name}"
        judge_end_told(board, since, _SEQUENCE, _FRAMES, latched, text)
        check(latched >= least, f"{text}: {latched} latches")


@case("HG-7.6/4-again", needs=PLAYS, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_playback_begins_with_its_first_frame(board: BoardClient) -> None:
    """behind a playback that was ended at any moment, by every end, the next begins with frame 0"""
    mode = ask_for_board_latches(board)
    send_phases_to_store(board, _SEQUENCE, frames=_FRAMES)
    period_us = board.clock.on_carrier(period_to_play(board))
    for (moment, (bring, _)), (name, end) in itertools.product(_MOMENTS.items(), _ENDS.items()):
        board.arm()
        bring(board)
        end(board)
        board.arm()
        since, asked_us = board.link.mark(), board.clock.device_us()
        play_now(board, _SEQUENCE, loops=1, period_us=period_us)
        most_us = board.clock.on_carrier(board.clock.ready_us(board.clock.device_us()))
        await_playback_end(board, since, _FRAMES * period_us)
        seen = latches_received_from_board(board, since, mode)[-_FRAMES:]
        text = f"PLAY behind one {moment} that {name} has ended"
        got = [(latch.loop, latch.index) for latch in seen]
        due = [(0, index) for index in range(_FRAMES)]
        check(got == due, f"{text}: (loop, index) of its latches are {got}, due {due}")
        # The last latch before may be of the same carrier period (HG-5.8/3).
        in_time = asked_us <= seen[0].t_us <= most_us + board.clock.carrier_us
        check(in_time, f"{text}: its first frame is latched {seen[0].t_us - asked_us} µs later")


@case("HG-3.6/4-playback", needs=PLAYS, depth=Depth.DEFAULT)
def every_playback_end_of_a_session_is_event_0(board: BoardClient) -> None:
    """the event that a new session causes by ending a playback has the number 0, the next one 1"""
    send_phases_to_store(board, _SEQUENCE, frames=_FRAMES)
    period_ms = board.quick_status_ms
    for moment, (bring, _) in _MOMENTS.items():
        since = board.arm(status_period_ms=period_ms)
        wait_us = 3 * period_ms * _MS
        board.link.await_event(Status, since, wait_us)  # this session has an event
        bring(board)
        since = board.link.mark()
        board.hello()
        board.link.await_event(Status, board.link.mark(), wait_us)  # none of the old session
        pieces = [piece for piece in board.wire.received[since:] if piece.is_event]
        seen = [
            (type(piece.message).__name__, piece.header.seq)
            for piece in pieces
            if piece.header is not None and piece.header.session == board.link.session
        ]
        due = [("PlaybackEnded", 0), ("Status", 1)]
        check_equal(seen[:2], due, f"a new session and a playback {moment}: events {seen[:2]}")


@case("HG-7.6/5-config", needs=PLAYS)
def a_configured_lease_leaves_the_playback_its_time(board: BoardClient) -> None:
    """SET_CONFIG while a sequence plays or waits: unattended_ms still stands for host_timeout_ms"""
    send_phases_to_store(board, _SEQUENCE, frames=_FRAMES)
    alone_ms = min(_ALONE_MS, board.identity.max_unattended_ms)
    for is_waiting in (False, True) if board.thorough else (False,):
        board.configure()
        board.arm()
        if is_waiting:
            play_later(board, _SEQUENCE, _AHEAD_US, unattended_ms=alone_ms)
        else:
            play_now(board, _SEQUENCE, loops=0, period_us=50 * _MS, unattended_ms=alone_ms)
        since = board.link.mark()
        board.configure(host_timeout_ms=_SHORT_LEASE_MS)
        judged_mute_by_timer(board, since, 2 * alone_ms * _MS, MuteReason.UNATTENDED)
