"""Names of the counters that each end of a connection keeps.  SPEC.md HG-9.2."""

from __future__ import annotations

from typing import Final

#: Counters that a host keeps of the frames that it receives, by the names of HG-9.2.
HOST_COUNTERS: Final = (
    "frames",
    "duplicate",
    "gap",
    "stale_session",
    "crc",
    "cobs",
    "short",
    "oversize",
    "bad_length",
    "bad_value",
    "unknown_type",
    "unsupported",
)

#: Counters of HG-9.2 that the connection of a board keeps; the board keeps the others.
LINK_COUNTERS: Final = (*HOST_COUNTERS, "requests", "repeated")
