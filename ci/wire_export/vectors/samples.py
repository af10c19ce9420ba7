"""Messages with chosen values: least, most, every byte different, and pseudo-random ones."""

from __future__ import annotations

import random
import struct
from collections.abc import Callable, Mapping
from typing import Any, Final

from haptogram_protocol import messages as m
from haptogram_protocol.record import Record, WireField

Choice = Callable[[int, bool], int]  # number of bits, whether signed -> value


def _least_vector_value(bits: int, signed: bool) -> int:
    return -(1 << (bits - 1)) if signed else 0


def _most_vector_value(bits: int, signed: bool) -> int:
    return (1 << (bits - 1 if signed else bits)) - 1


def _ordered_vector_value(bits: int, _: bool) -> int:
    """Return bytes 01 02 03 ... in their order on the wire: a swapped pair is seen at once."""
    return int.from_bytes(range(1, bits // 8 + 1), "little")


def _random_vector_value(seed: str) -> Choice:
    source = random.Random(seed)

    def choose(bits: int, signed: bool) -> int:
        value = source.getrandbits(bits)
        return value - (1 << bits) if signed and value >> (bits - 1) else value

    return choose


_TEXTS: Final = {"least": "", "most": "f" * 16, "ordered": "Größe µ 1", "random": "firmware 2.10"}
_UNITS: Final = {"least": 0, "most": 9, "ordered": 2, "random": 5}
#: Ways to choose the values of a sample, each with its description.
HOW: Final[Mapping[str, str]] = {
    "least": "least value of every field",
    "most": "largest value of every field",
    "ordered": "bytes of every number in rising order",
    "random": "pseudo-random values",
}


def vector_sample(kind: type[m.Message], how: str) -> m.Message:
    """Return a message of *kind*; *how* is one of :data:`HOW`."""
    choices = {
        "least": _least_vector_value,
        "most": _most_vector_value,
        "ordered": _ordered_vector_value,
    }
    choose = choices.get(how) or _random_vector_value(kind.__name__)
    made: m.Message = _vector_record(kind, how, choose)
    return made


def _vector_record(kind: type[Record], how: str, choose: Choice) -> Any:
    values = {name: _vector_value(field, how, choose) for name, field in kind.WIRE.items()}
    if tail := kind.TAIL:
        count = max(tail.least, _UNITS[how])
        if tail.record:
            items = tuple(_vector_record(tail.record, how, choose) for _ in range(count))
            values[tail.name] = items
        else:
            values[tail.name] = bytes(choose(8, False) for _ in range(count * tail.unit))
    return kind(**values)


def _vector_value(field: WireField, how: str, choose: Choice) -> Any:
    if field.record:
        return _vector_record(field.record, how, choose)
    if field.code.endswith("s"):
        return _TEXTS[how]
    if field.enumeration:
        members = list(field.enumeration)
        if how in ("least", "most"):
            return members[0 if how == "least" else -1]
        return members[choose(8, False) % len(members)]
    return choose(8 * struct.calcsize(field.code), field.code.islower())
