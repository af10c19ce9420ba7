"""Requests with one field at or beyond a limit, and all others as they should be."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Any, Final

from haptogram_protocol.messages import (
    Feature,
    GetGeometry,
    HelloReply,
    Message,
    Play,
    ReadDrive,
    ReadTrace,
    UploadBegin,
    UploadKind,
)
from haptogram_protocol.rules import READ_CAPABILITIES

from ...judge.refused_requests import OUT_OF_BOUNDS
from ..actions import ABSENT, POINT_BYTES, REPLACED, SLOT_US, STORED_PHASES

_NO_VALUE: Final = 9  # of no enumeration
_MOST_U32: Final = 0xFFFFFFFF
_LIMITS: Final = (
    *("transducers", "max_points", "max_chunk", "max_sequence_frames", "max_upload_bytes"),
)
#: Loops, of which 2 or 3 frames wrap a product of 32 bits.
MANY_LOOPS: Final = (0x80000000, 0x55555556, 0xAAAAAAAB, _MOST_U32)
#: Fields of the configuration, with values outside their bounds (HG-7.1).
REFUSED_CONFIG: Final = {
    name: tuple(value for other, value in OUT_OF_BOUNDS if other == name)
    for name, _ in OUT_OF_BOUNDS
} | {
    "late_window_us": (100_001, _MOST_U32),
    "trace_mode": (_NO_VALUE, 0xFF, *(2 | 1 << bit for bit in range(4, 8))),
}


def random_limit_requests(identity: HelloReply) -> list[Message]:
    """Return the requests at the limits of a board, each with one field at or beyond one."""
    can, count = Feature(identity.features & sum(Feature)), identity.transducers
    wholes: dict[Message, Feature] = {
        GetGeometry(0, count): Feature(0),
        **{ReadDrive(kind, 0, count): needed for kind, needed in READ_CAPABILITIES.items()},
        ReadTrace(0, 1): Feature.TRACE_RING,
        UploadBegin(UploadKind.PHASES, 0, REPLACED, count, 0): Feature.SEQUENCE_PHASES,
        UploadBegin(UploadKind.CORRECTION, 0, 0, count, 0): Feature.CORRECTION,
    }
    for points in {1, min(2, identity.max_points), identity.max_points}:
        whole = UploadBegin(UploadKind.POINTS, points, REPLACED, points * POINT_BYTES, 0)
        wholes[whole] = Feature.SEQUENCE_POINTS
    limits = {getattr(identity, name) + more for name in _LIMITS for more in (0, 1)}
    found = [
        request
        for whole, needed in wholes.items()
        if needed in can
        for request in _requests_beside(whole, limits)
    ]
    if Feature.SEQUENCE_PHASES in can:
        found += _plays_at_limits(identity)
    return found


def _requests_beside(whole: Any, limits: set[int]) -> Iterator[Message]:
    """Yield *whole* with one field that is near its value, at an end or at a limit, or masked."""
    for name, field in whole.WIRE.items():
        value, bits = int(getattr(whole, name)), 8 * field.size
        near = {value - 1, value + 1, 2 * value - 1, 2 * value, value + value // 2}
        masked = {value | 1 << bit for bit in (range(4, 8) if bits == 8 else (bits // 2, bits - 1))}
        for other in {0, 1, _NO_VALUE, (1 << bits) - 1, *near, *masked, *limits} - {value}:
            if 0 <= other < 1 << bits and name != "crc":
                yield dataclasses.replace(whole, **{name: other})


def _plays_at_limits(identity: HelloReply) -> Iterator[Message]:
    least_us = -(-1_000_000 // max(1, identity.max_playback_rate_hz))
    beyond_ms = {min(identity.max_unattended_ms + 1, _MOST_U32), _MOST_U32}
    values = {
        "period_us": (0, least_us - 1),
        "sequence": (0, ABSENT),
        "loops": MANY_LOOPS,
        "unattended_ms": (0, *(beyond_ms - {identity.max_unattended_ms})),
    }
    play = Play(STORED_PHASES, SLOT_US, 1, SLOT_US // 100)
    for name, some in values.items():
        yield from (dataclasses.replace(play, **{name: value}) for value in some)
