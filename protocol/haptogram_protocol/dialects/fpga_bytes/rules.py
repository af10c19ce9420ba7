"""Meanings of the bytes of one firmware."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

from ..codec import Operation
from .operations import SetAmplitudes, SetPhases

FpgaCodes: TypeAlias = type[SetPhases] | type[SetAmplitudes]


@dataclass(frozen=True)
class FpgaByteRules:
    """Meanings of the bytes of one firmware.

    Attributes
    ----------
    wire : str
        Name of the wire in messages.
    channels : int
        Channels of a board; code number *channels* goes to channel 0 again.
    off : int
        Code of a channel that is off; smaller ones are delays.
    commands : mapping
        Operation of every byte that is no code.
    starts : bool
        Whether codes belong after :class:`Begin`; others are taken as well, and counted.
    wraps : bool
        Whether a code too many goes to channel 0 again; otherwise it is not taken.
    amplitude_limit : int
        Largest amplitude.
    taken : bytes
        For each data byte the code in the board's register: masked, *off* apart.
    pattern : re.Pattern
        One of :attr:`commands`.
    """

    wire: str
    channels: int
    off: int
    commands: Mapping[int, Operation]
    starts: bool = True
    wraps: bool = True
    amplitude_limit: int = 0
    taken: bytes = field(init=False)
    pattern: re.Pattern[bytes] = field(init=False)

    def __post_init__(self) -> None:
        mask, off = self.off - 1, self.off
        taken = bytes(off if byte == off else byte & mask for byte in range(256))
        object.__setattr__(self, "taken", taken)
        found = re.compile(b"[" + re.escape(bytes(sorted(self.commands))) + b"]")
        object.__setattr__(self, "pattern", found)

    def limit(self, kind: FpgaCodes) -> int:
        """Return the largest code that *kind* may hold."""
        return self.off if kind is SetPhases else self.amplitude_limit
