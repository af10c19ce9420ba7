"""HG-6.1, HG-6.2, HG-6.3, HG-6.4, HG-6.6, HG-6.8: states of the output, faults among them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Final, TypeAlias

from haptogram_protocol import messages as m
from haptogram_protocol.rules import PLAYBACK
from haptogram_protocol.state import MuteReason, OutputInput, OutputState

from ...case import Depth, case
from ...client import latching, playback, uploads
from ...client.board_client import BoardClient
from ...client.capabilities import PLAYS
from ...client.stream_kinds import valid_requests_to_send
from ...judge.effects import OUTPUT_REQUESTS, StateAndReason, state_and_reason_after
from ...judge.timers import (
    HOLD,
    LEASE,
    UNATTENDED,
    TimerKind,
    judged_mute_by_timer,
    timer_kinds,
)
from ...outcome import SELF_REPORTED, check, check_equal, check_fields, not_observed
from ..ch05_stream.every_drop import (
    PLAYING,
    QUEUED_FRAMES,
    QUEUES,
    WAITS,
    output_states,
)

_MS: Final = 1000
_SEQUENCE: Final = 5
_SHORT_MS: Final = 20
_FOREIGN: Final = 0x0440
_NO_SESSION: Final = -1
_WAITED_MS: Final = 30  # of timers that would run out
_IN_FAULT: Final = {"state": OutputState.FAULT, "reason": MuteReason.FAULT}
_STATES: Final = (OutputState.DISARMED, OutputState.ARMED, OutputState.MUTED)
_MUTED: Final = (OutputState.MUTED, MuteReason.MUTE)
#: An input with its name; None: one that changes neither state nor reason.
_Input: TypeAlias = tuple[str, OutputInput | None, Callable[[], object]]
#: What leads to a state, with the state and the reason that it has then.
_Origin: TypeAlias = tuple[Callable[[], object], StateAndReason]


def _output_state(board: BoardClient) -> StateAndReason:
    """Return the output state and its reason, by STATUS."""
    status = board.status()
    return status.state, status.reason


def _state_text(found: StateAndReason) -> str:
    """Return an output state and its reason as text."""
    return f"{found[0].name} ({found[1].name})"


@case("HG-6.1/1", needs_reset=True)
def output_starts_disarmed(board: BoardClient) -> None:
    """after a reset: DISARMED, NEVER_ARMED, nothing radiated; frames are dropped"""
    check_fields(board.hello(), "after a reset: HELLO_REPLY", state=OutputState.DISARMED)
    board.check_status("after a reset", state=OutputState.DISARMED)
    with board.counting(dropped_state=None, latched=0):
        latching.latch_now(board)
    latching.check_silent(board, "after a reset")


@case("HG-6.2/1")
def follows_the_table_of_output_states(board: BoardClient) -> None:
    """ARM, MUTE, DISARM, STOP and HELLO lead from every state to the state in the table"""
    _judge_requests(board, with_reason=False)


@case("HG-6.2/1-play")
def plays_only_in_armed_state(board: BoardClient) -> None:
    """PLAY while DISARMED and MUTED is refused"""
    board.need(m.Feature.SEQUENCE_PHASES)
    playback.send_phases_that_fit(board, 1, frames=2)
    for state in (OutputState.DISARMED, OutputState.MUTED):
        board.bring_to(state)
        board.link.refused(m.Play(1, 1000, 1, 100), m.ErrorCode.BAD_STATE, int(state), flags=0x10)


@case("HG-6.2/2")
def tells_the_output_state(board: BoardClient) -> None:
    """ERROR(BAD_STATE) has the output state as its detail, in each state"""
    board.need_any(PLAYBACK | m.Feature.CORRECTION)
    for state in _STATES:
        board.bring_to(state)
        for message in (m.UploadCommit(1), m.UploadChunk(0, b"\x01")):
            board.link.refused(message, m.ErrorCode.BAD_STATE, int(state))


@case("HG-6.2/3", evidence=SELF_REPORTED)
def keeps_the_reason_of_the_state(board: BoardClient) -> None:
    """an input that keeps the state keeps the reason too, except MUTE"""
    _judge_requests(board, with_reason=True)


def _judge_requests(board: BoardClient, *, with_reason: bool) -> None:
    """FAILED unless each request leads from each state to the specified one.

    *with_reason*: the reason of each state is compared too.
    """
    for bring, due in _asked_output_states(board):
        for one in _inputs_to_output_states(board):
            if one[1] is not None:
                bring()
                _judge_input_to_output_state(board, due, one, with_reason=with_reason)


@case("HG-6.3/1", needs=m.Feature.READ_RADIATED, evidence=SELF_REPORTED)
def armed_output_is_silent_until_a_latch(board: BoardClient) -> None:
    """after a latch, DISARM and ARM nothing is radiated until the next latch"""
    for text in ("the first ARM", "ARM behind a latch and DISARM"):
        board.arm()
        latching.check_silent(board, text)
        latching.latch_now(board)
        check(latching.read_back_radiated(board).loudest > 0, "a latch is not radiated")
        board.disarm()


@case("HG-6.3/2", evidence=SELF_REPORTED)
def arms_again_in_armed_state(board: BoardClient) -> None:
    """ARM while ARMED keeps the queue and the drive"""
    board.arm()
    latching.latch_now(board)
    t_us = board.clock.soon_us(board.bytes_of_frames(2))
    board.require_hold(t_us - board.clock.device_us(), "a slow line")
    with board.counting(latched=2, flushed=0):
        latching.queue_frames(board, t_us, 2)
        board.arm()
        board.clock.end_exchange()
        if board.has(m.Feature.READ_RADIATED):
            check(
                latching.read_back_radiated(board).loudest > 0, "ARM while ARMED silences the board"
            )
        board.clock.wait_until(t_us + 2000)


# --- Notices of a change -----------------------------------------------------------------------


@case("HG-6.8/2")
def tells_the_state_after_a_foreign_mute(board: BoardClient) -> None:
    """MUTE without a session and of another one: STATE_CHANGED(MUTED, MUTE)"""
    for session in (0, board.link.session ^ 0x0AA0):
        since = board.arm()
        board.mute(session=session)
        name = f"MUTE of session {session:#06x}"
        _, event = board.due_event(m.StateChanged, since, 20 * _MS, name)
        check_equal((event.state, event.reason), _MUTED, f"{name}: STATE_CHANGED")


@case("HG-6.8/1", needs=m.Feature.CONFIG)
def tells_the_state_after_a_timer(board: BoardClient) -> None:
    """STATE_CHANGED names the lease and the hold when they run out"""
    for timer, length_ms in ((LEASE, 100), (HOLD, 50)):
        timer.judge_whole(board, length_ms)


# --- Every reason ------------------------------------------------------------------------------


@case("HG-6.2/3-origins", evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_input_in_every_output_state(board: BoardClient) -> None:
    """behind each reason of each state every input leads to the state and the reason that are
    due
    """
    playback.send_phases_to_store_if_supported(board, _SEQUENCE, frames=1)
    for bring, due in _origins_of_output_states(board):
        for one in _inputs_to_output_states(board):
            bring()
            _judge_input_to_output_state(board, due, one)


@case("HG-6.4/4-origins", evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_mute_in_every_output_state(board: BoardClient) -> None:
    """MUTE of every session or none, once and twice, behind each reason: state, events, counters"""
    playback.send_phases_to_store_if_supported(board, _SEQUENCE, frames=1)
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
    """FAILED unless the board is in state *due*, and an input causes the specified transition.

    *with_reason*: the reason of each state is compared too.  A refusal has to name the state.
    """
    name, event, happen = one
    parts = 2 if with_reason else 1
    before = _output_state(board)
    is_there = before[:parts] == due[:parts]
    check(is_there, f"{_state_text(before)} where {_state_text(due)} is due")
    answer = getattr(happen(), "message", None)
    if isinstance(answer, m.Error):
        code, state = m.ErrorCode.BAD_STATE, int(before[0])
        check_fields(answer, f"{name} in {before[0].name}", code=code, detail=state)
    told = getattr(answer, "state", None)
    after = _output_state(board)
    wanted = before if event is None else state_and_reason_after(before, event)
    check_equal(after[:parts], wanted[:parts], f"{name} in {_state_text(before)}")
    text = f"the reply to {name} says {told and told.name}, STATUS {after[0].name}"
    check(told in (None, after[0]), text)


def _sessions_of_mutes() -> Iterator[tuple[str, tuple[int, ...]]]:
    """Yield name and sessions of one MUTE or two, XORed with the open session; -1: no session."""
    for name, foreign in (
        ("MUTE", 0),
        ("MUTE of another session", _FOREIGN),
        ("MUTE without a session", _NO_SESSION),
    ):
        yield name, (foreign,)
        yield f"{name}, then of the session", (foreign, 0)


def _mute_of_sessions(board: BoardClient, sessions: tuple[int, ...]) -> None:
    """Send a MUTE for each of *sessions*, XORed with the open session; -1: without a session."""
    for foreign in sessions:
        session = 0 if foreign == _NO_SESSION else board.link.session ^ foreign
        board.mute(session=session)


def _judge_rest_behind_mutes(board: BoardClient, since: int, before: m.Counters, name: str) -> None:
    """FAILED if a MUTE with nothing queued counts more than frames and requests, or sends events.

    STATE_CHANGED may tell of MUTED, once; received frames from number *since* on count.
    """
    grown = board.counted_since(before)
    wrong = {key: n for key, n in grown.items() if n and key not in ("frames", "requests")}
    check(not wrong, f"{name} counts {wrong}")
    ended = board.link.events(m.PlaybackEnded, since)
    check(not ended, f"{name}: PLAYBACK_ENDED, and nothing has played")
    told = [(event.state, event.reason) for _, event in board.link.events(m.StateChanged, since)]
    texts = ", ".join(map(_state_text, told))
    check(told in ([], [_MUTED]), f"{name}: STATE_CHANGED tells {texts}; due is MUTED (MUTE), once")


def _asked_output_states(board: BoardClient) -> Iterator[_Origin]:
    """Yield functions that lead to a state by requests, each with that state and its reason."""
    disarmed, muted = OutputState.DISARMED, OutputState.MUTED
    yield partial(board.bring_to, disarmed), (disarmed, MuteReason.DISARM)
    yield partial(_new_session_for_output_state, board), (disarmed, MuteReason.NEW_SESSION)
    yield partial(_sound_for_output_state, board), (OutputState.ARMED, MuteReason.NONE)
    yield partial(board.bring_to, muted), _MUTED


def _origins_of_output_states(board: BoardClient) -> Iterator[_Origin]:
    """Yield functions that lead to a state, also by timers, each with that state and its reason."""
    yield from _asked_output_states(board)
    for timer in timer_kinds(board, HOLD, LEASE, UNATTENDED):
        yield partial(_mute_by_timer, board, timer), (OutputState.MUTED, timer.reason)


def _new_session_for_output_state(board: BoardClient) -> None:
    """Open a new session while ARMED."""
    board.arm()
    board.hello()


def _sound_for_output_state(board: BoardClient) -> None:
    """Arm the board and latch a frame."""
    board.bring_to(OutputState.DISARMED)
    board.arm()
    latching.latch_now(board)


def _mute_by_timer(board: BoardClient, timer: TimerKind) -> None:
    """Let one timer, of 20 ms, expire so that the board mutes."""
    long = {LEASE.name: 10_000, HOLD.name: 10_000}
    since = board.arm(**long | ({} if timer is UNATTENDED else {timer.name: _SHORT_MS}))
    if timer is UNATTENDED:
        playback.play_now(board, _SEQUENCE, loops=0, period_us=50 * _MS, unattended_ms=_SHORT_MS)
    elif timer is HOLD:
        latching.latch_now(board)
    judged_mute_by_timer(board, since, 1000 * _MS, timer.reason)
    board.configure()


def _inputs_to_output_states(board: BoardClient) -> Iterator[_Input]:
    """Yield every input: name, event in the table of states (None: changes no state), function."""
    plays = bool(board.identity.features & PLAYBACK)
    for event, message in OUTPUT_REQUESTS.items():
        if event is not OutputInput.STOP or plays:
            yield event.name, event, partial(board.link.ask, message)
    yield "MUTE without a session", OutputInput.MUTE, partial(board.mute, session=0)
    yield "a new session", OutputInput.NEW_SESSION, board.hello
    yield "HELLO again", None, lambda: board.hello(board.link.session)
    yield "a stream frame", None, lambda: latching.latch_now(board)
    if board.has(m.Feature.SEQUENCE_PHASES):
        play = playback.play_request(board, _SEQUENCE, loops=1, unattended_ms=100)
        yield "PLAY", None, partial(board.link.ask_at_once, play)


# --- Faults of the hardware --------------------------------------------------------------------


def fail_hardware(board: BoardClient) -> None:
    """Let the hardware fail; NOT-OBSERVED if nothing can."""
    raise_fault = board.raise_fault
    if raise_fault is None:
        not_observed("nothing can let the hardware of this board fail (--fault-cmd)")
    board.link.barrier()
    raise_fault()
    board.wire.idle_beyond(1000)


def recover_from_hardware_fault(board: BoardClient) -> None:
    """Lead the board out of FAULT; NOT-OBSERVED, and a board that starts anew, if it lasts."""
    if board.leaves_fault():
        return
    if board.restart is not None:
        board.restart()
    not_observed("the fault lasts: the command that brings it about (--fault-cmd) has to end it")


def _faults_in_every_state(board: BoardClient) -> Iterator[tuple[str, int]]:
    """Raise a hardware fault in each output state; yield its name and a number.

    The number is that of the first frame received after ARM.
    """
    for name, bring in output_states(board):
        since = board.arm()
        bring(board)
        fail_hardware(board)
        yield f"a fault {name}", since
        recover_from_hardware_fault(board)


@case("HG-6.8/1-fault")
def tells_of_a_hardware_fault(board: BoardClient) -> None:
    """STATE_CHANGED tells a fault once, from each state"""
    for name, since in _faults_in_every_state(board):
        board.link.barrier()
        told = [event for _, event in board.link.events(m.StateChanged, since)]
        due = [m.StateChanged(OutputState.FAULT, MuteReason.FAULT)]
        check_equal(told, due, f"{name}: STATE_CHANGED")


@case("HG-6.6/1-fault", evidence=SELF_REPORTED)
def a_hardware_fault_silences(board: BoardClient) -> None:
    """a fault silences the output, flushes the queue and ends a playback, in each state"""
    before = board.status().counters
    for text, since in _faults_in_every_state(board):
        board.check_status(text, queued=0, **_IN_FAULT)
        board.check_counted(before, text, {"flushed": QUEUED_FRAMES * text.endswith(QUEUES)})
        latching.check_silent(board, text)
        ended, due = board.link.events(m.PlaybackEnded, since), (PLAYING, WAITS)
        check_equal(len(ended), text.endswith(due), f"{text}: {len(ended)} PLAYBACK_ENDED")
        before = board.status().counters


@case("HG-6.6/3")
def a_lasting_hardware_fault_refuses_disarm(board: BoardClient) -> None:
    """a fault that lasts refuses DISARM with ERROR(FAULT)"""
    fail_hardware(board)
    answer = board.link.ask(m.Disarm())
    is_gone = not isinstance(answer.message, m.Error)
    if not is_gone:
        board.link.error_in(answer, m.Disarm.TYPE, m.ErrorCode.FAULT)
    recover_from_hardware_fault(board)
    if is_gone:
        not_observed("DISARM led out of FAULT at once: the fault was over before")


@case("HG-6.2/1-fault")
def follows_the_output_states_in_a_fault(board: BoardClient) -> None:
    """in FAULT every input leads to the state in the table"""
    _judge_inputs_in_fault(board, with_reason=False)


@case("HG-6.2/3-fault", evidence=SELF_REPORTED)
def a_hardware_fault_keeps_its_reason(board: BoardClient) -> None:
    """MUTE of any session, a refused ARM, a new session and a second fault leave the reason
    FAULT
    """
    _judge_inputs_in_fault(board, with_reason=True)


def _judge_inputs_in_fault(board: BoardClient, *, with_reason: bool) -> None:
    """FAILED unless each input in FAULT leads where the table of states says, DISARM to DISARMED.

    *with_reason*: the reason of each state is compared too.
    """
    playback.send_phases_to_store_if_supported(board, _SEQUENCE, frames=2)
    fault = OutputState.FAULT, MuteReason.FAULT
    again: _Input = "a second fault", None, partial(fail_hardware, board)
    for one in (*_inputs_to_output_states(board), again):
        fail_hardware(board)
        if one[1] is not OutputInput.DISARM:
            _judge_input_to_output_state(board, fault, one, with_reason=with_reason)
        recover_from_hardware_fault(board)
        board.check_status("DISARM in FAULT", state=OutputState.DISARMED)


@case("HG-6.2/1-requests", needs=PLAYS, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def a_hardware_fault_leaves_requests(board: BoardClient) -> None:
    """in FAULT all requests but ARM and PLAY are carried out: settings, uploads, readings,
    STATUS
    """
    board.arm()
    latching.latch_now(board)
    fail_hardware(board)
    period_ms = board.quick_status_ms
    board.hello()
    config = board.configure(host_timeout_ms=_WAITED_MS, hold_ms=_WAITED_MS, late_window_us=777)
    for message in valid_requests_to_send(board, _SEQUENCE):
        if isinstance(message, m.Disarm):
            continue
        answer = board.link.ask_at_once(message)
        if isinstance(message, m.UploadBegin):
            uploads.require_room_for_upload(message, answer)
        is_refused = isinstance(answer.message, m.Error)
        text = f"{message.TYPE.name} in FAULT: {board.link.answer_text(answer)}"
        check(is_refused == isinstance(message, m.Arm | m.Play), text)
    playback.send_phases_to_store(board, _SEQUENCE, frames=1)
    board.configure(status_period_ms=period_ms, late_window_us=777)
    since = board.link.mark()
    board.wire.idle(3 * period_ms * 1000 + 2 * _WAITED_MS * 1000)
    board.check_status("timers in FAULT", **_IN_FAULT)
    told = len(board.link.events(m.Status, since))
    check(told >= 2, f"{told} STATUS in FAULT in more than 3 periods")
    board.link.ask(m.SetConfig(config))
    recover_from_hardware_fault(board)
    board.configure()
    board.arm()
    with board.counting(latched=2):
        latching.latch_now(board)
        playback.play_out(board, _SEQUENCE, 1)
