"""Sans-I/O connections: bytes and times in, events and bytes out.

``receive_data``, ``next_event`` and ``data_to_send`` at both ends; at the host also
``next_deadline_us`` and ``advance_to``.  There is no socket, thread, sleep or clock in here.
"""

from .board import LINK_COUNTERS, BoardConnection
from .events import (
    NEED_DATA,
    BoardEvent,
    EventReceived,
    FrameDropped,
    HostEvent,
    NeedData,
    ReplyReceived,
    RequestReceived,
    RequestRefused,
    RequestTimedOut,
    StreamReceived,
)
from .host import HOST_COUNTERS, HostConnection
from .inbox import INPUT_LIMIT
from .outbox import OUTPUT_LIMIT
from .timer import INITIAL_RTO_US, MAX_ATTEMPTS, MAX_RTO_US, MIN_RTO_US, RoundTripTimer

__all__ = [
    "HOST_COUNTERS",
    "INITIAL_RTO_US",
    "INPUT_LIMIT",
    "LINK_COUNTERS",
    "MAX_ATTEMPTS",
    "MAX_RTO_US",
    "MIN_RTO_US",
    "NEED_DATA",
    "OUTPUT_LIMIT",
    "BoardConnection",
    "BoardEvent",
    "EventReceived",
    "FrameDropped",
    "HostConnection",
    "HostEvent",
    "NeedData",
    "ReplyReceived",
    "RequestReceived",
    "RequestRefused",
    "RequestTimedOut",
    "RoundTripTimer",
    "StreamReceived",
]
