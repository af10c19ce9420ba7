"""The capabilities without which a board does not take a message.  SPEC.md HG-1.2."""

from __future__ import annotations

from typing import Final

from haptogram_protocol.messages import (
    Drives,
    Feature,
    Message,
    Play,
    Points,
    ReadDrive,
    ReadTrace,
    SetConfig,
    Stop,
    UploadBegin,
    UploadChunk,
    UploadCommit,
)

_PLAYBACK: Final = Feature.SEQUENCE_PHASES | Feature.SEQUENCE_POINTS
_UPLOADS: Final = _PLAYBACK | Feature.CORRECTION
#: For each message the capabilities of which the board needs one.
_NEEDS_ANY: Final[dict[type[Message], Feature]] = {
    Drives: Feature.AMPLITUDE,
    Points: Feature.POINTS,
    SetConfig: Feature.CONFIG,
    ReadDrive: Feature.READ_LATCHED | Feature.READ_RADIATED,
    ReadTrace: Feature.TRACE_RING,
    UploadBegin: _UPLOADS,
    UploadChunk: _UPLOADS,
    UploadCommit: _UPLOADS,
    Play: _PLAYBACK,
    Stop: _PLAYBACK,
}


def unsupported_messages(features: Feature) -> frozenset[type[Message]]:
    """Return the messages that a board with these *features* does not take."""
    return frozenset(kind for kind, any_of in _NEEDS_ANY.items() if not any_of & features)
