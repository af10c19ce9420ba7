"""HG-6.2: the state and its reason, after every input in every state, whatever led there."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Final, TypeAlias

from haptogram_protocol.messages import Arm, Disarm, Feature, Flag, Message, Mute, Play, Stop
from haptogram_protocol.state import OUTPUT_TRANSITIONS, MuteReason, OutputInput, OutputState

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.capabilities import PLAYBACK
from ...client.latching import latch_now
from ...client.playback import play_now, send_phases_to_store_if_supported
from ...judge.timers import judged_mute_by_timer
from ...outcome import SELF_REPORTED, check

_MS: Final = 1000
_SEQUENCE: Final = 5
_SHORT_MS: Final = 20

Found: TypeAlias = tuple[OutputState, MuteReason]
#: Reasons that inputs give to the state that they lead to.
_REASONS: Final = {
    OutputInput.NEW_SESSION: MuteReason.NEW_SESSION,
    OutputInput.ARM: MuteReason.NONE,
    OutputInput.MUTE: MuteReason.MUTE,
    OutputInput.DISARM: MuteReason.DISARM,
}


def state_and_reason_after(before: Found, event: OutputInput) -> Found:
    """Return state and reason after an input; one that is not allowed changes neither."""
    due = OUTPUT_TRANSITIONS.get((before[0], event))
    state = before[0] if due is None else due
    asked = event is OutputInput.MUTE and state is OutputState.MUTED
    return state, _REASONS[event] if state is not before[0] or asked else before[1]


@case(
    "HG-6.2/3",
    "behind each reason of each state every input leads to the state and the reason that are due",
    variant="origins",
    evidence=SELF_REPORTED,
    depth=Depth.DEFAULT,
)
def every_input_in_every_output_state(board: BoardClient) -> None:
    send_phases_to_store_if_supported(board, _SEQUENCE, frames=1)
    for bring, due in _origins_of_output_states(board):
        for name, event, happen in _inputs_to_output_states(board):
            bring()
            before = _found_state_and_reason(board)
            check(
                before == due,
                f"{_state_text(before)} where {_state_text(due)} is due",
            )
            happen()
            after = _found_state_and_reason(board)
            wanted = before if event is None else state_and_reason_after(before, event)
            check(
                after == wanted,
                f"{name} in {_state_text(before)}: {_state_text(after)}, due {_state_text(wanted)}",
            )


def _found_state_and_reason(board: BoardClient) -> Found:
    status = board.status()
    return status.state, status.reason


def _state_text(found: Found) -> str:
    return f"{found[0].name} ({found[1].name})"


def _origins_of_output_states(board: BoardClient) -> Iterator[tuple[Callable[[], object], Found]]:
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
    latch_now(board, board.flat_phases())


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
        latch_now(board, board.flat_phases())
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
    yield "MUTE without a session", OutputInput.MUTE, partial(board.link.ask, Mute(), session=0)
    yield "a new session", OutputInput.NEW_SESSION, board.hello
    yield "HELLO again", None, lambda: board.hello(board.link.session)
    yield "a stream frame", None, lambda: latch_now(board, board.flat_phases())
    if board.identity.features & PLAYBACK:
        yield "STOP", None, partial(board.link.ask, Stop())
    if board.has(Feature.SEQUENCE_PHASES):
        play = Play(_SEQUENCE, 1000, 1, 100)
        yield "PLAY", None, partial(board.link.ask, play, flags=int(Flag.IMMEDIATE))
