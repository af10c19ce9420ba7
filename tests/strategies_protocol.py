"""Hypothesis strategies of the wire, derived from the declarations of the messages."""

import itertools
import struct
from typing import Any

from hypothesis import strategies as st

from haptogram_protocol.messages import MESSAGES, Message
from haptogram_protocol.record import Record, WireField

_SIGNED = "bhiq"


def _fits(text: str, size: int) -> bool:
    return len(text.encode()) <= size and not text.endswith("\0")


def values(field: WireField) -> st.SearchStrategy[Any]:
    """Everything that a field of the fixed part can hold."""
    if field.record is not None:
        return records(field.record)
    if field.enumeration is not None:
        return st.sampled_from(list(field.enumeration))
    if field.code.endswith("s"):
        characters = st.characters(exclude_categories=["Cs"])
        return st.text(characters, max_size=field.size).filter(lambda t: _fits(t, field.size))
    bits = 8 * struct.calcsize(field.code)
    if field.code in _SIGNED:
        return st.integers(-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    return st.integers(0, 2**bits - 1)


def records(kind: type[Record], *, max_units: int = 12) -> st.SearchStrategy[Any]:
    """Every record or message of one kind, with a tail of at most *max_units* units."""
    fields = {name: values(field) for name, field in kind.WIRE.items()}
    tail = kind.TAIL
    if tail is not None and tail.record is not None:
        items = st.lists(records(tail.record), min_size=tail.least, max_size=max_units)
        fields[tail.name] = items.map(tuple)
    elif tail is not None:
        units = st.lists(
            st.binary(min_size=tail.unit, max_size=tail.unit),
            min_size=tail.least,
            max_size=max_units,
        )
        fields[tail.name] = units.map(b"".join)
    return st.builds(kind, **fields)


messages: st.SearchStrategy[Message] = st.sampled_from(list(MESSAGES.values())).flatmap(records)

headers = st.fixed_dictionaries(
    {
        "flags": st.integers(0, 255),
        "seq": st.integers(0, 0xFFFF),
        "time_us": st.integers(0, 2**32 - 1),
        "session": st.integers(0, 0xFFFF),
    }
)

# Bytes that look like frames more often than chance: many zeros, short pieces, real frames.
noise = st.lists(
    st.one_of(st.binary(max_size=40), st.sampled_from([b"\0", b"\1", b"\xff", b"\0\0"])),
    max_size=30,
).map(b"".join)


@st.composite
def chunkings(draw: st.DrawFn, data: bytes) -> list[bytes]:
    """Cut *data* into chunks, some of them empty."""
    cuts = sorted(draw(st.lists(st.integers(0, len(data)), max_size=12)))
    edges = [0, *cuts, len(data)]
    return [data[a:b] for a, b in itertools.pairwise(edges)]
