"""Requests of fixed length and trace modes that a board takes, by its capabilities."""

from __future__ import annotations

from typing import Final

from haptogram_protocol.messages import (
    MESSAGES,
    REQUEST_RANGE,
    DriveKind,
    Feature,
    Message,
    Mute,
    TraceMode,
)
from haptogram_protocol.rules import READ_CAPABILITIES, TRACE_CAPABILITIES, unsupported_types

from .board_client import BoardClient

TRACES: Final = Feature.TRACE | Feature.TRACE_DRIVE | Feature.TRACE_RING
#: A sequence is played under a configuration that the case sets; its latches are traced.
PLAYS: Final = Feature.CONFIG | Feature.SEQUENCE_PHASES
TRACED_PLAYS: Final = PLAYS | Feature.TRACE
#: A ramp, and the amplitudes that are radiated in it.
SHOWN_RAMPS: Final = Feature.CONFIG | Feature.AMPLITUDE | Feature.READ_RADIATED
#: Trace modes with the capability of each: with OFF, which needs none, and without.
ALL_MODES: Final = tuple((feature, mode) for mode, feature in TRACE_CAPABILITIES.items())
TRACE_MODES: Final = tuple(pair for pair in ALL_MODES if pair[1] is not TraceMode.OFF)


def requests_that_board_takes(board: BoardClient) -> list[type[Message]]:
    """Return the requests of fixed length that the board takes, but for MUTE."""
    lacking = unsupported_types(Feature(board.identity.features))
    return [
        kind
        for kind in MESSAGES.values()
        if kind.TYPE in REQUEST_RANGE and not kind.TAIL and kind.TYPE not in lacking
        if kind is not Mute
    ]


def drive_kinds(board: BoardClient) -> list[DriveKind]:
    """Return the kinds of drives that the board reads back."""
    return [kind for kind, feature in READ_CAPABILITIES.items() if board.has(feature)]


def trace_modes(board: BoardClient, *wanted: TraceMode) -> list[TraceMode]:
    """Return those of the *wanted* trace modes, or of all but OFF, that the board takes."""
    modes = wanted or (TraceMode.CRC, TraceMode.DRIVE, TraceMode.RING)
    return [mode for mode in modes if board.has(TRACE_CAPABILITIES[mode])]
