"""Sans-I/O connections: bytes and times in, events and bytes out.

Both ends have ``receive_data``, ``next_event`` and ``data_to_send``; the host's end also has
``next_deadline_us`` and ``advance_to``. Sockets, threads, sleeps and clocks do not live here.
"""

from .board import OUTPUT_LIMIT, BoardConnection
from .counters import HOST_COUNTERS, LINK_COUNTERS
from .events import *
from .host import HostConnection
from .inbox import INPUT_LIMIT
from .pending import INITIAL_RTO_US, MAX_ATTEMPTS, MAX_RTO_US, MIN_RTO_US, RoundTripTimer
