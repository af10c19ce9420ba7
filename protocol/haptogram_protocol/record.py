"""Fixed little-endian records, declared once.

One line per field gives the dataclass attribute, its width on the wire, the byte table of SPEC.md
and the C header: nothing about a layout is written twice.
"""

from __future__ import annotations

import dataclasses
import enum
import struct
from typing import Any, ClassVar, Final, Self, TypeVar, dataclass_transform

from .errors import LocalProtocolError, RemoteProtocolError

_WIRE: Final = "haptogram_wire"


@dataclasses.dataclass(frozen=True, slots=True)
class WireField:
    """How one field travels.

    Attributes
    ----------
    code : str
        :mod:`struct` code, e.g. ``"I"`` for u32 or ``"16s"`` for text; empty for a nested record.
    doc : str
        Meaning, with its unit.
    enumeration : type or None
        Values allowed, where only some are.
    record : type or None
        Nested record.
    """

    code: str
    doc: str
    enumeration: type[enum.IntEnum] | None = None
    record: type[Record] | None = None


def wire(
    code: str, doc: str, *, enum: type[enum.IntEnum] | None = None, default: Any = dataclasses.MISSING
) -> Any:
    """Declare a field of a record: its :mod:`struct` code and what it means."""
    return dataclasses.field(default=default, metadata={_WIRE: WireField(code, doc, enum)})


def nested(record: type[Record], doc: str) -> Any:
    """Declare a field that is itself a record."""
    layout = record.LAYOUT.format.removeprefix("<")
    return dataclasses.field(metadata={_WIRE: WireField(layout, doc, record=record)})


def wire_fields(record: type[Record]) -> dict[str, WireField]:
    """Return name and wire form of the fixed fields of *record*, in their order on the wire."""
    return {
        field.name: field.metadata[_WIRE]
        for field in dataclasses.fields(record)
        if _WIRE in field.metadata
    }


class Record:
    """Base of everything that has a fixed layout.  Use :func:`record` on every subclass."""

    __slots__ = ()
    LAYOUT: ClassVar[struct.Struct]
    WIRE: ClassVar[dict[str, WireField]]

    def pack(self) -> bytes:
        """Return the fixed part in bytes.

        Raises
        ------
        LocalProtocolError
            If a value does not fit its field.
        """
        values: list[Any] = []
        for name, field in self.WIRE.items():
            value = getattr(self, name)
            if field.record is not None:
                values += field.record.LAYOUT.unpack(value.pack())
            else:
                values.append(value.encode() if isinstance(value, str) else value)
        try:
            return self.LAYOUT.pack(*values)
        except struct.error as error:
            raise LocalProtocolError(f"{self!r} does not fit its layout: {error}") from error

    @classmethod
    def unpack(cls, data: bytes) -> Self:
        """Return the record whose fixed part is *data*.

        Raises
        ------
        RemoteProtocolError
            With the reason ``bad_length`` or ``bad_value``.
        """
        if len(data) != cls.LAYOUT.size:
            raise RemoteProtocolError(
                f"{cls.__name__} of {len(data)} bytes; its layout has {cls.LAYOUT.size}",
                reason="bad_length",
            )
        return cls(**cls._values(data))

    @classmethod
    def _values(cls, data: bytes) -> dict[str, Any]:
        """Return the fixed fields by name, taken from the front of *data*."""
        raw = iter(cls.LAYOUT.unpack_from(data))
        return {name: _value(name, field, raw) for name, field in cls.WIRE.items()}


def _value(name: str, field: WireField, raw: Any) -> Any:
    if field.record is not None:
        layout = field.record.LAYOUT
        count = len(layout.unpack(bytes(layout.size)))
        return field.record.unpack(layout.pack(*(next(raw) for _ in range(count))))
    value = next(raw)
    if isinstance(value, bytes):
        return value.rstrip(b"\x00").decode(errors="replace")
    if field.enumeration is None:
        return value
    try:
        return field.enumeration(value)
    except ValueError as error:
        raise RemoteProtocolError(f"{name} is {value}: {error}", reason="bad_value") from error


_R = TypeVar("_R", bound=Record)


@dataclass_transform(frozen_default=True, field_specifiers=(wire, nested))
def record(cls: type[_R]) -> type[_R]:
    """Make *cls* a frozen dataclass with ``LAYOUT`` and ``WIRE`` derived from its fields."""
    made = dataclasses.dataclass(frozen=True, slots=True)(cls)
    made.WIRE = wire_fields(made)
    made.LAYOUT = struct.Struct("<" + "".join(field.code for field in made.WIRE.values()))
    return made
