"""Operations of an FPGA that takes a byte for a code or a command, and the bytes of a firmware."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

from ..codec import Operation


@dataclass(frozen=True, slots=True)
class Begin(Operation):
    """The boards that listen write channel 0 next."""


@dataclass(frozen=True, slots=True)
class BeginAmplitudes(Operation):
    """The boards that listen take amplitudes, channel 0 next."""


@dataclass(frozen=True, slots=True)
class SetPhases(Operation):
    """Codes for the buffer that does not radiate.

    Attributes
    ----------
    boards : tuple of int
        The boards that take the codes.
    first : int
        Channel of the first code.
    codes : bytes
        Delay of the rising edge in steps of a period, or the code that means off, for each channel.
    """

    boards: tuple[int, ...]
    first: int
    codes: bytes


@dataclass(frozen=True, slots=True)
class SetAmplitudes(Operation):
    """Widths of the pulses, in steps of a period, as :class:`SetPhases` has codes."""

    boards: tuple[int, ...]
    first: int
    codes: bytes


@dataclass(frozen=True, slots=True)
class Swap(Operation):
    """Every board swaps its two buffers, listening or not, and writes channel 0 next."""


@dataclass(frozen=True, slots=True)
class Select(Operation):
    """*board* listens from now on, and no other."""

    board: int


@dataclass(frozen=True, slots=True)
class Clocks(Operation):
    """The clocks of the shift registers run, or stand still."""

    on: bool


@dataclass(frozen=True, slots=True)
class ModulationStep(Operation):
    """Step of the amplitude modulation, 0 to 31."""

    step: int


@dataclass(frozen=True, slots=True)
class ToggleMultiplex(Operation):
    """Quick multiplexing is switched on or off."""


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
