"""Little-endian records, declared once.

One line per field declares the attribute, its width on the wire, its row in the byte table of
SPEC.md and its member in the C header. A record is a fixed part and, in some messages, a tail that
fills the rest of the payload: bytes, or records of one kind.
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
_NOT_UTF8: Final = "surrogateescape"  # bytes against HG-3.2/2 are read, and written as they came


def text_as_utf8(text: str) -> str:
    """Return the text of a field with U+FFFD for each byte that was no UTF-8."""
    return text.encode(errors=_NOT_UTF8).decode(errors="replace")


@dataclasses.dataclass(frozen=True, slots=True)
class WireField:
    """Form on the wire of one field of the fixed part.

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
        """True if the field is a plain number: no enumeration, no record, no text."""
        return self.enumeration is None and self.record is None and not self.code.endswith("s")

    def to_raw(self, name: str, value: Any) -> Any:
        """Return *value* in the form that :mod:`struct` packs."""
        if not isinstance(value, str):
            return value
        text = value.encode(errors=_NOT_UTF8)
        if len(text) > self.size or text.endswith(b"\x00"):
            raise LocalProtocolError(
                f"{name} is {value!r}: {len(text)} bytes of UTF-8; the field holds {self.size}, "
                "the last of them not zero"
            )
        return text

    def value(self, name: str, raw: Any, base: int) -> Any:
        """Return the value of what :mod:`struct` unpacked; the record begins at byte *base*."""
        if isinstance(raw, bytes):
            return raw.rstrip(b"\x00").decode(errors=_NOT_UTF8)
        if self.enumeration is None:
            return raw
        if (known := self.enumeration._value2member_map_.get(raw)) is not None:
            return known
        try:
            return self.enumeration(raw)
        except ValueError as error:
            raise RemoteProtocolError(
                f"{name} is {raw}: {error}", reason="bad_value", offset=base + self.offset
            ) from error


@dataclasses.dataclass(frozen=True, slots=True)
class WireTail:
    """Form on the wire of the bytes after the fixed part.

    Attributes
    ----------
    name : str
        Field of the dataclass.
    doc : str
        Meaning.
    unit : int
        The length of the tail is a multiple of *unit* bytes.
    least : int
        Least number of units.
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
    """Declare a field of a record by its :mod:`struct` code and its meaning."""
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
    """Base of all records and messages; :func:`record` decorates every subclass.

    Attributes
    ----------
    LAYOUT : struct.Struct
        Layout of the fixed part.
    WIRE : dict of str to WireField
        Fields of the fixed part, in their order on the wire.
    TAIL : WireTail or None
        Tail after the fixed part.
    ITEMS : int
        Number of values that :mod:`struct` packs for the fixed part.
    VALUES, ALL_VALUES : callable
        Return the values of the fixed fields of a record, and of all of them.
    CONVERTED : tuple
        Place, name and form of the fields that are not plain numbers; most records have none.
    """

    __slots__ = ()
    LAYOUT: ClassVar[struct.Struct]
    WIRE: ClassVar[dict[str, WireField]]
    TAIL: ClassVar[WireTail | None]
    ITEMS: ClassVar[int]
    VALUES: ClassVar[Callable[[Record], tuple[Any, ...]]]
    ALL_VALUES: ClassVar[Callable[[Record], tuple[Any, ...]]]
    CONVERTED: ClassVar[tuple[tuple[int, str, WireField], ...]]

    # As frozen dataclasses have them, which write the code of these methods anew for each class: in
    # all, half of the time in which this package is imported.

    def __repr__(self) -> str:
        """Return the record as the call that makes it."""
        names = [field.name for field in dataclasses.fields(cast(Any, self))]
        values = zip(names, type(self).ALL_VALUES(self), strict=True)
        told = ", ".join(f"{name}={value!r}" for name, value in values)
        return f"{type(self).__qualname__}({told})"

    def __eq__(self, other: object) -> bool:
        """Return True for a record of the same type and values."""
        if other.__class__ is not self.__class__:
            return NotImplemented
        return type(self).ALL_VALUES(self) == type(self).ALL_VALUES(other)

    def __hash__(self) -> int:
        """Return the hash of the values."""
        return hash(type(self).ALL_VALUES(self))

    def __setattr__(self, name: str, value: object) -> None:
        """Refuse to change a record."""
        raise dataclasses.FrozenInstanceError(f"cannot assign to field {name!r}")

    def __delattr__(self, name: str) -> None:
        """Refuse to change a record."""
        raise dataclasses.FrozenInstanceError(f"cannot delete field {name!r}")

    def __reduce__(self) -> tuple[type[Self], tuple[Any, ...]]:
        """Return the type and the values, by which a record is pickled and copied."""
        return type(self), type(self).ALL_VALUES(self)

    def pack(self) -> bytes:
        """Return the bytes of the record.

        Raises
        ------
        LocalProtocolError
            If a value does not fit its field.
        """
        if not self.ITEMS:
            return self._pack_tail() if self.TAIL else b""
        try:
            raw = self.to_raw() if self.CONVERTED else type(self).VALUES(self)
            fixed = self.LAYOUT.pack(*raw)
        except struct.error as error:
            raise LocalProtocolError(f"{self!r} does not fit its layout: {error}") from error
        return fixed + self._pack_tail() if self.TAIL else fixed

    def to_raw(self) -> list[Any]:
        """Return the values that :mod:`struct` packs, those of nested records in line."""
        raw = list(type(self).VALUES(self))
        for place, name, field in reversed(self.CONVERTED):  # backwards: a record takes more places
            if field.record is not None:
                raw[place : place + 1] = raw[place].to_raw()
            else:
                raw[place] = field.to_raw(name, raw[place])
        return raw

    def _pack_tail(self) -> bytes:
        """Return the bytes of the variable field; LocalProtocolError for a wrong length."""
        form = cast(WireTail, self.TAIL)
        value = getattr(self, form.name)
        data = bytes(value) if form.record is None else b"".join(item.pack() for item in value)
        if not _wire_tail_fits(form, len(data)):
            raise LocalProtocolError(
                f"{type(self).__name__}.{form.name} of {len(data)} bytes; {_wire_tail_rule(form)}"
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
        size, form = cls.LAYOUT.size, cls.TAIL
        rest = len(data) - size
        if rest < 0 or (not _wire_tail_fits(form, rest) if form else rest):
            rule = f", then {_wire_tail_rule(form)}" if form else ""
            raise RemoteProtocolError(
                f"{cls.__name__} of {len(data)} bytes; its layout has {size}{rule}",
                reason="bad_length",
            )
        values: tuple[Any, ...] = cls.LAYOUT.unpack_from(data) if size else ()
        if cls.CONVERTED:
            values = (*cls.from_raw(values, 0),)
        return cls(*values, *((_unpack_wire_tail(form, data, size),) if form else ()))

    @classmethod
    def from_raw(cls, raw: Sequence[Any], base: int) -> list[Any]:
        """Return the values of the fixed fields, in order.

        Parameters
        ----------
        raw : sequence
            Values that :mod:`struct` unpacked.
        base : int
            First byte of the record in its payload.
        """
        values = list(raw)
        for place, name, field in cls.CONVERTED:
            if (inner := field.record) is not None:
                taken = slice(place, place + inner.ITEMS)
                values[taken] = [inner(*inner.from_raw(values[taken], base + field.offset))]
            else:
                values[place] = field.value(name, values[place], base)
        return values


def _wire_tail_fits(form: WireTail, length: int) -> bool:
    """Return True if a tail of *length* bytes has whole units, and at least *form.least*."""
    return length % form.unit == 0 and length >= form.least * form.unit


def _wire_tail_rule(form: WireTail) -> str:
    """Return the rule for the length of a tail as text."""
    return f"{form.name} in units of {form.unit} bytes, at least {form.least}"


def _unpack_wire_tail(form: WireTail, data: bytes, start: int) -> Any:
    """Return the tail, from byte *start* on, as bytes or as a tuple of its records."""
    if form.record is None:
        return data[start:]
    size, record = form.unit, form.record
    items = (record.LAYOUT.unpack_from(data, i) for i in range(start, len(data), size))
    return tuple(
        record(*record.from_raw(item, start + number * size)) for number, item in enumerate(items)
    )


def _wire_fields(made: Any) -> tuple[dict[str, WireField], WireTail | None]:
    """Return the wire form of a dataclass: its fixed fields by name, and its tail (or None)."""
    fixed: dict[str, WireField] = {}
    offset = 0
    for field in dataclasses.fields(made):
        form = field.metadata[_WIRE]
        if isinstance(form, WireTail):
            return fixed, dataclasses.replace(form, name=field.name)
        fixed[field.name] = dataclasses.replace(form, offset=offset)
        offset += form.size
    return fixed, None


def _record_getter(names: tuple[str, ...]) -> Callable[[Record], tuple[Any, ...]]:
    """Return a function that returns all attributes *names* of a record as a tuple."""
    if len(names) > 1:
        return operator.attrgetter(*names)
    if not names:
        return lambda _: ()
    (name,) = names
    return lambda record: (getattr(record, name),)


def _set_record_init(made: Any) -> None:
    """Give a dataclass an ``__init__`` that sets each slot directly, which is quicker.

    *made* is the class; it must have slots.
    """
    fields = {field.name: field for field in dataclasses.fields(made)}
    slots: dict[str, Any] = {f"_set_{name}": getattr(made, name).__set__ for name in fields}
    body = "; ".join(f"_set_{name}(self, {name})" for name in fields) or "pass"
    exec(f"def __init__(self, {', '.join(fields)}): {body}", slots)
    init = slots["__init__"]
    usual = (field.default for field in fields.values())
    init.__defaults__ = tuple(one for one in usual if one is not dataclasses.MISSING)
    init.__annotations__ = {name: field.type for name, field in fields.items()} | {"return": None}
    init.__qualname__ = f"{made.__qualname__}.__init__"
    made.__init__ = init


_R = TypeVar("_R", bound=Record)


@dataclass_transform(frozen_default=True, field_specifiers=(wire, nested, tail, repeated))
def record(cls: type[_R]) -> type[_R]:
    """Make *cls* a frozen dataclass with ``LAYOUT``, ``WIRE`` and ``TAIL`` from its fields."""
    made: Any = dataclasses.dataclass(slots=True, init=False, repr=False, eq=False)(cls)
    _set_record_init(made)
    made.ALL_VALUES = _record_getter(tuple(field.name for field in dataclasses.fields(made)))
    made.WIRE, made.TAIL = _wire_fields(made)
    made.LAYOUT = struct.Struct("<" + "".join(field.code for field in made.WIRE.values()))
    made.VALUES = _record_getter(tuple(made.WIRE))
    made.ITEMS = sum(field.record.ITEMS if field.record else 1 for field in made.WIRE.values())
    made.CONVERTED = tuple(
        (place, name, field)
        for place, (name, field) in enumerate(made.WIRE.items())
        if not field.is_number
    )
    return cast(type[_R], made)
