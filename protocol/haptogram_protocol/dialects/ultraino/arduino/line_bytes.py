"""Bytes of the line of Ultraino's Arduino boards: parts of patterns, durations and commands."""

from __future__ import annotations

import re
from typing import Final

SWAP: Final = b"\x00"
COMMAND: Final = b"\x10"
DURATION_BYTES: Final = bytes([0x30, 0x70, 0xB0, 0xF0])
BYTES_OF_DURATION: Final = 4
#: Pattern of half slot bytes, by the number of remaining hops.
PARTS: Final = {
    hops: rb"[" + b"".join(re.escape(bytes([high << 4 | hops])) for high in range(16)) + rb"]+"
    for hops in range(1, 16)
}
OTHER_HOPS: Final = b"[" + re.escape(bytes(b for b in range(256) if b & 0x0F > 1)) + b"]"


def durations_from_pairs(pairs: bytes) -> bytes:
    """Return the durations of bytes that hold two bits each, high ones first."""
    padded = pairs + b"\0" * (-len(pairs) % BYTES_OF_DURATION)
    return bytes(
        padded[at] & 0xC0
        | padded[at + 1] >> 2 & 0x30
        | padded[at + 2] >> 4 & 0x0C
        | padded[at + 3] >> 6
        for at in range(0, len(padded), BYTES_OF_DURATION)
    )


def durations_to_pairs(durations: bytes) -> bytes:
    """Return the four bytes of each duration, high bits first."""
    return bytes(0x30 | value << up & 0xC0 for value in durations for up in (0, 2, 4, 6))
