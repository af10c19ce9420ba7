"""Values of the fields of a frame: every one of a byte, and those beside a value and at limits."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final, TypeAlias

from haptogram_protocol import messages as m
from haptogram_protocol.framing import HEADER_BYTES
from haptogram_protocol.record import Record

from ...judge.refused_requests import OUT_OF_BOUNDS
from ..actions import SLOT_US, STORED_PHASES

#: A message, and the bytes to put at an offset of its body.
FieldValue: TypeAlias = tuple[m.Message, int, bytes]

_NO_VALUE: Final = 9  # a value of no enumeration
_MOST_U32: Final = 0xFFFFFFFF
_LIMITS: Final = (
    *("transducers", "max_points", "max_chunk", "max_sequence_frames", "max_upload_bytes"),
)
#: Loops for which the product with 2 or 3 frames overflows 32 bits.
MANY_LOOPS: Final = (0x80000000, 0x55555556, 0xAAAAAAAB, _MOST_U32)
#: Fields of the configuration, with values outside their bounds (HG-7.1).
REFUSED_CONFIG: Final = {
    name: tuple(value for other, value in OUT_OF_BOUNDS if other == name)
    for name, _ in OUT_OF_BOUNDS
} | {
    "late_window_us": (100_001, _MOST_U32),
    "trace_mode": (_NO_VALUE, 0xFF, *(2 | 1 << bit for bit in range(4, 8))),
}
#: Fields with values that make timers expire at any time, or that have no meaning.
_NOT_ANY: Final = frozenset(
    {
        *("hold_ms", "ramp_ms", "host_timeout_ms", "status_period_ms", "unattended_ms"),
        *("period_us", "loops", "nonce", "crc", "token"),
    }
)


def field_values(identity: m.HelloReply, messages: Iterable[m.Message]) -> Iterator[FieldValue]:
    """Yield *messages* with other values of type, flags and each field.

    A field of one byte is an enumeration, a version or a count: the first message that has it
    gets every value, the others and longer fields those at which an answer may change.
    """
    limits = {getattr(identity, name) + more for name in _LIMITS for more in (0, 1)}
    types, flags = (m.Header.WIRE[name].offset for name in ("type", "flags"))
    met = set()
    for message in messages:
        if isinstance(message, m.Ping | m.Phases):
            yield from ((message, types, bytes([kind])) for kind in range(256))
        if not isinstance(message, m.Play):  # its frames would be due when others arrive
            yield from ((message, flags, bytes([1 << bit])) for bit in range(8))
        for value, offset, size in _numbers(message, HEADER_BYTES):
            is_first = (type(message), offset) not in met
            met.add((type(message), offset))
            others = _nearby_values(value, 8 * size) | limits
            if size == 1 and is_first:
                others = set(range(256))
            for other in others - {value}:
                if 0 <= other < 1 << 8 * size:
                    yield message, offset, other.to_bytes(size, "little")


def play_values(identity: m.HelloReply) -> Iterator[FieldValue]:
    """Yield PLAY with a number that no board takes, and with many loops."""
    least_us = -(-1_000_000 // max(1, identity.max_playback_rate_hz))
    beyond_ms = {min(identity.max_unattended_ms + 1, _MOST_U32), _MOST_U32}
    play = m.Play(STORED_PHASES, SLOT_US, 1, SLOT_US // 100)
    values: dict[str, Iterable[int]] = {
        "period_us": (0, least_us - 1),
        "loops": MANY_LOOPS,
        "unattended_ms": {0, *beyond_ms} - {identity.max_unattended_ms},
    }
    for name, some in values.items():
        field = m.Play.WIRE[name]
        for value in some:
            yield play, HEADER_BYTES + field.offset, value.to_bytes(field.size, "little")


def _numbers(record: Record, base: int) -> Iterator[tuple[int, int, int]]:
    """Yield (value, offset in the body, size in bytes) of each fixed field of *record*.

    *base* is the offset of *record*; fields of records within it count too. Left out are fields
    whose other values have no meaning, or make a timer end at any time.
    """
    for name, field in record.WIRE.items():
        if field.record is not None:
            yield from _numbers(getattr(record, name), base + field.offset)
        elif name not in _NOT_ANY:
            yield int(getattr(record, name)), base + field.offset, field.size


def _nearby_values(value: int, bits: int) -> set[int]:
    """Return values of *bits* bits at which an answer to *value* may change.

    That is: one more or less, one and a half times, double (or one less than that), with one higher
    bit set; 0, 1, the greatest, and a value that no table has.
    """
    near = {value - 1, value + 1, 2 * value - 1, 2 * value, value + value // 2}
    masked = {value | 1 << bit for bit in (range(4, 8) if bits == 8 else (bits // 2, bits - 1))}
    return {0, 1, _NO_VALUE, (1 << bits) - 1, *near, *masked}
