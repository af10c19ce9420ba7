"""Requests of fixed length that a board takes, by its capabilities."""

from __future__ import annotations

from typing import Final

from haptogram_protocol.messages import (
    Arm,
    Disarm,
    Feature,
    GetConfig,
    GetGeometry,
    GetStatus,
    Hello,
    Message,
    Ping,
    Play,
    ReadDrive,
    ReadTrace,
    SetConfig,
    Stop,
    UploadBegin,
    UploadCommit,
)

from .board_client import BoardClient

PLAYBACK: Final = Feature.SEQUENCE_PHASES | Feature.SEQUENCE_POINTS
UPLOADS: Final = PLAYBACK | Feature.CORRECTION
TRACES: Final = Feature.TRACE | Feature.TRACE_DRIVE | Feature.TRACE_RING
#: Capabilities of which a request needs one; without any, every board takes the request.
_NEEDS_ANY: Final[dict[type[Message], Feature]] = {
    Hello: Feature(0),
    Arm: Feature(0),
    Disarm: Feature(0),
    Ping: Feature(0),
    GetStatus: Feature(0),
    GetConfig: Feature(0),
    GetGeometry: Feature(0),
    SetConfig: Feature.CONFIG,
    ReadDrive: Feature.READ_LATCHED | Feature.READ_RADIATED,
    ReadTrace: Feature.TRACE_RING,
    UploadBegin: UPLOADS,
    UploadCommit: UPLOADS,
    Play: PLAYBACK,
    Stop: PLAYBACK,
}


def requests_that_board_takes(board: BoardClient) -> list[type[Message]]:
    """Return the requests of fixed length that the board takes."""
    features = board.identity.features
    return [kind for kind, any_of in _NEEDS_ANY.items() if not any_of or any_of & features]


def session_for_request(board: BoardClient, kind: type[Message]) -> int:
    """Return the session that the header of a request carries: 0 for HELLO."""
    return 0 if kind is Hello else board.link.session
