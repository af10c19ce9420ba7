"""HG-5.7, HG-6.2, HG-6.4: state and reason after every input in every state; frames in FAULT."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Final

from haptogram_protocol.messages import (
    Arm,
    Counters,
    Disarm,
    Feature,
    Flag,
    Message,
    Mute,
    PlaybackEnded,
    StateChanged,
    Stop,
)
from haptogram_protocol.rules import PLAYBACK
from haptogram_protocol.state import MuteReason, OutputInput, OutputState

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.latching import latch_now
from ...client.playback import play_now, play_request, send_phases_to_store_if_supported
from ...client.stream_kinds import stream_kinds
from ...judge.effects import StateAndReason, state_and_reason_after
from ...judge.timers import judged_mute_by_timer
from ...outcome import SELF_REPORTED, check
from .faults import fail_hardware, recover_from_hardware_fault

_MS: Final = 1000
_SEQUENCE: Final = 5
_SHORT_MS: Final = 20
_FOREIGN: Final = 0x0440
_NO_SESSION: Final = -1


@case("HG-6.2/3-origins", evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_input_in_every_output_state(board: BoardClient) -> None:
    """behind each reason of each state every input leads to the state and the reason that are
    due
    """
    send_phases_to_store_if_supported(board, _SEQUENCE, frames=1)
    for bring, due in _origins_of_output_states(board):
        for name, event, happen in _inputs_to_output_states(board):
            bring()
            _judge_input_to_output_state(board, due, name, event, happen)


@case("HG-6.4/4-origins", evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_mute_in_every_output_state(board: BoardClient) -> None:
    """MUTE of every session or none, once and twice, behind each reason: state, events, counters"""
    send_phases_to_store_if_supported(board, _SEQUENCE, frames=1)
    for bring, due in _origins_of_output_states(board):
        for way in board.wire.ways_of_mute():
            for name, sessions in _sessions_of_mutes():
                bring()
                mute_all = partial(_mute_of_sessions, board, sessions)
                text = f"{name} {way}".strip()
                since, before = board.link.mark(), board.status().counters
                _judge_input_to_output_state(board, due, text, OutputInput.MUTE, mute_all)
                _judge_rest_behind_mutes(board, since, before, f"{text} in {_state_text(due)}")


@case("HG-5.7/1-fault", evidence=SELF_REPORTED)
def a_hardware_fault_drops_stream_frames(board: BoardClient) -> None:
    """in FAULT frames of every message and format are counted in dropped_state, none is latched"""
    fail_hardware(board)
    kinds = stream_kinds(board)
    with board.counting(dropped_state=len(kinds), latched=0):
        for kind in kinds:
            board.link.stream(kind.make())
    recover_from_hardware_fault(board)


def _judge_input_to_output_state(
    board: BoardClient,
    due: StateAndReason,
    name: str,
    event: OutputInput | None,
    happen: Callable[[], object],
) -> None:
    """FAILED unless the board is in the state *due*, and an input leads where it has to."""
    before = _found_state_and_reason(board)
    check(before == due, f"{_state_text(before)} where {_state_text(due)} is due")
    happen()
    after = _found_state_and_reason(board)
    wanted = before if event is None else state_and_reason_after(before, event)
    check(
        after == wanted,
        f"{name} in {_state_text(before)}: {_state_text(after)}, due {_state_text(wanted)}",
    )


def _found_state_and_reason(board: BoardClient) -> StateAndReason:
    status = board.status()
    return status.state, status.reason


def _sessions_of_mutes() -> Iterator[tuple[str, tuple[int, ...]]]:
    """Yield names of MUTE, or of two of them in a row, and how the session of each differs."""
    for name, foreign in (
        ("MUTE", 0),
        ("MUTE of another session", _FOREIGN),
        ("MUTE without a session", _NO_SESSION),
    ):
        yield name, (foreign,)
        yield f"{name}, then of the session", (foreign, 0)


def _mute_of_sessions(board: BoardClient, sessions: tuple[int, ...]) -> None:
    for foreign in sessions:
        board.link.ask(
            Mute(), session=0 if foreign == _NO_SESSION else board.link.session ^ foreign
        )


def _judge_rest_behind_mutes(board: BoardClient, since: int, before: Counters, name: str) -> None:
    """FAILED if MUTE, with nothing queued, counts or reports what did not happen."""
    grown = board.counted_since(before)
    wrong = {
        counter: number
        for counter, number in grown.items()
        if number and counter not in ("frames", "requests")
    }
    check(not wrong, f"{name} counts {wrong}")
    ended = board.link.events(PlaybackEnded, since)
    check(not ended, f"{name}: PLAYBACK_ENDED, and nothing has played")
    muted = OutputState.MUTED, MuteReason.MUTE
    told = [(event.state, event.reason) for _, event in board.link.events(StateChanged, since)]
    texts = ", ".join(map(_state_text, told))
    check(told in ([], [muted]), f"{name}: STATE_CHANGED tells {texts}; due is MUTED (MUTE), once")


def _state_text(found: StateAndReason) -> str:
    return f"{found[0].name} ({found[1].name})"


def _origins_of_output_states(
    board: BoardClient,
) -> Iterator[tuple[Callable[[], object], StateAndReason]]:
    """Yield what leads to a state, with the state and the reason that it has then."""
    disarmed, muted = OutputState.DISARMED, OutputState.MUTED
    yield partial(board.bring_to, disarmed), (disarmed, MuteReason.DISARM)
    yield partial(_new_session_for_output_state, board), (disarmed, MuteReason.NEW_SESSION)
    yield partial(_sound_for_output_state, board), (OutputState.ARMED, MuteReason.NONE)
    yield partial(board.bring_to, muted), (muted, MuteReason.MUTE)
    if board.has(Feature.CONFIG):
        yield (
            partial(_mute_by_timer_for_state, board, MuteReason.HOLD_EXPIRED),
            (muted, MuteReason.HOLD_EXPIRED),
        )
        yield (
            partial(_mute_by_timer_for_state, board, MuteReason.HOST_SILENT),
            (muted, MuteReason.HOST_SILENT),
        )
    if board.has(Feature.SEQUENCE_PHASES | Feature.CONFIG):
        yield (
            partial(_mute_by_timer_for_state, board, MuteReason.UNATTENDED),
            (muted, MuteReason.UNATTENDED),
        )


def _new_session_for_output_state(board: BoardClient) -> None:
    board.arm()
    board.hello()


def _sound_for_output_state(board: BoardClient) -> None:
    board.bring_to(OutputState.DISARMED)
    board.arm()
    latch_now(board)


def _mute_by_timer_for_state(board: BoardClient, reason: MuteReason) -> None:
    """Let one timer run out."""
    lease = reason is MuteReason.HOST_SILENT
    hold = reason is MuteReason.HOLD_EXPIRED
    board.configure(
        host_timeout_ms=_SHORT_MS if lease else 10_000, hold_ms=_SHORT_MS if hold else 10_000
    )
    board.arm()
    since = board.link.mark()
    if reason is MuteReason.UNATTENDED:
        play_now(board, _SEQUENCE, loops=0, period_us=50 * _MS, unattended_ms=_SHORT_MS)
    elif hold:
        latch_now(board)
    judged_mute_by_timer(board, since, 1000 * _MS, reason)
    board.configure()


def _inputs_to_output_states(
    board: BoardClient,
) -> Iterator[tuple[str, OutputInput | None, Callable[[], object]]]:
    """Yield inputs with their names; None: one that changes neither state nor reason."""
    inputs: dict[OutputInput, Message] = {
        OutputInput.ARM: Arm(),
        OutputInput.DISARM: Disarm(),
        OutputInput.MUTE: Mute(),
    }
    for event, message in inputs.items():
        yield event.name, event, partial(board.link.ask, message)
    yield "a new session", OutputInput.NEW_SESSION, board.hello
    yield "HELLO again", None, lambda: board.hello(board.link.session)
    yield "a stream frame", None, lambda: latch_now(board)
    if board.identity.features & PLAYBACK:
        yield "STOP", None, partial(board.link.ask, Stop())
    if board.has(Feature.SEQUENCE_PHASES):
        play = play_request(board, _SEQUENCE, loops=1, unattended_ms=100)
        yield "PLAY", None, partial(board.link.ask, play, flags=int(Flag.IMMEDIATE))
