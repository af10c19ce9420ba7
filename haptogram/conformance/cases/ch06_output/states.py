"""HG-6.1, HG-6.2, HG-6.3, HG-6.8: output states, their transitions, and the notice of a change."""

from __future__ import annotations

from typing import Final

from haptogram_protocol.messages import (
    Arm,
    Disarm,
    ErrorCode,
    Feature,
    Message,
    Mute,
    Play,
    StateChanged,
    Stop,
    UploadChunk,
    UploadCommit,
)
from haptogram_protocol.state import OUTPUT_TRANSITIONS, MuteReason, OutputInput, OutputState

from ...case import case
from ...client.board_client import BoardClient
from ...client.latching import is_board_silent, latch_now
from ...client.playback import send_phases_that_fit
from ...outcome import SELF_REPORTED, check, check_equal, fail

_SEQUENCES: Final = Feature.SEQUENCE_PHASES | Feature.SEQUENCE_POINTS
_STATES: Final = (OutputState.DISARMED, OutputState.ARMED, OutputState.MUTED)
_INPUTS: Final[dict[OutputInput, Message]] = {
    OutputInput.ARM: Arm(),
    OutputInput.MUTE: Mute(),
    OutputInput.DISARM: Disarm(),
    OutputInput.STOP: Stop(),
}
_REASONS: Final = {
    OutputInput.ARM: MuteReason.NONE,
    OutputInput.MUTE: MuteReason.MUTE,
    OutputInput.DISARM: MuteReason.DISARM,
    OutputInput.NEW_SESSION: MuteReason.NEW_SESSION,
}


@case("HG-6.1/1", needs_reset=True)
def output_starts_disarmed(board: BoardClient) -> None:
    """after a reset: DISARMED, NEVER_ARMED, nothing radiated; frames are dropped"""
    state = board.hello().state
    check_equal(state, OutputState.DISARMED, f"after a reset HELLO_REPLY says {state.name}")
    found = board.status()
    check_equal(found.state, OutputState.DISARMED, f"after a reset the state is {found.state.name}")
    with board.counting(dropped_state=None, latched=0):
        latch_now(board)
    if board.has(Feature.READ_RADIATED):
        check(is_board_silent(board), "transducers are driven after a reset")


@case("HG-6.2/1")
def follows_the_table_of_output_states(board: BoardClient) -> None:
    """ARM, MUTE, DISARM, STOP and HELLO lead from every state to the state in the table"""
    for state in _STATES:
        for event in (*_INPUTS, OutputInput.NEW_SESSION):
            if event is OutputInput.STOP and not board.identity.features & _SEQUENCES:
                continue
            board.bring_to(state)
            _do_output_event(board, event)
            due = OUTPUT_TRANSITIONS[state, event]
            found = board.status()
            check(
                found.state is due,
                f"{event.name} while {state.name}: {found.state.name}, due is {due.name}",
            )
            if due is not state and event in _REASONS:
                check_equal(
                    found.reason,
                    _REASONS[event],
                    f"{event.name} while {state.name}: reason {found.reason.name}",
                )


def _do_output_event(board: BoardClient, event: OutputInput) -> None:
    if event is OutputInput.NEW_SESSION:
        board.hello()
        return
    message = _INPUTS[event]
    reply = board.link.ask(message).message
    state = getattr(reply, "state", None)
    if state is None:
        fail(f"{event.name} is not answered by its reply")
    found = board.status().state
    check_equal(state, found, f"the reply to {event.name} says {state.name}, STATUS {found.name}")


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
    board.need_any(_SEQUENCES | Feature.CORRECTION)
    for state in _STATES:
        board.bring_to(state)
        board.link.refused(UploadCommit(1), ErrorCode.BAD_STATE, int(state))
        board.link.refused(UploadChunk(0, b"\x01"), ErrorCode.BAD_STATE, int(state))


@case("HG-6.2/3", evidence=SELF_REPORTED)
def keeps_the_reason_of_the_state(board: BoardClient) -> None:
    """an input that keeps the state keeps the reason too, except MUTE"""
    for state in _STATES:
        for event in (OutputInput.ARM, OutputInput.DISARM, OutputInput.NEW_SESSION):
            if OUTPUT_TRANSITIONS[state, event] is not state:
                continue
            board.bring_to(state)
            before = board.status().reason
            _do_output_event(board, event)
            after = board.status().reason
            check(
                after is before,
                f"{event.name} while {state.name}: the reason was {before.name}, is {after.name}",
            )


@case("HG-6.3/1", needs=Feature.READ_RADIATED, evidence=SELF_REPORTED)
def armed_output_is_silent_until_a_latch(board: BoardClient) -> None:
    """after a latch, DISARM and ARM nothing is radiated until the next latch"""
    board.arm()
    check(is_board_silent(board), "ARM makes a sound")
    latch_now(board)
    check(not is_board_silent(board), "a latch is not radiated")
    board.disarm()
    board.arm()
    check(is_board_silent(board), "ARM sounds the drive that was latched before")
    latch_now(board)
    check(not is_board_silent(board), "a latch is not radiated")


@case("HG-6.3/2", evidence=SELF_REPORTED)
def arms_again_in_armed_state(board: BoardClient) -> None:
    """ARM while ARMED keeps the queue and the drive"""
    board.arm()
    latch_now(board)
    t_us = board.clock.soon_us(board.bytes_of_frames(2))
    board.require_hold(t_us - board.clock.device_us(), "a slow line")
    with board.counting(latched=2, flushed=0):
        for number in range(2):
            board.link.stream(board.flat_phases(), t_us + number * 1000)
        board.arm()
        board.clock.end_exchange()
        if board.has(Feature.READ_RADIATED):
            check(not is_board_silent(board), "ARM while ARMED silences the board")
        board.clock.wait_until(t_us + 2000)


@case("HG-6.8/2")
def tells_the_state_after_a_foreign_mute(board: BoardClient) -> None:
    """MUTE without a session and of another one: STATE_CHANGED(MUTED, MUTE)"""
    for session in (0, board.link.session ^ 0x0AA0):
        board.arm()
        since = board.link.mark()
        board.link.ask(Mute(), session=session)
        name = f"MUTE of session {session:#06x}"
        _, event = board.due_event(StateChanged, since, 20_000, name)
        check_equal(
            (event.state, event.reason),
            (OutputState.MUTED, MuteReason.MUTE),
            f"STATE_CHANGED says {event.state.name}, {event.reason.name}",
        )


@case("HG-6.8/1", needs=Feature.CONFIG)
def tells_the_state_after_a_timer(board: BoardClient) -> None:
    """STATE_CHANGED names the lease and the hold when they run out"""
    for reason, changes in (
        (MuteReason.HOST_SILENT, {"host_timeout_ms": 100}),
        (MuteReason.HOLD_EXPIRED, {"hold_ms": 50}),
    ):
        board.configure(**changes)
        board.arm()
        since = board.link.mark()
        latch_now(board)
        _, event = board.due_event(StateChanged, since, 200_000, reason.name)
        got = (event.state, event.reason)
        check_equal(
            got, (OutputState.MUTED, reason), f"{reason.name}: {got[0].name}, {got[1].name}"
        )
