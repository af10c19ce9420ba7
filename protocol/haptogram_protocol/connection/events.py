"""What a connection reports.  One frozen dataclass per event; times are those of the caller.

``t_rx_us`` is always the time that the caller gave with the bytes which ended the frame.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import Final, TypeAlias

from ..messages import Drives, Error, Header, Message, MessageType, Phases, Points


class NeedData(enum.Enum):
    """Type of :data:`NEED_DATA`."""

    NEED_DATA = enum.auto()


#: There is no event until more bytes come (or until a deadline passes).
NEED_DATA: Final = NeedData.NEED_DATA


@dataclass(frozen=True, slots=True)
class FrameDropped:
    """A frame, or a run of bytes, went no further; it has been counted.

    Attributes
    ----------
    reason : str
        Name of the counter (SPEC.md HG-9.2).
    detail : str
        One line for a log.
    renews_lease : bool
        Board: the frame was one of the open session all the same (HG-6.7).
    """

    reason: str
    detail: str
    t_rx_us: int
    renews_lease: bool = False


# --- At the board ------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class StreamReceived:
    """A stream frame of the open session, neither seen before nor damaged.

    Attributes
    ----------
    index : int
        Unwrapped sequence number; the first one of a session is 0xFFF0 = 65520.
    t_apply_us : int or None
        As on the wire, modulo 2^32; None: as soon as the frame is complete.
    """

    message: Phases | Drives | Points
    index: int
    t_apply_us: int | None
    session: int
    t_rx_us: int
    renews_lease: bool = True


@dataclass(frozen=True, slots=True)
class RequestReceived:
    """A request that is to be carried out once and answered with ``reply`` or ``refuse``.

    Attributes
    ----------
    t_wire_us : int
        Time field of the header, modulo 2^32: the start time of a PLAY, else 0.
    immediate : bool
        PLAY: start at once, ``t_wire_us`` means nothing.
    new_session : bool
        A HELLO whose nonce is not that of the open session: mute, flush, ``open_session``, reply.
    crc : int
        CRC-32 of the frame's body, by which a repetition is known.
    """

    message: Message
    seq: int
    session: int
    t_wire_us: int
    immediate: bool
    t_rx_us: int
    new_session: bool
    renews_lease: bool
    crc: int


BoardEvent: TypeAlias = StreamReceived | RequestReceived | FrameDropped


# --- At the host -------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class ReplyReceived:
    """The board carried out a request.

    Attributes
    ----------
    request : MessageType
        Type of the request.
    rtt_us : int or None
        Round trip; None where the request was sent more than once (Karn: nobody knows which of
        the two was answered).
    t_device_us : int
        Device time of the reply's first byte, modulo 2^32.
    """

    message: Message
    seq: int
    request: MessageType
    rtt_us: int | None
    t_rx_us: int
    t_device_us: int


@dataclass(frozen=True, slots=True)
class RequestRefused:
    """The board answered a request with ERROR."""

    error: Error
    seq: int
    request: MessageType
    t_rx_us: int


@dataclass(frozen=True, slots=True)
class RequestTimedOut:
    """Nothing answered a request, however often it was sent."""

    request: MessageType
    seq: int
    attempts: int


@dataclass(frozen=True, slots=True)
class EventReceived:
    """The board reported something by itself.

    Attributes
    ----------
    gap : int
        Events that were sent between the last one and this one, and never came.
    """

    message: Message
    header: Header
    t_rx_us: int
    gap: int


HostEvent: TypeAlias = (
    ReplyReceived | RequestRefused | RequestTimedOut | EventReceived | FrameDropped
)

__all__ = [
    "NEED_DATA",
    "BoardEvent",
    "EventReceived",
    "FrameDropped",
    "HostEvent",
    "NeedData",
    "ReplyReceived",
    "RequestReceived",
    "RequestRefused",
    "RequestTimedOut",
    "StreamReceived",
]
