"""Changes that are due after an event, where all else that a board holds is as before."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final, TypeAlias

from haptogram_protocol import messages as m
from haptogram_protocol.state import OUTPUT_TRANSITIONS, MuteReason, OutputInput, OutputState

from ..clauses import load_spec_table
from ..client.board_client import BoardClient
from .held_state import ANYTHING, Held

#: Expected changes of the state after an event.
Due: TypeAlias = Callable[[BoardClient, Held], dict[str, object]]
StateAndReason: TypeAlias = tuple[OutputState, MuteReason]
#: Requests that are inputs of the table of HG-6.2.
OUTPUT_REQUESTS: Final[Mapping[OutputInput, m.Message]] = {
    OutputInput.ARM: m.Arm(),
    OutputInput.MUTE: m.Mute(),
    OutputInput.DISARM: m.Disarm(),
    OutputInput.STOP: m.Stop(),
}
#: Reasons that inputs give to the state that they lead to.
_REASONS: Final = {
    OutputInput.NEW_SESSION: MuteReason.NEW_SESSION,
    OutputInput.ARM: MuteReason.NONE,
    OutputInput.MUTE: MuteReason.MUTE,
    OutputInput.DISARM: MuteReason.DISARM,
}
#: The same inputs in the table of effects.
_INPUTS: Final = {
    OutputInput.NEW_SESSION: "HELLO, another nonce",
    OutputInput.ARM: "ARM",
    OutputInput.MUTE: "MUTE, any session",
    OutputInput.DISARM: "DISARM",
}
_OTHER_CONFIG: Final = {"config_crc": ANYTHING, "the configuration": ANYTHING}


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
    """Return {counter: due value} for the counter *name* that counts *number* beyond *before*."""
    key = f"the counter {name}"
    count = before[key]
    assert isinstance(count, int)  # a counter
    return {key: (count + number) & 0xFFFFFFFF}


def state_before_effect(before: Held) -> tuple[OutputState, MuteReason]:
    """Return output state and reason before an event."""
    found = before["the output state"]
    assert isinstance(found, tuple)  # judged_held_state
    return found


def _tabled_effect(name: str, before: Held) -> dict[str, object]:
    """Return what SPEC.md's table of effects says of held state after the input *name*.

    That is due values by name; what is not in it stays as in *before*.
    """
    row = next(row for row in load_spec_table("input") if row["input"] == name)
    changed: dict[str, object] = {}
    if "hold" in row:  # the output goes off
        changed["the radiated drive"] = ANYTHING
    if "playback" in row:
        changed["events"] = ANYTHING
    if row.get("queue") == "flushed":
        queued = before["the queue"]
        assert isinstance(queued, int)  # StatusReply.queued
        changed |= {"the queue": 0} | _counted_effect(before, "flushed", queued)
    if "upload" in row:  # none is left
        changed["the upload"] = "refused", m.ErrorCode.BAD_STATE
    if "last latch, ring" in row:  # the drive: HG-8.6/4
        changed |= {"the last latch": (0, 0), "the trace ring": m.TraceReply(0, 0, ())}
        changed["the latched drive"] = ANYTHING
    return changed


def _effect_of_row(name: str) -> Due:
    """Return a function of (board, held state before) for the table's row *name* in SPEC.md."""
    return lambda _, before: _tabled_effect(name, before)


def effect_of_input(event: OutputInput) -> Due:
    """Return the changes by an input of the table of HG-6.2."""

    def due(_: BoardClient, before: Held) -> dict[str, object]:
        found = state_and_reason_after(state_before_effect(before), event)
        return {"the output state": found} | _tabled_effect(_INPUTS[event], before)

    return due


def effect_of_timer(reason: MuteReason) -> Due:
    """Return the changes by a mute by a timer (HG-6.11/5), whose length was set for it."""

    def due(_: BoardClient, before: Held) -> dict[str, object]:
        changed: dict[str, object] = {"the output state": (OutputState.MUTED, reason)}
        changed |= _tabled_effect("end of a ramp", before) | _OTHER_CONFIG
        return changed | _counted_effect(before, "timeouts", 1)

    return due


def effect_of_fault(_: BoardClient, before: Held) -> dict[str, object]:
    """Return the changes by a fault of the hardware."""
    changed: dict[str, object] = {"the output state": (OutputState.FAULT, MuteReason.FAULT)}
    return changed | _tabled_effect("a fault of the hardware", before)


def effect_counted_once(name: str) -> Due:
    """Return the change by an event that one counter counts, once."""
    return lambda _, before: _counted_effect(before, name, 1)


def effect_of_received(number: int) -> Due:
    """Return the change by an upload after *number* bytes."""
    return lambda _, __: {"the upload": m.UploadChunkReply(number)}


def effect_of_copies(_: BoardClient, __: Held) -> dict[str, object]:
    """Return the change by frames that the board has seen before."""
    return {"the counter duplicate": ANYTHING}


def effect_of_correction(_: BoardClient, before: Held) -> dict[str, object]:
    """Return the changes by a new phase correction."""
    changed = _tabled_effect("UPLOAD_COMMIT", before) | _OTHER_CONFIG
    return changed | {"the radiated drive": ANYTHING}


effect_of_new_session: Final = effect_of_input(OutputInput.NEW_SESSION)
effect_of_end: Final = _effect_of_row("STOP of a playback")
effect_of_play: Final = _effect_of_row("PLAY")
effect_of_commit: Final = _effect_of_row("UPLOAD_COMMIT")
