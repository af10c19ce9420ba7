"""Every message of the protocol: one frozen dataclass each.  SPEC.md chapters 3 to 10.

``serialize`` returns the payload, ``deserialize`` reads it; the ten header bytes are a record of
their own. A wrong length, or a value outside its range, raises :class:`RemoteProtocolError` and no
other error. The rules about when a message may be sent live in :mod:`..connection`.
"""

from __future__ import annotations

import struct
from typing import Final

from ..errors import LocalProtocolError, RemoteProtocolError
from .configuration import (
    Config,
    ConfigReply,
    Element,
    GeometryReply,
    GetConfig,
    GetGeometry,
    SetConfig,
    SetConfigReply,
    TraceMode,
)
from .evidence import (
    DriveKind,
    DriveReply,
    LatchKey,
    ReadDrive,
    ReadTrace,
    Trace,
    TraceDrive,
    TracePlayback,
    TraceRecord,
    TraceReply,
)
from .header import (
    EVENT_RANGE,
    FIRST_STREAM_SEQ,
    MAX_TRANSDUCERS,
    MUST_UNDERSTAND,
    REQUEST_RANGE,
    RESPONSE_OFFSET,
    RESPONSE_RANGE,
    STREAM_RANGE,
    VERSION_MAJOR,
    VERSION_MINOR,
    Ack,
    Error,
    ErrorCode,
    Flag,
    Header,
    Message,
    MessageType,
    signed_difference,
    unwrap,
)
from .playback import (
    Play,
    PlaybackEnded,
    PlayReply,
    Stop,
    StopReply,
    UploadBegin,
    UploadBeginReply,
    UploadChunk,
    UploadChunkReply,
    UploadCommit,
    UploadCommitReply,
    UploadKind,
)
from .session import (
    Arm,
    ArmReply,
    Disarm,
    DisarmReply,
    Feature,
    Hello,
    HelloReply,
    Mute,
    MuteReply,
    Ping,
    Pong,
    StateChanged,
)
from .status import GROWING_COUNTERS, Counters, GetStatus, Status, StatusReply
from .stream import (
    Drives,
    FocalPoint,
    Phases,
    Points,
    drive_codes,
)

_KINDS: Final = [
    kind
    for kind in list(globals().values())
    if isinstance(kind, type) and issubclass(kind, Message) and hasattr(kind, "TYPE")
]
#: Message by type byte, in the order of the types.
MESSAGES: Final[dict[int, type[Message]]] = {
    int(kind.TYPE): kind for kind in sorted(_KINDS, key=lambda kind: kind.TYPE)
}


def parse_body(body: bytes) -> tuple[Header, Message]:
    """Return header and message of a frame whose CRC was right.

    What a later minor version adds to a response or event is ignored (HG-11.3).

    Parameters
    ----------
    body : bytes
        Header and payload, as a :class:`~haptogram_protocol.framing.FrameDecoder` returns them.

    Raises
    ------
    RemoteProtocolError
        With the reason ``unknown_type``, ``bad_length`` or ``bad_value``.
    """
    header = Header.of_body(body)
    return header, parse_payload(header, body)


def parse_payload(header: Header, body: bytes) -> Message:
    """Return the message behind *header*; see :func:`parse_body`."""
    message = MESSAGES.get(header.type)
    if message is None:
        raise RemoteProtocolError(
            f"message type {header.type:#04x} is unknown", reason="unknown_type"
        )
    grows = header.type >= RESPONSE_RANGE.start and not message.TAIL
    size = Header.LAYOUT.size
    return message.deserialize(body[size : size + message.LAYOUT.size if grows else None])


def build_body(message: Message, *, flags: int, seq: int, time_us: int, session: int) -> bytes:
    """Return header and payload of a frame, for :func:`~haptogram_protocol.framing.encode_frame`.

    Parameters
    ----------
    message : Message
        Payload.
    flags : int
        Sum of :class:`Flag` bits.
    seq : int
        Sequence number; taken modulo 2^16.
    time_us : int
        Device time in microseconds; taken modulo 2^32.
    session : int
        Nonce of the session, 0 to 65535.

    Raises
    ------
    LocalProtocolError
        If a value does not fit its field.
    """
    kind, time_us = message.TYPE, time_us & 0xFFFFFFFF
    try:
        header = Header.LAYOUT.pack(kind, flags, seq & 0xFFFF, time_us, session)
    except struct.error as error:
        raise LocalProtocolError(f"header of {kind.name} does not fit: {error}") from error
    return header + message.serialize()


__all__ = [
    "EVENT_RANGE",
    "FIRST_STREAM_SEQ",
    "GROWING_COUNTERS",
    "MAX_TRANSDUCERS",
    "MESSAGES",
    "MUST_UNDERSTAND",
    "REQUEST_RANGE",
    "RESPONSE_OFFSET",
    "RESPONSE_RANGE",
    "STREAM_RANGE",
    "VERSION_MAJOR",
    "VERSION_MINOR",
    "Ack",
    "Arm",
    "ArmReply",
    "Config",
    "ConfigReply",
    "Counters",
    "Disarm",
    "DisarmReply",
    "DriveKind",
    "DriveReply",
    "Drives",
    "Element",
    "Error",
    "ErrorCode",
    "Feature",
    "Flag",
    "FocalPoint",
    "GeometryReply",
    "GetConfig",
    "GetGeometry",
    "GetStatus",
    "Header",
    "Hello",
    "HelloReply",
    "LatchKey",
    "Message",
    "MessageType",
    "Mute",
    "MuteReply",
    "Phases",
    "Ping",
    "Play",
    "PlayReply",
    "PlaybackEnded",
    "Points",
    "Pong",
    "ReadDrive",
    "ReadTrace",
    "SetConfig",
    "SetConfigReply",
    "StateChanged",
    "Status",
    "StatusReply",
    "Stop",
    "StopReply",
    "Trace",
    "TraceDrive",
    "TraceMode",
    "TracePlayback",
    "TraceRecord",
    "TraceReply",
    "UploadBegin",
    "UploadBeginReply",
    "UploadChunk",
    "UploadChunkReply",
    "UploadCommit",
    "UploadCommitReply",
    "UploadKind",
    "build_body",
    "drive_codes",
    "parse_body",
    "parse_payload",
    "signed_difference",
    "unwrap",
]
