"""Requests of fixed length and trace modes that a board takes, by its capabilities."""

from __future__ import annotations

from typing import Final

from haptogram_protocol import messages as m
from haptogram_protocol.rules import READ_CAPABILITIES, TRACE_CAPABILITIES, unsupported_types

from .board_client import BoardClient

TRACES: Final = m.Feature.TRACE | m.Feature.TRACE_DRIVE | m.Feature.TRACE_RING
#: A sequence is played under a configuration that the case sets; its latches are traced.
PLAYS: Final = m.Feature.CONFIG | m.Feature.SEQUENCE_PHASES
TRACED_PLAYS: Final = PLAYS | m.Feature.TRACE
#: A ramp, and the amplitudes that are radiated in it.
SHOWN_RAMPS: Final = m.Feature.CONFIG | m.Feature.AMPLITUDE | m.Feature.READ_RADIATED
#: Trace modes with the capability of each: with OFF, which needs none, and without.
ALL_MODES: Final = tuple((feature, mode) for mode, feature in TRACE_CAPABILITIES.items())
TRACE_MODES: Final = tuple(pair for pair in ALL_MODES if pair[1] is not m.TraceMode.OFF)


def requests_that_board_takes(board: BoardClient) -> list[type[m.Message]]:
    """Return the requests of fixed length that the board takes, but for MUTE."""
    lacking = unsupported_types(m.Feature(board.identity.features))
    return [
        kind
        for kind in m.MESSAGES.values()
        if kind.TYPE in m.REQUEST_RANGE and not kind.TAIL and kind.TYPE not in lacking
        if kind is not m.Mute
    ]


def drive_kinds(board: BoardClient) -> list[m.DriveKind]:
    """Return the kinds of drives that the board reads back."""
    return [kind for kind, feature in READ_CAPABILITIES.items() if board.has(feature)]


def trace_modes(board: BoardClient, *wanted: m.TraceMode) -> list[m.TraceMode]:
    """Return those of the *wanted* trace modes, or of all but OFF, that the board takes."""
    modes = wanted or (m.TraceMode.CRC, m.TraceMode.DRIVE, m.TraceMode.RING)
    return [mode for mode in modes if board.has(TRACE_CAPABILITIES[mode])]
