"""Requests with one field at or beyond a limit, and all others as they should be."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Any, Final

from haptogram_protocol.messages import (
    Config,
    Feature,
    GetGeometry,
    HelloReply,
    Message,
    Play,
    ReadDrive,
    ReadTrace,
    SetConfig,
    UploadBegin,
    UploadKind,
)
from haptogram_protocol.rules import READ_CAPABILITIES

from ...judge.refused_requests import OUT_OF_BOUNDS
from ..actions import ABSENT, REPLACED, SLOT_US, STORED_PHASES

_POINT_BYTES: Final = 16
_NO_VALUE: Final = 9  # of no enumeration
_MOST: Final = {1: 0xFF, 2: 0xFFFF, 4: 0xFFFFFFFF}  # by bytes


def _odd_values(value: int) -> tuple[int, ...]:
    """Return *value* with each higher bit of a byte: one that is masked is taken for it."""
    return tuple(value | 1 << bit for bit in range(4, 8))


_NO_KINDS: Final = (0, _NO_VALUE, _MOST[1], *_odd_values(1))
#: Loops, of which 2 or 3 frames wrap a product of 32 bits.
MANY_LOOPS: Final = (0x80000000, 0x55555556, 0xAAAAAAAB, _MOST[4])
#: Fields of the configuration, with values outside their bounds (HG-7.1).
REFUSED_CONFIG: Final = {
    name: tuple(value for other, value in OUT_OF_BOUNDS if other == name)
    for name, _ in OUT_OF_BOUNDS
} | {
    "late_window_us": (100_001, _MOST[4]),
    "trace_mode": (_NO_VALUE, _MOST[1], *_odd_values(2)),
}


def random_limit_requests(identity: HelloReply, config: Config) -> list[Message]:
    """Return the requests at the limits of a board, each with one field of *config* or its own."""
    can, count = identity.features, identity.transducers
    found: list[Message] = [
        GetGeometry(first, number)
        for first in (count - 1, count, _MOST[2])
        for number in (0, 1, _MOST[2])
    ]
    if can & Feature.CONFIG:
        for name, values in REFUSED_CONFIG.items():
            found += map(SetConfig, _limit_request_with(config, **{name: values}))
    for kind, feature in READ_CAPABILITIES.items():
        if can & feature:
            whole = ReadDrive(kind, 0, count)
            found += _limit_request_with(whole, kind=_NO_KINDS)
            found += _limit_request_with(whole, first=(1, count - 1, count, _MOST[2]))
            found += _limit_request_with(whole, count=(0, 1, count + 1, _MOST[2]))
    if can & Feature.TRACE_RING:
        found += [ReadTrace(0, number) for number in (0, 1, _MOST[2])]
    if can & Feature.SEQUENCE_PHASES:
        least_us = -(-1_000_000 // max(1, identity.max_playback_rate_hz))
        play = Play(STORED_PHASES, SLOT_US, 1, SLOT_US // 100)
        found += _limit_request_with(play, period_us=(0, least_us - 1), sequence=(0, ABSENT))
        found += _limit_request_with(play, loops=MANY_LOOPS)
        longer_ms = (identity.max_unattended_ms + 1, _MOST[4])
        beyond_ms = [ms for ms in longer_ms if identity.max_unattended_ms < ms <= _MOST[4]]
        found += _limit_request_with(play, unattended_ms=(0, *beyond_ms))
    return found + list(_limit_requests_to_upload(identity))


def _limit_requests_to_upload(identity: HelloReply) -> Iterator[UploadBegin]:
    count, can = identity.transducers, identity.features
    if can & Feature.SEQUENCE_PHASES:
        phases = UploadBegin(UploadKind.PHASES, 0, REPLACED, count, 0)
        yield from _limit_request_with(phases, kind=_NO_KINDS, points_per_frame=(1, _MOST[1]))
        yield from _limit_request_with(phases, target=(0,), size=(0, _MOST[4] // count * count))
        yield from _limit_request_with(
            phases, size=(count - 1, count + 1, 2 * count - 1) if count > 1 else ()
        )
    if can & Feature.SEQUENCE_POINTS:
        for points in sorted({1, min(2, identity.max_points), identity.max_points}):
            frame = points * _POINT_BYTES
            whole = UploadBegin(UploadKind.POINTS, points, REPLACED, frame, 0)
            sizes = {0, frame - 1, frame + 1, frame + _POINT_BYTES // 2, _MOST[4] // frame * frame}
            yield from _limit_request_with(whole, size=sorted(sizes), target=(0,))
            if points > 1:  # a multiple of a point, not of a frame
                yield from _limit_request_with(whole, size=(_POINT_BYTES, frame + _POINT_BYTES))
        yield from _limit_request_with(
            whole, points_per_frame=(0, min(_MOST[1], identity.max_points + 1))
        )
    if can & Feature.CORRECTION:
        correction = UploadBegin(UploadKind.CORRECTION, 0, 0, count, 0)
        yield from _limit_request_with(correction, target=(1, _MOST[2]), points_per_frame=(1,))
        yield from _limit_request_with(correction, size=(0, count - 1, count + 1, 2 * count))


def _limit_request_with(whole: Any, **values: Any) -> list[Any]:
    """Return *whole* once with each value of each field."""
    return [
        dataclasses.replace(whole, **{name: value})
        for name, choices in values.items()
        for value in choices
    ]
