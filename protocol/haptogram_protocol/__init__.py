"""The Haptogram wire protocol: codec and sans-I/O connection, standard library only.

What both ends of a link need is here; every message is in :mod:`haptogram_protocol.messages`.
"""

from .connection import NEED_DATA, BoardConnection, HostConnection
from .errors import LocalProtocolError, ProtocolError, RemoteProtocolError
from .framing import FrameDecoder, encode_frame
from .messages import MESSAGES, VERSION_MAJOR, VERSION_MINOR, Message, MessageType
from .state import LinkState, MuteReason, OutputState

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
