"""Enumerations whose members carry their meaning, for the tables of SPEC.md and the C headers."""

from __future__ import annotations

import enum
from typing import Self


class DocumentedEnum(enum.IntEnum):
    """Numbers on the wire; declare a member as ``NAME = value, "meaning"``."""

    doc: str

    def __new__(cls, value: int, doc: str = "") -> Self:
        """Keep *doc* beside the number."""
        member = int.__new__(cls, value)
        member._value_ = value
        member.doc = doc
        return member


class DocumentedFlag(enum.IntFlag):
    """Bits on the wire; declare a member as ``NAME = bit, "meaning"``."""

    doc: str

    def __new__(cls, value: int, doc: str = "") -> Self:
        """Keep *doc* beside the number."""
        member = int.__new__(cls, value)
        member._value_ = value
        member.doc = doc
        return member
