"""Every message of the protocol: one frozen dataclass each.  SPEC.md chapters 3 to 10.

A module here adds its messages by defining them: nothing lists them a second time.

``serialize`` returns the payload, ``deserialize`` reads it; the ten header bytes are a record of
their own. A wrong length, or a value outside its range, raises :class:`RemoteProtocolError` and no
other error. The rules about when a message may be sent live in :mod:`..connection`.
"""

from __future__ import annotations

import struct
from typing import Final

from ..errors import LocalProtocolError, RemoteProtocolError
from .configuration import *
from .evidence import *
from .header import *
from .header import RESPONSE_RANGE, Header, Message
from .playback import *
from .session import *
from .status import *
from .stream import *

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

    Fields that a later minor version adds to a response or event are ignored (HG-11.3).

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
    """Return the message after *header*; see :func:`parse_body`."""
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
