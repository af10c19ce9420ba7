"""HG-6.2, HG-6.6, HG-6.8: a fault of the hardware, where something can bring one about."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final

from haptogram_protocol.messages import (
    Arm,
    Disarm,
    Error,
    ErrorCode,
    Feature,
    Mute,
    Play,
    PlaybackEnded,
    SetConfig,
    StateChanged,
    Status,
    StatusReply,
    UploadBegin,
)
from haptogram_protocol.rules import PLAYBACK
from haptogram_protocol.state import OUTPUT_TRANSITIONS, MuteReason, OutputInput, OutputState

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.latching import is_board_silent, latch_now
from ...client.playback import (
    play_out,
    play_request,
    send_phases_that_fit,
    send_phases_to_store,
)
from ...client.request_client import flags_at_once
from ...client.stream_kinds import valid_requests_to_send
from ...client.uploads import require_room_for_upload
from ...judge.effects import OUTPUT_REQUESTS
from ...outcome import SELF_REPORTED, check, check_equal, not_observed
from ..ch05_stream.every_state import (
    PLAYBACK_PLAYS,
    PLAYBACK_WAITS,
    QUEUED_FRAMES,
    QUEUES,
    output_states,
)

_SEQUENCE: Final = 4
_SHORT_MS: Final = 30  # of timers that would run out
_FAULT: Final = (OutputState.FAULT, MuteReason.FAULT)


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


def _check_in_fault(board: BoardClient, text: str) -> StatusReply:
    """Return the status; FAILED unless it says FAULT, with the reason FAULT."""
    found = board.status()
    told = found.state, found.reason
    check_equal(told, _FAULT, f"{text}: {told[0].name}, {told[1].name}")
    return found


def _faults_in_every_state(board: BoardClient) -> Iterator[tuple[str, int]]:
    """Let the hardware fail in each state; yield its name, and the piece at which it was ARMED."""
    for name, bring in output_states(board).items():
        since = board.arm()
        bring()
        fail_hardware(board)
        yield f"a fault {name}", since
        recover_from_hardware_fault(board)


@case("HG-6.8/1-fault")
def tells_of_a_hardware_fault(board: BoardClient) -> None:
    """STATE_CHANGED tells a fault once, from each state"""
    for name, since in _faults_in_every_state(board):
        board.link.barrier()
        told = [(event.state, event.reason) for _, event in board.link.events(StateChanged, since)]
        check_equal(told, [_FAULT], f"{name}: STATE_CHANGED says {told}")


@case("HG-6.6/1-fault", evidence=SELF_REPORTED)
def a_hardware_fault_silences(board: BoardClient) -> None:
    """a fault silences the output, flushes the queue and ends a playback, in each state"""
    before = board.status().counters
    for text, since in _faults_in_every_state(board):
        found = _check_in_fault(board, text)
        board.check_counted(before, text, {"flushed": QUEUED_FRAMES * text.endswith(QUEUES)})
        check_equal(found.queued, 0, f"{text}: {found.queued} frames are queued")
        if board.has(Feature.READ_RADIATED):
            check(is_board_silent(board), f"{text}: transducers are driven")
        ended = len(board.link.events(PlaybackEnded, since))
        check_equal(
            ended,
            text.endswith((PLAYBACK_PLAYS, PLAYBACK_WAITS)),
            f"{text}: {ended} PLAYBACK_ENDED",
        )
        before = board.status().counters


@case("HG-6.6/3")
def a_lasting_hardware_fault_refuses_disarm(board: BoardClient) -> None:
    """a fault that lasts refuses DISARM with ERROR(FAULT)"""
    fail_hardware(board)
    answer = board.link.ask(Disarm())
    is_gone = not isinstance(answer.message, Error)
    if not is_gone:
        board.link.error_in(answer, Disarm.TYPE, ErrorCode.FAULT)
    recover_from_hardware_fault(board)
    if is_gone:
        not_observed("DISARM led out of FAULT at once: the fault was over before")


@case("HG-6.2/1-fault")
def follows_the_output_states_in_a_fault(board: BoardClient) -> None:
    """in FAULT every input leads to the state in the table"""
    inputs = dict(OUTPUT_REQUESTS)
    if board.has(Feature.SEQUENCE_PHASES):
        send_phases_that_fit(board, _SEQUENCE, frames=2)
        inputs |= {OutputInput.PLAY: play_request(board, _SEQUENCE, loops=1, unattended_ms=100)}
    if not board.identity.features & PLAYBACK:
        del inputs[OutputInput.STOP]
    for event in (*inputs, OutputInput.LATCH, OutputInput.NEW_SESSION):
        fail_hardware(board)
        due = OUTPUT_TRANSITIONS.get((OutputState.FAULT, event))
        if event is OutputInput.NEW_SESSION:
            board.hello()
        elif event is OutputInput.DISARM:
            recover_from_hardware_fault(board)
        elif event is OutputInput.LATCH:
            with board.counting(dropped_state=None, latched=0):
                board.link.stream(board.flat_phases())
        elif due is None:
            flags, state = flags_at_once(inputs[event]), int(OutputState.FAULT)
            board.link.refused(inputs[event], ErrorCode.BAD_STATE, state, flags=flags)
        else:
            board.link.ask(inputs[event])
        board.check_state(OutputState.FAULT if due is None else due, f"{event.name} in FAULT:")
        recover_from_hardware_fault(board)


@case("HG-6.2/3-fault", evidence=SELF_REPORTED)
def a_hardware_fault_keeps_its_reason(board: BoardClient) -> None:
    """MUTE of any session, a refused ARM, a new session and a second fault leave the reason
    FAULT
    """
    others: dict[str, Callable[[], object]] = {
        "MUTE": lambda: board.link.ask(Mute()),
        "MUTE without a session": lambda: board.link.ask(Mute(), session=0),
        "ARM": lambda: board.link.ask(Arm()),
        "a new session": board.hello,
        "a second fault": lambda: fail_hardware(board),
    }
    fail_hardware(board)
    for name, happen in others.items():
        happen()
        _check_in_fault(board, f"{name} in FAULT")
    recover_from_hardware_fault(board)


@case(
    "HG-6.2/1-requests",
    needs=Feature.CONFIG | Feature.SEQUENCE_PHASES,
    evidence=SELF_REPORTED,
    depth=Depth.DEFAULT,
)
def a_hardware_fault_leaves_requests(board: BoardClient) -> None:
    """in FAULT all requests but ARM and PLAY are carried out: settings, uploads, readings,
    STATUS
    """
    board.arm()
    latch_now(board)
    fail_hardware(board)
    period_ms = board.quick_status_ms
    board.hello()
    config = board.configure(host_timeout_ms=_SHORT_MS, hold_ms=_SHORT_MS, late_window_us=777)
    for message in valid_requests_to_send(board, _SEQUENCE):
        if isinstance(message, Disarm):
            continue
        answer = board.link.ask_at_once(message)
        if isinstance(message, UploadBegin):
            require_room_for_upload(message, answer)
        is_refused = isinstance(answer.message, Error)
        text = f"{message.TYPE.name} in FAULT: {board.link.answer_text(answer)}"
        check(is_refused == isinstance(message, Arm | Play), text)
    send_phases_to_store(board, _SEQUENCE, frames=1)
    board.configure(status_period_ms=period_ms, late_window_us=777)
    since = board.link.mark()
    board.wire.idle(3 * period_ms * 1000 + 2 * _SHORT_MS * 1000)
    _check_in_fault(board, "timers in FAULT")
    told = len(board.link.events(Status, since))
    check(told >= 2, f"{told} STATUS in FAULT in more than 3 periods")
    board.link.ask(SetConfig(config))
    recover_from_hardware_fault(board)
    board.configure()
    board.arm()
    with board.counting(latched=2):
        latch_now(board)
        play_out(board, _SEQUENCE, 1)
