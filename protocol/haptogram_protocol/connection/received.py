"""A frame at the board on its way through the checks of SPEC.md HG-3.8."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from .. import messages

# HG-3.5: IMMEDIATE has a meaning in these only.  MUTE is carried out whatever its flags (HG-6.4).
_TAKES_IMMEDIATE: Final = frozenset({*messages.STREAM_RANGE, int(messages.MessageType.PLAY)})
IMMEDIATE: Final = int(
    messages.Flag.IMMEDIATE
)  # as a number: an operation on a Flag costs microseconds


@dataclass(slots=True)  # frozen would take four times as long to make
class ReceivedFrame:
    """A frame whose CRC was right.

    Attributes
    ----------
    header : Header
        Its header.
    payload : bytes
        Bytes after the header.
    crc : int
        CRC-32 of header and payload, by which a repeated request is known.
    t_rx_us : int
        Device time, unwrapped, at which its last byte came.
    in_session : bool
        True if the frame is of the open session; it renews the lease then (HG-6.7).
    """

    header: messages.Header
    payload: bytes
    crc: int
    t_rx_us: int
    in_session: bool


def unknown_received_flags(header: messages.Header) -> int:
    """Return the must-understand flags that have no meaning in such a frame.  HG-3.4."""
    known = IMMEDIATE if header.type in _TAKES_IMMEDIATE else 0
    return header.flags & messages.MUST_UNDERSTAND & ~known
