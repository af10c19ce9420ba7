"""Every value of each byte of requests and stream frames."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import product
from typing import Final

from haptogram_protocol.framing import HEADER_BYTES
from haptogram_protocol.messages import Header, Message
from haptogram_protocol.record import Record

#: Fields of which a value may let timers end at any time, or ask for much: they have tables of
#: their own.
_OTHERS: Final = frozenset(
    {
        *("hold_ms", "ramp_ms", "host_timeout_ms", "status_period_ms", "unattended_ms"),
        *("period_us", "loops", "size", "nonce", "crc", "token"),
    }
)


def _fields_of_bytes(
    record: type[Record], base: int = HEADER_BYTES
) -> Iterator[tuple[str, int, int]]:
    """Yield name, offset in the body and size of each field, records within records included."""
    for name, field in record.WIRE.items():
        if field.record is not None:
            yield from _fields_of_bytes(field.record, base + field.offset)
        elif name not in _OTHERS:
            yield name, base + field.offset, field.size


def byte_values(*groups: Mapping[str, type[Message]]) -> dict[str, list[tuple[str, str, str]]]:
    """Return message, offset and value of each byte, of fields of one byte and of longer ones.

    Fields of one byte are types, enumerations, versions and counts.  The type is that of the first
    message of each group; the flags are those of every message.
    """
    found: dict[str, list[tuple[str, str, str]]] = {"short": [], "long": []}
    for messages in groups:
        places = {(name, Header.WIRE["type"].offset): "short" for name in list(messages)[:1]}
        for name, kind in messages.items():
            places[name, Header.WIRE["flags"].offset] = "long"
            for _, offset, size in _fields_of_bytes(kind):
                places |= {
                    (name, offset + n): "short" if size == 1 else "long" for n in range(size)
                }
        for ((name, offset), which), value in product(places.items(), range(256)):
            found[which].append((name, str(offset), str(value)))
    return found
