"""HG-3.8, HG-5.5, HG-5.7, HG-9.1: checks and drops of stream frames, and STATUS, in every state."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Final

from haptogram_protocol.messages import Feature, Mute
from haptogram_protocol.state import OutputState

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.latching import latch_now, queue_frames
from ...client.playback import play_later, play_now, send_phases_to_store
from ...client.stream_kinds import stream_kinds
from ...judge.timers import judge_status_period
from ...outcome import SELF_REPORTED, named
from .every_drop import DROPS

_MS: Final = 1000
_SEQUENCE: Final = 6
_GAP: Final = 7
_AHEAD_US: Final = 8_000_000
_SILENT: Final = "while ARMED and silent"
_SOUNDS: Final = "while it sounds"
PLAYBACK_PLAYS: Final = "while a sequence plays"
PLAYBACK_WAITS: Final = "while a playback waits"
QUEUES: Final = "with frames queued"
QUEUED_FRAMES: Final = 2
_QUEUED_US: Final = 3_000_000
_TAKES_FRAMES: Final = (_SILENT, _SOUNDS)
#: Counters of steps 6 to 10 of HG-3.8, which come before the output state.
BEFORE_STATE: Final = ("stale_session", "duplicate", "unsupported", "bad_length", "bad_value")


def _playing_at_stream_frame(board: BoardClient) -> None:
    board.arm()
    play_now(board, _SEQUENCE, loops=0, period_us=9_000_000, unattended_ms=9_999)
    board.clock.wait_latched()


def _waiting_at_stream_frame(board: BoardClient) -> None:
    board.arm()
    play_later(board, _SEQUENCE, _AHEAD_US, unattended_ms=9_999)


def _queueing_at_stream_frame(board: BoardClient) -> None:
    latch_now(board)
    queue_frames(board, board.clock.ahead_us(_QUEUED_US), QUEUED_FRAMES)


def _silent_at_stream_frame(board: BoardClient) -> None:
    board.bring_to(OutputState.DISARMED)
    board.arm()


def _states_at_stream_frame(board: BoardClient) -> dict[str, Callable[[], object]]:
    """Return what brings the board into each state of the output, from ARMED, by its name."""
    states: dict[str, Callable[[], object]] = {
        "while DISARMED": partial(board.bring_to, OutputState.DISARMED),
        "while MUTED": partial(board.bring_to, OutputState.MUTED),
        _SILENT: partial(_silent_at_stream_frame, board),
        _SOUNDS: lambda: latch_now(board),
    }
    if board.has(Feature.SEQUENCE_PHASES):
        send_phases_to_store(board, _SEQUENCE, frames=1)
        states[PLAYBACK_PLAYS] = partial(_playing_at_stream_frame, board)
        if board.clock.horizon_us >= _AHEAD_US:
            states[PLAYBACK_WAITS] = partial(_waiting_at_stream_frame, board)
    return states


def output_states(board: BoardClient) -> dict[str, Callable[[], object]]:
    """Return the states of an output by their names, each with its way there from ARMED."""
    states = _states_at_stream_frame(board)
    if PLAYBACK_PLAYS in states:  # with the usual period, which no hold ends
        states[PLAYBACK_PLAYS] = lambda: play_now(board, _SEQUENCE, loops=0)
    if board.clock.horizon_us >= _QUEUED_US:
        states[QUEUES] = partial(_queueing_at_stream_frame, board)
    return states


@case("HG-5.7/1-states", evidence=SELF_REPORTED)
def no_other_state_takes_stream_frames(board: BoardClient) -> None:
    """frames while DISARMED, MUTED, while a sequence plays or waits: dropped_state, none is
    latched
    """
    kinds = stream_kinds(board)
    for name, bring in _states_at_stream_frame(board).items():
        if name in _TAKES_FRAMES:
            continue
        board.arm()
        bring()
        t_us = board.clock.soon_us(bytes(2000))
        messages = [kind.make() for kind in (kinds if board.thorough else kinds[:1])]
        with named(name), board.counting(dropped_state=2 * len(messages), latched=0):
            for message in messages:
                board.link.stream(message)
                board.link.stream(message, t_us)
            board.clock.wait_latched()
            board.check_status("frames dropped", queued=0)
        board.link.ask(Mute())


@case("HG-3.8/1-states", evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_state_checks_stream_frames_alike(board: BoardClient) -> None:
    """stale, old, flagged, wrong frames of every format count alike off, on, playing and waiting"""
    for name, bring in _states_at_stream_frame(board).items():
        board.hello()
        board.arm()
        latch_now(board)  # a number is used
        for kind in stream_kinds(board):
            for drop in DROPS:
                if drop.counter not in BEFORE_STATE:
                    continue
                board.link.ask(Mute())
                board.arm()
                bring()  # anew: on a slow line its timers would end meanwhile
                wires = board.within_timers(drop.frames(board, kind, 0))
                counts = {drop.counter: len(wires), "latched": 0, "accepted": 0}
                with named(f"{name}, {kind.name} {drop.summary}"), board.counting(**counts):
                    board.link.unanswered(f"{kind.name} {drop.summary}", *wires)
        board.link.ask(Mute())


@case("HG-5.5/2-states", evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_state_counts_gaps_of_the_stream(board: BoardClient) -> None:
    """gaps before frames that are taken or dropped count alike off, on, playing and waiting"""
    for name, bring in _states_at_stream_frame(board).items():
        board.arm()
        bring()
        for kind in stream_kinds(board):
            for flags in ({}, {"flags": 0x40}):
                before = board.status().counters
                board.link.stream_next += _GAP
                board.link.stream(kind.make(), **flags)
                board.link.stream(kind.make(), **flags)
                text = f"{name}, a gap of {_GAP} before {kind.name}"
                board.check_counted(before, text, {"gap": _GAP})
        board.link.ask(Mute())


@case("HG-9.1/1-states", needs=Feature.CONFIG, depth=Depth.DEFAULT)
def every_state_of_the_stream_sends_status(board: BoardClient) -> None:
    """STATUS comes at its time off, on, playing and waiting"""
    period_ms = board.quick_status_ms
    for name, bring in _states_at_stream_frame(board).items():
        board.arm(status_period_ms=period_ms)
        bring()
        since = board.link.mark()
        board.wire.idle_beyond(7 * period_ms * _MS // 2)
        board.link.barrier()
        judge_status_period(board, since, period_ms, 3, f"{name}, 3.5 periods")
        board.link.ask(Mute())
