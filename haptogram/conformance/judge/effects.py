"""Changes that are due after an event, where all else that a board holds is as before."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final, TypeAlias

from haptogram_protocol.messages import (
    Arm,
    Disarm,
    ErrorCode,
    Message,
    Mute,
    Stop,
    TraceReply,
    UploadChunkReply,
)
from haptogram_protocol.state import OUTPUT_TRANSITIONS, MuteReason, OutputInput, OutputState

from ..client.board_client import BoardClient
from .held_state import ANYTHING, Held

#: What is due after an event, where it is not what was there before.
Due: TypeAlias = Callable[[BoardClient, Held], dict[str, object]]
StateAndReason: TypeAlias = tuple[OutputState, MuteReason]
#: Requests that are inputs of the table of HG-6.2.
OUTPUT_REQUESTS: Final[Mapping[OutputInput, Message]] = {
    OutputInput.ARM: Arm(),
    OutputInput.MUTE: Mute(),
    OutputInput.DISARM: Disarm(),
    OutputInput.STOP: Stop(),
}
#: Reasons that inputs give to the state that they lead to.
_REASONS: Final = {
    OutputInput.NEW_SESSION: MuteReason.NEW_SESSION,
    OutputInput.ARM: MuteReason.NONE,
    OutputInput.MUTE: MuteReason.MUTE,
    OutputInput.DISARM: MuteReason.DISARM,
}


def state_and_reason_after(before: StateAndReason, event: OutputInput) -> StateAndReason:
    """Return state and reason after an input; one that is not allowed changes neither."""
    due = OUTPUT_TRANSITIONS.get((before[0], event))
    state = before[0] if due is None else due
    asked = event is OutputInput.MUTE and state is OutputState.MUTED
    return state, _REASONS[event] if state is not before[0] or asked else before[1]


def no_effect(_: BoardClient, __: Held) -> dict[str, object]:
    """Return no change."""
    return {}


def _counted_effect(before: Held, name: str, number: int) -> dict[str, object]:
    key = f"the counter {name}"
    count = before[key]
    assert isinstance(count, int)  # a counter
    return {key: (count + number) & 0xFFFFFFFF}


def _queued_before_effect(before: Held) -> int:
    queued = before["the queue"]
    assert isinstance(queued, int)  # StatusReply.queued
    return queued


def state_before_effect(before: Held) -> tuple[OutputState, MuteReason]:
    """Return output state and reason before an event."""
    found = before["the output state"]
    assert isinstance(found, tuple)  # judged_held_state
    return found


def _flushed_effect(before: Held) -> dict[str, object]:
    return {"the queue": 0, "events": ANYTHING} | _counted_effect(
        before, "flushed", _queued_before_effect(before)
    )


def effect_of_input(event: OutputInput) -> Due:
    """Return the changes by an input of the table of HG-6.2."""

    def due(_: BoardClient, before: Held) -> dict[str, object]:
        found = state_and_reason_after(state_before_effect(before), event)
        changed: dict[str, object] = {"the output state": found}
        if event is not OutputInput.ARM:
            changed |= {"the radiated drive": ANYTHING} | _flushed_effect(before)
        return changed

    return due


def effect_of_new_session(board: BoardClient, before: Held) -> dict[str, object]:
    """Return the changes by HELLO with a new nonce (HG-4.6)."""
    ring = TraceReply(0, 0, ())
    refused = ("refused", ErrorCode.BAD_STATE)
    return effect_of_input(OutputInput.NEW_SESSION)(board, before) | {
        "the last latch": (0, 0),
        "the latched drive": ANYTHING,  # HG-8.6/4
        "the trace ring": ring,
        "the upload": refused,
    }


def effect_of_timer(reason: MuteReason) -> Due:
    """Return the changes by a mute by a timer (HG-6.11/5)."""

    def due(_: BoardClient, before: Held) -> dict[str, object]:
        free = ("the radiated drive", "config_crc", "the configuration")
        changed: dict[str, object] = dict.fromkeys(free, ANYTHING)
        changed["the output state"] = OutputState.MUTED, reason
        return changed | _flushed_effect(before) | _counted_effect(before, "timeouts", 1)

    return due


def effect_of_fault(_: BoardClient, before: Held) -> dict[str, object]:
    """Return the changes by a fault of the hardware."""
    changed: dict[str, object] = {"the output state": (OutputState.FAULT, MuteReason.FAULT)}
    return changed | {"the radiated drive": ANYTHING} | _flushed_effect(before)


def effect_counted_once(name: str) -> Due:
    """Return the change by an event that one counter counts, once."""
    return lambda _, before: _counted_effect(before, name, 1)


def effect_of_received(number: int) -> Due:
    """Return the change by an upload of which so many bytes have come."""
    return lambda _, __: {"the upload": UploadChunkReply(number)}


def effect_of_copies(_: BoardClient, __: Held) -> dict[str, object]:
    """Return the change by frames that the board has seen before."""
    return {"the counter duplicate": ANYTHING}


def effect_of_end(_: BoardClient, __: Held) -> dict[str, object]:
    """Return the change by the end of a playback, if one plays."""
    return {"events": ANYTHING}


def effect_of_play(_: BoardClient, before: Held) -> dict[str, object]:
    """Return the changes by PLAY (HG-7.6/3)."""
    return _flushed_effect(before)


def effect_of_commit(_: BoardClient, __: Held) -> dict[str, object]:
    """Return the change by UPLOAD_COMMIT: no upload is left."""
    return {"the upload": ("refused", ErrorCode.BAD_STATE)}


def effect_of_correction(_: BoardClient, __: Held) -> dict[str, object]:
    """Return the changes by a new phase correction."""
    refused = ("refused", ErrorCode.BAD_STATE)
    free = ("config_crc", "the configuration", "the radiated drive")
    return {"the upload": refused} | dict.fromkeys(free, ANYTHING)
