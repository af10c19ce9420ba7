"""Little-endian records, declared once.

One line per field gives the dataclass attribute, its width on the wire, the byte table of SPEC.md
and the C header: nothing about a layout is written twice.  A record is a fixed part and, in some
messages, a tail that fills the rest of the payload: bytes, or records of one kind.
"""

from __future__ import annotations

import dataclasses
import enum
import operator
import struct
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, Final, Self, TypeVar, cast, dataclass_transform

from .errors import LocalProtocolError, RemoteProtocolError

_WIRE: Final = "haptogram_wire"


@dataclasses.dataclass(frozen=True, slots=True)
class WireField:
    """How one field of the fixed part travels.

    Attributes
    ----------
    code : str
        :mod:`struct` code, e.g. ``"I"`` for u32 or ``"16s"`` for text; of a nested record, all of
        its codes.
    doc : str
        Meaning, with its unit.
    enumeration : type or None
        Values allowed, where only some are.
    record : type or None
        Nested record.
    offset : int
        First byte of the field in its record.
    """

    code: str
    doc: str
    enumeration: type[enum.IntEnum] | None = None
    record: type[Record] | None = None
    offset: int = 0

    @property
    def size(self) -> int:
        """Bytes that the field takes."""
        return struct.calcsize("<" + self.code)

    @property
    def is_number(self) -> bool:
        """Whether :mod:`struct` gives and takes the very value, and every value will do."""
        return self.enumeration is None and self.record is None and not self.code.endswith("s")

    def to_raw(self, name: str, value: Any) -> Any:
        """Return what :mod:`struct` packs for *value*."""
        if not isinstance(value, str):
            return value
        text = value.encode()
        if len(text) > self.size or text.endswith(b"\x00"):
            raise LocalProtocolError(
                f"{name} is {value!r}: {len(text)} bytes of UTF-8; the field holds {self.size}, "
                "the last of them not zero"
            )
        return text

    def value(self, name: str, raw: Any, base: int) -> Any:
        """Return the value for what :mod:`struct` gave; *base* is where the record begins."""
        if isinstance(raw, bytes):
            return raw.rstrip(b"\x00").decode(errors="replace")
        if self.enumeration is None:
            return raw
        try:
            return self.enumeration(raw)
        except ValueError as error:
            raise RemoteProtocolError(
                f"{name} is {raw}: {error}", reason="bad_value", offset=base + self.offset
            ) from error


@dataclasses.dataclass(frozen=True, slots=True)
class WireTail:
    """What fills the payload behind the fixed part.

    Attributes
    ----------
    name : str
        Field of the dataclass.
    doc : str
        Meaning.
    unit : int
        Its length is a multiple of this many bytes.
    least : int
        Units that must be there.
    record : type or None
        Kind of the records; None: plain bytes.
    """

    name: str
    doc: str
    unit: int
    least: int
    record: type[Record] | None


def wire(
    code: str,
    doc: str,
    *,
    enum: type[enum.IntEnum] | None = None,
    default: Any = dataclasses.MISSING,
) -> Any:
    """Declare a field of a record: its :mod:`struct` code and what it means."""
    return dataclasses.field(default=default, metadata={_WIRE: WireField(code, doc, enum)})


def nested(record: type[Record], doc: str) -> Any:
    """Declare a field that is itself a record."""
    layout = record.LAYOUT.format.removeprefix("<")
    return dataclasses.field(metadata={_WIRE: WireField(layout, doc, record=record)})


def tail(doc: str, *, unit: int = 1) -> Any:
    """Declare bytes that fill the rest of the payload, in units of *unit*."""
    return dataclasses.field(metadata={_WIRE: WireTail("", doc, unit, 0, None)})


def repeated(record: type[Record], doc: str, *, least: int = 0) -> Any:
    """Declare records that fill the rest of the payload, at least *least* of them."""
    unit = record.LAYOUT.size
    return dataclasses.field(metadata={_WIRE: WireTail("", doc, unit, least, record)})


class Record:
    """Base of everything that has a layout.  Use :func:`record` on every subclass.

    Attributes
    ----------
    LAYOUT : struct.Struct
        Of the fixed part.
    WIRE : dict of str to WireField
        Its fields, in their order on the wire.
    TAIL : WireTail or None
        What follows them.
    ITEMS : int
        How many values :mod:`struct` packs for them.
    VALUES : callable
        Returns the values of the fixed fields of a record.
    CONVERTED : tuple
        Place, name and form of those fields that are not plain numbers: most records have none.
    """

    __slots__ = ()
    LAYOUT: ClassVar[struct.Struct]
    WIRE: ClassVar[dict[str, WireField]]
    TAIL: ClassVar[WireTail | None]
    ITEMS: ClassVar[int]
    VALUES: ClassVar[Callable[[Record], tuple[Any, ...]]]
    CONVERTED: ClassVar[tuple[tuple[int, str, WireField], ...]]

    def pack(self) -> bytes:
        """Return the bytes.

        Raises
        ------
        LocalProtocolError
            If a value does not fit its field.
        """
        try:
            fixed = self.LAYOUT.pack(*self.to_raw())
        except struct.error as error:
            raise LocalProtocolError(f"{self!r} does not fit its layout: {error}") from error
        return fixed + self._pack_tail() if self.TAIL else fixed

    def to_raw(self) -> list[Any]:
        """Return what :mod:`struct` packs for the fixed fields, nested ones in line."""
        raw = list(type(self).VALUES(self))
        for place, name, field in reversed(self.CONVERTED):  # backwards: a record takes more places
            if field.record is not None:
                raw[place : place + 1] = raw[place].to_raw()
            else:
                raw[place] = field.to_raw(name, raw[place])
        return raw

    def _pack_tail(self) -> bytes:
        what = cast(WireTail, self.TAIL)
        value = getattr(self, what.name)
        data = bytes(value) if what.record is None else b"".join(item.pack() for item in value)
        if not _tail_fits(what, len(data)):
            raise LocalProtocolError(
                f"{type(self).__name__}.{what.name} of {len(data)} bytes; {_tail_rule(what)}"
            )
        return data

    @classmethod
    def unpack(cls, data: bytes) -> Self:
        """Return the record whose bytes are *data*.

        Raises
        ------
        RemoteProtocolError
            With the reason ``bad_length``, or ``bad_value`` and the offset of the field.
        """
        size, what = cls.LAYOUT.size, cls.TAIL
        rest = len(data) - size
        if rest < 0 or (not _tail_fits(what, rest) if what else rest):
            rule = f", then {_tail_rule(what)}" if what else ""
            raise RemoteProtocolError(
                f"{cls.__name__} of {len(data)} bytes; its layout has {size}{rule}",
                reason="bad_length",
            )
        values = cls.from_raw(cls.LAYOUT.unpack_from(data), 0)
        if what:
            values.append(_unpack_tail(what, data, size))
        return cls(*values)

    @classmethod
    def from_raw(cls, raw: Sequence[Any], base: int) -> list[Any]:
        """Return the values of the fixed fields, in order, from what :mod:`struct` gave.

        *base* is the first byte of the record in its payload.
        """
        values = list(raw)
        for place, name, field in cls.CONVERTED:
            if (inner := field.record) is not None:
                taken = slice(place, place + inner.ITEMS)
                values[taken] = [inner(*inner.from_raw(values[taken], base + field.offset))]
            else:
                values[place] = field.value(name, values[place], base)
        return values


def _tail_fits(what: WireTail, length: int) -> bool:
    return length % what.unit == 0 and length >= what.least * what.unit


def _tail_rule(what: WireTail) -> str:
    return f"{what.name} in units of {what.unit} bytes, at least {what.least}"


def _unpack_tail(what: WireTail, data: bytes, start: int) -> Any:
    if what.record is None:
        return data[start:]
    size, record = what.unit, what.record
    items = (record.LAYOUT.unpack_from(data, i) for i in range(start, len(data), size))
    return tuple(
        record(*record.from_raw(item, start + number * size)) for number, item in enumerate(items)
    )


def _wire_fields(made: Any) -> tuple[dict[str, WireField], WireTail | None]:
    """Return the wire form of the fields of a dataclass: the fixed ones and the tail."""
    fixed: dict[str, WireField] = {}
    offset = 0
    for field in dataclasses.fields(made):
        form = field.metadata[_WIRE]
        if isinstance(form, WireTail):
            return fixed, dataclasses.replace(form, name=field.name)
        fixed[field.name] = dataclasses.replace(form, offset=offset)
        offset += form.size
    return fixed, None


def _getter(names: tuple[str, ...]) -> Callable[[Record], tuple[Any, ...]]:
    """Return what gets the attributes *names*, all at once."""
    if len(names) > 1:
        return operator.attrgetter(*names)
    return lambda record: tuple(getattr(record, name) for name in names)


_R = TypeVar("_R", bound=Record)


@dataclass_transform(frozen_default=True, field_specifiers=(wire, nested, tail, repeated))
def record(cls: type[_R]) -> type[_R]:
    """Make *cls* a frozen dataclass with ``LAYOUT``, ``WIRE`` and ``TAIL`` from its fields."""
    made = dataclasses.dataclass(frozen=True, slots=True)(cls)
    made.WIRE, made.TAIL = _wire_fields(made)
    made.LAYOUT = struct.Struct("<" + "".join(field.code for field in made.WIRE.values()))
    made.VALUES = _getter(tuple(made.WIRE))
    made.ITEMS = sum(field.record.ITEMS if field.record else 1 for field in made.WIRE.values())
    made.CONVERTED = tuple(
        (place, name, field)
        for place, (name, field) in enumerate(made.WIRE.items())
        if not field.is_number
    )
    return made
