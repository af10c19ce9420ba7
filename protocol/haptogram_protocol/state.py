"""The two state machines of the protocol, as tables.  SPEC.md chapters 4 and 6.

A pair that a table lacks is a violation: by the host itself (``LocalProtocolError``) or by the peer
(``ERROR(BAD_STATE)``). SPEC.md, the tests and the board read these tables.
"""

from __future__ import annotations

import enum
from collections.abc import Mapping
from typing import Final

from .documented import DocumentedEnum
from .errors import LocalProtocolError


class OutputState(DocumentedEnum):
    """States of the board's output.  HG-6.1."""

    DISARMED = 0, "output off; frames are dropped until ARM"
    ARMED = 1, "frames are latched and radiated"
    MUTED = 2, "output off after MUTE or by a timer; only ARM leads out"
    FAULT = 3, "output off; the hardware reports a fault; DISARM leads out once it is gone"


class MuteReason(DocumentedEnum):
    """Why the output is off.  HG-6.2."""

    NONE = 0, "the output is not off"
    NEVER_ARMED = 1, "nothing has armed the board since it started"
    MUTE = 2, "MUTE was received"
    DISARM = 3, "DISARM was received"
    NEW_SESSION = 4, "a HELLO with a new nonce was received"
    HOLD_EXPIRED = 5, "the stream stopped"
    HOST_SILENT = 6, "the lease ran out"
    UNATTENDED = 7, "playback ran longer than it was allowed to without a frame from the host"
    FAULT = 8, "the hardware reports a fault"


class OutputInput(enum.Enum):
    """Input of the state machine of the output.  HG-6.2."""

    __hash__ = object.__hash__  # that of an enumeration is written in Python

    NEW_SESSION = enum.auto()
    ARM = enum.auto()
    MUTE = enum.auto()
    DISARM = enum.auto()
    LATCH = enum.auto()
    PLAY = enum.auto()
    STOP = enum.auto()
    RAMP_ENDED = enum.auto()
    FAULT_FOUND = enum.auto()


_S, _I = OutputState, OutputInput

# HG-6.2.  Only ARM leads out of MUTED; MUTE is never refused.
OUTPUT_TRANSITIONS: Final[Mapping[tuple[OutputState, OutputInput], OutputState]] = {
    (_S.DISARMED, _I.NEW_SESSION): _S.DISARMED,
    (_S.DISARMED, _I.ARM): _S.ARMED,
    (_S.DISARMED, _I.MUTE): _S.MUTED,
    (_S.DISARMED, _I.DISARM): _S.DISARMED,
    (_S.DISARMED, _I.STOP): _S.DISARMED,
    (_S.DISARMED, _I.FAULT_FOUND): _S.FAULT,
    (_S.ARMED, _I.NEW_SESSION): _S.DISARMED,
    (_S.ARMED, _I.ARM): _S.ARMED,
    (_S.ARMED, _I.MUTE): _S.MUTED,
    (_S.ARMED, _I.DISARM): _S.DISARMED,
    (_S.ARMED, _I.LATCH): _S.ARMED,
    (_S.ARMED, _I.PLAY): _S.ARMED,
    (_S.ARMED, _I.STOP): _S.ARMED,
    (_S.ARMED, _I.RAMP_ENDED): _S.MUTED,
    (_S.ARMED, _I.FAULT_FOUND): _S.FAULT,
    (_S.MUTED, _I.NEW_SESSION): _S.MUTED,
    (_S.MUTED, _I.ARM): _S.ARMED,
    (_S.MUTED, _I.MUTE): _S.MUTED,
    (_S.MUTED, _I.DISARM): _S.MUTED,
    (_S.MUTED, _I.STOP): _S.MUTED,
    (_S.MUTED, _I.FAULT_FOUND): _S.FAULT,
    (_S.FAULT, _I.NEW_SESSION): _S.FAULT,
    (_S.FAULT, _I.MUTE): _S.FAULT,
    (_S.FAULT, _I.STOP): _S.FAULT,
    (_S.FAULT, _I.DISARM): _S.DISARMED,
    (_S.FAULT, _I.FAULT_FOUND): _S.FAULT,
}


class LinkState(enum.Enum):
    """State of the link as the host knows it.  HG-4.1.

    Attributes
    ----------
    CLOSED
        No HELLO was sent.
    GREETING
        A HELLO waits for its answer.
    OPEN
        The session is open: requests and stream frames may be sent.
    FAILED
        A request was refused for its session or not answered; only HELLO leads out.
    """

    __hash__ = object.__hash__
    CLOSED = enum.auto()
    GREETING = enum.auto()
    OPEN = enum.auto()
    FAILED = enum.auto()


class LinkInput(enum.Enum):
    """Input of the state machine of the link."""

    __hash__ = object.__hash__

    HELLO_SENT = enum.auto()
    HELLO_ANSWERED = enum.auto()
    REFUSED = enum.auto()
    REQUEST_SENT = enum.auto()
    STREAM_SENT = enum.auto()
    TIMED_OUT = enum.auto()
    PORT_CLOSED = enum.auto()


_L, _N = LinkState, LinkInput

# HG-4.1.  HELLO is allowed in every state: it opens the link again.
LINK_TRANSITIONS: Final[Mapping[tuple[LinkState, LinkInput], LinkState]] = {
    (_L.CLOSED, _N.HELLO_SENT): _L.GREETING,
    (_L.CLOSED, _N.PORT_CLOSED): _L.CLOSED,
    (_L.GREETING, _N.HELLO_SENT): _L.GREETING,
    (_L.GREETING, _N.HELLO_ANSWERED): _L.OPEN,
    (_L.GREETING, _N.REFUSED): _L.FAILED,
    (_L.GREETING, _N.TIMED_OUT): _L.FAILED,
    (_L.GREETING, _N.PORT_CLOSED): _L.CLOSED,
    (_L.OPEN, _N.HELLO_SENT): _L.GREETING,
    (_L.OPEN, _N.REQUEST_SENT): _L.OPEN,
    (_L.OPEN, _N.STREAM_SENT): _L.OPEN,
    (_L.OPEN, _N.REFUSED): _L.OPEN,
    (_L.OPEN, _N.TIMED_OUT): _L.OPEN,
    (_L.OPEN, _N.PORT_CLOSED): _L.CLOSED,
    (_L.FAILED, _N.HELLO_SENT): _L.GREETING,
    (_L.FAILED, _N.PORT_CLOSED): _L.CLOSED,
}


def next_output_state(state: OutputState, event: OutputInput) -> OutputState:
    """Return the output state after *event*; :class:`LocalProtocolError` if it is not allowed."""
    try:
        return OUTPUT_TRANSITIONS[state, event]
    except KeyError:
        raise LocalProtocolError(f"{event.name} is not allowed while {state.name}") from None


def next_link_state(state: LinkState, event: LinkInput) -> LinkState:
    """Return the link state after *event*; :class:`LocalProtocolError` if it is not allowed."""
    try:
        return LINK_TRANSITIONS[state, event]
    except KeyError:
        raise LocalProtocolError(f"{event.name} is not allowed while {state.name}") from None
