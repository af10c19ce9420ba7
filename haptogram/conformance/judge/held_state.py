"""State of a board as far as a host can read it, before and after a refusal."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from haptogram_protocol.messages import (
    ConfigReply,
    DriveKind,
    DriveReply,
    Error,
    Feature,
    GetConfig,
    PlaybackEnded,
    ReadDrive,
    ReadTrace,
    StateChanged,
    TraceReply,
    UploadChunk,
)

from ..client.board_client import BoardClient

_RECORDS: Final = 8
#: Counters that no refused request moves.
_COUNTERS: Final = (
    "latched",
    "late",
    "dropped_late",
    "dropped_future",
    "dropped_full",
    "flushed",
    "duplicate",
    "gap",
    "repeated",
    "timeouts",
)
_UPLOADS: Final = Feature.SEQUENCE_PHASES | Feature.SEQUENCE_POINTS | Feature.CORRECTION

Held = Mapping[str, object]


def judged_held_state(board: BoardClient, since: int) -> Held:
    """Return output, queue, margins, configuration, drives, ring and upload by their names.

    Events since piece *since* that tell of a change of output or playback count as well.
    """
    status = board.status()
    held: dict[str, object] = {
        "the output state": (status.state.name, status.reason.name),
        "the queue": status.queued,
        "the arrival margins": status.margins,
        "the last latch": (status.last_seq, status.last_latch_us),
        "config_crc": status.config_crc,
        "the configuration": board.link.call(GetConfig(), ConfigReply),
    }
    held |= {f"the counter {name}": getattr(status.counters, name) for name in _COUNTERS}
    for feature, kind in (
        (Feature.READ_LATCHED, DriveKind.LATCHED),
        (Feature.READ_RADIATED, DriveKind.RADIATED),
    ):
        if board.has(feature):
            read = ReadDrive(kind, 0, board.identity.transducers)
            held[f"the {kind.name.lower()} drive"] = board.link.call(read, DriveReply)
    if board.has(Feature.TRACE_RING):
        held["the trace ring"] = board.link.call(ReadTrace(0, _RECORDS), TraceReply)
    if board.identity.features & _UPLOADS:
        held["the upload"] = _held_state_of_upload(board)
    events = [*board.link.events(StateChanged, since), *board.link.events(PlaybackEnded, since)]
    held["events"] = [event for _, event in events]
    return held


def _held_state_of_upload(board: BoardClient) -> object:
    """Return the progress of the upload by a chunk without bytes, or the refusal's code."""
    answer = board.link.ask(UploadChunk(0, b"")).message
    return ("refused", answer.code) if isinstance(answer, Error) else answer


def held_state_changes(before: Held, after: Held) -> str:
    """Return the differences in words; empty if there is none."""
    return "; ".join(
        f"{name} was {_held_state_text(before[name])}, is {_held_state_text(value)}"
        for name, value in after.items()
        if value != before[name]
    )


def _held_state_text(value: object) -> str:
    text = str(value)
    return text if len(text) <= 80 else f"{text[:77]}..."
