"""HG-3.8, HG-5.5, HG-5.7, HG-9.1: checks and drops of stream frames, and STATUS, in every state."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, Final

from haptogram_protocol.messages import Feature, Mute
from haptogram_protocol.state import OutputState

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.latching import latch_now
from ...client.playback import play_later, play_now, send_phases_to_store_if_supported
from ...client.stream_kinds import stream_kinds
from ...judge.refused_requests import STORED
from ...judge.timers import judge_status_period
from ...outcome import SELF_REPORTED, named
from .every_drop import DROPS, fill_queue

_MS: Final = 1000
_GAP: Final = 7
_AHEAD_US: Final = 8_000_000  # queued frames and a waiting playback are due then
QUEUED_FRAMES: Final = 3
OFF: Final = "while DISARMED"
MUTED: Final = "while MUTED"
SILENT: Final = "while ARMED and silent"
SOUNDS: Final = "while it sounds"
PLAYING: Final = "while a sequence plays"
PLAYING_SLOWLY: Final = "within a long period of a playback"
WAITS: Final = "while a playback waits for its start"
QUEUES: Final = "with frames queued"
#: Counters of steps 6 to 10 of HG-3.8, which come before the output state.
BEFORE_STATE: Final = ("stale_session", "duplicate", "unsupported", "bad_length", "bad_value")


def _play_slowly(board: BoardClient) -> None:
    play_now(board, STORED, loops=0, period_us=9_000_000, unattended_ms=9_999)
    board.clock.wait_latched()


#: What brings an ARMED board into each state of its output; :data:`STORED` is what plays.
OUTPUT_STATES: Final[dict[str, Callable[[BoardClient], Any]]] = {
    OFF: lambda board: board.bring_to(OutputState.DISARMED),
    MUTED: lambda board: board.bring_to(OutputState.MUTED),
    SILENT: BoardClient.arm_anew,
    SOUNDS: latch_now,
    PLAYING: lambda board: play_now(board, STORED, loops=0, unattended_ms=9_999),
    PLAYING_SLOWLY: _play_slowly,
    WAITS: lambda board: play_later(board, STORED, _AHEAD_US, unattended_ms=9_999),
    QUEUES: lambda board: fill_queue(board, QUEUED_FRAMES, _AHEAD_US),
}


def output_states(
    board: BoardClient, *, queues: bool = True
) -> Iterator[tuple[str, Callable[[BoardClient], Any]]]:
    """Yield the states that a board can be in, each with what brings it there from ARMED.

    What plays has the usual period, which no hold ends; a long one if nothing *queues*: no frame
    of it is latched soon.
    """
    send_phases_to_store_if_supported(board, STORED, frames=1)
    names, reached = [OFF, MUTED, SILENT, SOUNDS], board.clock.horizon_us > _AHEAD_US
    if board.has(Feature.SEQUENCE_PHASES):
        names += [PLAYING if queues else PLAYING_SLOWLY, *[WAITS] * reached]
    for name in names + [QUEUES] * (queues and reached):
        yield name, OUTPUT_STATES[name]


@case("HG-5.7/1-states", evidence=SELF_REPORTED)
def no_other_state_takes_stream_frames(board: BoardClient) -> None:
    """frames while DISARMED, MUTED, while a sequence plays or waits: dropped_state, none is
    latched
    """
    kinds = stream_kinds(board)
    for name, bring in output_states(board, queues=False):
        if name in (SILENT, SOUNDS):
            continue
        board.arm()
        bring(board)
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
    for name, bring in output_states(board, queues=False):
        board.hello()
        board.arm()
        latch_now(board)  # a number is used
        for kind in stream_kinds(board):
            for drop in DROPS:
                if drop.counter not in BEFORE_STATE:
                    continue
                board.link.ask(Mute())
                board.arm()
                bring(board)  # anew: on a slow line its timers would end meanwhile
                wires = board.within_timers(drop.frames(board, kind, 0))
                counts = {drop.counter: len(wires), "latched": 0, "accepted": 0}
                with named(f"{name}, {kind.name} {drop.summary}"), board.counting(**counts):
                    board.link.unanswered(f"{kind.name} {drop.summary}", *wires)
        board.link.ask(Mute())


@case("HG-5.5/2-states", evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_state_counts_gaps_of_the_stream(board: BoardClient) -> None:
    """gaps before frames that are taken or dropped count alike off, on, playing and waiting"""
    for name, bring in output_states(board, queues=False):
        board.arm()
        bring(board)
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
    for name, bring in output_states(board, queues=False):
        board.arm(status_period_ms=period_ms)
        bring(board)
        since = board.link.mark()
        board.wire.idle_beyond(7 * period_ms * _MS // 2)
        board.link.barrier()
        judge_status_period(board, since, period_ms, 3, f"{name}, 3.5 periods")
        board.link.ask(Mute())
