"""HG-6.1, HG-6.2, HG-6.3, HG-6.4, HG-6.8: output states, their reasons, and notices of a change."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Final, TypeAlias

from haptogram_protocol.messages import (
    Counters,
    ErrorCode,
    Feature,
    Mute,
    Play,
    PlaybackEnded,
    StateChanged,
    UploadChunk,
    UploadCommit,
)
from haptogram_protocol.rules import PLAYBACK
from haptogram_protocol.state import MuteReason, OutputInput, OutputState

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.latching import is_board_silent, latch_now, queue_frames
from ...client.playback import (
    play_now,
    play_request,
    send_phases_that_fit,
    send_phases_to_store_if_supported,
)
from ...judge.effects import OUTPUT_REQUESTS, StateAndReason, state_and_reason_after
from ...judge.timers import judged_mute_by_timer
from ...outcome import SELF_REPORTED, check, check_equal

_MS: Final = 1000
_SEQUENCE: Final = 5
_SHORT_MS: Final = 20
_FOREIGN: Final = 0x0440
_NO_SESSION: Final = -1
_STATES: Final = (OutputState.DISARMED, OutputState.ARMED, OutputState.MUTED)
_MUTED: Final = (OutputState.MUTED, MuteReason.MUTE)
#: An input with its name; None: one that changes neither state nor reason.
_Input: TypeAlias = tuple[str, OutputInput | None, Callable[[], object]]
#: What leads to a state, with the state and the reason that it has then.
_Origin: TypeAlias = tuple[Callable[[], object], StateAndReason]


def _found_state(board: BoardClient) -> StateAndReason:
    status = board.status()
    return status.state, status.reason


def _state_text(found: StateAndReason) -> str:
    return f"{found[0].name} ({found[1].name})"


@case("HG-6.1/1", needs_reset=True)
def output_starts_disarmed(board: BoardClient) -> None:
    """after a reset: DISARMED, NEVER_ARMED, nothing radiated; frames are dropped"""
    state = board.hello().state
    check_equal(state, OutputState.DISARMED, f"after a reset HELLO_REPLY says {state.name}")
    board.check_state(OutputState.DISARMED, "after a reset the state is")
    with board.counting(dropped_state=None, latched=0):
        latch_now(board)
    if board.has(Feature.READ_RADIATED):
        check(is_board_silent(board), "transducers are driven after a reset")


@case("HG-6.2/1")
def follows_the_table_of_output_states(board: BoardClient) -> None:
    """ARM, MUTE, DISARM, STOP and HELLO lead from every state to the state in the table"""
    _judge_requests(board, with_reason=False)


@case("HG-6.2/1-play")
def plays_only_in_armed_state(board: BoardClient) -> None:
    """PLAY while DISARMED and MUTED is refused"""
    board.need(Feature.SEQUENCE_PHASES)
    send_phases_that_fit(board, 1, frames=2)
    for state in (OutputState.DISARMED, OutputState.MUTED):
        board.bring_to(state)
        board.link.refused(Play(1, 1000, 1, 100), ErrorCode.BAD_STATE, int(state), flags=0x10)


@case("HG-6.2/2")
def tells_the_output_state(board: BoardClient) -> None:
    """ERROR(BAD_STATE) has the output state as its detail, in each state"""
    board.need_any(PLAYBACK | Feature.CORRECTION)
    for state in _STATES:
        board.bring_to(state)
        for message in (UploadCommit(1), UploadChunk(0, b"\x01")):
            board.link.refused(message, ErrorCode.BAD_STATE, int(state))


@case("HG-6.2/3", evidence=SELF_REPORTED)
def keeps_the_reason_of_the_state(board: BoardClient) -> None:
    """an input that keeps the state keeps the reason too, except MUTE"""
    _judge_requests(board, with_reason=True)


def _judge_requests(board: BoardClient, *, with_reason: bool) -> None:
    """FAILED unless requests lead where they have to, from each state that requests lead to."""
    for bring, due in _asked_output_states(board):
        for one in _inputs_to_output_states(board):
            if one[1] is not None:
                bring()
                _judge_input_to_output_state(board, due, one, with_reason=with_reason)


@case("HG-6.3/1", needs=Feature.READ_RADIATED, evidence=SELF_REPORTED)
def armed_output_is_silent_until_a_latch(board: BoardClient) -> None:
    """after a latch, DISARM and ARM nothing is radiated until the next latch"""
    for text in ("ARM makes a sound", "ARM sounds the drive that was latched before"):
        board.arm()
        check(is_board_silent(board), text)
        latch_now(board)
        check(not is_board_silent(board), "a latch is not radiated")
        board.disarm()


@case("HG-6.3/2", evidence=SELF_REPORTED)
def arms_again_in_armed_state(board: BoardClient) -> None:
    """ARM while ARMED keeps the queue and the drive"""
    board.arm()
    latch_now(board)
    t_us = board.clock.soon_us(board.bytes_of_frames(2))
    board.require_hold(t_us - board.clock.device_us(), "a slow line")
    with board.counting(latched=2, flushed=0):
        queue_frames(board, t_us, 2)
        board.arm()
        board.clock.end_exchange()
        if board.has(Feature.READ_RADIATED):
            check(not is_board_silent(board), "ARM while ARMED silences the board")
        board.clock.wait_until(t_us + 2000)


# --- Notices of a change -----------------------------------------------------------------------


def _check_told(
    board: BoardClient, since: int, due: StateAndReason, text: str, within_ms: int
) -> None:
    """FAILED unless STATE_CHANGED tells of the state that is due, in time."""
    _, event = board.due_event(StateChanged, since, within_ms * _MS, text)
    told = event.state, event.reason
    check_equal(told, due, f"{text}: STATE_CHANGED says {_state_text(told)}")


@case("HG-6.8/2")
def tells_the_state_after_a_foreign_mute(board: BoardClient) -> None:
    """MUTE without a session and of another one: STATE_CHANGED(MUTED, MUTE)"""
    for session in (0, board.link.session ^ 0x0AA0):
        since = board.arm()
        board.link.ask(Mute(), session=session)
        _check_told(board, since, _MUTED, f"MUTE of session {session:#06x}", 20)


@case("HG-6.8/1", needs=Feature.CONFIG)
def tells_the_state_after_a_timer(board: BoardClient) -> None:
    """STATE_CHANGED names the lease and the hold when they run out"""
    for reason, changes in (
        (MuteReason.HOST_SILENT, {"host_timeout_ms": 100}),
        (MuteReason.HOLD_EXPIRED, {"hold_ms": 50}),
    ):
        since = board.arm(**changes)
        latch_now(board)
        _check_told(board, since, (OutputState.MUTED, reason), reason.name, 200)


# --- Every reason ------------------------------------------------------------------------------


@case("HG-6.2/3-origins", evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_input_in_every_output_state(board: BoardClient) -> None:
    """behind each reason of each state every input leads to the state and the reason that are
    due
    """
    send_phases_to_store_if_supported(board, _SEQUENCE, frames=1)
    for bring, due in _origins_of_output_states(board):
        for one in _inputs_to_output_states(board):
            bring()
            _judge_input_to_output_state(board, due, one)


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
                _judge_input_to_output_state(board, due, (text, OutputInput.MUTE, mute_all))
                _judge_rest_behind_mutes(board, since, before, f"{text} in {_state_text(due)}")


def _judge_input_to_output_state(
    board: BoardClient, due: StateAndReason, one: _Input, *, with_reason: bool = True
) -> None:
    """FAILED unless the board is in the state *due*, and an input leads where it has to."""
    name, event, happen = one
    parts = 2 if with_reason else 1
    before = _found_state(board)
    is_there = before[:parts] == due[:parts]
    check(is_there, f"{_state_text(before)} where {_state_text(due)} is due")
    told = getattr(getattr(happen(), "message", None), "state", None)
    after = _found_state(board)
    wanted = before if event is None else state_and_reason_after(before, event)
    text = f"{name} in {_state_text(before)}: {_state_text(after)}, due {_state_text(wanted)}"
    check(after[:parts] == wanted[:parts], text)
    text = f"the reply to {name} says {told and told.name}, STATUS {after[0].name}"
    check(told in (None, after[0]), text)


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
        session = 0 if foreign == _NO_SESSION else board.link.session ^ foreign
        board.link.ask(Mute(), session=session)


def _judge_rest_behind_mutes(board: BoardClient, since: int, before: Counters, name: str) -> None:
    """FAILED if MUTE, with nothing queued, counts or reports what did not happen."""
    grown = board.counted_since(before)
    wrong = {key: n for key, n in grown.items() if n and key not in ("frames", "requests")}
    check(not wrong, f"{name} counts {wrong}")
    ended = board.link.events(PlaybackEnded, since)
    check(not ended, f"{name}: PLAYBACK_ENDED, and nothing has played")
    told = [(event.state, event.reason) for _, event in board.link.events(StateChanged, since)]
    texts = ", ".join(map(_state_text, told))
    check(told in ([], [_MUTED]), f"{name}: STATE_CHANGED tells {texts}; due is MUTED (MUTE), once")


def _asked_output_states(board: BoardClient) -> Iterator[_Origin]:
    """Yield requests that lead to a state, with the state and the reason that it has then."""
    disarmed, muted = OutputState.DISARMED, OutputState.MUTED
    yield partial(board.bring_to, disarmed), (disarmed, MuteReason.DISARM)
    yield partial(_new_session_for_output_state, board), (disarmed, MuteReason.NEW_SESSION)
    yield partial(_sound_for_output_state, board), (OutputState.ARMED, MuteReason.NONE)
    yield partial(board.bring_to, muted), _MUTED


def _origins_of_output_states(board: BoardClient) -> Iterator[_Origin]:
    """Yield all that leads to a state, timers too."""
    yield from _asked_output_states(board)
    timers = [MuteReason.HOLD_EXPIRED, MuteReason.HOST_SILENT]
    timers += [MuteReason.UNATTENDED] if board.has(Feature.SEQUENCE_PHASES) else []
    for reason in timers if board.has(Feature.CONFIG) else []:
        muted = OutputState.MUTED, reason
        yield partial(_mute_by_timer_for_state, board, reason), muted


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
    since = board.arm()
    if reason is MuteReason.UNATTENDED:
        play_now(board, _SEQUENCE, loops=0, period_us=50 * _MS, unattended_ms=_SHORT_MS)
    elif hold:
        latch_now(board)
    judged_mute_by_timer(board, since, 1000 * _MS, reason)
    board.configure()


def _inputs_to_output_states(board: BoardClient) -> Iterator[_Input]:
    plays = bool(board.identity.features & PLAYBACK)
    for event, message in OUTPUT_REQUESTS.items():
        if event is not OutputInput.STOP or plays:
            yield event.name, event, partial(board.link.ask, message)
    yield "a new session", OutputInput.NEW_SESSION, board.hello
    yield "HELLO again", None, lambda: board.hello(board.link.session)
    yield "a stream frame", None, lambda: latch_now(board)
    if board.has(Feature.SEQUENCE_PHASES):
        play = play_request(board, _SEQUENCE, loops=1, unattended_ms=100)
        yield "PLAY", None, partial(board.link.ask_at_once, play)
