"""Events of a connection, one dataclass each; nobody changes one.

They are not frozen, which takes a quarter of the time: a frame makes one at each end.

``t_rx_us`` is always the time that the caller gave with the last bytes of the frame.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import Final, TypeAlias

from ..messages import Drives, Error, Header, Message, MessageType, Phases, Points


class NeedData(enum.Enum):
    """Type of :data:`NEED_DATA`."""

    NEED_DATA = enum.auto()


#: No event is pending; more bytes, or a deadline, bring the next one.
NEED_DATA: Final = NeedData.NEED_DATA


@dataclass(slots=True)
class FrameDropped:
    """A frame, or a run of bytes, was dropped and counted.

    Attributes
    ----------
    reason : str
        Name of the counter (SPEC.md HG-9.2).
    renews_lease : bool
        Board: True if the frame was of the open session (HG-6.7).
    """

    reason: str
    t_rx_us: int
    renews_lease: bool = False


# --- At the board ------------------------------------------------------------------------------


@dataclass(slots=True)
class StreamReceived:
    """A new stream frame of the open session passed every check.

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


@dataclass(slots=True)
class RequestReceived:
    """A new request passed every check; the board answers it with ``reply`` or ``refuse``.

    Attributes
    ----------
    t_wire_us : int
        Time field of the header, modulo 2^32: the start time of a PLAY, else 0.
    immediate : bool
        PLAY: start at once and ignore ``t_wire_us``.
    new_session : bool
        True for a HELLO with a new nonce: mute, flush, call ``open_session``, then reply.
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


@dataclass(slots=True)
class ReplyReceived:
    """The board carried out a request.

    Attributes
    ----------
    request : MessageType
        Type of the request.
    rtt_us : int or None
        Round trip in microseconds; None if the request was sent more than once, because the
        answered copy is unknown (Karn's rule).
    t_device_us : int
        Device time of the reply's first byte, modulo 2^32.
    """

    message: Message
    seq: int
    request: MessageType
    rtt_us: int | None
    t_rx_us: int
    t_device_us: int


@dataclass(slots=True)
class RequestRefused:
    """The board answered a request with ERROR."""

    error: Error
    seq: int
    request: MessageType
    t_rx_us: int


@dataclass(slots=True)
class RequestTimedOut:
    """A request was sent as often as it may be, and never answered."""

    request: MessageType
    seq: int
    attempts: int


@dataclass(slots=True)
class EventReceived:
    """The board sent an event.

    Attributes
    ----------
    gap : int
        Number of events lost between the last one and this one.
    """

    message: Message
    header: Header
    t_rx_us: int
    gap: int


HostEvent: TypeAlias = (
    ReplyReceived | RequestRefused | RequestTimedOut | EventReceived | FrameDropped
)
