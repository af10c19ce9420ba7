"""Operations of an FPGA that takes a byte for a code or a command."""

from __future__ import annotations

from dataclasses import dataclass

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
