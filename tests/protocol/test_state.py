"""The two tables, over the whole product of state and input."""

import itertools

import pytest

from haptogram_protocol.errors import LocalProtocolError
from haptogram_protocol.state import (
    LINK_TRANSITIONS,
    OUTPUT_TRANSITIONS,
    LinkInput,
    LinkState,
    OutputInput,
    OutputState,
    next_link_state,
    next_output_state,
)

# Written down from SPEC.md HG-6.2, not read from the table: input, then the state after it from
# DISARMED, ARMED, MUTED, FAULT.
OUTPUT = """
    NEW_SESSION  DISARMED DISARMED MUTED    FAULT
    ARM          ARMED    ARMED    ARMED    -
    MUTE         MUTED    MUTED    MUTED    FAULT
    DISARM       DISARMED DISARMED MUTED    DISARMED
    LATCH        -        ARMED    -        -
    PLAY         -        ARMED    -        -
    STOP         DISARMED ARMED    MUTED    FAULT
    RAMP_ENDED   -        MUTED    -        -
    FAULT_FOUND  FAULT    FAULT    FAULT    FAULT
"""
# Likewise from HG-4.1: CLOSED, GREETING, OPEN, FAILED.
LINK = """
    HELLO_SENT      GREETING GREETING GREETING GREETING
    HELLO_ANSWERED  -        OPEN     -        -
    REFUSED         -        FAILED   OPEN     -
    REQUEST_SENT    -        -        OPEN     -
    STREAM_SENT     -        -        OPEN     -
    TIMED_OUT       -        FAILED   OPEN     -
    PORT_CLOSED     CLOSED   CLOSED   CLOSED   CLOSED
"""


def _rows(text: str) -> dict[str, list[str]]:
    return {words[0]: words[1:] for line in text.split("\n") if (words := line.split())}


@pytest.mark.parametrize(
    ("state", "event"), [*itertools.product(OutputState, OutputInput)], ids=lambda item: item.name
)
def test_output_product(state: OutputState, event: OutputInput) -> None:
    wanted = _rows(OUTPUT)[event.name][list(OutputState).index(state)]
    if wanted == "-":
        with pytest.raises(LocalProtocolError, match=f"{event.name}.*{state.name}"):
            next_output_state(state, event)
    else:
        assert next_output_state(state, event) is OutputState[wanted]


@pytest.mark.parametrize(
    ("state", "event"), [*itertools.product(LinkState, LinkInput)], ids=lambda item: item.name
)
def test_link_product(state: LinkState, event: LinkInput) -> None:
    wanted = _rows(LINK)[event.name][list(LinkState).index(state)]
    if wanted == "-":
        with pytest.raises(LocalProtocolError, match=f"{event.name}.*{state.name}"):
            next_link_state(state, event)
    else:
        assert next_link_state(state, event) is LinkState[wanted]


def test_only_arm_leads_to_output() -> None:
    into = {
        event
        for (state, event), after in OUTPUT_TRANSITIONS.items()
        if after is OutputState.ARMED and state is not OutputState.ARMED
    }
    assert into == {OutputInput.ARM}


def test_only_arm_leads_out_of_muted_but_for_a_fault() -> None:
    out = {
        event
        for (state, event), after in OUTPUT_TRANSITIONS.items()
        if state is OutputState.MUTED and after not in (OutputState.MUTED, OutputState.FAULT)
    }
    assert out == {OutputInput.ARM}


@pytest.mark.parametrize("state", OutputState)
def test_mute_is_never_refused_and_never_leaves_output_on(state: OutputState) -> None:
    assert next_output_state(state, OutputInput.MUTE) is not OutputState.ARMED


def test_a_link_can_be_opened_again_and_closed_from_everywhere() -> None:
    for state in LinkState:
        assert LINK_TRANSITIONS[state, LinkInput.HELLO_SENT] is LinkState.GREETING
        assert LINK_TRANSITIONS[state, LinkInput.PORT_CLOSED] is LinkState.CLOSED
