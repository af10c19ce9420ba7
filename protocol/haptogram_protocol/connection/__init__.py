"""Sans-I/O connections: bytes and times in, events and bytes out.

Both ends have ``receive_data``, ``next_event`` and ``data_to_send``; the host's end also has
``next_deadline_us`` and ``advance_to``. Sockets, threads, sleeps and clocks do not live here.
"""

from .board import BoardConnection
from .counters import HOST_COUNTERS, LINK_COUNTERS
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
from .host import HostConnection
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
