"""The Haptogram wire protocol: codec and sans-I/O connection, standard library only.

The names here serve both ends of a link. All messages live in :mod:`haptogram_protocol.messages`;
ports, clocks and threads live elsewhere.
"""

from .connection import NEED_DATA, BoardConnection, HostConnection
from .errors import LocalProtocolError, ProtocolError, RemoteProtocolError
from .framing import FrameDecoder, encode_frame
from .messages import MESSAGES, VERSION_MAJOR, VERSION_MINOR, Message, MessageType
from .state import LinkState, MuteReason, OutputState


def __dir__() -> list[str]:
    return sorted(__all__)


__all__ = [
    "MESSAGES",
    "NEED_DATA",
    "VERSION_MAJOR",
    "VERSION_MINOR",
    "BoardConnection",
    "FrameDecoder",
    "HostConnection",
    "LinkState",
    "LocalProtocolError",
    "Message",
    "MessageType",
    "MuteReason",
    "OutputState",
    "ProtocolError",
    "RemoteProtocolError",
    "encode_frame",
]
